"""Velocity from a recorded angle: zero-phase local cubics (Savitzky and Golay, Anal. Chem. 36, 1964)."""

from __future__ import annotations

import numpy as np
from scipy.signal import savgol_coeffs, savgol_filter

HALF_WIDTH = 0.010
"""Half of the filter's window [s]; a longer one would blunt reversals, a shorter one pass on the encoder's steps."""

ORDER = 3
"""Order of the local polynomial: the derivative of a cubic is exact."""

MIN_HALF_SAMPLES = 2
"""Fewest samples on each side: below, four coefficients leave no noise to average."""


def differentiate(x: np.ndarray, dt: float) -> np.ndarray:
    """Time derivative of a uniformly sampled signal, without phase shift.

    The first and last half window take the slopes of the cubic through the first and last full window: one-sided and so
    noisier, but neither shifted nor padded with made-up samples. :func:`frequency_response` gives the filter's gain.

    Args:
        x: Signal, shape (N,), N >= 5.
        dt: Sampling interval [s].

    Returns:
        Derivative [unit of x per s], shape (N,).
    """
    moved = x - x[0]  # a large offset would eat digits of the slope
    return np.asarray(savgol_filter(moved, 2 * half_samples(len(x), dt) + 1, ORDER, deriv=1, delta=dt))


def half_samples(count: int, dt: float) -> int:
    """Samples on each side of the window for a signal of ``count`` samples."""
    return min(max(round(HALF_WIDTH / dt), MIN_HALF_SAMPLES), (count - 1) // 2)


def frequency_response(f: np.ndarray, dt: float) -> np.ndarray:
    """Gain of :func:`differentiate` over that of the ideal derivative at the frequencies ``f`` [Hz]; real: no phase."""
    m = half_samples(2**31, dt)
    slope, k = savgol_coeffs(2 * m + 1, ORDER, deriv=1, use="dot"), np.arange(-m, m + 1)
    # the weights are odd in k, so only the sine part is left; sum(k*slope) = 1 is its limit at 0 Hz
    cycles = 2.0 * np.asarray(f, dtype=np.float64)[:, None] * dt * k
    return (np.sinc(cycles) * k * slope).sum(1)
