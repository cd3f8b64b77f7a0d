"""Shifts of calibration: whether the re-fitted eq. 14 lies off its nominal values along one telling direction.

Re-fitting takes up a bias, a gain or an offset without a trace, so only nominal parameters can show them. Nominal
values vary from device to device; what they may is 2 % each, and 3 mN·m of D for a joint of the paper's size.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrwarp.diagnose.engine import Fitted
from mrwarp.diagnose.uncertainty import covariance
from mrwarp.identify.parameters import BASE_PART, LINEAR, LINEAR_PART, SHAPE, SHAPE_PART, shape_coordinates

SPREAD = 0.02
"""What a parameter may differ from device to device, one standard deviation [1]."""
BIAS_SPREAD = 0.0008
"""The same for D, as a share of the torque's range: 3 mN·m of the paper's 2 N·m."""
OTHER_DEVICE = 0.2
"""What each parameter may differ where the nominal values are those of another device, one standard deviation [1]."""
_MARGIN = 11.0
"""Logarithm of the odds that a single shift must have against another device; of real shifts it is 17 to 20."""
_DROP = 16.0
_APART = 6.0
_LEFT = 22.0


@dataclass(frozen=True, kw_only=True)
class Found:
    """A shift, in inner units."""

    name: str
    value: float
    error: float
    alternatives: tuple[str, ...]


def find_shifts(fit: Fitted, nominal: Mapping[str, float], torque_range: float) -> list[Found]:
    """Shifts of calibration that the re-fitted parameters show against nominal ones.

    No shift of calibration touches alpha, beta and gamma: where these lie off too, it is another device.

    Args:
        fit: The final model.
        nominal: D, B, C, I1, K0, K1, alpha, beta, gamma in inner units.
        torque_range: Range of the torque, inner units.
    """
    base = np.array([nominal[name] for name in LINEAR])
    shape = np.array([nominal[name] for name in SHAPE])
    centre = shape_coordinates(*shape, fit.coordinates.ranges.qd)
    steps = [
        shape_coordinates(*np.where(np.arange(3) == i, shape * (1.0 + SPREAD), shape), fit.coordinates.ranges.qd)
        - centre for i in range(3)
    ]  # fmt: skip
    delta = fit.x[BASE_PART] - np.concatenate([base, centre])
    prior = np.maximum(SPREAD * np.abs(base), 1e-9)
    bias = [LINEAR.index("D"), LINEAR.index("I1")]  # I1 is a bias that grows with the current
    prior[bias] = np.maximum(prior[bias], BIAS_SPREAD * torque_range)
    device = np.zeros((len(delta), len(delta)))
    device[LINEAR_PART, LINEAR_PART] = np.diag(prior**2)
    device[SHAPE_PART, SHAPE_PART] = sum(np.outer(step, step) for step in steps)
    measured = covariance(fit)[BASE_PART, BASE_PART]
    weight = np.linalg.inv(measured + device)
    whole = float(delta @ weight @ delta)
    directions = {name: np.zeros(len(delta)) for name in ("torque_bias", "torque_gain", "current_gain")}
    by_current = [LINEAR.index("I1"), LINEAR.index("K1")]
    directions["torque_bias"][LINEAR.index("D")] = 1.0
    directions["torque_gain"][LINEAR_PART] = base
    directions["current_gain"][by_current] = base[by_current]
    rank = []
    for name, d in directions.items():
        information = float(d @ weight @ d)
        if information <= 0.0:
            continue
        size = float(d @ weight @ delta) / information
        rank.append((whole - size**2 * information, name, size, information**-0.5))
    rank.sort()
    if not rank or whole - rank[0][0] < _DROP or rank[0][0] > _LEFT:
        return []
    best = rank[0]
    shifted = _log_likelihood(delta, measured + device) + 0.5 * (whole - best[0])
    if shifted < _log_likelihood(delta, measured + (OTHER_DEVICE / SPREAD) ** 2 * device) + _MARGIN:
        return []
    near = tuple(r[1] for r in rank[1:] if r[0] - best[0] < _APART)
    value = best[2] + (0.0 if best[1] == "torque_bias" else 1.0)
    if best[1] == "torque_bias":
        near = ("encoder_offset", "friction_asymmetry", *near)
    return [Found(name=best[1], value=value, error=best[3], alternatives=near)]


def _log_likelihood(delta: np.ndarray, spread: np.ndarray) -> float:
    return -0.5 * float(delta @ np.linalg.solve(spread, delta) + np.linalg.slogdet(spread)[1])
