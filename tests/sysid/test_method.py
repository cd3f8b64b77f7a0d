"""The method on a plant whose truth is known in closed form: a spring with friction."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy import stats

from mrwarp.sysid.certainty import BY_CHANCE, agreement, by_ratio, clearness, gain_and_t, two_sizes
from mrwarp.sysid.jackknife import effective_count, jackknife, student, sum_and_error
from mrwarp.sysid.least_squares import minimise, ridge_solve
from mrwarp.sysid.left_out import in_a_row, left_out, one_step, predicted
from mrwarp.sysid.pieces import Pieces, Quadratic, about_origin
from mrwarp.sysid.plant import Listed
from mrwarp.sysid.stepwise import eliminated, searched
from mrwarp.sysid.verdict import VERDICTS, Verdict
from tests.sysid.spring import LAWS, NOISE, ZEROS, Spring, SpringPlant


def diagnosed(spring: Spring) -> tuple[Verdict, dict[str, tuple[float, float]]]:
    """The whole method: the search of the plant, then intervals by the jackknife."""
    causes = searched(SpringPlant(spring))
    pieces = spring.pieces(causes)
    sizes, half = ridge_solve(*pieces.sums()), np.zeros(0)
    if causes:
        half = student(0.95, spring.runs - 1) * np.sqrt(np.diag(jackknife(left_out(pieces))))
    found = {name: (float(x), float(h)) for name, x, h in zip(causes, sizes, half, strict=True)}
    clear = {name: x for name, x in found.items() if clearness(*x, (0.0, 0.0)) > 1.0}
    return VERDICTS[bool(clear), False], clear


@pytest.mark.parametrize(
    "truth", [{}, {"coulomb": 0.05}, {"softer": -0.1, "viscous": 0.06}, {"coulomb": -0.04, "viscous": 0.05}]
)
def test_hidden_causes_are_named_with_their_sizes(truth: dict[str, float]) -> None:
    """No more and no fewer, regardless of the zeros of the runs."""
    verdict, found = diagnosed(Spring(truth))
    assert verdict == ("named" if truth else "none")
    assert found.keys() == truth.keys()
    for name, (size, half) in found.items():
        assert abs(size - truth[name]) < half < 0.03


def test_a_zero_of_each_run_is_removed_as_its_covariance_says() -> None:
    """The quadratic form is that of generalised least squares with the zero's variance in the covariance."""
    spring = Spring({"coulomb": 0.1}, runs=3)
    pieces = spring.pieces(["softer", "coulomb"])
    for k, rows in enumerate(spring.rows):
        x = rows[[0, 1, 3]]
        covariance = np.eye(x.shape[1]) + (ZEROS / NOISE) ** 2
        want = x @ np.linalg.solve(covariance, x.T)
        np.testing.assert_allclose(pieces.information[k], want[:2, :2], rtol=1e-8, atol=1e-6)
        np.testing.assert_allclose(pieces.score[k], want[:2, 2], rtol=1e-8, atol=1e-6)
        assert pieces.square[k] == pytest.approx(want[2, 2], rel=1e-8)


def test_what_is_left_of_pieces_adds_up_and_does_not_depend_on_the_point() -> None:
    """Forms about the numbers' origin and about another point leave the same; their sum is that of the whole."""
    pieces, x = Spring({"coulomb": 0.1}).pieces(list(LAWS)), np.array([0.3, -0.2, 0.1])
    np.testing.assert_allclose(about_origin(pieces, x).left(x + 0.1), pieces.left(np.full(3, 0.1)), rtol=1e-9)
    whole = Quadratic(float(pieces.square.sum()), *pieces.sums())
    assert whole.after(x) == pytest.approx(pieces.left(x).sum())
    each = np.stack([x * k for k in range(12)])
    np.testing.assert_allclose(pieces.left(each)[5], pieces.some([5]).left(5.0 * x)[0])


