"""Angles that a sensor does not give as they are: readings that begin again after a turn, or a speed alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.integrate import cumulative_trapezoid

_WITHIN = 1.001
"""Largest span, in periods, of readings that begin again after one: rounding may go a little beyond."""
_SMOOTH = 3.0
"""Largest step that a wrap may leave, over the largest of the other steps: a joint goes on as it went."""
_SLOW, _STEADY = 0.25, 0.25
"""Largest step of such an angle, in periods; of a faster shaft, the mean change from step to step, in mean steps."""


def unwrapped(q: np.ndarray, periods: Sequence[float]) -> tuple[np.ndarray, int, float]:
    """An angle that goes on where its reading begins again.

    Args:
        q: Angle or displacement, shape (N,).
        periods: Lengths after which readings may begin again, in the unit of ``q``, the shortest first.

    Returns:
        The angle, continued from its first sample; how often the reading began again; and the period (0: never).
    """
    steps = np.diff(q)
    for period in periods:
        wraps = np.abs(steps) > 0.5 * period
        if not wraps.any() or np.ptp(q) > _WITHIN * period:
            continue
        whole = np.rint(steps / period)
        left = steps - period * whole
        size, usual = np.abs(left), np.abs(left[~wraps]).max(initial=0.0)
        goes_on = usual <= _SLOW * period or np.abs(np.diff(left)).mean() < _STEADY * size.mean()
        if goes_on and size[wraps].max() <= max(_SMOOTH * usual, 1e-3 * period):
            turns = np.concatenate([[0.0], np.cumsum(whole)])
            return q - period * turns, int(wraps.sum()), period
    return q, 0, 0.0


def integrated(qd: np.ndarray, dt: float) -> np.ndarray:
    """Angle from a speed, by trapezoids, from 0; shape (N,)."""
    return np.asarray(cumulative_trapezoid(qd, dx=dt, initial=0.0))
