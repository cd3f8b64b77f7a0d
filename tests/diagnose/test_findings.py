"""Units: what the diagnosis writes for any device can be read again, and numbers scale as the device does."""

from dataclasses import astuple, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from mrwarp.diagnose.findings import _spring_or_weight, outer_model, suspects_of, unexplained_of
from mrwarp.diagnose.held_out import Predictor
from mrwarp.diagnose.problem import fit_model
from mrwarp.diagnose.proof import HIDDEN_MOTION, Rejection, impossible_size
from mrwarp.diagnose.residual_structure import LAG, leftovers
from mrwarp.diagnose.screening import Models
from mrwarp.diagnose.search import Selection
from mrwarp.effects.catalogue import CATALOGUE, parameter_of
from mrwarp.identify.dataset import Motion, Scales
from mrwarp.identify.parameters import factor_of
from mrwarp.model_file import effect_unit, load_model, save_model
from tests.diagnose import known

PARAMETERS = [(name, p.name) for name, law in CATALOGUE.items() for p in law.parameters]


def test_units_of_a_linear_damper() -> None:
    """Radians become metres and newton metres newtons; a rotor's inertia becomes a mass, and a joule stays one."""
    units = {"q": "m", "current": "V", "torque": "N"}
    found = {key: effect_unit(parameter_of(*key), units) for key in PARAMETERS}
    assert found["current_viscosity", "B1"] == "N·s/(m·V)" and found["backlash", "half_gap"] == "m"
    assert found["coulomb_friction", "torque"] == "N" and found["remanence", "half_width"] == "V"
    assert found["current_saturation", "u"] == "1/V" and found["cogging", "periods"] == "1/m"
    assert found["rotor_inertia", "inertia"] == "kg" and found["temperature_drift", "yield_loss"] == "1/J"
    assert not any("rad" in unit or "N·m" in unit or "A" in unit for unit in found.values())


@pytest.mark.parametrize(("effect", "name"), PARAMETERS)
def test_factor_agrees_with_the_unit(effect: str, name: str) -> None:
    """The powers of ``scale`` are those of rad, A and N·m in the unit as it is written; kg·m² and J hide them."""
    p = parameter_of(effect, name)
    unit = {"kg·m²": "N·m·s²/rad", "1/J": "1/(N·m·rad)", "N·m/rad²": "N·m/(rad·rad)"}.get(p.unit, p.unit)
    above, _, below = unit.partition("/")
    above, below = above.replace("N·m", "T").split("·"), below.strip("()").replace("N·m", "T").split("·")
    powers = tuple(above.count(word) - below.count(word) for word in ("rad", "A", "T"))
    assert powers == p.scale
    assert factor_of(p, Scales(q=2.0, current=3.0, torque=5.0)) == pytest.approx(
        2.0 ** powers[0] * 3.0 ** powers[1] * 5.0 ** powers[2]
    )


HIDDEN = {
    "coil_lag": {"time_constant": 0.012},
    "rotor_inertia": {"inertia": 0.003},
    "cogging": {"sine": 0.03, "cosine": 0.02, "periods": 20.0},
    "temperature_drift": {"yield_loss": 0.02, "viscosity_loss": 0.01, "time_constant": 60.0},
}


def fitted_recording(q: float, current: float, size: float):
    """Problem, fit and recording of one device, seen in other units."""
    exact = known.motion(4, runs=4, seconds=2.0)
    torque = known.problem(HIDDEN, seed=4, at=exact).motion.torque
    recording = known.recording(exact, torque, q=q, current=current, size=size)
    motion = Motion.of(recording)
    problem = known.posed(motion, sigma=0.03, q_zero=0.1, units=recording.units)
    c = problem.parameters(tuple(HIDDEN))
    scales = Motion.of(known.recording(exact, torque)).scales
    inner = {
        name: {key: value / factor_of(parameter_of(name, key), scales) for key, value in parameters.items()}
        for name, parameters in HIDDEN.items()
    }
    x = known.vector(c, inner, **{name: value / scales.factor(name) for name, value in known.TRUTH.items()})
    return problem, fit_model(problem, c, x, iterations=4), recording


UNITS = Scales(q=0.03125, current=8.0, torque=256.0)
"""Of a device in m, V and N, in those of the joint: powers of two, by which no sample is rounded."""

OF_FACTORS = 8.0 * float(np.finfo(float).eps)
"""Relative rounding of a number's factor: three powers of scales and their products."""


def test_model_scales_with_the_units(tmp_path: Path) -> None:
    """A device in m, V and N: every number and interval times its factor, and the file can be read."""
    (one, fit, here), (other, same, there) = fitted_recording(1.0, 1.0, 1.0), fitted_recording(*astuple(UNITS))
    assert other.motion.scales.torque == UNITS.torque * one.motion.scales.torque
    np.testing.assert_array_equal(same.x, fit.x)
    plain, scaled = outer_model(one, fit, here, 3), outer_model(other, same, there, 3)
    for name, p in plain.parameters.items():
        assert scaled.parameters[name].value == pytest.approx(p.value * UNITS.factor(name), rel=OF_FACTORS, abs=0.0)
    for effect, its in zip(plain.effects, scaled.effects, strict=True):
        for name, p in effect.parameters.items():
            factor, found = factor_of(parameter_of(effect.name, name), UNITS), its.parameters[name]
            assert found.value == pytest.approx(p.value * factor, rel=OF_FACTORS, abs=0.0)
            if p.ci95 is not None:
                assert found.ci95 == pytest.approx([x * factor for x in p.ci95], rel=OF_FACTORS, abs=0.0)
    assert load_model(save_model(plain, tmp_path / "plain.json")) == plain
    assert load_model(save_model(scaled, tmp_path / "scaled.json")) == scaled


