"""The evidence against densities written out in full, and a plant of straight lines whose truth is known."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from mrwarp.sysid.by_evidence import searched_by_evidence
from mrwarp.sysid.evidence import Discrepancy, Signals, correlation, learned, posterior, showing
from mrwarp.sysid.settings import Gain, Odds

RUNS, SAMPLES = 12, 150


def signals(derivatives: np.ndarray, functions: np.ndarray, mismatch: np.ndarray, forms=()) -> Signals:
    """Of arrays of shape (P, T, N), (K, T, N) and (T, N); each function is a group."""
    rows = np.concatenate([derivatives, functions, mismatch[None]]).swapaxes(0, 1)
    return Signals(
        grams=rows @ rows.swapaxes(1, 2),
        counts=np.full(len(mismatch), float(mismatch.shape[1])),
        live=list(range(len(derivatives))),
        group=np.arange(len(functions)),
        forms=np.array(forms),
        room=np.full(len(derivatives), np.inf),
    )


def test_the_evidence_is_the_density_of_all_unknowns_together() -> None:
    """One number with a unit-information prior, one function with parts of its own in each run, by dense matrices."""
    rng = np.random.default_rng(1)
    line, function = rng.normal(size=(1, 3, 8)), rng.normal(size=(1, 3, 8))
    mismatch = rng.normal(size=(3, 8)) + 1.5 * function[0]
    d = Discrepancy(common=np.array([1.0]), own=np.array([0.3]), scale=np.array([1.0, 1.5, 0.8]))
    s = signals(line, function, mismatch)
    total = d.reduced(s).sum(axis=0)
    covariance = np.zeros((24, 24))
    for run in range(3):
        part = slice(8 * run, 8 * run + 8)
        own = function[0, run]
        covariance[part, part] = d.scale[run] * np.eye(8) + d.own[0] * np.outer(own, own)
    j, f, r = line.ravel(), function.ravel(), mismatch.ravel()
    information = float(j @ np.linalg.solve(covariance, j))

    def density(variance: float) -> float:
        prior = 24.0 / information * np.outer(j, j)
        return float(multivariate_normal.logpdf(r, np.zeros(24), covariance + prior + variance * np.outer(f, f)))

    expected = max(density(v) for v in np.geomspace(1e-3, 30.0, 400)) - density(0.0)
    found = posterior(s, total, [0], d.common).log - posterior(s, total, [], d.common).log
    # a unit-information prior is normal only to 1/N
    assert found == pytest.approx(expected, abs=0.06)


@pytest.mark.parametrize("size", [0.3, 0.0, -0.3])
def test_a_number_that_may_not_be_negative_has_half_a_prior(size: float) -> None:
    """By the integral over the sizes that are possible; the number is 0.1 before its change."""
    rng = np.random.default_rng(8)
    line, noise = rng.normal(size=(1, 3, 30)), rng.normal(size=(3, 30))
    mismatch = (size - 0.1) * line[0] + noise
    s = signals(line, np.zeros((0, 3, 30)), mismatch)
    total = s.grams.sum(axis=0)
    width = np.sqrt(float(s.counts.sum()) / total[0, 0])
    grid = np.linspace(-20.0 * width, 20.0 * width, 400_001)
    prior = -0.5 * np.log(2.0 * np.pi) - np.log(width) - 0.5 * (grid / width) ** 2
    density = np.exp(prior - 0.5 * (total[1, 1] - 2.0 * grid * total[0, 1] + grid**2 * total[0, 0]))
    possible = np.log(2.0 * density[grid > -0.1].sum() / density.sum())
    bounded = posterior(replace(s, room=np.array([0.1])), total, [], np.zeros(0))
    assert bounded.log - posterior(s, total, [], np.zeros(0)).log == pytest.approx(possible, rel=0.02, abs=0.06)


def test_variances_are_learned() -> None:
    """Of a common function, of what another has of its own in each run, and of each run's noise."""
    rng = np.random.default_rng(2)
    functions = rng.normal(size=(3, 40, 200))
    own = 0.5 * rng.normal(size=(40, 1))
    noise = np.where(np.arange(40) % 2, 1.0, 2.0)[:, None]
    mismatch = 0.7 * functions[0] + own * functions[1] + noise * rng.normal(size=(40, 200))
    d = learned(signals(rng.normal(size=(1, 40, 200)), functions, mismatch), 1e-6)
    assert d.common[0] == pytest.approx(0.49, rel=0.2) and d.own[1] == pytest.approx(0.25, rel=0.5)
    assert d.own[[0, 2]].max() < 0.01
    assert np.sqrt(d.scale) == pytest.approx(noise[:, 0], rel=0.2)


