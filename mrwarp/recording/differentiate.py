"""Velocity from a recorded angle: zero-phase local cubics (Savitzky and Golay, Anal. Chem. 36, 1964)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

HALF_WIDTH = 0.010
"""Half of the filter's window [s]; a longer one would smooth reversals, a shorter one pass on the encoder's steps."""

WIDEST = 32
"""Largest factor by which the window is widened where the signal is little more than noise within it."""

_QUIET = 0.1
"""Noise of the velocity, over its RMS, above which the window is widened: noise adds to the way."""

_NOISE_ONLY = 1.1
"""Factor by which what a wider window leaves of the signal may grow; more would be motion."""

ORDER = 3
"""Order of the local polynomial: the derivative of a cubic is exact."""

_LONG = 500
"""Samples of a window from which sums over it are taken by Fourier's way."""

MIN_HALF_SAMPLES = 2
"""Fewest samples on each side: below, four coefficients leave no noise to average."""


def differentiate(x: np.ndarray, dt: float, half: int | None = None) -> np.ndarray:
    """Time derivative of a uniformly sampled signal, without phase shift.

    The first and last half window take the slopes of the cubic through the first and last full window: one-sided and so
    noisier, but neither shifted nor padded with made-up samples. :func:`frequency_response` gives the filter's gain.

    Args:
        x: Signal, shape (N,), N >= 5.
        dt: Sampling interval [s].
        half: Samples on each side of the window; None: those of :data:`HALF_WIDTH`.

    Returns:
        Derivative [unit of x per s], shape (N,).
    """
    moved = x - x[0]  # a large offset would eat digits of the slope
    half = half_samples(len(x), dt) if half is None else half
    return _filtered(moved, half, slopes=True) / dt


def quiet_half(x: np.ndarray, dt: float) -> int:
    """Samples on each side of the narrowest window whose slopes are motion and not noise.

    That of :data:`HALF_WIDTH` unless noise is over a tenth of the velocity. Then it is doubled for as long as what it
    leaves of the signal does not grow: slow motion of a few micrometres needs a longer window than a swing.
    """
    half = first = half_samples(len(x), dt)
    steps = np.abs(np.diff(x))
    # an encoder's step is noise of step/sqrt(12), also where it seldom flips
    step = float(steps[steps > 0.0].min()) / np.sqrt(12.0) if (steps > 0.0).any() else 0.0
    noise = max(_noise(x, half), step)
    while half < WIDEST * first and 4 * half + 1 <= len(x) // 4:
        slopes = differentiate(x, dt, half)
        weights = middle_weights(half, slopes=True) / dt
        if noise * np.sqrt(weights @ weights) < _QUIET * np.sqrt(np.mean(slopes**2)):
            break
        if _noise(x, 2 * half) > _NOISE_ONLY * noise:
            break
        half *= 2
    return half


def _noise(x: np.ndarray, half: int) -> float:
    """Standard deviation of the white noise of which a window would leave as much as it leaves of a signal."""
    rest = x - _filtered(x - x[0], half, slopes=False) - x[0]
    centre = float(middle_weights(half, slopes=False)[half])
    return float(np.sqrt(np.mean(rest**2) / max(1.0 - centre, 1e-6)))


@lru_cache(maxsize=32)
def local_cubics(half: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of a window: powers of its places and those of their slopes, (place, 4), and the fit of its cubic, (4, sample).

    The cubic's value at each place is ``powers @ fit @ samples``. Those of :mod:`scipy.signal`, which takes half of the
    time of `mrwarp check` to load; and no matrix of places by samples, which for a window of 20,000 is 3 GB.
    """
    powers = np.vander(np.arange(-half, half + 1) / half, ORDER + 1, increasing=True)
    slopes = np.zeros_like(powers)
    slopes[:, 1:] = powers[:, :-1] * np.arange(1, ORDER + 1) / half
    return powers, slopes, np.linalg.pinv(powers)


def middle_weights(half: int, *, slopes: bool) -> np.ndarray:
    """Weights of a window's samples in its cubic's value, or slope per sample, in the middle; shape (2*half + 1,)."""
    powers, rates, fit = local_cubics(half)
    return (rates if slopes else powers)[half] @ fit


def _filtered(x: np.ndarray, half: int, *, slopes: bool) -> np.ndarray:
    """Signal (N,) by the weights of a window's middle; what lies before the first one and after the last by theirs."""
    powers, rates, fit = local_cubics(half)
    at, size = rates if slopes else powers, 2 * half + 1
    inner = _convolved(x, middle_weights(half, slopes=slopes)[::-1])
    return np.concatenate([at[:half] @ (fit @ x[:size]), inner, at[half + 1 :] @ (fit @ x[-size:])])


def _convolved(x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """``np.convolve(x, weights, "valid")``; of a long window by Fourier's way."""
    if len(weights) < _LONG:
        return np.convolve(x, weights, mode="valid")
    from scipy.signal import oaconvolve  # long windows are rare

    return oaconvolve(x, weights, mode="valid")


def half_samples(count: int, dt: float) -> int:
    """Samples on each side of the window for a signal of ``count`` samples."""
    return min(max(round(HALF_WIDTH / dt), MIN_HALF_SAMPLES), (count - 1) // 2)


def frequency_response(f: np.ndarray, dt: float, half: int | None = None) -> np.ndarray:
    """Gain of :func:`differentiate` over that of the ideal derivative at the frequencies ``f`` [Hz]; real: no phase."""
    m = half_samples(2**31, dt) if half is None else half
    slope, k = middle_weights(m, slopes=True), np.arange(-m, m + 1)
    # the weights are odd in k, so only the sine part is left; sum(k*slope) = 1 is its limit at 0 Hz
    cycles = 2.0 * np.asarray(f, dtype=np.float64)[:, None] * dt * k
    return (np.sinc(cycles) * k * slope).sum(1)
