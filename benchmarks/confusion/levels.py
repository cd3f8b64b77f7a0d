"""How large an effect is: what re-fitting eqs. 14 and 15 leaves of it, over the noise; and the strength for a level."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from benchmarks.confusion.effects import EFFECTS, Effect
from benchmarks.confusion.motion import Motion
from benchmarks.confusion.truth import BASE, Device, Signals, simulate

TOLERANCE = 0.01
"""Relative error of the level at which the search for a strength stops."""

_STEPS = 3
"""Gauss-Newton steps of a refit; the last one moves the level by less than the tolerance."""


def baseline(values: np.ndarray, signals: Signals, zero: float) -> tuple[np.ndarray, np.ndarray]:
    """Eqs. 14 and 15 along logged signals, and their derivatives.

    Args:
        values: Coefficients in the order of :data:`~benchmarks.confusion.truth.BASE`.
        signals: What was logged; its torque is not used.
        zero: Position where the stiffness is zero [rad].

    Returns:
        Torque [N·m], shape (T, M), and its derivatives with respect to the coefficients, shape (9, T, M).
    """
    d, b, c, i1, k0, k1, alpha, beta, gamma = values
    z = signals.path.hysteresis(beta, gamma)
    weak = 1.0 + alpha * np.abs(signals.qd)
    gain = k0 + k1 * signals.current
    shape = []
    for x, other in ((beta, (0.0, 1.0)), (gamma, (1.0, 0.0))):
        h = 1e-4 * abs(x)
        up, down = (
            signals.path.hysteresis(beta + sign * h * other[1], gamma + sign * h * other[0]) for sign in (1.0, -1.0)
        )
        shape.append(gain / weak * (up - down) / (2.0 * h))
    hysteretic = gain * z / weak
    q = signals.q - zero
    columns = [np.ones_like(z), signals.qd, q, signals.current, z / weak, signals.current * z / weak]
    columns += [-hysteretic * np.abs(signals.qd) / weak, *shape]
    return d + b * signals.qd + c * q + i1 * signals.current + hysteretic, np.stack(columns)


def refitted(device: Device, signals: Signals) -> np.ndarray:
    """What is left of the torque when the nine coefficients are fitted to it [N·m], shape (T, M).

    Gauss-Newton from the device's own coefficients; noise-free signals need no more.
    """
    start = values = np.array([device.base[name] for name in BASE])
    torque, slopes = baseline(values, signals, device.zero)
    best = left = signals.torque - torque
    for _ in range(_STEPS):
        flat = slopes.reshape(len(BASE), -1)
        norm = np.sqrt(np.sum(flat * flat, axis=1))
        flat = flat / norm[:, None]
        step = np.linalg.lstsq(flat @ flat.T, flat @ left.ravel(), rcond=1e-12)[0] / norm
        # on the way alpha, beta and gamma may not leave the range where eq. 15 is stable
        values = values + step
        values[6] = max(values[6], 0.2 * start[6])
        values[7] = np.clip(values[7], 0.5 * start[7], 2.0 * start[7])
        values[8] = np.clip(values[8], -0.95 * values[7], 0.95 * values[7])
        torque, slopes = baseline(values, signals, device.zero)
        left = signals.torque - torque
        if np.sum(left * left) < np.sum(best * best):
            best = left
    return best


def level_of(device: Device, motion: Motion, sigma: float) -> float:
    """RMS of what survives re-fitting the baseline, over the noise ``sigma`` [N·m]."""
    return float(np.sqrt(np.mean(refitted(device, simulate(device, motion)) ** 2))) / sigma


def strength_for(
    name: str, draws: dict[str, float], *, level: float, device: Device, motion: Motion, sigma: float
) -> tuple[Effect, float]:
    """The strength with which an effect, alone on a device, has a level on a motion, and the level it really has.

    The two differ by :data:`TOLERANCE`, except where the level jumps over the strength (a delay below one sample: edges
    enter one by one) or the law ends before.
    """
    spec = EFFECTS[name]

    def measure(strength: float) -> float:
        return level_of(device.with_effects({name: Effect(strength=strength, draws=draws)}), motion, sigma)

    strength, found = _search(measure, level, spec.guess, spec.largest if draws.get("sign", 1.0) < 0.0 else math.inf)
    return Effect(strength=strength, draws=draws), found


def _search(measure: Callable[[float], float], level: float, guess: float, largest: float) -> tuple[float, float]:
    """Secant on logarithms, held inside a bracket; a level grows with its strength. Best strength and its level."""
    low, high = 0.0, math.inf
    x, slope = guess, 1.0
    before: tuple[float, float] | None = None
    best, reached = guess, math.inf
    for _ in range(25):
        found = measure(x)
        if abs(found - level) < abs(reached - level):
            best, reached = x, found
        low, high = (max(low, x), high) if found < level else (low, min(high, x))
        if abs(reached / level - 1.0) < TOLERANCE or 0.0 < high - low < 1e-3 * low:
            break
        if found <= 0.0:
            following = 4.0 * x
        else:
            point = (math.log(x), math.log(found / level))
            if before is not None and point[0] != before[0]:
                slope = min(max((point[1] - before[1]) / (point[0] - before[0]), 0.3), 3.0)
            before = point
            following = x * math.exp(min(max(-point[1] / slope, -2.0), 2.0))
        if not low < following < high:
            following = math.sqrt(low * high) if low > 0.0 and high < math.inf else following
        following = min(following, largest)
        if following == x:
            break
        x = following
    return best, reached
