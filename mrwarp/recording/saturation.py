"""Samples at which a torque sensor stood at the end of its range: they are set aside, the others are used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation

from mrwarp.recording.data import Recording, Repair

CLIPPED = 0.002
"""Share of samples that stand, in runs, at the very largest torque above which the sensor counts as saturated."""

MOST = 0.25
"""Largest share of samples that may be set aside; beyond, too little of the torque is known."""

_MOST_OF_ONE = 0.5
"""Share of a trajectory's samples beyond which it is left out altogether."""

_BEFORE, _AFTER = 1, 4
"""Samples set aside around each: a sensor leaves its limit late, and noise is judged by what came just before."""


def at_limit(x: np.ndarray) -> float:
    """Share of samples that stand, in runs, at the largest value; 0 where more are just below it, as at a peak."""
    reach = max(float(np.ptp(x)), 1e-300)
    at = x >= x.max() - 1e-9 * reach
    below = (x >= x.max() - 0.01 * reach) & ~at
    return float((at[1:] & at[:-1]).mean()) if at.sum() >= below.sum() else 0.0


def mark_saturated(recording: Recording) -> Recording:
    """Set saturated samples aside (``Trajectory.lost``) where enough others are left; else the recording as it is."""
    torque = np.concatenate([run.torque for run in recording.trajectories])
    reach = float(np.ptp(torque))
    limits = [sign * (sign * torque).max() for sign in (1.0, -1.0) if at_limit(sign * torque) > CLIPPED]
    if not limits or reach == 0.0:
        return recording
    size = _BEFORE + 1 + _AFTER
    runs, repairs, lost_in_all = [], list(recording.repairs), 0
    for run in recording.trajectories:
        at = np.any([np.abs(run.torque - limit) <= 1e-9 * reach for limit in limits], axis=0)
        lost = binary_dilation(at, np.ones(size), origin=_BEFORE - size // 2)
        lost_in_all += int(lost.sum())
        if not at.any():
            runs.append(run)
            continue
        count, places = int(at.sum()), np.flatnonzero(np.diff(at.astype(int), prepend=0) == 1)
        where = tuple(float(run.t[k]) for k in places[:10])
        text = f"the torque stands at the end of its range in {count} of {len(at)} samples, first at {where[0]:.4g} s: "
        if lost.mean() > _MOST_OF_ONE:
            repairs.append(Repair(trajectory=run.id, kind="left_out", count=1, at=where, text=text + "left out"))
            continue
        runs.append(replace(run, lost=lost))
        repairs.append(
            Repair(trajectory=run.id, kind="saturated", count=count, at=where, text=text + "they do not count")
        )
    if lost_in_all > MOST * len(torque) or not runs:
        return recording
    return replace(recording, trajectories=tuple(runs), repairs=tuple(repairs))
