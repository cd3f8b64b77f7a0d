"""The experiment that separates rivals: which, how long, and nothing where nothing is open."""

import functools
from dataclasses import replace

import numpy as np
import pytest

from mrwarp.diagnose import next_experiment
from mrwarp.diagnose.next_experiment import propose, repeated
from mrwarp.diagnose.search import Selection
from tests.diagnose import known

CURRENT = ("current steps", "current steps, slow swing", "current staircase")


def ambiguous(named: str, rival: str, numbers: dict[str, dict[str, float]], sigma: float = 0.05, turns: float = 0.0):
    """A problem and a search that could not distinguish two effects."""
    at = known.motion(60, runs=6, seconds=3.0)
    if turns:
        at = replace(at, ranges=replace(at.ranges, q=2.0 * np.pi * turns, turns=turns))
    problem = known.problem({named: numbers[named]}, seed=60, at=at, sigma=sigma)
    base = known.fitted(problem)
    fits = {name: known.fitted(problem, {name: numbers[name]}) for name in (named, rival)}
    return problem, Selection(
        base=base,
        final=fits[named],
        screened=[],
        leftovers=[],
        alternatives={named: (rival,)},
        fits={base.effects: base, **{(name,): fit for name, fit in fits.items()}},
    )


LAGS = {"coil_lag": {"time_constant": 0.004}, "command_delay": {"delay": 0.004}}
FRICTION = {"coulomb_friction": {"torque": 0.05}, "stribeck": {"torque": 0.05, "stribeck_speed": 2.0}}
DRIFTS = {
    "wear": {"rate": 0.004},
    "temperature_drift": {"yield_loss": 0.01, "viscosity_loss": 0.0, "time_constant": 100.0},
}


@functools.cache
def lags():
    """A lag of the current and a delay of its command."""
    return ambiguous("coil_lag", "command_delay", LAGS)


@functools.cache
def frictions():
    """Two frictions."""
    return ambiguous("coulomb_friction", "stribeck", FRICTION)


def test_nothing_open_needs_no_experiment() -> None:
    """Without rivals nothing is proposed."""
    problem, selection = lags()
    for alternatives in ({"coil_lag": ()}, {}):
        assert propose(problem, replace(selection, alternatives=alternatives), 1) is None


def test_lag_and_delay_are_told_by_single_steps() -> None:
    """Current is stepped while the joint moves slowly; the settings are within what the device did."""
    problem, selection = lags()
    found = propose(problem, selection, 1)
    assert found is not None and found.kind == "current steps, slow swing"
    assert found.separates == ("coil_lag", "command_delay") and 20.0 < found.seconds < 60.0
    assert "step the current" in found.what and "1.5 A" in found.what and "0.25 Hz" in found.what
    assert found.settings["separation_sigma"] > 0.0
    assert found.settings["amplitude"] == pytest.approx(0.35 * problem.motion.ranges.q)
    assert found.settings["current_max"] == 1.5 and found.settings["rate"] == pytest.approx(200.0)
    assert propose(problem, selection, 1) == found


def test_other_effects_of_the_current_are_told_by_its_course() -> None:
    """Remanence against a lag: the current changes while the joint moves."""
    found = propose(*ambiguous("coil_lag", "remanence", {**LAGS, "remanence": {"half_width": 0.05}}), 1)
    assert found is not None and found.kind in CURRENT


def test_seconds_grow_with_the_square_of_the_noise() -> None:
    """Three times the noise needs nine times as long, in as many more runs."""
    problem, selection = frictions()
    quiet, loud = (propose(replace(problem, noise=known.white(s)), selection, 1) for s in (0.1, 0.3))
    assert quiet is not None and loud is not None and 12.0 < quiet.seconds < loud.seconds < 36000.0
    assert loud.seconds / quiet.seconds == pytest.approx(9.0, rel=0.2)
    for found in (quiet, loud):
        runs, length = found.settings["runs"], found.settings["run_seconds"]
        assert (runs - 1.0) * length < found.seconds <= runs * length