def test_model_holds_what_was_hidden() -> None:
    """In the recording's units the fitted numbers are those that were put in, to four standard errors."""
    problem, fit, recording = fitted_recording(1.0, 1.0, 1.0)
    model = outer_model(problem, fit, recording, 3)
    assert model.parameters["q_offset"].value == 0.1 * problem.motion.scales.q
    for effect in model.effects:
        if effect.name == "temperature_drift":  # of which 8 s show little
            continue
        for name, p in effect.parameters.items():
            true = HIDDEN[effect.name][name]
            assert p.ci95 is not None and p.ci95[0] <= p.value <= p.ci95[1]
            assert p.value == pytest.approx(true, abs=p.ci95[1] - p.ci95[0])
    [lag] = fit.parameters.own("coil_lag")
    low, high = model.effects[0].parameters["time_constant"].ci95 or (0.0, 0.0)  # an interval of the logarithm
    assert low < np.exp(fit.x[lag]) < high and np.sqrt(low * high) == pytest.approx(np.exp(fit.x[lag]))


def test_predictor_speaks_the_recordings_units() -> None:
    """On the recording that was fitted it gives the fit's torque, in any units the same but for the factor."""
    found = []
    for units in (Scales(), UNITS):
        problem, fit, recording = fitted_recording(*astuple(units))
        predictor = Predictor(rows=np.stack([fit.row, fit.row]), motion=problem.motion, recording=recording)
        tau = predictor.torque(recording)
        np.testing.assert_array_equal(tau[1], fit.torque * problem.motion.scales.torque)
        np.testing.assert_array_equal(tau[0], tau[1])
        found.append(tau[0] / units.torque)
    np.testing.assert_array_equal(found[0], found[1])


@pytest.mark.parametrize("reason", ["its 95 % interval contains zero", HIDDEN_MOTION])
def test_the_hidden_motion_of_a_shaft_is_no_structure(reason: str) -> None:
    """A lag that may stand for a shaft's motion between samples, and structure that this lag would take up, are one."""
    problem = known.problem({"torque_sensor_lag": {"time_constant": 0.002}}, at=known.motion(5, runs=6, seconds=2.0))
    base = known.fitted(problem)
    left = tuple(f for f in leftovers(problem, base) if f.group.form == LAG)
    selection = Selection(base=base, final=base, screened=[], fits={}, leftovers=[], nameless=left)
    lag = Rejection(effect="torque_sensor_lag", reason=reason, gain=0.1, fit=base)
    assert unexplained_of(problem, selection, None) is not None
    assert (unexplained_of(problem, selection, None, (lag,)) is None) == (reason == HIDDEN_MOTION)


@pytest.mark.parametrize(
    ("effect", "numbers", "possible"),
    [
        ("wear", {"rate": -0.02}, False),
        ("wear", {"rate": 0.02}, True),
        ("rotor_inertia", {"inertia": -0.004}, False),
        ("torque_sensor_lag", {"time_constant": 0.05}, False),
        ("torque_sensor_lag", {"time_constant": 0.004}, True),
    ],
)
def test_a_suspect_says_whether_a_device_can_have_it(effect: str, numbers: dict[str, float], possible: bool) -> None:
    """By its sign and its size; a proof that lacks only certainty leaves it possible."""
    at = known.motion(5, runs=3, seconds=1.0)
    problem = known.problem({effect: numbers}, at=at)
    fit = known.fitted(problem, {effect: numbers})
    reason = impossible_size(effect, fit, problem.motion.ranges) or "its 95 % interval contains zero"
    rejection = Rejection(effect=effect, reason=reason, gain=0.1, fit=fit)
    recording = known.recording(at, problem.motion.torque)
    found = SimpleNamespace(problem=problem, rejected=(rejection,), recording=recording, seed=1)
    [suspect] = suspects_of(cast(Any, found))
    assert suspect.possible == possible and suspect.reason == reason


@pytest.mark.parametrize(("effects", "C", "open_"), [({"gravity": {"sine": 3.0}}, 0.0, True), ({}, 3.0, False)])
def test_a_spring_and_a_weight_are_one_stiffness_in_small_swings(effects: dict, C: float, open_: bool) -> None:
    """A pendulum's stiffness may be a spring's; a true spring's is clear of zero next to gravity."""
    problem = known.problem({"rotor_inertia": {"inertia": 0.02}, **effects}, seed=60, sigma=0.005, C=C)
    fit = known.fitted(problem, {"rotor_inertia": {"inertia": 0.02}})
    base = known.fitted(problem)
    selection = Selection(base=base, final=fit, screened=[], fits={}, leftovers=[])
    said = _spring_or_weight(Models(problem, base), selection)
    assert bool(said) == open_ and all("a spring or a weight" in text for text in said)
    assert not _spring_or_weight(Models(problem, base), replace(selection, final=base))
