"""The search for causes: thresholds, singles, pairs, rivals, proxies of other structure."""

from dataclasses import replace

import numpy as np
import pytest

from mrwarp.diagnose import screening
from mrwarp.diagnose.baseline import fit_baseline
from mrwarp.diagnose.pipeline import _candidates
from mrwarp.diagnose.problem import covariance, reported_fit, threshold
from mrwarp.diagnose.screening import Models
from mrwarp.diagnose.search import JointSearch, Selection, first_guess, screen_candidates, select
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.parameters import LINEAR
from mrwarp.recording.data import NO_INPUT
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.settings import Gain, Settings
from tests.diagnose import known

CANDIDATES = [name for name, law in CATALOGUE.items() if law.kind != "calibration" and name != "velocity_lag"]


def searched(problem, candidates: list[str] | None = None) -> Selection:
    """The outcome on a problem."""
    base = known.fitted(problem)
    return select(problem, base, screen_candidates(problem, base, candidates or CANDIDATES))


def made(hidden: dict | None = None, seed: int = 50, **more):
    """A problem of six runs of 3 s."""
    return known.problem(hidden, seed=seed, at=known.motion(seed, runs=6, seconds=3.0), **more)


def test_threshold_is_chi_squared_or_a_share_of_the_samples() -> None:
    """30 for few samples; 0.3 % of them where they are many, for the replay itself errs by as much."""
    problem = made()
    small = known.fitted(problem)
    assert threshold(problem, small) == 30.0
    small.equations.count = 100_000.0
    assert threshold(problem, small) == pytest.approx(300.0)
    stricter = replace(problem, settings=Settings(gain=Gain(floor=0.01)))
    assert threshold(stricter, small) == pytest.approx(1000.0)


def test_a_look_at_a_candidate_is_taken_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a look taken again would be; again only where other starts are left as they are."""
    problem = made({"coil_lag": {"time_constant": 0.02}})
    models, asked = Models(problem, known.fitted(problem)), list[list[str]]()
    taken = screening.screen
    monkeypatch.setattr(
        screening, "screen", lambda p, f, effects, **how: asked.append(list(effects)) or taken(p, f, effects, **how)
    )
    first = models.screened(models.base, ["coil_lag", "wear"])
    both = models.screened(models.base, ["coil_lag", "cogging", "wear"])
    assert asked[:2] == [["coil_lag", "wear"], ["cogging"]] and {id(c) for c in first} < {id(c) for c in both}
    for c, new in zip(both, taken(problem, models.base, ["coil_lag", "cogging", "wear"]), strict=True):
        assert c.effect == new.effect and c.total == pytest.approx(new.total, rel=1e-9)
    models.screened(models.base, ["coil_lag", "wear"], hopeless=1e9)
    assert asked[2:] == [["coil_lag", "wear"]]


def test_a_body_s_mechanics_are_found_together() -> None:
    """Inertia and a weight come with their sizes from one regression; a negative inertia and clean data give none."""
    names = [name for name, law in CATALOGUE.items() if law.mechanics]
    problem = made({"rotor_inertia": {"inertia": 0.01}, "gravity": {"sine": 1.5, "cosine": 0.8}})
    found = {c.effect: c.values for c in screening.lacking_together(problem, known.fitted(problem), names)}
    assert {"rotor_inertia", "gravity"} <= found.keys()
    np.testing.assert_allclose(found["rotor_inertia"], 0.01, rtol=0.05)
    np.testing.assert_allclose(found["gravity"][1], 0.8, rtol=0.1)  # over a short way the sine is known as C only
    for hidden in ({"rotor_inertia": {"inertia": -0.01}}, None):
        problem = made(hidden)
        found = screening.lacking_together(problem, known.fitted(problem), names)
        assert len(found) < 2 and not (hidden and [c for c in found if c.effect == "rotor_inertia"])


def test_nothing_is_named_in_clean_data() -> None:
    """The final model is the baseline; it gains nothing, and no structure is left above the threshold."""
    for seed in (50, 51):
        selection = searched(made(seed=seed))
        assert selection.final is selection.base and selection.gain == 0.0 and not selection.alternatives
        assert max(f.gain for f in selection.leftovers) < threshold(made(), selection.base)
        assert first_guess(made(seed=seed), selection.base, selection.screened) is None


@pytest.mark.parametrize(
    ("effect", "numbers"),
    [
        ("coil_lag", {"time_constant": 0.008}),
        ("cogging", {"sine": 0.02, "cosine": 0.0, "periods": 25.0}),
        ("coulomb_friction", {"torque": 0.05}),
    ],
)
def test_hidden_effect_is_named(effect: str, numbers: dict[str, float]) -> None:
    """Alone, with its numbers, and what it adds is what the final model gains."""
    problem = made({effect: numbers})
    selection = searched(problem)
    assert selection.final.effects == (effect,)
    found = selection.final.parameters.values(selection.final.x)[effect]
    for name, value in numbers.items():
        assert found[name] == pytest.approx(value, rel=0.15, abs=2e-3)
    assert selection.own_gain[effect] == pytest.approx(selection.gain) and selection.gain > threshold(
        made(), selection.base
    )
    assert max(f.gain for f in selection.leftovers) < threshold(problem, selection.base)
    single = first_guess(problem, selection.base, selection.screened)
    assert single is not None and effect in single.effects


def test_resolution_widens_the_stated_interval() -> None:
    """A half gap is known to 2.5 % at best, one standard error."""
    problem = made({"backlash": {"half_gap": 0.002}})
    selection = searched(problem, ["backlash"])
    assert selection.final.effects == ("backlash",)
    stated = reported_fit(problem, selection.final)
    [gap] = stated.parameters.own("backlash")
    assert covariance(stated)[gap, gap] >= max(covariance(selection.final)[gap, gap], 0.025**2)


def test_pair_is_found_whole() -> None:
    """Two effects that are not each other's rivals are both named, in the order of the path."""
    selection = searched(
        made({"coil_lag": {"time_constant": 0.008}, "cogging": {"sine": 0.03, "cosine": 0.0, "periods": 25}})
    )
    assert selection.final.effects == ("coil_lag", "cogging")
    assert min(selection.own_gain.values()) > threshold(made(), selection.base)


