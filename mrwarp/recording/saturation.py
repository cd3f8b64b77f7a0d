"""Samples at which a torque sensor stood at the end of its range, or was stuck: set aside, the others are used."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import binary_dilation

from mrwarp.recording.data import Recording, Repair, few_levels

CLIPPED = 0.002
"""Share of samples that stand, in runs, at the very largest torque above which the sensor counts as saturated."""

MOST = 0.25
"""Largest share of samples that may be set aside; beyond, too little of the torque is known."""

_MOST_OF_ONE = 0.5
"""Share of a trajectory's samples beyond which it is left out altogether."""

_STUCK_SAMPLES, _STUCK_SECONDS, _STUCK_TIMES = 20, 0.05, 3
"""Fewest equal samples, and shortest time [s], of a reading that is stuck, and how often that is in a run at most."""
_STUCK_WAY, _STUCK_ELSE, _USUAL = 0.02, 0.05, 95.0
"""Part of the run's range that the joint moves in that time at least; share of equal neighbours elsewhere at most;
percentile of the changes from sample to sample that the one after it exceeds."""

_BEFORE, _AFTER = 1, 4
"""Samples set aside around each: a sensor leaves its limit late, and noise is judged by what came just before."""


def at_limit(x: np.ndarray) -> float:
    """Share of samples that stand, in runs, at the largest value; 0 where more are just below it, as at a peak."""
    reach = max(float(np.ptp(x)), 1e-300)
    at = x >= x.max() - 1e-9 * reach
    below = (x >= x.max() - 0.01 * reach) & ~at
    return float((at[1:] & at[:-1]).mean()) if at.sum() >= below.sum() else 0.0


def stuck(x: np.ndarray, q: np.ndarray, dt: float) -> np.ndarray:
    """Samples that only repeat the one before, for long and seldom, while the joint moves, bool, shape (N,).

    What follows them is a jump: what stands at an end of its range goes on from there.

    Args:
        x: A torque, shape (N,), that changes from most samples to the next.
        q: Angle or displacement, shape (N,).
        dt: Sampling interval [s].
    """
    out, same = np.zeros(len(x), dtype=bool), np.diff(x) == 0.0
    edges = np.flatnonzero(np.diff(same.astype(int), prepend=0, append=0))
    begins, ends = edges[::2], edges[1::2]
    long = np.flatnonzero(ends - begins >= max(_STUCK_SAMPLES, _STUCK_SECONDS / dt))
    found = [slice(a + 1, b + 1) for a, b in zip(begins[long], ends[long], strict=True)]
    usual = float(np.percentile(np.abs(np.diff(x)), _USUAL)) if len(found) else 0.0
    found = [at for at in found if np.ptp(q[at]) > _STUCK_WAY * np.ptp(q)]
    found = [at for at in found if np.abs(np.diff(x[at.stop - 1 : at.stop + 1])).sum() > usual]
    for at in found:
        out[at] = True
    seldom = len(found) <= _STUCK_TIMES and same[~out[1:]].sum() < _STUCK_ELSE * np.count_nonzero(~out)
    return out if seldom and 2 * out.sum() < len(x) else np.zeros(len(x), dtype=bool)


def saturated(recording: Recording) -> str:
    """A note where so much of the torque is at the end of its sensor's range, or stuck, that it was not set aside."""
    runs = recording.trajectories
    if any(run.lost is not None for run in runs):
        return ""
    runs = [run for run in runs if not few_levels(run.torque)]
    if not runs:
        return ""
    torque = np.concatenate([run.torque for run in runs])
    clipped, limit = max((at_limit(torque), torque.max()), (at_limit(-torque), torque.min()))
    if clipped > CLIPPED:
        return (
            f"the torque sensor is saturated: {100 * clipped:.2g} % of the samples stand at its largest reading "
            f"({limit:.4g}), so the torque beyond is unknown; use a larger range or less current"
        )
    if stood := float(np.concatenate([stuck(run.torque, run.q, run.dt) for run in runs]).mean()):
        return (
            f"the torque stands still in {100 * stood:.2g} % of the samples while the joint moves: its reading was "
            "stuck; look after the sensor's connection, and record again"
        )
    return ""


def mark_saturated(recording: Recording) -> Recording:
    """Set saturated samples aside (``Trajectory.lost``) where enough others are left; else the recording as it is.

    A torque of few levels is a command, which has no sensor's range.
    """
    levels = [few_levels(run.torque) for run in recording.trajectories]
    if all(levels):
        return recording
    measured = [run for run, few in zip(recording.trajectories, levels, strict=True) if not few]
    torque = np.concatenate([run.torque for run in measured])
    reach = float(np.ptp(torque))
    limits = [sign * (sign * torque).max() for sign in (1.0, -1.0) if at_limit(sign * torque) > CLIPPED]
    stands = [
        np.zeros(len(run.t), dtype=bool) if few else stuck(run.torque, run.q, run.dt)
        for run, few in zip(recording.trajectories, levels, strict=True)
    ]
    if reach == 0.0 or not (limits or any(x.any() for x in stands)):
        return recording
    size = _BEFORE + 1 + _AFTER
    runs, repairs, lost_in_all = [], list(recording.repairs), 0
    for run, few, stood in zip(recording.trajectories, levels, stands, strict=True):
        ended = (
            np.zeros(len(run.t), dtype=bool)
            if few
            else (np.abs(run.torque - np.array([limits]).T) <= 1e-9 * reach).any(axis=0)
        )
        at = ended | stood
        lost = binary_dilation(at, np.ones(size), origin=_BEFORE - size // 2)
        lost_in_all += int(lost.sum())
        if not at.any():
            runs.append(run)
            continue
        count, places = int(at.sum()), np.flatnonzero(np.diff(at.astype(int), prepend=0) == 1)
        where = tuple(float(run.t[k]) for k in places[:10])
        what = "at the end of its range" if ended.any() else "still while the joint moves"
        text = f"the torque stands {what} in {count} of {len(at)} samples, first at {where[0]:.4g} s: "
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
