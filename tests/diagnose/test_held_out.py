"""Gain on trajectories that took no part: against brute-force refits, and its interval."""

import dataclasses
import functools

import numpy as np
import pytest

from mrwarp.diagnose.held_out import Account, HeldOut, Share, account_of, hold_out, not_predicted, reduction
from mrwarp.diagnose.problem import Problem, reported_fit
from mrwarp.diagnose.search import Selection
from tests.diagnose import known

pytestmark = pytest.mark.usefixtures("few_trees")
HIDDEN = {"rotor_inertia": {"inertia": 0.01}}


@pytest.fixture(scope="module")
def problem():
    """Six runs of a joint with an inertia."""
    return known.problem(HIDDEN, at=known.motion(8, runs=6, seconds=2.0))


def searched(problem, final: dict | None) -> Selection:
    """A search that ended with some model."""
    base = known.fitted(problem)
    best = base if final is None else known.fitted(problem, final)
    return Selection(base=base, final=best, screened=[], fits={base.effects: base, best.effects: best}, leftovers=[])


def held(problem: Problem, selection: Selection) -> HeldOut:
    """Every trajectory, predicted by what the others say."""
    baseline, extended = (reported_fit(problem, fit) for fit in (selection.base, selection.final))
    return hold_out(problem, selection, baseline, extended)


def test_each_trajectory_is_predicted_by_the_others(problem) -> None:
    """The prediction of a trajectory is that of a linear refit to the others, for baseline and extension.

    The refit leaves numbers at a bound where they are.
    """
    selection = searched(problem, HIDDEN)
    found = held(problem, selection)
    assert found.agreed == 1.0
    for fit, predicted, errors in (
        (selection.base, found.predicted_baseline, found.baseline),
        (selection.final, found.predicted_extended, found.extended),
    ):
        for k, part in enumerate(problem.motion.parts):
            others = np.ones(len(fit.torque), dtype=bool)
            others[part] = False
            slopes, rest = fit.slopes[fit.free], problem.motion.torque - fit.torque
            left = np.linalg.lstsq(slopes[:, others].T, rest[others], rcond=None)[0]
            want = fit.torque[part] + left @ slopes[:, part]
            np.testing.assert_allclose(predicted[part], want, atol=2e-4)
            assert errors[k] == pytest.approx(((want - problem.motion.torque[part]) ** 2).sum(), rel=1e-3)


def test_gain_is_that_on_new_data(problem) -> None:
    """The stated gain is within 20 % of the gain of both models on another session of the same joint."""
    selection = searched(problem, HIDDEN)
    value, (low, high) = reduction(held(problem, selection), seed=1)
    assert low <= value <= high and high - low < 0.5 and value > 0.3
    new = known.problem(HIDDEN, seed=99, at=known.motion(98, runs=6, seconds=2.0))
    errors = [
        np.sqrt(np.mean((new.motion.torque - new.replay.torque(f.parameters.row(f.x)[None])[0]) ** 2))
        for f in (selection.base, selection.final)
    ]
    assert value == pytest.approx(1.0 - errors[1] / errors[0], rel=0.2)


def test_gain_is_that_of_the_reported_model(problem) -> None:
    """A better model that the search fitted on its way, and did not name, does not lend its figures."""
    selection = searched(problem, None)
    better = known.fitted(problem, HIDDEN)
    assert better.total < selection.base.total
    found = held(problem, dataclasses.replace(selection, fits={**selection.fits, better.effects: better}))
    assert np.array_equal(found.baseline, found.extended)


def test_samples_without_weight_do_not_count(problem) -> None:
    """An error at the head of a trajectory, whose stress nobody knows, is no error of the model."""
    weight = np.ones(len(problem.measured))
    weight[:40] = 0.0
    measured = np.where(weight > 0.0, problem.measured, problem.measured + 5.0)
    selection = searched(problem, None)
    faulty = held(dataclasses.replace(problem, weight=weight, measured=measured), selection)
    assert faulty.baseline[0] < 1.2 * held(problem, selection).baseline[0]


def test_base_alone_gains_nothing(problem) -> None:
    """Where nothing was named both are the same."""
    found = held(problem, searched(problem, None))
    assert np.array_equal(found.baseline, found.extended) and reduction(found, seed=1) == (0.0, (0.0, 0.0))


def test_model_that_the_others_would_not_choose_is_not_used() -> None:
    """A trajectory is predicted without an effect that only it shows."""
    at = known.motion(8, runs=6, seconds=2.0)
    plus = np.zeros(len(at.q))
    plus[at.parts[2]] = 0.05 * at.qdd[at.parts[2]]
    problem = known.problem(at=at, plus=plus)
    selection = searched(problem, HIDDEN)
    found = held(problem, selection)
    assert found.agreed < 1.0
    part = problem.motion.parts[2]
    np.testing.assert_array_equal(found.predicted_extended[part], found.predicted_baseline[part])