def test_a_small_effect_next_to_a_large_one_is_measured_by_what_is_left_above_the_noise() -> None:
    """A cogging of 8 mN·m on a body without a device: noise is nobody's wrong form. A device's law may hide in it."""
    hidden = {"rotor_inertia": {"inertia": 0.03}, "cogging": {"sine": 0.008, "cosine": 0.0, "periods": 14.0}}
    device = made(hidden)
    body = replace(device, units={**device.units, "current": NO_INPUT})
    may_be = ["rotor_inertia", "cogging", "coulomb_friction", "stribeck", "position_friction", "wear"]
    selection = searched(body, may_be)
    assert selection.named == ["rotor_inertia", "cogging"]
    assert selection.own_gain["cogging"] < selection.final.total * Settings().search.added
    assert searched(device, may_be).named == ["rotor_inertia"]


def test_structure_outside_the_catalogue_is_not_named() -> None:
    """A viscosity that changes along the angle is left over, and says on what it depends."""
    at = known.motion(52, runs=6, seconds=3.0)
    s = at
    selection = searched(known.problem(seed=52, at=at, plus=0.15 * s.q**2 * s.qd))
    assert selection.final is selection.base
    assert set(selection.leftovers[0].group.variables[:2]) & {"q", "qd"}
    assert selection.leftovers[0].gain > threshold(made(), selection.base)


def test_only_candidates_are_named() -> None:
    """An effect that is not offered is not found; what remains of it is left over."""
    selection = searched(made({"rotor_inertia": {"inertia": 0.01}}), ["wear", "coil_lag"])
    assert "rotor_inertia" not in selection.final.effects
    assert selection.leftovers[0].gain > threshold(made(), selection.base)


def test_a_caller_says_which_effects_may_be_named() -> None:
    """Of the catalogue, and never one that the data cannot show."""
    problem = made()
    base = known.fitted(problem)
    assert _candidates(problem, base, ("wear", "coil_lag", "torque_gain")) == ["coil_lag", "wear"]
    assert {"coil_lag", "wear", "backlash"} < set(_candidates(problem, base, None))


def test_search_is_the_same_twice() -> None:
    """No draw is left to chance: bit-equal numbers."""
    one, two = (searched(made({"coil_lag": {"time_constant": 0.008}}), ["coil_lag", "command_delay"]) for _ in range(2))
    assert np.array_equal(one.final.x, two.final.x) and one.own_gain == two.own_gain


def test_stated_numbers_are_those_of_plain_least_squares() -> None:
    """Same effects; they miss fewer newton metres than the numbers that decided, with intervals at least as wide."""
    problem = made({"friction_asymmetry": {"coulomb": 0.0, "viscous": 0.02, "speed": 0.02}})
    selection = searched(problem, ["friction_asymmetry"])
    stated = reported_fit(problem, selection.final)
    assert stated.effects == selection.final.effects == ("friction_asymmetry",)
    torque = problem.motion.torque
    assert np.sum((torque - stated.torque) ** 2) <= np.sum((torque - selection.final.torque) ** 2) * (1.0 + 1e-6)
    assert (np.diag(covariance(stated)) >= np.diag(covariance(selection.final)) * (1.0 - 1e-9)).all()
    found = stated.parameters.values(stated.x)["friction_asymmetry"]
    assert found["viscous"] == pytest.approx(0.02, rel=0.15) and "thinning" not in found


