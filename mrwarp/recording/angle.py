"""Readings that are not what they stand for: angles that begin again after a turn, wrong ones, a speed alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrwarp.recording.data import Repair, is_command, quantity, with_unit
from mrwarp.recording.units import Units

_WITHIN = 1.001
"""Largest span, in periods, of readings that begin again after one: rounding may go a little beyond."""
_SMOOTH = 3.0
"""Largest step that a wrap may leave, over the largest of the other steps: a joint goes on as it went."""
_GAP = 6.5
"""Intervals, in the mean one, that are a gap: beyond, a trajectory is split."""
_SLOW, _STEADY = 0.25, 0.25
"""Largest step of such an angle, in periods; of a faster shaft, the mean change from step to step, in mean steps."""
_AWAY, _COUNTS = 6.0, 4.0
"""Least distance of a wrong reading from the middle of its neighbours, in the 95th percentile of a run's steps, and in
its smallest one. The former is 17 standard deviations of white noise; what rests on an encoder's edge goes to and fro
by one count. The neighbours differ by half as much at most: by the motion."""
_AROUND, _MORE = 3, 1.5
"""Steps on either side of a jump whose means are the speed before and after it; how many times as large as anywhere
else a change is that comes with it."""
_STUCK, _CREEPS = 10, 0.05
"""Fewest equal readings before a jump that were stuck; part of the quickest step that a joint which moves makes."""
_JUMPS = 3
"""Most jumps of an angle in a run: what is more frequent is how this joint moves."""
_WRONG = 0.01
"""Largest share of readings that are replaced: what is more frequent is no exception."""
_EDGE = 4.0
"""Usual steps within which a reading that begins again jumps from one end of its range to the other."""
_ROUND = 2e-3
"""Share by which the length after which a reading begins again may be off a round one."""
_BRIEF = 3
"""Pulses of one sample for each of two from which a command does not make them itself: its own have any length."""


def without_wrong_readings(
    x: np.ndarray, periods: Sequence[float] = (), most: float = _WRONG
) -> tuple[np.ndarray, np.ndarray]:
    """A channel without single readings that go far off and come back at once, as no joint does.

    Args:
        x: Angle, displacement, velocity, or what else is measured, shape (N,).
        periods: Lengths after which readings may begin again; a step of such a length is none.
        most: Largest share of the readings that may be wrong; where more are, all stay.

    Returns:
        The channel, each wrong reading replaced by the middle of its neighbours, and where they were.
    """
    step = np.diff(x)
    for period in periods:
        step = step - period * np.rint(step / period)
    size = np.abs(step)
    if not size.any():
        return x, np.empty(0, dtype=int)
    least = max(_AWAY * float(np.percentile(size, 95)), _COUNTS * float(size[size > 0.0].min()))
    there, back = step[:-1], step[1:]
    off = (there * back < 0.0) & (0.5 * np.abs(there - back) > least) & (np.abs(there + back) < 0.5 * least)
    at = np.flatnonzero(off) + 1
    if not 0 < len(at) <= most * len(x):
        return x, np.empty(0, dtype=int)
    x = x.copy()
    x[at] = x[at - 1] + 0.5 * (step[at - 1] + step[at])
    return x, at


def without_brief_pulses(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A commanded input without single samples that are off to one side of the levels before and after them.

    Args:
        x: Control input that stays as it is from most samples to the next, shape (N,).

    Returns:
        The input, each of these samples at the level before it, and where they were.
    """
    step = np.diff(x)
    holds = np.pad(step == 0.0, 1, constant_values=True)  # on either side of each sample
    one = (step[:-1] * step[1:] < 0.0) & holds[:-3] & holds[3:]
    two = (step[:-2] * step[2:] < 0.0) & (step[1:-1] == 0.0)
    at = np.flatnonzero(one) + 1
    if not 0 < len(at) <= _WRONG * len(x) or len(at) < _BRIEF * int(two.sum()):
        return x, np.empty(0, dtype=int)
    x = x.copy()
    x[at] = x[at - 1]
    return x, at