def test_friction_is_told_by_a_motion_within_that_of_the_data() -> None:
    """Not by the current; no faster and no more violent than what was recorded."""
    problem, selection = frictions()
    found = propose(problem, selection, 1)
    assert found is not None and found.kind not in CURRENT
    omega, size = 2.0 * np.pi * found.settings["frequency_high"], found.settings["amplitude"]
    assert omega * size <= 1.001 * np.abs(problem.motion.qd).max()
    assert omega**2 * size <= 1.001 * np.abs(problem.motion.qdd).max()
    assert 2.0 * size <= problem.motion.ranges.q


def test_a_joint_that_turns_on_and_on_swings_within_a_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Not by a part of all its turns; a sweep that its speed leaves no room for is described as a steady swing."""
    sweep = next_experiment.STANDARD["wide swings"]._replace(low=0.5)
    monkeypatch.setattr(next_experiment, "STANDARD", {"wide swings": sweep})
    found = propose(*ambiguous("coulomb_friction", "stribeck", FRICTION, turns=20.0), 1)
    assert found is not None and found.settings["amplitude"] == pytest.approx(0.9 * np.pi)
    low = found.settings["frequency_low"]
    assert low == found.settings["frequency_high"] < 0.5
    assert found.what.endswith(f"the joint swings by ±2.83 rad at {low:.2g} Hz")


def test_wear_and_warmth_are_told_by_a_rest() -> None:
    """Weakening over the session: rest five time constants at least, and repeat the first runs."""
    found = propose(*ambiguous("wear", "temperature_drift", DRIFTS), 1)
    assert found is not None and found.kind == "rest and repeat"
    assert "rest for" in found.what and "repeat the first" in found.what
    assert found.settings["rest_seconds"] == 600.0 and found.settings["runs"] >= 3.0
    assert found.seconds == found.settings["rest_seconds"] + found.settings["runs"] * found.settings["run_seconds"]


def test_runs_repeated_after_a_rest_begin_cold_and_worn() -> None:
    """The clock and the way go on; the heat is what the runs had when they were first made."""
    like = known.motion(60, runs=6, seconds=3.0)
    rest = 3600.0
    again = repeated(like, rest, 2)
    assert len(again.parts) == 2 and len(again.time) == 1200
    assert again.time[0] == pytest.approx(like.time[-1] + rest)
    assert again.slid_time[0] == pytest.approx(like.slid_time[-1])
    np.testing.assert_allclose(np.diff(again.slid_time), np.diff(like.slid_time[:1200]))
    np.testing.assert_allclose(again.heat[:4], like.heat[:4, :1200], atol=1e-6)
    assert again.heat[-1, 0] > like.heat[-1, 0]


def test_what_no_experiment_can_tell_apart_is_not_proposed() -> None:
    """A rival that imitates everything separates by nothing, however long; nor is there one without its fit."""
    problem, selection = frictions()
    for fits in ({**selection.fits, ("stribeck",): selection.final}, {}):
        assert propose(problem, replace(selection, fits=fits), 1) is None


def test_rivals_with_another_law_are_found() -> None:
    """The rival's fit is the one with the same law."""
    law = {"kwok": {"slope": 1.0, "width": 0.2}}
    problem = known.problem(
        {"coulomb_friction": FRICTION["coulomb_friction"]},
        seed=60,
        at=known.motion(60, runs=6, seconds=3.0),
        sigma=0.05,
    )
    fits = {f.effects: f for f in (known.fitted(problem, {**law, name: FRICTION[name]}) for name in FRICTION)}
    final = next(fit for fit in fits.values() if "coulomb_friction" in fit.effects)
    selection = Selection(
        base=known.fitted(problem, law),
        final=final,
        screened=[],
        leftovers=[],
        alternatives={"coulomb_friction": ("stribeck",)},
        fits=fits,
    )
    found = propose(problem, selection, 1)
    assert found is not None and found.separates == ("coulomb_friction", "stribeck")