def test_reduction_is_that_of_the_rmse() -> None:
    """1 - sqrt(sum/sum); its interval comes from whole trajectories and from the seed."""
    rng = np.random.default_rng(3)
    baseline = rng.uniform(1.0, 2.0, 20)
    none = np.zeros(0)
    half = HeldOut(
        baseline=baseline, extended=0.25 * baseline, predicted_baseline=none, predicted_extended=none, agreed=1.0
    )
    value, (low, high) = reduction(half, seed=5)
    assert value == pytest.approx(0.5) and (low, high) == pytest.approx((0.5, 0.5))
    mixed = HeldOut(
        baseline=baseline,
        extended=baseline * rng.uniform(0.2, 1.2, 20),
        predicted_baseline=none,
        predicted_extended=none,
        agreed=1.0,
    )
    value, (low, high) = reduction(mixed, seed=5)
    assert low < value < high and reduction(mixed, seed=5) == (value, (low, high))
    few = HeldOut(
        baseline=baseline[:5], extended=mixed.extended[:5], predicted_baseline=none, predicted_extended=none, agreed=1.0
    )
    assert np.diff(reduction(few, seed=5)[1]) > high - low


@functools.cache
def predicted(plus: str | None):
    """Problem, errors and what repeats, of a baseline that lacks nothing, or a torque along angle and velocity."""
    at = known.motion(8, runs=6, seconds=2.0)
    gains = np.repeat([0.08, -0.05, 0.02, -0.09, 0.06, -0.03], len(at.q) // 6)
    added = {
        None: np.zeros(len(at.q)),
        "law": 0.3 * np.sin(3.0 * at.q) * at.qd,
        "gains": gains * known.problem(at=at, sigma=0.0).motion.torque,
    }[plus]
    problem = known.problem(at=at, plus=added)
    selection = searched(problem, None)
    found = held(problem, selection)
    return problem, found, not_predicted(problem, found, reported_fit(problem, selection.final), seed=0)


def accounted(plus: str | None):
    """The account of it, and the noise's true share."""
    problem, found, left = predicted(plus)
    noise = known.SIGMA**2 * len(problem.motion.q)
    return account_of(problem, found, left, seed=0), noise / float(found.baseline.sum())


def test_account_calls_noise_what_does_not_repeat() -> None:
    """Pure noise is not repeatable, for any flexible predictor, and nothing is left open."""
    account, _ = accounted(None)
    assert account.not_repeatable.share > 0.95 and not account.open


def test_a_motion_that_comes_again_bounds_what_does_not_repeat(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where that differs by less than boosting leaves, it counts, with its own interval."""
    before, _ = accounted("law")
    half = 0.5 * before.left

    def spread(motion, mismatch, at):
        return np.ones(len(motion.dt)), np.full(len(motion.dt), (half * motion.torque[at].std()) ** 2)

    monkeypatch.setattr("mrwarp.diagnose.held_out.spread_where_it_repeats", spread)
    after, _ = accounted("law")
    share, repeats = after.not_repeatable, after.repeatable
    # a quarter, and the zeros and gains of runs in what boosting leaves
    assert 0.25 * before.not_repeatable.share < share.share < 0.5 * before.not_repeatable.share
    assert share.ci95[0] < share.share < share.ci95[1] < before.not_repeatable.ci95[1]
    assert after.named.share + repeats.share + share.share == pytest.approx(1.0) and after.learnable == before.learnable


def test_a_gain_that_differs_from_run_to_run_does_not_repeat(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the same motion comes again within a run it has the same gain, which is no structure all the same."""

    def spread(motion, mismatch, at):
        return np.ones(len(motion.dt)), np.full(len(motion.dt), known.SIGMA**2)

    monkeypatch.setattr("mrwarp.diagnose.held_out.spread_where_it_repeats", spread)
    account, noise = accounted("gains")
    assert noise < 0.3, "the gains are most of the mismatch"
    assert account.not_repeatable.share > 0.9 and not account.open


def test_account_divides_the_mismatch() -> None:
    """The three shares add up to 1; the repeating part is separated from the added noise."""
    account, truth = accounted("law")
    assert account.named.share + account.repeatable.share + account.not_repeatable.share == pytest.approx(1.0)
    assert account.open and account.named.share == 0.0
    assert 0.8 * truth < account.not_repeatable.share < 0.1
    for part in (account.named, account.repeatable, account.not_repeatable, account.learnable):
        assert part.ci95[0] <= part.share <= part.ci95[1]


@pytest.mark.parametrize(("share", "is_open"), [(0.2, True), (0.05, False)])
def test_what_repeats_is_open_from_a_tenth(share: float, is_open: bool) -> None:
    """The share itself decides, however wide its interval: an empty `unexplained` would claim that nothing does."""
    part = Share(share=share, ci95=(0.0, 0.9))
    account = Account(named=part, repeatable=part, not_repeatable=part, left=0.1, cycle_spread=None, learnable=part)
    assert account.open == is_open
