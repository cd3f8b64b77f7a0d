"""Whether orientation, gyroscope, accelerometer and motion capture of a trunk show one motion, before any replay.

Over a tenth of a second the mean of the gyroscope is the change of the orientation, and the mean of the velocity that
of the position. Where a channel contradicts that, other readings are tried on the log: units, signs, axes, the order of
a quaternion. The ones that explain it are reported with their share. The mean of the accelerometer in the world's axes
is gravity, but for the change of the speed over the time: it says which of two readings is right.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import permutations, product
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.spatial.transform import Rotation

from mrwarp.robot_logs.causes.of_channels import EXPLAINED, LATE, LEANS, SMOOTHED, STANDSTILL
from mrwarp.robot_logs.channels.torque_channel import regressed
from mrwarp.robot_logs.robot_log import STANDARD_GRAVITY, UNITS, LogError, LogRun, RobotLog
from mrwarp.sysid.jackknife import jackknife, student
from mrwarp.sysid.left_out import in_a_row
from mrwarp.sysid.settings import Settings

PAIRS = {"gyro": "quat", "vel": "pos"}
"""Channels that are the change of another one."""

ORDERS: dict[str, Callable[[np.ndarray], np.ndarray]] = {
    "": lambda q: q,
    "quat is x, y, z, w (write w first)": lambda q: np.roll(q, 1, axis=1),
    "quat turns the world's axes into the trunk's (change the signs of x, y, z)": lambda q: q * [1.0, -1.0, -1.0, -1.0],
}
"""Other readings of an orientation's columns, as w, x, y, z that turn the trunk's axes into the world's."""


class Agreement(NamedTuple):
    """How far one motion is another."""

    share: float
    """Share of the variance of the axis that follows least [1]; negative where it turns the other way."""
    factor: float
    """Of the first to the second; 1 where their errors may be what differs from it."""
    moving: np.ndarray
    """Axes along which one of them moves, or that clearly belong together, shape (3,)."""


class Reading(NamedTuple):
    """A way to read two channels by which they show one motion."""

    says: str
    """Meaning, with the remedy."""
    changes: int
    """Changes that it asks for."""
    share: float
    """See :class:`Agreement`."""
    order: str = ""
    """Reading of the orientation, of :data:`ORDERS`."""


def one_trunk(log: RobotLog, settings: Settings) -> RobotLog:
    """The log without readings of the trunk's motion that contradict the others, with a note on each.

    A note, too, where nothing says how the trunk leans.

    Raises:
        LogError: orientation and gyroscope contradict each other, and the orientation may be what is wrong.
    """
    if log.base != "free":
        return log
    notes, out = [], []
    if blind := [run.id for run in log.runs if "quat" not in run.base]:
        notes.append(f"no quat in {', '.join(blind)}: the trunk is taken as level there; log it where the robot leans")
    for channel in PAIRS:
        if text := _contradiction(log, channel, settings):
            out.append(channel)
            notes.append(f"{channel} {text}; it is left out")
    if text := _gravity(log, settings):
        notes.append(f"acc {text}; no replay depends on acc")
    if not notes:
        return log
    runs = tuple(replace(run, base={c: x for c, x in run.base.items() if c not in out}) for run in log.runs)
    return replace(log, runs=runs, notes=(*log.notes, *notes))