def test_law_bends_where_that_foretells_better() -> None:
    """Viscous friction that thins: the same effect is named, and its stated numbers hold the thinning."""
    truth = {"friction_asymmetry": {"coulomb": 0.0, "viscous": 0.04, "speed": 0.02, "thinning": 0.4}}
    problem = made(truth)
    selection = searched(problem, ["friction_asymmetry"])
    stated = reported_fit(problem, selection.final)
    found = stated.parameters.values(stated.x)["friction_asymmetry"]
    assert selection.final.effects == ("friction_asymmetry",)
    assert "thinning" not in selection.final.parameters.values(selection.final.x)["friction_asymmetry"]
    assert found["viscous"] == pytest.approx(0.04, rel=0.1) and found["thinning"] == pytest.approx(0.4, rel=0.5)
    assert covariance(stated).shape == (len(stated.x),) * 2


def test_effect_at_the_edge_of_its_range_must_show_in_most_trajectories() -> None:
    """In clean data a cogging with the fewest periods is dropped; inside its range that rule does not touch it."""
    problem = made()
    selection = searched(problem, ["cogging"])
    models = Models(problem, selection.base)
    fit = models.grown(selection.base, selection.screened[0])
    assert fit.effects == ("cogging",)
    inside, edge = fit.x.copy(), fit.x.copy()
    inside[-1] = 0.5 * (fit.parameters.low[-1] + fit.parameters.high[-1])
    edge[-1] = fit.parameters.low[-1]
    plant = JointSearch(models, selection.screened, [])
    assert plant.within_range(replace(fit, x=inside)) == [np.inf]
    assert plant.within_range(replace(fit, x=edge)) == [0.0]


def test_there_are_as_many_causes_as_are_hidden() -> None:
    """Four effects that are not each other's rivals are all found: nothing ends the search at three."""
    hidden = {
        "coil_lag": {"time_constant": 0.01},
        "rotor_inertia": {"inertia": 0.006},
        "coulomb_friction": {"torque": 0.08},
        "cogging": {"sine": 0.06, "cosine": 0.0, "periods": 25.0},
    }
    selection = searched(made(hidden), [*hidden, "wear"])
    assert set(selection.final.effects) == set(hidden)


def test_friction_that_grows_with_a_load_is_told_by_name() -> None:
    """Where the control input is a pressure, K1 stays at 0 and ``load_friction`` is found in its place."""
    at = known.motion(60, runs=6, seconds=3.0)
    at = replace(at, ranges=replace(at.ranges, load=True))
    on = known.problem({"load_friction": {"F1": 0.1}}, at=at, K1=0.0)
    on = replace(on, units={**on.units, "current": "bar"})
    selection = searched(on, ["coulomb_friction", "load_friction", "wear"])
    assert selection.base.x[LINEAR.index("K1")] == 0.0 and "current_viscosity" in on.impossible
    assert tuple(selection.named) == ("load_friction",)
    final = selection.final
    assert final.parameters.values(final.x)["load_friction"]["F1"] == pytest.approx(0.1, rel=0.05)
    assert np.isfinite(covariance(final)).all()


def to_and_fro(speed: float, friction: float, rng: np.random.Generator) -> Trajectory:
    """A run at one speed to and fro, with a friction that is constant in it; its clock begins at 0 s."""
    t = np.arange(600) * 0.01
    way = np.where(np.arange(len(t)) // 200 % 2 == 0, speed, -speed)
    qd = np.convolve(np.pad(way, 5, mode="edge"), np.full(11, 1 / 11), "valid")
    torque = friction * np.tanh(qd / 0.01) + 0.004 * rng.normal(size=len(t))
    q = np.cumsum(qd) * 0.01 + 1e-5 * rng.normal(size=len(t))
    qd = qd + 1e-3 * rng.normal(size=len(t))
    return Trajectory(id=f"at {speed}, {rng.integers(1000)}", t=t, q=q, qd=qd, current=0.0 * t, torque=torque)


def test_the_order_of_files_is_no_time() -> None:
    """Gain of wear where friction falls from file to file with the speed, and each file begins at 0 s.

    In any order of the files it is the same, and little of what it would be by a clock that runs on.
    """
    rng = np.random.default_rng(3)
    devices = ((0.08, 0.31), (0.15, 0.24), (0.3, 0.21))
    runs = [to_and_fro(speed, friction, rng) for speed, friction in devices for _ in range(3)]
    mixed = [runs[k] for k in (4, 0, 8, 2, 6, 1, 5, 3, 7)]
    clocked = [replace(run, t=run.t + 6.0 * k) for k, run in enumerate(runs)]
    gains = []
    for some in (runs, mixed, clocked):
        recording = Recording(trajectories=tuple(some))
        problem, base = fit_baseline(
            recording, model=None, threads=1, seed=0, log=lambda text: None, settings=known.QUICK
        )
        [wear] = screen_candidates(problem, base, ["wear"])
        gains.append((base.total - wear.total) / base.total)
    assert gains[1] == pytest.approx(gains[0], abs=0.01)
    assert gains[0] < 0.05 and gains[2] > 0.15