def test_left_out_pieces_are_predicted_by_fits_without_them() -> None:
    """One at a time and in parts of neighbours."""
    pieces = Spring({"coulomb": 0.05}, runs=7).pieces(["softer", "coulomb"])
    for folds in (None, in_a_row(7, 3)):
        change, loss = predicted(pieces, folds)
        for fold in folds or [np.array([k]) for k in range(7)]:
            rest = pieces.some(np.setdiff1d(np.arange(7), fold))
            want = np.linalg.solve(*rest.sums())
            np.testing.assert_allclose(change[fold], np.tile(want, (len(fold), 1)), rtol=1e-5)
            np.testing.assert_allclose(loss[fold], pieces.some(fold).left(want), rtol=1e-6)


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("value", [np.inf, np.nan])
def test_a_replay_that_is_not_finite_has_an_infinite_error(value: float) -> None:
    """It is no candidate: its error compares with any other, and a search that begins there stays."""
    grams = np.stack([np.diag([4.0, 2.0, 1.0])] * 5)
    grams[1, 2] = grams[1, :, 2] = value
    change, loss = predicted(Pieces.of_grams(grams))
    np.testing.assert_array_equal(loss, [1.0, np.inf, 1.0, 1.0, 1.0])
    assert not change.any() and loss.sum() > 1e30
    bounds = -np.ones(2), np.ones(2)
    found = minimise(lambda x: Quadratic.of(grams[1]), np.zeros(2), *bounds)
    assert found.quadratic.loss == np.inf and not found.x.any()


def test_leaving_out_by_one_step_is_the_same_to_first_order() -> None:
    """Over runs that say equally much, an interval by one step is that by fits without each run."""
    pieces, folds = Spring({"coulomb": 0.05}, runs=12).pieces(["coulomb"]), in_a_row(12, 6)
    information, score = pieces.sums()
    steps = one_step(pieces, folds, score / information[0], 1.0 / information)
    assert jackknife(steps)[0, 0] == pytest.approx(jackknife(left_out(pieces, folds))[0, 0], rel=1e-2)


def test_the_jackknife_of_a_mean_is_its_squared_standard_error() -> None:
    """In closed form: leaving one of N numbers out moves their mean by (mean - it)/(N - 1)."""
    x = np.random.default_rng(0).normal(size=9)
    changes = ((x.sum() - x) / 8.0)[:, None]
    assert jackknife(changes)[0, 0] == pytest.approx(x.var(ddof=1) / 9.0)
    assert sum_and_error(x) == pytest.approx((x.sum(), x.std(ddof=1) * 3.0))
    assert sum_and_error(x[:1])[1] == np.inf
    assert student(0.95, 8.0) == pytest.approx(stats.t.ppf(0.975, 8))


def test_intervals_hold_the_truth_nineteen_times_of_twenty() -> None:
    """Over 200 springs, with pieces as units though samples of a run share its zero."""
    covered = 0
    for seed in range(200):
        pieces = Spring({"coulomb": 0.05}, seed=seed, runs=6).pieces(["coulomb"])
        half = student(0.95, 5.0) * np.sqrt(jackknife(left_out(pieces))[0, 0])
        covered += abs(float(ridge_solve(*pieces.sums())[0]) - 0.05) < half
    assert 182 <= covered <= 199  # 190 give or take three standard deviations


def test_pieces_count_by_what_they_say() -> None:
    """Four equal ones are four; one that says nothing is none."""
    assert effective_count(np.array([2.0, 2.0, 2.0, 2.0, 0.0])) == pytest.approx(4.0)
    assert effective_count(np.array([1.0, 1e-9])) == pytest.approx(1.0)


def test_the_least_certain_goes_first_and_the_others_are_judged_without_it() -> None:
    """Two that share one merit: only the weaker goes, for without it the other has all of it; or both together."""
    merit = {"a": 3.0, "b": 0.5, "c": 0.4}

    def certainty(kept: list[str]) -> list[float]:
        shared = {"b": 0.8} if {"b", "c"} & set(kept) != {"b", "c"} else {}
        return [(merit | shared | ({"b": 1.2} if "c" not in kept else {}))[name] for name in kept]

    assert eliminated(Listed(), list("abc"), certainty) == (["a", "b"], ["c"])
    assert eliminated(Listed(), list("abc"), certainty, together=lambda weakest: weakest) == (["a"], ["c", "b"])
    assert eliminated(Listed(), ["a"], lambda kept: [float("nan")]) == (
        [],
        ["a"],
    )  # what cannot be judged is not certain