def _contradiction(log: RobotLog, channel: str, settings: Settings) -> str:
    """Why a channel is not the change of its other, in words; empty where it is.

    Raises:
        LogError: the orientation may be what is wrong.
    """
    of, parts, tolerated = PAIRS[channel], settings.robot.parts, settings.gain.detail
    runs = [run for run in log.runs if channel in run.base and of in run.base]
    runs = [run for run in runs if round(SMOOTHED / run.dt) > 2]  # slower rows do not show how a trunk shakes
    if not runs:
        return ""
    motion = _motions(runs, channel, ORDERS[""])
    seen, own = motion["seen"], motion[""]
    if len(seen) <= parts:
        return ""
    if not any(np.ptp(run.base[of], axis=0).any() for run in runs) and seen.std(axis=0).max() > STANDSTILL:
        raise LogError(f"{log.path}: {of} stands still while {channel} moves; leave {of} out")
    fit = agreed(*moments(seen, own), tolerated)
    turned = _turned(seen, own, channel, parts)
    if fit.share >= settings.gain.half and fit.factor == 1.0 and turned is None:
        return (_late(runs, channel, parts) or _of_other(motion, channel, settings)) if fit.moving.any() else ""
    motions = {"": motion}
    if of == "quat":
        motions |= {order: _motions(runs, channel, read) for order, read in ORDERS.items() if order}
    found = [x for order, own in motions.items() for x in _readings(own, order, channel, tolerated)]
    found = found or ([] if turned is None else [turned])
    what = f"is not the change of {of} (to {100.0 * max(fit.share, 0.0):.0f} %, and {fit.factor:.3g} times)"
    if not found:
        return f"{what}, and no other axes, signs, order or unit explain it"
    few = min(reading.changes for reading in found)
    likely = _by_gravity(log, [reading for reading in found if reading.changes == few], settings)
    said = " or ".join(dict.fromkeys(x.says for x in likely))
    text = f"{what}, but is it (to {100.0 * max(x.share for x in likely):.0f} %) if {said}"
    if any(x.order for x in likely):
        raise LogError(f"{log.path}: {channel} {text}; correct it, or leave {channel} out")
    return text


