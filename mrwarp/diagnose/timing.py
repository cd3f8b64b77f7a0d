"""The clocks of a log: a torque that is written down before the motion that it goes with.

A commanded force is held until the next sample, so a log of commands is ahead of the motion by part of a sample. No
effect of the catalogue acts before its cause, so what speaks for such a shift speaks for the log.
"""

from __future__ import annotations

import copy

import numpy as np

from mrwarp.diagnose.choice import gain_and_t, threshold
from mrwarp.diagnose.engine import Engine, Fitted

_TRIED = (0.25, 0.5, 0.75, 1.0)
"""Shifts that are tried [samples]."""
_CLEAR, _CLEAR_T = 0.02, 4.0
"""Least gain, as a share of all that the model leaves, and its least ratio to its standard error."""


def find_timing(engine: Engine, fitted: Fitted) -> float:
    """Samples by which the torque is logged ahead of the motion; the engine's motion is shifted by them, if any.

    Args:
        engine: The data set; its motion is changed.
        fitted: The best model so far.
    """
    original = engine.motion
    shifts, losses = [0.0], [fitted.left_out]
    best = fitted
    for shift in _TRIED:
        trial = copy.copy(engine)
        trial.follow(original.later(shift))
        best = trial.fit(best.coordinates, best.x)
        shifts.append(shift)
        losses.append(best.left_out)
        if losses[-1].sum() > losses[-2].sum():
            break
    totals = [float(loss.sum()) for loss in losses]
    k = int(np.argmin(totals))
    gain, t = gain_and_t(losses[0], losses[k])
    if gain < max(5.0 * threshold(fitted), _CLEAR * totals[0]) or t < _CLEAR_T:
        return 0.0
    found = shifts[k]
    if 0 < k < len(totals) - 1:  # the vertex of the parabola through the best and its neighbours
        before, here, after = totals[k - 1 : k + 2]
        found += 0.5 * _TRIED[0] * (before - after) / (before - 2.0 * here + after)
    engine.follow(original.later(found))
    return found


def timing_note(ahead: float, dt: float) -> str:
    """What was found, for the report's notes.

    Args:
        ahead: Samples.
        dt: Sampling interval [s].
    """
    return (
        f"torque is logged {ahead:.2f} samples ({1e3 * ahead * dt:.2g} ms) ahead of the motion, as where a command is "
        "logged that is held until the next sample; the motion was taken that much later"
    )
