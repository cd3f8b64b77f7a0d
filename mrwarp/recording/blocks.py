"""Few long runs, cut into blocks that take turns in being predicted: each block is a run of its own to every method.

A block begins where little is unknown: at a rest, or shortly before the control input changes, which then belongs to
one block with all that follows from it. Between two blocks a guard is left out, so that no sample of one touches the
other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mrwarp.recording.data import Recording, Repair, Trajectory, quantity

ENOUGH = 12
"""Runs from which none is cut: as many as a recording should have."""
SECONDS, LEAST, MOST = 5.0, 2.0, 40
"""Length of a block [s]; the least one of short recordings [s]; the most blocks, of long ones."""
SAMPLES, PERIODS = 200, 1.5
"""Fewest samples of a block, and of periods of the motion in it: a part of a stroke goes one way only."""
GUARD = 0.1
"""Time [s] that is left out between two blocks."""
_SHIFT = 0.35
"""Largest shift of a cut, in block lengths, to where little is unknown."""
_AHEAD = 0.15
"""Time [s] by which a block begins before its first change of the control input."""
_FORGETS, _HEAD = 0.5, 0.25
"""Path, in ranges of the run's angle, after which the stress that a block begins with is forgotten; until then its
torque does not count, but for the largest such share of the block."""
_RESTS, _LONG = 0.02, 0.1
"""Speed at rest, as part of the run's usual one, and the least length of a rest [s]."""
_TURNS = 0.1
"""Part of the run's range by which a motion has to go back to have turned."""


def in_blocks(recording: Recording) -> Recording:
    """A recording whose long runs are cut into blocks where it has few; else the recording itself.

    ``Recording.repairs`` says how many there are, and from how many runs.
    """
    runs = recording.trajectories
    if len(runs) >= ENOUGH or is_cut(recording):
        return recording
    seconds = [len(run.t) * run.dt for run in runs]
    total = sum(seconds)
    length = max(SECONDS if total >= ENOUGH * SECONDS else max(LEAST, total / ENOUGH), total / MOST)
    found = [blocks_of(run, length) for run in runs]
    if all(len(blocks) == 1 for blocks in found):
        return recording
    name, count = quantity("current", recording.units), sum(map(len, found))
    text = (
        f"cut into {count} blocks of about {total / count:.3g} s at rests and before changes of the {name}, with "
        f"{GUARD:g} s left out between them: they take turns in being predicted"
    )
    label = runs[0].id if len(runs) == 1 else f"{len(runs)} runs"
    repair = Repair(trajectory=label, kind="cut", count=count, text=text)
    return replace(
        recording,
        trajectories=tuple(block for blocks in found for block in blocks),
        repairs=(*recording.repairs, repair),
    )


def is_cut(recording: Recording) -> bool:
    """Whether the runs of a recording are blocks of longer ones."""
    return any(repair.kind == "cut" for repair in recording.repairs)


def blocks_of(run: Trajectory, length: float) -> list[Trajectory]:
    """Blocks of a run that are about as long [s] as asked for, and hold enough samples and motion."""
    least = max(length, SAMPLES * run.dt, PERIODS * _period(run))
    count = int(len(run.t) * run.dt / least)
    if count < 2:
        return [run]
    size, guard = len(run.t) / count, max(1, round(GUARD / run.dt))
    ends = []
    cost = _unknown(run)
    for k in range(1, count):
        first, last = (round((k + sign * _SHIFT) * size) for sign in (-1.0, 1.0))
        near = np.arange(max(first, 0), min(last, len(run.t) - 1))
        ends.append(int(near[np.argmin(cost[near] + 0.5 * np.abs(near / size - k))]))
    bounds = [0, *ends, len(run.t)]
    return [_block(run, a + guard if a else 0, b) for a, b in zip(bounds[:-1], bounds[1:], strict=True)]


def _block(run: Trajectory, first: int, last: int) -> Trajectory:
    """Some samples of a run, as a run."""
    arrays = {
        name: None if (x := getattr(run, name)) is None else x[first:last]
        for name in ("t", "q", "qd", "current", "torque", "temperature", "lost")
    }
    before = arrays.pop("lost")
    lost = np.zeros(last - first, dtype=bool) if before is None else before.copy()
    if first:
        path = np.cumsum(np.abs(run.qd[first:last])) * run.dt
        lost[: min(int(np.searchsorted(path, _FORGETS * np.ptp(run.q))), round(_HEAD * (last - first)))] = True
    return replace(run, id=f"{run.id}@{run.t[first]:.4g}s", lost=lost if lost.any() else None, **arrays)


def _period(run: Trajectory) -> float:
    """Time of a stroke to and fro [s], from how often the motion turns; 0 where it never does."""
    least, turns, way, end = _TURNS * float(np.ptp(run.q)), 0, 0.0, float(run.q[0])
    for x in run.q[:: max(1, round(0.01 / run.dt))]:
        if way * (x - end) >= 0.0:
            end = x if way else end
            way = way or (np.sign(x - end) if abs(x - end) > least else 0.0)
        elif abs(x - end) > least:
            turns, way, end = turns + 1, -way, float(x)
    return 2.0 * len(run.t) * run.dt / turns if turns else 0.0


def _unknown(run: Trajectory) -> np.ndarray:
    """How much is unknown where a block would begin, in parts, shape (N,): least at a rest or before a change.

    After a change of the control input a coil's current is on its way for a while.
    """
    samples = len(run.t)
    changes = np.flatnonzero(np.abs(np.diff(run.current)) > _TURNS * max(float(np.ptp(run.current)), 1e-300)) + 1
    since, until = np.full(samples, np.inf), np.full(samples, np.inf)
    for k, at in enumerate(changes):
        stop = changes[k + 1] if k + 1 < len(changes) else samples
        since[at:stop] = (np.arange(at, stop) - at) * run.dt
        start = changes[k - 1] if k else 0
        until[start:at] = (at - np.arange(start, at)) * run.dt
    slow = np.abs(run.qd) < _RESTS * float(np.percentile(np.abs(run.qd), 95))
    width = max(1, round(_LONG / run.dt))
    rests = np.convolve(slow, np.ones(width), mode="same") > width - 1
    before = np.abs(until - _AHEAD - GUARD) < 0.5 * _AHEAD
    cost = np.where(rests, 0.0, np.where(before, 0.0, 0.5))
    return cost + np.exp(-since / _AHEAD) + (until < GUARD)
