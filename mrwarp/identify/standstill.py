"""Where a joint rests: there the noise of its channels must not be taken for motion.

A loop that is steeper on one way than on the other makes a steady pull of velocity noise, in seconds of rest.
"""

from __future__ import annotations

import numpy as np

from mrwarp.recording.load import Trajectory

_WINDOW = 0.1
"""Time in which nothing moves beyond the noise [s], and at least ten samples."""
_SHORTEST = 0.25
"""Shortest rest [s]: a turning point of slow motion looks like a shorter one."""
_EDGE = 0.03
"""Time at each end of a rest in which nobody knows whether the joint moves already, or still [s]."""
_SCATTER = 1.8
"""Largest standard deviation of a resting angle over that of its noise; 1.73 for a reading that flips by one step."""
_T = 3.0
"""Standard errors by which the halves of a rest, or its velocity and 0, may differ."""


def known_velocity(run: Trajectory, sigma_q: float, sigma_v: float) -> tuple[np.ndarray, np.ndarray]:
    """Velocity where a joint rests: 0, or the slope of the angle where it creeps.

    Args:
        run: Trajectory of N samples.
        sigma_q: Standard deviation of the angle's noise.
        sigma_v: Standard deviation of the velocity's noise; infinite: not looked at.

    Returns:
        The velocity, NaN where it is not known, and whether a sample is at the edge of a rest; both of shape (N,).
    """
    size, edge = len(run.q), round(_EDGE / run.dt)
    known, doubtful = np.full(size, np.nan), np.zeros(size, dtype=bool)
    for part in resting(run.q, run.qd, run.dt, sigma_q, sigma_v):
        begin = part.start + edge if part.start else 0
        end = part.stop - edge if part.stop < size else size
        t = (np.arange(end - begin) - 0.5 * (end - begin - 1)) * run.dt
        slope, error = float(t @ run.q[begin:end] / (t @ t)), sigma_q / float(np.sqrt(t @ t))
        known[begin:end] = slope if abs(slope) > _T * error else 0.0
        doubtful[part.start : begin] = doubtful[end : part.stop] = True
    return known, doubtful


def resting(q: np.ndarray, qd: np.ndarray, dt: float, sigma_q: float, sigma_v: float) -> list[slice]:
    """Stretches of a trajectory whose angle and velocity change by no more than their noise.

    Args:
        q: Angle, shape (N,).
        qd: Velocity, shape (N,).
        dt: Sampling interval [s].
        sigma_q: Standard deviation of the angle's noise.
        sigma_v: Standard deviation of the velocity's noise; infinite: not looked at.
    """
    half = max(5, round(0.5 * _WINDOW / dt))
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
    return [slice(int(a), int(b)) for a, b in edges.reshape(-1, 2) if (b - a) * dt > _SHORTEST]
