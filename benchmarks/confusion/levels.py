"""How large an effect is: what re-fitting eqs. 14 and 15 leaves of it, over the noise; and the strength for a level."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchmarks.confusion.effects import EFFECTS, Effect
from benchmarks.confusion.motion import Motion
from benchmarks.confusion.truth import BASE, Device, Signals, simulate

TOLERANCE = 0.01
"""Relative error of the level at which the search for a strength stops."""

_STEPS = 5
"""Most Gauss-Newton steps of a refit."""

_SETTLED = 0.002
"""Share of the residual's energy below which a step ends the refit: a tenth of a per cent of the level."""

_RATE = 200.0
"""Logs of a higher rate are thinned to no less than this to search a strength [1/s]."""


def baseline(values: np.ndarray, signals: Signals, zero: float) -> np.ndarray:
    """Eqs. 14 and 15 along logged signals.

    Args:
        values: Coefficients in the order of :data:`~benchmarks.confusion.truth.BASE`.
        signals: What was logged; its torque is not used.
        zero: Position where the stiffness is zero [rad].

    Returns:
        Torque [N·m], shape (T, M).
    """
    d, b, c, i1, k0, k1, alpha, beta, gamma = values
    gain = (k0 + k1 * signals.current) / (1.0 + alpha * np.abs(signals.qd))
    straight = d + b * signals.qd + c * (signals.q - zero) + i1 * signals.current
    return straight + gain * signals.path.hysteresis(beta, gamma)


def derivatives(values: np.ndarray, signals: Signals, zero: float) -> np.ndarray:
    """Derivatives of :func:`baseline` with respect to the coefficients by central differences, shape (9, T * M)."""
    out = []
    for k, value in enumerate(values):
        if k < 6:  # the torque is linear in these
            continue
        h = 1e-4 * abs(value)
        up, down = (baseline(np.where(np.arange(9) == k, value + s * h, values), signals, zero) for s in (1.0, -1.0))
        out.append((up - down).ravel() / (2.0 * h))
    shape = signals.path.hysteresis(values[7], values[8]) / (1.0 + values[6] * np.abs(signals.qd))
    linear = (np.ones_like(shape), signals.qd, signals.q - zero, signals.current, shape, signals.current * shape)
    return np.stack([*(x.ravel() for x in linear), *out])


def refitted(device: Device, signals: Signals) -> np.ndarray:
    """Torque that remains when the nine coefficients are fitted to it [N·m], shape (T, M).

    Gauss-Newton from the device's own coefficients; noise-free signals need no more.
    """
    start = values = np.array([device.base[name] for name in BASE])
    best = left = signals.torque - baseline(values, signals, device.zero)
    size = np.sum(best * best)
    for _ in range(_STEPS):
        slopes = derivatives(values, signals, device.zero)
        norm = np.sqrt(np.sum(slopes * slopes, axis=1))
        slopes /= norm[:, None]
        values = values + np.linalg.lstsq(slopes @ slopes.T, slopes @ left.ravel(), rcond=1e-12)[0] / norm
        # on the way alpha, beta and gamma may not leave the range where eq. 15 is stable
        values[6] = max(values[6], 0.2 * start[6])
        values[7] = np.clip(values[7], 0.5 * start[7], 2.0 * start[7])
        values[8] = np.clip(values[8], -0.95 * values[7], 0.95 * values[7])
        left = signals.torque - baseline(values, signals, device.zero)
        before, now = size, np.sum(left * left)
        if now < size:
            best, size = left, now
        if now > before * (1.0 - _SETTLED):
            break
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
    thin = math.floor(motion.rate / _RATE)
    if thin > 1 and name != "command_delay":  # which acts on few samples
        motion = replace(motion, rate=motion.rate / thin, substeps=motion.substeps * thin)

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
