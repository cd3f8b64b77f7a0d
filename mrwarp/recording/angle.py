"""Angles that a sensor does not give as they are: readings that begin again after a turn, or a speed alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_WITHIN = 1.001
"""Largest span, in periods, of readings that begin again after one: rounding may go a little beyond."""
_SMOOTH = 3.0
"""Largest step that a wrap may leave, over the largest of the other steps: a joint goes on as it went."""
_GAP = 6.5
"""Intervals, in the mean one, that are a gap: beyond, a trajectory is split."""
_SLOW, _STEADY = 0.25, 0.25
"""Largest step of such an angle, in periods; of a faster shaft, the mean change from step to step, in mean steps."""


def unwrapped(t: np.ndarray, q: np.ndarray, periods: Sequence[float]) -> tuple[np.ndarray, int, float]:
    """An angle that goes on where its reading begins again.

    Args:
        t: Time [s], shape (N,); nothing is continued over a gap.
        q: Angle or displacement, shape (N,).
        periods: Lengths after which readings may begin again, in the unit of ``q``, the shortest first.

    Returns:
        The angle, continued from its first sample; how often the reading began again; and the period (0: never).
    """
    long = np.diff(t) / max(float(np.mean(np.diff(t))), 1e-300)
    steps = np.where(long > _GAP, 0.0, np.diff(q))
    long = np.clip(long, 1.0, _GAP)
    for period in periods:
        wraps = np.abs(steps) > 0.5 * period
        if not wraps.any() or np.ptp(q) > _WITHIN * period:
            continue
        whole = np.rint(steps / period)
        left = (steps - period * whole) / long  # from sample to sample, where some are missing
        size, usual = np.abs(left), np.abs(left[~wraps]).max(initial=0.0)
        goes_on = usual <= _SLOW * period or np.abs(np.diff(left)).mean() < _STEADY * size.mean()
        if goes_on and size[wraps].max() <= max(_SMOOTH * usual, 1e-3 * period):
            turns = np.concatenate([[0.0], np.cumsum(whole)])
            return q - period * turns, int(wraps.sum()), period
    return q, 0, 0.0


def integrated(qd: np.ndarray, dt: float) -> np.ndarray:
    """Angle from a speed, by trapezoids, from 0; shape (N,)."""
    return np.concatenate([[0.0], np.cumsum(0.5 * dt * (qd[1:] + qd[:-1]))])