def test_samples_of_a_slow_noise_count_as_few() -> None:
    """First-order noise has (1 + a)/(1 - a) times the power of white noise at low frequencies."""
    rng = np.random.default_rng(3)
    units = []
    for white in rng.normal(size=(20, 2000)):
        x = np.empty_like(white)
        x[0] = white[0]
        for k in range(1, len(x)):
            x[k] = 0.8 * x[k - 1] + white[k]
        units.append(x)
    assert correlation(units) == pytest.approx(9.0, rel=0.15)
    assert correlation(list(rng.normal(size=(20, 2000)))) == pytest.approx(1.0, abs=0.15)


@dataclass(frozen=True)
class Line:
    """A model with straight causes."""

    causes: tuple[str, ...]


class Lines:
    """Torque that is a sum of rows, with nameless rows next to them."""

    least = 1.0
    base = Line(())

    def __init__(self, rows: dict[str, np.ndarray], functions: np.ndarray, measured: np.ndarray) -> None:
        self.rows, self.functions, self.measured = rows, functions, measured

    def causes(self, model: Line) -> Sequence[str]:
        """Of a model."""
        return model.causes

    def without(self, model: Line, cause: str) -> Line:
        """One less."""
        return Line(tuple(x for x in model.causes if x != cause))

    def grown(self, model: Line) -> Iterable[tuple[str, Line]]:
        """One more."""
        return [(x, Line(tuple(sorted((*model.causes, x))))) for x in self.rows if x not in model.causes]

    def swapped(self, model: Line, cause: str) -> Iterable[tuple[str, Line]]:
        """Any other in its place."""
        rest = tuple(x for x in model.causes if x != cause)
        return [(x, Line(tuple(sorted((*rest, x))))) for x in self.rows if x not in model.causes]

    def contains(self, cause: str, other: str) -> bool:
        """A name that is longer."""
        return cause != other and cause.startswith(other)

    def ordinary(self, cause: str) -> bool:
        """Of those that have an o in their name."""
        return "o" in cause

    def distinct(self, cause: str, other: str) -> bool:
        """Any two."""
        return True

    def signals(self, model: Line) -> Signals:
        """An offset and the causes' rows."""
        derivatives = np.stack([np.ones_like(self.measured), *(self.rows[x] for x in model.causes)])
        return signals(derivatives, self.functions, self.measured)

    def rest(self, model: Line, change: np.ndarray, sizes: np.ndarray) -> Sequence[np.ndarray]:
        """The rest of each run."""
        derivatives = [np.ones_like(self.measured), *(self.rows[x] for x in model.causes)]
        left = self.measured - sum(c * row for c, row in zip(change, derivatives, strict=True))
        return list(left - np.einsum("tk,ktn->tn", sizes, self.functions))


def lines(seed: int, sizes: dict[str, float], nameless: float = 0.0, own: float = 0.0) -> Lines:
    """Runs with causes a and b of these sizes, a nameless row, and what it has of its own in each run."""
    rng = np.random.default_rng(seed)
    rows = {name: rng.normal(size=(RUNS, SAMPLES)) for name in ("a", "b", "c")}
    rows["c"] = 0.9 * rows["a"] + 0.1 * rows["c"]
    functions = rng.normal(size=(2, RUNS, SAMPLES))
    functions[1] = 0.3 * rows["b"] + functions[0]
    measured = sum(size * rows[name] for name, size in sizes.items()) + rng.normal(size=(RUNS, SAMPLES))
    return Lines(rows, functions, measured + (nameless + own * rng.normal(size=(RUNS, 1))) * functions[0])


def test_causes_are_named_and_nothing_else() -> None:
    """Two causes; noise alone; each over several draws."""
    for seed in range(6):
        assert set(searched_by_evidence(lines(seed, {"a": 0.5, "b": 0.5}), Odds(), Gain()).odds) == {"a", "b"}
        found = searched_by_evidence(lines(seed, {}), Odds(), Gain())
        assert not found.odds and not found.nameless


def test_a_small_cause_shows_next_to_a_large_slow_one() -> None:
    """How far noise is correlated is seen once the large cause is in: without it, its own slow torque would count."""
    slow = np.sin(np.linspace(0.0, 6.0, SAMPLES) + np.linspace(0.0, 3.0, RUNS)[:, None])
    for seed in range(4):
        plant = lines(seed, {"a": 0.25})
        plant.rows = {"a": plant.rows["a"], "slow": slow}
        plant.measured = plant.measured + 5.0 * slow
        assert set(searched_by_evidence(plant, Odds(), Gain()).odds) == {"a", "slow"}


def test_a_cause_that_does_as_well_is_a_rival() -> None:
    """c is a but for a tenth: a small effect may be either, a large one is a."""
    found = searched_by_evidence(lines(3, {"a": 0.12}), Odds(), Gain())
    assert {name for cause in found.odds for name in (cause, *found.rivals[cause])} == {"a", "c"}
    assert searched_by_evidence(lines(3, {"a": 2.0}), Odds(), Gain()).rivals == {"a": ()}
    # what was proven before has rivals, too: also one that is likelier
    proven = searched_by_evidence(lines(3, {"a": 0.12}), Odds(), Gain(), begin=Line(("c",)))
    assert proven.rivals == {"c": ("a",)}


