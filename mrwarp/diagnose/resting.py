"""Where a joint rests: there the noise of its channels must not be taken for motion.

A loop that is steeper on one way than on the other makes a steady pull of velocity noise, in seconds of rest.
"""

from __future__ import annotations

import numpy as np

from mrwarp.sysid.recording import Trajectory

_SHORTEST = 0.1
"""Shortest rest that is looked for [s], and at least ten samples."""
_SCATTER = 1.8
"""Largest standard deviation of a resting angle over that of its noise; 1.73 for a reading that flips by one step."""
_T = 3.0
"""Standard errors by which the halves of a rest, or its velocity and 0, may differ."""


def known_velocity(run: Trajectory, sigma_q: float, sigma_v: float) -> np.ndarray:
    """Velocity where a joint rests, shape (N,), NaN elsewhere: 0, or the slope of the angle where it creeps.

    Args:
        run: Trajectory of N samples.
        sigma_q: Standard deviation of the angle's noise.
        sigma_v: Standard deviation of the velocity's noise; infinite: not looked at.
    """
    known = np.full(len(run.q), np.nan)
    for part in resting(run.q, run.qd, run.dt, sigma_q, sigma_v):
        count = part.stop - part.start
        t = (np.arange(count) - 0.5 * (count - 1)) * run.dt
        slope, error = float(t @ run.q[part] / (t @ t)), sigma_q / float(np.sqrt(t @ t))
        known[part] = slope if abs(slope) > _T * error else 0.0
    return known


def resting(q: np.ndarray, qd: np.ndarray, dt: float, sigma_q: float, sigma_v: float) -> list[slice]:
    """Stretches of a trajectory whose angle and velocity change by no more than their noise.

    Args:
        q: Angle, shape (N,).
        qd: Velocity, shape (N,).
        dt: Sampling interval [s].
        sigma_q: Standard deviation of the angle's noise.
        sigma_v: Standard deviation of the velocity's noise; infinite: not looked at.
    """
    half = max(5, round(0.5 * _SHORTEST / dt))
    width = 2 * half
    if len(q) < width:
        return []
    x = q - q.mean()
    sums, squares = (np.concatenate([[0.0], np.cumsum(y)]) for y in (x, x**2))
    mean = (sums[width:] - sums[:-width]) / width
    scatter = np.sqrt(np.maximum((squares[width:] - squares[:-width]) / width - mean**2, 0.0))
    halves = (sums[half:] - sums[:-half]) / half
    drift = np.abs(halves[half:] - halves[:-half])
    still = (scatter < _SCATTER * sigma_q) & (drift < _T * sigma_q * np.sqrt(2.0 / half))
    if np.isfinite(sigma_v):
        way = np.concatenate([[0.0], np.cumsum(qd)])
        still &= np.abs(way[width:] - way[:-width]) < _T * sigma_v * np.sqrt(width)
    inside = np.convolve(still, np.ones(width)) > 0.5  # every sample of a window that is still
    edges = np.flatnonzero(np.diff(inside, prepend=False, append=False))
    return [slice(int(begin), int(end)) for begin, end in edges.reshape(-1, 2)]
