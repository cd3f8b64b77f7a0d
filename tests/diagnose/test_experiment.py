"""The experiment that separates rivals: which, how long, and nothing where nothing is open."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from mrwarp.diagnose.choose import Choice
from mrwarp.diagnose.experiment import propose

_SPEC = importlib.util.spec_from_file_location("known", Path(__file__).with_name("known.py"))
assert _SPEC is not None and _SPEC.loader is not None
known = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(known)

CURRENT = ("current steps", "current chirp", "current staircase")


def ambiguous(named: str, rival: str, numbers: dict[str, dict[str, float]], sigma: float = 0.05):
    """An engine and a search that could not tell two effects apart."""
    engine = known.engine({named: numbers[named]}, seed=60, at=known.motion(60, runs=6, seconds=3.0), sigma=sigma)
    base = known.fitted(engine)
    fits = {name: known.fitted(engine, {name: numbers[name]}) for name in (named, rival)}
    return engine, Choice(
        base=base, final=fits[named], first_look=[], alternatives={named: (rival,)},
        fits={base.effects: base, **{(name,): fit for name, fit in fits.items()}},
    )  # fmt: skip


LAGS = {"coil_lag": {"time_constant": 0.004}, "command_delay": {"delay": 0.004}}
FRICTION = {"coulomb_friction": {"torque": 0.05}, "stribeck": {"torque": 0.05, "stribeck_speed": 2.0}}
DRIFTS = {
    "wear": {"rate": 0.004},
    "temperature_drift": {"yield_loss": 0.01, "viscosity_loss": 0.0, "time_constant": 100.0},
}


def test_nothing_open_needs_no_experiment() -> None:
    """Without rivals nothing is proposed."""
    engine, choice = ambiguous("coil_lag", "command_delay", LAGS)
    choice.alternatives = {"coil_lag": ()}
    assert propose(engine, choice, 1) is None
    choice.alternatives = {}
    assert propose(engine, choice, 1) is None


def test_lag_and_delay_are_told_by_the_current() -> None:
    """Current is stepped or swept while the joint moves; the settings are within what the device did."""
    engine, choice = ambiguous("coil_lag", "command_delay", LAGS)
    found = propose(engine, choice, 1)
    assert found is not None and found.kind in CURRENT
    assert found.separates == ("coil_lag", "command_delay") and found.what
    assert found.settings["separation_sigma"] > 0.0
    assert found.settings["range"] == pytest.approx(engine.motion.ranges.q)
    assert found.settings["current_max"] == 1.5 and found.settings["rate"] == pytest.approx(200.0)
    assert propose(engine, choice, 1) == found


def test_seconds_grow_with_the_square_of_the_noise() -> None:
    """Three times the noise needs nine times as long."""
    engine, choice = ambiguous("coil_lag", "command_delay", LAGS)
    engine.noise = known.white(0.2)
    quiet = propose(engine, choice, 1)
    engine.noise = known.white(0.6)
    loud = propose(engine, choice, 1)
    assert quiet is not None and loud is not None and 2.0 < quiet.seconds < loud.seconds < 36000.0
    assert loud.seconds / quiet.seconds == pytest.approx(9.0, rel=0.05)


def test_friction_is_told_by_the_motion() -> None:
    """Effects of the velocity are separated by a motion, not by the current."""
    found = propose(*ambiguous("coulomb_friction", "stribeck", FRICTION), 1)
    assert found is not None and found.kind not in CURRENT


def test_wear_and_warmth_are_told_by_a_rest() -> None:
    """Weakening over the session: rest, and repeat the first run."""
    found = propose(*ambiguous("wear", "temperature_drift", DRIFTS), 1)
    assert found is not None and found.kind == "rest and repeat" and "repeat the first" in found.what


def test_experiment_of_an_effect_that_rivals_itself_is_endless() -> None:
    """A rival that imitates everything separates by nothing: the time runs to its limit."""
    engine, choice = ambiguous("coil_lag", "command_delay", LAGS)
    choice.fits["command_delay",] = choice.final
    found = propose(engine, choice, 1)
    assert found is not None and found.seconds == 36000.0
    assert np.isfinite(found.settings["separation_sigma"])
