"""Shifts of calibration: whether the re-fitted eq. 14 lies off its nominal values along one clear direction.

Re-fitting takes up a bias, a gain or an offset without a trace, so only nominal parameters can show them. Nominal
values vary from device to device; what they may is 2 % each, and 3 mN·m of D for a joint of the paper's size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mrwarp.diagnose.problem import Fit, Problem, base_vector, covariance, normalised
from mrwarp.diagnose.result import Shift
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.parameters import BASE_PART, LINEAR, LINEAR_PART, SHAPE, SHAPE_PART, factor_of
from mrwarp.model_file import JOINT_UNITS, Model, effect_unit
from mrwarp.params import MrParams
from mrwarp.recording.load import Recording
from mrwarp.sysid.settings import Settings

SPREAD = 0.02
"""Spread of a parameter from device to device, one standard deviation [1]."""
BIAS_SPREAD = 0.0008
"""Spread of D, as a share of the torque's range: 3 mN·m of the paper's 2 N·m."""
OTHER_DEVICE = 0.2
"""Spread of each parameter where the nominal values are those of another device, one standard deviation [1]."""


def calibration_shifts(problem: Problem, fit: Fit, recording: Recording, model: Model | None) -> tuple[Shift, ...]:
    """Shifts of a final model against the nominal parameters: those of ``model``, else the paper's for its joint."""
    if model is not None:
        nominal = model.values
    elif recording.units == JOINT_UNITS:
        paper = MrParams().bouc_wen
        nominal = {name: getattr(paper, name) for name in (*LINEAR, *SHAPE)}
    else:
        return ()
    motion = problem.motion
    shift = find_shift(fit, normalised(nominal, motion.scales), float(np.ptp(motion.torque)), problem.settings)
    if shift is None:
        return ()
    p = CATALOGUE[shift.name].parameters[0]
    value, low, high = (x * factor_of(p, motion.scales) for x in (shift.value, *shift.ci95))
    return (replace(shift, value=value, ci95=(low, high), unit=effect_unit(p, recording.units)),)


def find_shift(fit: Fit, nominal: Mapping[str, float], torque_range: float, settings: Settings) -> Shift | None:
    """The shift of calibration that the re-fitted parameters show against nominal ones, normalised units, or None.

    No shift of calibration touches alpha, beta and gamma: where these lie off too, it is another device. ``nominal``
    holds D, B, C, I1, K0, K1, alpha, beta and gamma; it and ``torque_range`` are in normalised units.
    """
    speed, limits = fit.parameters.ranges.qd, settings.calibration
    centre = base_vector(nominal, speed)
    steps = [base_vector({**nominal, name: nominal[name] * (1.0 + SPREAD)}, speed) - centre for name in SHAPE]
    delta = fit.x[BASE_PART] - centre
    prior = np.maximum(SPREAD * np.abs(centre[LINEAR_PART]), 1e-9)
    biases = [LINEAR.index("D"), LINEAR.index("I1")]  # I1 is a bias that grows with the current
    prior[biases] = np.maximum(prior[biases], BIAS_SPREAD * torque_range)
    device = np.zeros((len(delta), len(delta)))
    device[LINEAR_PART, LINEAR_PART] = np.diag(prior**2)
    device[SHAPE_PART, SHAPE_PART] = sum(np.outer(step, step) for step in np.array(steps)[:, SHAPE_PART])
    measured = covariance(fit)[BASE_PART, BASE_PART]
    weight = np.linalg.inv(measured + device)
    whole = float(delta @ weight @ delta)
    rank = []
    for name, law in CATALOGUE.items():
        parts = {p: nominal[p] if law.parameters[0].null else 1.0 for p in law.taken_up_by}
        d = np.array([parts.get(p, 0.0) for p in LINEAR] + [0.0] * len(SHAPE))
        information = float(d @ weight @ d)
        if information > 0.0:
            size = float(d @ weight @ delta) / information
            rank.append((whole - size**2 * information, name, size, information**-0.5))
    rank.sort()
    if not rank or whole - rank[0][0] < settings.gain.clear_t**2 or rank[0][0] > limits.left:
        return None
    left, name, size, error = rank[0]
    shifted = _log_likelihood(delta, measured + device) + 0.5 * (whole - left)
    if shifted < _log_likelihood(delta, measured + (OTHER_DEVICE / SPREAD) ** 2 * device) + limits.odds:
        return None
    near = (*CATALOGUE[name].looks_like, *(r[1] for r in rank[1:] if r[0] - left < limits.distinct))
    value = CATALOGUE[name].parameters[0].null + size
    ci95 = (value - 1.96 * error, value + 1.96 * error)
    return Shift(name=name, value=value, ci95=ci95, alternatives=near, unit="1")


def _log_likelihood(delta: np.ndarray, spread: np.ndarray) -> float:
    return -0.5 * float(delta @ np.linalg.solve(spread, delta) + np.linalg.slogdet(spread)[1])