def test_what_a_cause_contains_comes_before_it() -> None:
    """One number more that chance makes likelier is not taken; what the data need is."""
    for seed in range(8):
        plant = lines(seed, {"a": 0.3})
        plant.rows = {"a": plant.rows["a"], "a and less": plant.rows["a"] + 0.05 * plant.rows["b"]}
        assert set(searched_by_evidence(plant, Odds(), Gain()).odds) == {"a"}
    plant = lines(0, {"a": 0.5, "b": 0.5})
    plant.rows = {"a": plant.rows["a"], "a and b": plant.rows["a"] + plant.rows["b"]}
    assert "a and b" in searched_by_evidence(plant, Odds(), Gain()).odds


def test_what_has_no_name_is_no_cause() -> None:
    """A nameless function that looks a little like a cause: that cause is not named, and the function is reported."""
    for own in (0.0, 0.5):
        found = searched_by_evidence(lines(4, {}, nameless=1.0, own=own), Odds(), Gain())
        assert not found.odds and 0 in found.nameless


def test_a_cause_that_structure_without_a_name_explains_as_well_is_a_suspect() -> None:
    """So is b, of which the nameless rows hold a part; a, smaller than they are, is named next to them."""
    for seed in range(4):
        likeness = searched_by_evidence(lines(seed, {}, nameless=1.0), Odds(), Gain(), begin=Line(("b",)))
        there = searched_by_evidence(lines(seed, {"a": 0.3}, nameless=1.0), Odds(), Gain(), begin=Line(("a",)))
        assert not likeness.odds and "b" in likeness.suspects and 0 in likeness.nameless
        assert set(there.odds) == {"a"} and not there.suspects


@pytest.mark.parametrize(("size", "nameless", "enters"), [(0.2, 1.0, False), (1.3, 1.0, True), (0.2, 0.0, True)])
def test_what_only_the_evidence_lets_in_completes_the_model(size: float, nameless: float, enters: bool) -> None:
    """A cause next to a nameless one stays where it was proven before or takes as much; else it is a suspect."""
    for seed in range(4):
        plant = lines(seed, {"a": 1.0, "b": size}, nameless=nameless)
        del plant.rows["c"]
        plant.functions = plant.functions[:1]
        proven = searched_by_evidence(plant, Odds(), Gain(), begin=Line(("a", "b")))
        unproven = searched_by_evidence(plant, Odds(), Gain(), begin=Line(("a",)))
        assert set(proven.odds) == {"a", "b"} and not proven.suspects and not proven.entered
        assert set(unproven.odds) == ({"a", "b"} if enters else {"a"})
        assert set(unproven.suspects) == unproven.entered == (set() if enters else {"b"})


def test_an_ordinary_cause_needs_no_odds_against_it() -> None:
    """One that plants of its kind have as a rule needs to be likelier than not; another needs more than that."""
    stays = dict[str, int]()
    for name in ("b", "ordinary"):
        found = []
        for seed in range(8):
            plant = lines(seed, {"a": 1.0, "b": 0.13})
            plant.rows = {"a": plant.rows["a"], name: plant.rows["b"]}
            found.append(searched_by_evidence(plant, Odds(), Gain(), begin=Line(("a",))))
            assert name not in found[-1].odds or found[-1].odds[name] > (0.0 if name == "ordinary" else Odds().enters)
        stays[name] = sum(name in x.odds for x in found)
    assert stays["b"] < stays["ordinary"]


def test_a_size_that_would_show_is_found() -> None:
    """A cause of that size, put into recordings of noise, is named in most; one of half the size in few."""
    quiet = lines(7, {})
    found = searched_by_evidence(quiet, Odds(), Gain())
    bare = signals(np.ones((1, RUNS, SAMPLES)), quiet.functions, quiet.rows["b"])
    [unit] = showing(bare, found.discrepancy, found.nameless)
    size = float((np.sqrt(2.0 * Odds().enters + np.log(RUNS * SAMPLES)) + 1.645) / np.sqrt(unit))
    seeds = range(10, 22)
    named = [
        sum("b" in searched_by_evidence(lines(seed, {"b": factor * size}), Odds(), Gain()).odds for seed in seeds)
        for factor in (1.0, 0.5)
    ]
    assert named[0] >= 11 and named[1] <= 4


def test_the_interval_of_a_cause_grows_next_to_what_differs_from_run_to_run() -> None:
    """A cause along a function that has a size of its own in each run is known as well as the mean of twelve."""
    plant = lines(6, {}, own=0.6)
    plant.rows = {"b": plant.functions[0] + 0.3 * plant.rows["b"]}
    plant.measured = plant.measured + 3.0 * plant.rows["b"]
    found = searched_by_evidence(plant, Odds(), Gain())
    assert set(found.odds) == {"b"}
    assert np.sqrt(found.variance[-1]) > 2.0 / np.sqrt(RUNS * SAMPLES)