def without_jumps(t: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """An angle that goes on where it was when its reading jumps.

    A jump is longer than every other step of the run, and differs from those before and after it by far more than any
    other does.

    Args:
        t: Time [s], shape (N,); a step over missing samples counts as the mean change from one to the next.
        q: Angle or displacement, shape (N,).

    Returns:
        The angle, moved back after each jump, and the samples after which it jumps.
    """
    none = q, np.empty(0, dtype=int)
    if len(q) < 4 * _JUMPS:
        return none
    long = np.diff(t) / max(float(np.median(np.diff(t))), 1e-300)
    step = np.pad(np.diff(q) / np.maximum(long, 1.0), 1, mode="edge")  # from sample to sample, where some are missing
    excess = step[1:-1] - 0.5 * (step[:-2] + step[2:])
    left, jumps = np.abs(excess), list[int]()
    for _ in range(_JUMPS):
        jumps.append(int(left.argmax()))
        least = np.abs(excess[jumps]).min()
        left[max(jumps[-1] - 1, 0) : jumps[-1] + 2] = 0.0  # the steps next to it differ from it by as much
        if least > _AWAY * left.max() > 0.0:
            break
    else:
        return none
    at = np.sort(jumps)
    moved = np.zeros(len(q))
    moved[at + 1] = excess[at]
    back = q - np.cumsum(moved)
    size, others = np.abs(step[1:-1])[at], np.abs(np.delete(step[1:-1], at))
    alone = size.min() > max(_SMOOTH * others.max(), _COUNTS * others[others > 0.0].min(initial=np.inf))
    return (back, at) if alone else none


def replace_wrong_readings(
    label: str, run: dict[str, np.ndarray], units: Units, lengths: Sequence[float]
) -> list[Repair]:
    """Replace single wrong readings of motion and control input in the columns of a run; notes on them.

    ``lengths`` are those after which readings of the angle may begin again.
    """
    found = []
    for key in (key for key in ("q", "qd", "current") if key in run):
        before, commanded = run[key], key == "current" and is_command(run[key])
        if commanded:
            run[key], at = without_brief_pulses(before)
        else:
            run[key], at = without_wrong_readings(before, lengths if key == "q" else ())
        if len(at):
            far, where = float(np.abs(before - run[key]).max()), tuple(float(t) for t in run["t"][at[:10]])
            places = ", ".join(f"{t:.4g}" for t in where[:3]) + (", ..." if len(at) > 3 else "")
            what = quantity(key, {key: units.base(key)}) if key == "current" else "joint"
            text = (
                f"{len(at)} single readings of {key} go off by up to {with_unit(f'{far:.3g}', units.base(key))} and "
                f"come back at once, as no {what} does (at {places} s): the "
                f"{'level before them' if commanded else 'middle of their neighbours'} takes their place"
            )
            found.append(Repair(trajectory=label, kind="replaced", count=len(at), at=where, text=text))
    return found


def undo_jumps(label: str, run: dict[str, np.ndarray], units: Units) -> tuple[list[slice], list[Repair]]:
    """Move the angle of a run back where it alone jumps; where more does, the run is two runs.

    Where an encoder slips or is set to zero, speed, torque and control input go on as they were. Where they change by
    more than anywhere else in the run, another run begins. Where the reading stood still before, it was stuck. A jump
    that is longer than the run's motion stays as it is: a joint that rests but for one quick move does not jump. Where
    the velocity was logged and does not move, it does.

    Returns:
        The samples of each run that is in it, and a note.
    """
    whole, (back, at) = [slice(0, len(run["q"]))], without_jumps(run["t"], run["q"])
    if not len(at):
        return whole, []
    speed, change = np.diff(back), np.zeros(len(back) - 1)
    stood = [_stood(run["q"], int(k)) for k in at]
    bounds = [0, *(x for k, long in zip(at, stood, strict=True) for x in (int(k) + 1 - long, int(k) + 1)), len(back)]
    pieces = [slice(*bounds[k : k + 2]) for k in range(0, len(bounds), 2)]
    means = np.convolve(speed, np.full(_AROUND, 1.0 / _AROUND), "valid")
    change[_AROUND:-_AROUND] = means[_AROUND + 1 :] - means[: -_AROUND - 1]
    names = {key: quantity(key, {key: units.base(key)}) for key in ("current", "torque")}
    changes = {"speed": change, **{name: np.diff(run[key]) for key, name in names.items()}}
    with_it = [name for name, x in changes.items() if _stands_out(np.abs(x), at)]
    size, where = float(np.abs(np.diff(run["q"]))[at].max()), tuple(float(t) for t in run["t"][at])
    after = f"(after {', '.join(f'{t:.4g}' for t in where)} s)"
    if any(stood):
        text = (
            f"q stands still and then jumps by up to {with_unit(f'{size:.3g}', units.base('q'))} {after}, as a reading "
            f"that was stuck: {sum(stood)} samples before the jumps are left out, the rest is separated there"
        )
        return pieces, [Repair(trajectory=label, kind="split", count=len(at), at=where, text=text)]
    if with_it:
        text = (
            f"q jumps by up to {with_unit(f'{size:.3g}', units.base('q'))} {after}, and {' and '.join(with_it)} with "
            "it, as where two runs stand in one file: they are separated; give each its own 'trajectory' id"
        )
        return pieces, [Repair(trajectory=label, kind="split", count=len(at), at=where, text=text)]
    if size >= np.ptp(back) and not _stays(run, at):
        return whole, []
    moved = float(np.abs(np.diff(run["q"] - back)).max())
    run["q"] = back
    text = (
        f"q jumps {len(at)} times, by up to {with_unit(f'{moved:.3g}', units.base('q'))} {after}, and nothing else "
        "with it, as where an encoder slips or is set to zero: it goes on from where it was; mount the encoder firmly; "
        "do not trust what depends on the place"
    )
    return whole, [Repair(trajectory=label, kind="shifted", count=len(at), at=where, text=text)]


def _stood(q: np.ndarray, k: int) -> int:
    """Samples up to the k-th that only repeat the one before them, where the joint moves after it; else 0."""
    long = int(np.argmax(np.append(q[k::-1] != q[k], True))) - 1
    moves = np.abs(q[k + 1 + _AROUND :][:1] - q[k + 1]) if k + 2 < len(q) else np.zeros(1)
    return long if long >= _STUCK and moves.sum() > _AROUND * _CREEPS * np.abs(np.diff(q[: k + 1])).max() else 0


def _stays(run: dict[str, np.ndarray], at: np.ndarray) -> bool:
    """Whether the velocity that was logged moves by next to nothing where the angle jumps after some samples."""
    if "qd" not in run:
        return False
    moved = np.maximum(np.abs(run["qd"][at]), np.abs(run["qd"][at + 1])) * np.diff(run["t"])[at]
    return bool((moved < _CREEPS * np.abs(np.diff(run["q"]))[at]).all())


def _stands_out(size: np.ndarray, at: np.ndarray) -> bool:
    """Whether a change from sample to sample is clearly larger at one of some places than anywhere not near them."""
    near = np.abs(np.arange(len(size))[:, None] - at).min(axis=1) <= 2 * _AROUND
    return bool(size[at].max() > _MORE * size[~near].max(initial=0.0))


def unwrapped(t: np.ndarray, q: np.ndarray, periods: Sequence[float]) -> tuple[np.ndarray, int, float]:
    """An angle that goes on where its reading begins again.

    Args:
        t: Time [s], shape (N,); nothing is continued over a gap.
        q: Angle or displacement, shape (N,).
        periods: Lengths after which readings may begin again, in the unit of ``q``, the shortest first.

    Returns:
        The angle, continued from its first sample; how often the reading began again; and the period (0: never).
    """
    if len(t) < 3:
        return q, 0, 0.0
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


def wrap_length(t: np.ndarray, q: np.ndarray, unit: float = 1.0) -> float:
    """Length after which a reading begins again, by its jumps alone; 0 where it does not.

    Each such jump is nearly as long as all readings cover, leads from one of their ends to the other, and goes against
    the motion before and after it.

    Args:
        t: Time [s], shape (N,); a jump over a gap is none.
        q: Angle or displacement, shape (N,).
        unit: One of what was logged, in the unit of ``q``: such a length is a round number of these.
    """
    reach = float(np.ptp(q))
    if len(q) < 4 * _AROUND or reach == 0.0:
        return 0.0
    step, long = np.diff(q), np.diff(t) / max(float(np.median(np.diff(t))), 1e-300)
    jumps = (np.abs(step) > 0.5 * reach) & (long < _GAP)
    at = np.flatnonzero(jumps)
    at = at[(at >= _AROUND) & (at + _AROUND + 1 < len(q))]
    others = np.abs(step[~jumps])
    usual = float(others.max(initial=0.0))
    if not len(at) or len(at) > _SLOW * len(q) or not 0.0 < usual < _SLOW * reach:
        return 0.0
    near = [np.concatenate([step[k - _AROUND : k], step[k + 1 : k + 1 + _AROUND]]) for k in at]
    motion = np.array([x[np.abs(x) < 0.5 * reach].mean() if (np.abs(x) < 0.5 * reach).any() else 0.0 for x in near])
    length = np.abs(step[at] - motion * long[at])
    period = float(np.median(length))
    inside = [q[k] > q.max() - _EDGE * usual or q[k] < q.min() + _EDGE * usual for k in at]
    inside = np.array(inside) & (np.abs(np.abs(q[at + 1] - q[at]) - reach) < 2.0 * _EDGE * usual)
    against = motion * step[at] < 0.0
    similar = np.abs(length - period) < _EDGE * usual
    if not (similar.all() and inside.all() and against.mean() > 0.5):
        return 0.0
    error = float(np.abs(length - period).mean()) / np.sqrt(len(at)) + 1e-5 * period
    return unit * _round_length(period / unit, error / unit)


def _round_length(length: float, error: float) -> float:
    """The likeliest length near one that was read off with an error: turns, a power of two, else one of few digits."""
    for near in (*(np.pi * turns for turns in (1, 2, 4, 8)), 2.0 ** np.rint(np.log2(length))):
        if abs(length - near) <= max(error, _ROUND * length):
            return float(near)
    near = float(f"{length:.3g}")
    return near if abs(length - near) <= max(_EDGE * error, _ROUND * length) else length


def unwrap(
    label: str, run: dict[str, np.ndarray], units: Units, lengths: Sequence[float]
) -> tuple[float, list[Repair]]:
    """Let the angle of a run go on where its reading begins again, after one of some lengths.

    Returns:
        The length, 0 where it never does, and a note.
    """
    run["q"], wraps, period = unwrapped(run["t"], run["q"], lengths)
    if not wraps:
        return 0.0, []
    turn = np.isclose(period, 2.0 * np.pi)
    counted = f"{period / units.convert('q', np.ones(1))[0]:g} {units.declared['q']}"
    text = f"the {'angle' if turn else 'reading of q'} begins again after {'a turn' if turn else counted} "
    text += f"({wraps} times): it goes on from its start"
    return period, [Repair(trajectory=label, kind="unwrapped", count=wraps, text=text)]


def in_one_turn(angles: Sequence[np.ndarray], period: float) -> list[np.ndarray]:
    """Angles of several runs, moved by whole periods so that their medians are nearest to the first one's.

    Where a reading begins again, a run may begin on either side of that place though the joint is where it was.
    """
    middle = float(np.median(angles[0]))
    turns = [float(np.rint((middle - np.median(q)) / period)) for q in angles]
    return [q + period * turn if turn else q for q, turn in zip(angles, turns, strict=True)]


def integrated(qd: np.ndarray, dt: float) -> np.ndarray:
    """Angle from a speed, by trapezoids, from 0; shape (N,)."""
    return np.concatenate([[0.0], np.cumsum(0.5 * dt * (qd[1:] + qd[:-1]))])