def _motions(runs: Sequence[LogRun], channel: str, read: Callable[[np.ndarray], np.ndarray]) -> dict[str, np.ndarray]:
    """The mean of a channel as ``seen``, and the change that it should be by whose axes it may be in, (M, 3) each.

    Under "" are the axes of the contract.
    """
    found: dict[str, list[np.ndarray]] = {}
    for run in runs:
        t, step = run.t, min(round(SMOOTHED / run.dt), run.samples - 2)
        time = (t[step:] - t[:-step])[:, None]
        path = cumulative_trapezoid(run.base[channel], t, axis=0, initial=0.0)
        turn = Rotation.from_quat(np.roll(read(run.base["quat"]), -1, axis=1)) if "quat" in run.base else None
        if channel == "vel":
            own = (run.base["pos"][step:] - run.base["pos"][:-step]) / time
            other = {} if turn is None else {"trunk": turn[step // 2 : step // 2 + len(own)].inv().apply(own)}
        else:
            assert turn is not None
            own = (turn[:-step].inv() * turn[step:]).as_rotvec() / time
            other = {"world": turn[:-step].apply(own)}
        whole = time[:, 0] < 1.5 * step * run.dt
        for name, x in ({"": own, "seen": (path[step:] - path[:-step]) / time} | other).items():
            found.setdefault(name, []).append(x[whole])
    return {name: np.concatenate(x) for name, x in found.items() if len(x) == len(runs)}


def moments(seen: np.ndarray, own: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Standard deviations of two motions, (3,) each, and the correlations of their axes, (3, 3)."""
    width, spread = np.maximum(seen.std(axis=0), 1e-12), np.maximum(own.std(axis=0), 1e-12)
    both = (seen - seen.mean(axis=0)).T @ (own - own.mean(axis=0)) / len(seen)
    return width, spread, both / np.outer(width, spread)


def agreed(
    width: np.ndarray,
    spread: np.ndarray,
    r: np.ndarray,
    tolerated: float,
    axes: tuple[int, ...] = (0, 1, 2),
    signs: Sequence[float] = (1.0, 1.0, 1.0),
) -> Agreement:
    """How far two motions of these moments agree where the axes of the second are in an order, with signs.

    Both have errors, so that the factor of an axis lies between their two regressions (Frisch 1934). Where neither
    moves they agree.
    """
    spread, r = spread[list(axes)], r[range(3), axes] * signs
    factor = float(np.linalg.norm(width) / np.linalg.norm(spread))
    moving = (np.maximum(spread, width / factor) > STANDSTILL) | (r**2 > EXPLAINED)
    if not moving.any():
        return Agreement(1.0, 1.0, moving)
    ratio, size = (width / spread)[moving], np.maximum(np.abs(r[moving]), 1e-6)
    one = (size * ratio < 1.0 + tolerated) & (ratio / size > 1.0 - tolerated)
    return Agreement(float((r * np.abs(r))[moving].min()), 1.0 if one.all() else factor, moving)


def _axes() -> Iterator[tuple[tuple[int, ...], tuple[float, ...]]]:
    """Orders of three axes with their signs, that of the contract first."""
    return product(permutations(range(3)), product((1.0, -1.0), repeat=3))


def _readings(motion: Mapping[str, np.ndarray], order: str, channel: str, tolerated: float) -> Iterator[Reading]:
    """Readings by which a channel is the change of its other, where the orientation is read in one way."""
    for frame in [name for name in motion if name != "seen"]:
        known = moments(motion["seen"], motion[frame])
        for axes, signs in _axes():
            fit = agreed(*known, tolerated, axes, signs)
            if fit.share < EXPLAINED:
                continue
            other = [k for k in np.flatnonzero(fit.moving).tolist() if axes[k] != k or signs[k] < 0.0]
            plain = all(axes[k] == k for k in other)
            mirrored = np.linalg.det(np.eye(3)[list(axes)]) * np.prod(signs) < 0.0 and not plain
            says = [order] if order else []
            says += [f"{channel} is in the {frame}'s axes (turn it by quat)"] if frame else []
            if other:
                moved = ", ".join(f"{'xyz'[k]} is {'-' if signs[k] < 0.0 else ''}{'xyz'[axes[k]]}" for k in other)
                says.append(f"of {channel} {moved} (write each axis under its own name and sign)")
            says += [_unit(channel, fit.factor)] if fit.factor != 1.0 else []
            yield Reading(" and ".join(says), len(says) + mirrored, fit.share, order)


def _unit(channel: str, factor: float) -> str:
    """A factor of a channel in words, with the unit that has it."""
    own = [unit for unit, size in UNITS[channel].items() if abs(size * factor - 1.0) < 0.1 and size != 1.0]
    what = f"{channel} counts {factor:.3g} times the motion"
    return f'{what} (declare "units": {{"{channel}": "{own[0]}"}})' if own else f"{what} (another unit or other stamps)"


def _turned(seen: np.ndarray, own: np.ndarray, channel: str, parts: int) -> Reading | None:
    """A reading by which the sensor is turned on the trunk, clearly further than a mounting errs; None where not.

    The rotation of least squares (Kabsch 1976), drawn to none by a hundredth of the motion: an axis about which nothing
    moves shows no rotation.
    """
    x, y = own - own.mean(axis=0), seen - seen.mean(axis=0)

    def solved(c: np.ndarray) -> Rotation:
        u, _, v = np.linalg.svd(c + 0.01 * np.linalg.norm(c, "nuc") * np.eye(3))
        return Rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v)

    grams = np.stack([y[f].T @ x[f] for f in in_a_row(len(y), parts)])
    whole = solved(grams.sum(axis=0))
    least = np.stack([solved(grams.sum(axis=0) - g).as_rotvec() for g in grams])
    half = student(0.95, parts - 1) * float(np.sqrt(np.trace(jackknife(least))))
    angle = float(whole.magnitude())
    fit = agreed(*moments(seen, whole.apply(own)), EXPLAINED)
    if angle - half < LEANS or fit.share < EXPLAINED:
        return None
    axis = ", ".join(f"{a:.2f}" for a in np.round(whole.inv().as_rotvec() / angle, 2) + 0.0)
    says = f"it is turned by {np.degrees(angle):.0f}° about ({axis}) (the sensor sits turned the other way)"
    return Reading(says, 1, fit.share)


def _late(runs: Sequence[LogRun], channel: str, parts: int) -> str:
    """By how much a channel comes after or before the change of its other, in words; empty where it does not.

    By the least squares of their difference over shifts by rows, a parabola's, with a jackknife over parts.
    """
    dt = float(np.median([run.dt for run in runs]))
    most = round(2.0 * SMOOTHED / dt)
    shifts, sums = np.arange(-most, most + 1), np.zeros((parts, 2 * most + 1))
    for run in runs:
        motion = _motions([run], channel, ORDERS[""])
        inner = np.arange(most, len(motion["seen"]) - most)
        for own, f in zip(sums, in_a_row(len(inner), parts) if len(inner) > parts else (), strict=False):
            own += [-((motion["seen"][inner[f]] - motion[""][inner[f] - k]) ** 2).sum() for k in shifts]

    def top(r: np.ndarray) -> float:
        k = int(np.clip(np.argmax(r), 1, len(r) - 2))
        bend = r[k - 1] - 2.0 * r[k] + r[k + 1]
        return dt * float(shifts[k] + 0.5 * (r[k - 1] - r[k + 1]) / min(bend, -1e-300))

    late = top(sums.sum(axis=0))
    each = np.array([[top(sums.sum(axis=0) - own_)] for own_ in sums])
    half = student(0.95, parts - 1) * float(np.sqrt(jackknife(each)[0, 0]))
    if abs(late) - half <= LATE:
        return ""
    when = "after" if late > 0.0 else "before"
    return f"comes {1e3 * abs(late):.0f} ms {when} the change of {PAIRS[channel]}: one is filtered, or of another clock"


def _of_other(motion: Mapping[str, np.ndarray], channel: str, settings: Settings) -> str:
    """Whose axes a channel is in if not its own, in words; empty where it is in its own, or the log does not show it.

    Where both have nearly the same axes the channel looks like its own motion. What it differs from that by then still
    is their difference; what a mounting turns does not count.
    """
    frame, seen, own = next((name for name in motion if name not in ("", "seen")), ""), motion["seen"], motion[""]
    if not frame:
        return ""
    turned = [np.cross(axis, own) for axis in np.eye(3)]
    y, *references = ((x - x.mean(axis=0)).ravel() for x in (seen - own, motion[frame] - own, *turned))
    fit = regressed(y, references[:1], references[1:], settings.robot.parts)
    if fit.value[0] - fit.half[0] < settings.gain.half or fit.explained < settings.gain.half:
        return ""
    return f"is in the {frame}'s axes (turn it by quat), which are nearly its own here"


def _leans(log: RobotLog, order: str, parts: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean accelerometer and what gravity is in the trunk's axes, in units of gravity, of parts of each recording."""
    seen, up = [], []
    for run in log.runs:
        if "acc" in run.base and "quat" in run.base:
            turn = Rotation.from_quat(np.roll(ORDERS[order](run.base["quat"]), -1, axis=1))
            own = turn.inv().apply([0.0, 0.0, 1.0])
            for f in in_a_row(run.samples, parts):
                seen.append(run.base["acc"][f].mean(axis=0) / STANDARD_GRAVITY)
                up.append(own[f].mean(axis=0))
    return np.array(seen).reshape(-1, 3), np.array(up).reshape(-1, 3)


def _by_gravity(log: RobotLog, found: Sequence[Reading], settings: Settings) -> list[Reading]:
    """Those of several readings that the accelerometer does not contradict more than another."""
    left = []
    for reading in found:
        seen, up = _leans(log, reading.order, settings.robot.parts)
        left.append(float(((seen - up) ** 2).sum()))
    return [x for x, own in zip(found, left, strict=True) if settings.gain.half * own <= min(left)]


def _gravity(log: RobotLog, settings: Settings) -> str:
    """Why the accelerometer does not show gravity where the orientation has it, in words; empty where it does.

    Raises:
        LogError: by the orientation the trunk is upside down, by the accelerometer it is not.
    """
    seen, up = _leans(log, "", settings.robot.parts)
    half = settings.gain.half
    if not len(seen) or np.linalg.norm((seen - up).mean(axis=0)) < half:
        return ""
    if np.linalg.norm(seen.mean(axis=0)) < half:
        return "holds no gravity: an estimate of the motion's part"
    left = {(axes, signs): float(((seen - np.array(signs) * up[:, axes]) ** 2).mean()) for axes, signs in _axes()}
    axes, signs = min(left, key=lambda x: left[x])
    where = ", ".join(f"{x:.1f}" for x in STANDARD_GRAVITY * seen.mean(axis=0))
    should = ", ".join(f"{x:.1f}" for x in STANDARD_GRAVITY * up.mean(axis=0))
    what = f"has a mean of ({where}) m/s², gravity by quat is ({should})"
    if up[:, 2].mean() < -half and seen[:, 2].mean() > half:
        raise LogError(
            f"{log.path}: by quat the trunk is upside down, by acc it is not ({where} m/s²): write quat for a world "
            "whose z points up, or leave acc out"
        )
    k = int(np.argmax(np.abs(up.mean(axis=0))))
    at = axes.index(k)
    if left[axes, signs] > half**2:
        return f"{what}, and no other axes or signs explain it"
    down = "; or quat and gyro, too, are of axes that point down, and have to be written in axes that point up"
    turned = down if at == k == 2 and signs[at] < 0.0 else ""
    return f"{what}: its {'xyz'[at]} is {'-' if signs[at] < 0.0 else ''}{'xyz'[k]}{turned}"