def test_a_plant_decides_what_is_possible() -> None:
    """A softer spring, which the search would name, stays out where the plant allows stiffer ones only."""
    spring = Spring({"softer": -0.1, "coulomb": 0.05})
    assert set(searched(SpringPlant(spring))) == {"softer", "coulomb"}
    assert searched(SpringPlant(spring, positive=("softer",))) == ["coulomb"]


def test_the_order_of_the_steps_is_that_of_the_method() -> None:
    """Growing until the plant sees nothing that is worth its place, settling, then each test until all causes pass."""
    asked: list[str] = []

    class Plant(Listed[int]):
        base: list[int] = []
        tests = (lambda model: [1.0 if n != 2 else 0.0 for n in model], lambda model: [float(n != 9) for n in model])

        def candidates(self, model: list[int]) -> list[int]:
            asked.append(f"beyond {model}")
            return [len(model) + 1, 7]

        def grown(self, model: list[int], candidates: Sequence[int]) -> list[int] | None:
            return [*model, candidates[0]] if candidates[0] < 4 else None

        def settled(self, model: list[int]) -> list[int]:
            asked.append(f"settled {model}")
            return [*model, 9]

    assert searched(Plant()) == [1, 3]
    assert asked == ["beyond []", "beyond [1]", "beyond [1, 2]", "beyond [1, 2, 3]", "settled [1, 2, 3]"]


def test_gains_of_pieces_are_compared_with_their_scatter() -> None:
    """Equal gains are certain, gains of one piece alone are not, by their sum, ratios and ranks."""
    before = np.full(12, 4.0)
    even, one = np.linspace(1.0, 1.2, 12), np.where(np.arange(12) == 0, 0.1, 4.0 + 0.001 * np.arange(12))
    assert gain_and_t(before, even)[1] > 10.0 > 1.1 > gain_and_t(before, one)[1]
    assert by_ratio(before, even) > 10.0 > 1.1 > by_ratio(before, one)
    assert agreement(before - even) >= 1.0 > agreement(before - one)


@pytest.mark.parametrize("backwards", [0.2, 0.0])
def test_a_true_cause_has_one_size_in_both_halves(backwards: float) -> None:
    """Friction of both directions is the same; what acts in one direction only differs by more than its error."""
    grams = []
    for rows in Spring({"coulomb": backwards}, seed=3).rows:
        forwards = rows[1] > 0.0
        target = rows[3] + (0.2 - backwards) / NOISE * forwards
        table = np.stack([rows[0], rows[1] * forwards, rows[1] * ~forwards, target])
        grams.append(table @ table.T)
    sizes, error = two_sizes(np.stack(grams))
    assert (abs(sizes[0] - sizes[1]) > 3.0 * error) == (backwards == 0.0)


def test_a_number_is_clear_where_its_interval_leaves_out_what_is_no_fault() -> None:
    """In half widths from the nearest end of the usual range."""
    assert clearness(0.5, 0.1, (0.0, 0.2)) == pytest.approx(3.0)
    assert clearness(0.1, 0.1, (0.0, 0.2)) == 0.0


def test_pieces_agree_by_the_exact_distribution_of_signed_ranks() -> None:
    """The score needed of 30 to 50 pieces is reached just where SciPy's exact test gives the allowed chance."""
    rng, sides = np.random.default_rng(0), set()
    for _ in range(300):
        gain = rng.normal(rng.uniform(0.5, 2.0), 1.0, rng.integers(30, 50))
        chance = np.asarray(stats.wilcoxon(gain, alternative="greater", method="exact"))[1]
        rare = bool(chance <= BY_CHANCE)
        assert (agreement(gain) >= 1.0 - 1e-12) == rare
        sides.add(rare)
    assert sides == {True, False}
    assert agreement(np.ones(8)) > 1.0 > agreement(np.array([*np.ones(7), -2.0]))
