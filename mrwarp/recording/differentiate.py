"""Velocity from a recorded angle: zero-phase local polynomials (Savitzky and Golay, Anal. Chem. 36, 1964)."""

from __future__ import annotations

import numpy as np

HALF_WIDTH = 0.010
"""Half of the filter's window [s]; a longer one would blunt reversals, a shorter one pass on the encoder's steps."""

ORDER = 3
"""Order of the local polynomial: the derivative of a cubic is exact."""

MIN_HALF_SAMPLES = 2
"""Fewest samples on each side: below, four coefficients leave no noise to average."""


def differentiate(x: np.ndarray, dt: float, *, half_width: float = HALF_WIDTH) -> np.ndarray:
    """Time derivative of a uniformly sampled signal, without phase shift.

    At each sample a cubic is fitted by least squares to the samples within ``half_width`` on both sides, and its slope
    there is the derivative. The window is symmetric, so the filter has no phase; :func:`frequency_response` gives its
    gain. The first and last half window take the slopes of the cubic through the first and last full window: one-sided
    and so noisier, but neither shifted nor padded with made-up samples.

    Args:
        x: Signal, shape (N,), N >= 5.
        dt: Sampling interval [s].
        half_width: Half of the window [s].

    Returns:
        Derivative [unit of x per s], shape (N,).
    """
    m = half_samples(len(x), dt, half_width)
    slope, ends = _weights(m)
    out = np.empty(len(x))
    out[m : len(x) - m] = np.convolve(x, slope[::-1], mode="valid")
    # differences from the window's own start: a large offset of x would otherwise eat digits of its slope
    out[:m] = ends[:m] @ (x[: 2 * m + 1] - x[0])
    out[len(x) - m :] = ends[m + 1 :] @ (x[len(x) - 2 * m - 1 :] - x[-1])
    return out / dt


def half_samples(count: int, dt: float, half_width: float = HALF_WIDTH) -> int:
    """Samples on each side of the window for a signal of ``count`` samples."""
    return min(max(round(half_width / dt), MIN_HALF_SAMPLES), (count - 1) // 2)


def frequency_response(f: np.ndarray, dt: float, *, half_width: float = HALF_WIDTH) -> np.ndarray:
    """Gain of :func:`differentiate` over that of the ideal derivative at the frequencies ``f`` [Hz]; real: no phase."""
    m = half_samples(2**31, dt, half_width)
    slope, _ = _weights(m)
    k = np.arange(-m, m + 1)
    omega = 2.0 * np.pi * np.asarray(f, dtype=np.float64)[:, None] * dt
    # the weights are odd in k, so only the sine part is left
    safe = np.where(omega == 0.0, 1.0, omega)
    return np.where(omega[:, 0] == 0.0, 1.0, (np.sin(omega * k) * slope).sum(1) / safe[:, 0])


def _weights(m: int) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the slope at the window's centre, shape (2m+1,), and at each of its samples, shape (2m+1, 2m+1)."""
    # scaled to [-1, 1]: powers of k itself would make the least-squares problem ill-conditioned for wide windows
    s = np.arange(-m, m + 1) / m
    powers = np.arange(ORDER + 1)
    fit = np.linalg.pinv(s[:, None] ** powers)
    slopes = powers[1:] * s[:, None] ** (powers[1:] - 1) / m
    ends = slopes @ fit[1:]
    return ends[m], ends
