"""Derivatives of replays by parameters and starts, and the quadratic forms of windows that follow from them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE, DRIVE
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.window_replay import ParameterBatch, Replay, nuisances
from mrwarp.robot_logs.windows import Windows, mismatch, side_by_side

START_SPREAD = 1.0
"""Standard deviation of a window's start, in the steps of :func:`mrwarp.robot_logs.window_replay.nuisances`."""

DERIVATIVE_STEP = 0.0051
"""Longest physics step of the replays from which derivatives are taken [s]; mismatches are those of the fine step."""

CENTRAL_SHARE = 0.1
"""Steps of central derivatives, in the parameters' own."""

AT_ONCE = 3200
"""Windows times robots that are replayed before their readings are put by."""

CREEP = 0.004
"""Standard deviation of a slow drift of joints of a robot on its feet, over a window [rad/s]: in simulations and on
soft soles feet that stick creep, and how fast none agree on. The virtual robot's hips drift by up to 0.002 rad/s while
it stands."""

LEAN = 0.002
"""Standard deviation of an inertial unit's roll and pitch, over a window, in addition to those of the session [rad]:
its filter wanders, the virtual robot's by as much."""


@dataclass(frozen=True, kw_only=True)
class Slopes:
    """Derivatives of the replays of a group's W windows, all N readings of a window in one row, channel by channel."""

    layout: dict[str, tuple[int, int]]
    """Samples and columns of each channel, by name."""
    j: np.ndarray
    """By parameter, shape (W, P, N)."""
    z: np.ndarray
    """By the window's start, per step of it, and by what wanders in a window of a free robot, shape (W, Z, N)."""
    windows: Windows
    """The windows, with the steps of the replays from which derivatives are taken."""
    about: np.ndarray
    """Parameters at which derivatives are taken, shape (P,)."""
    base: np.ndarray
    """Mismatch of these replays where derivatives are taken, 0 where there is no reading, shape (W, N)."""

    def scale(self, sigma: dict[str, np.ndarray]) -> np.ndarray:
        """Rest of each channel, one number a reading, shape (N,)."""
        return np.concatenate([np.tile(sigma[name], samples) for name, (samples, _) in self.layout.items()])

    def channels(self, x: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
        """Rows of readings by channel: (..., N) to (..., S, C)."""
        at = 0
        for name, (samples, columns) in self.layout.items():
            yield name, x[..., at : at + samples * columns].reshape(*x.shape[:-1], samples, columns)
            at += samples * columns

    def at(self, windows: Windows) -> np.ndarray:
        """Where each of some windows of the log is among these, -1 where it is not, shape (W,)."""
        place = {
            key: k for k, key in enumerate(zip(self.windows.run.tolist(), self.windows.start.tolist(), strict=True))
        }
        return np.array([place.get(key, -1) for key in zip(windows.run.tolist(), windows.start.tolist(), strict=True)])

    @cached_property
    def blocks(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Readings that the same numbers move: those parameters, those of the start, and the readings, by index."""
        groups: dict[bytes, tuple[np.ndarray, list[np.ndarray]]] = {}
        at = 0
        moved = [dict(self.channels(x)) for x in (self.j, self.z)]
        for name, (samples, columns) in self.layout.items():
            by = np.concatenate([(x[name] != 0.0).any(axis=(0, 2)) for x in moved])  # (P + Z, C)
            for c in range(columns):
                _, readings = groups.setdefault(by[:, c].tobytes(), (by[:, c], []))
                readings.append(at + c + columns * np.arange(samples))
            at += samples * columns
        count = self.j.shape[1]
        return [
            (np.flatnonzero(by[:count]), np.flatnonzero(by[count:]), np.sort(np.concatenate(readings)))
            for by, readings in groups.values()
        ]

    def reduced(self, rows: np.ndarray, sigma: dict[str, np.ndarray]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Quadratic forms of the windows about their theta, the starts eliminated.

        Args:
            rows: Mismatch of each window, shape (W, N).
            sigma: What is left in each channel, by name, shape (C,).

        Returns:
            Information (W, P, P), score (W, P), and weighted squared mismatch, (W,).
        """
        count, params, starts = *self.j.shape[:2], self.z.shape[1]
        scale, size = self.scale(sigma), params + 1 + starts
        a, b, c = np.zeros((count, params, params)), np.zeros((count, params)), np.zeros(count)
        for w in range(count):
            g = np.zeros((size, size))
            for own, start, readings in self.blocks:
                parts = self.j[w][np.ix_(own, readings)], rows[w : w + 1, readings], self.z[w][np.ix_(start, readings)]
                x = np.concatenate(parts) / scale[readings]  # float64: the start takes most of it
                at = np.concatenate([own, [params], params + 1 + start])
                g[np.ix_(at, at)] += x @ x.T
            across, start = g[: params + 1, params + 1 :], g[params + 1 :, params + 1 :]
            start = start + np.eye(starts) / START_SPREAD**2
            left = g[: params + 1, : params + 1] - across @ np.linalg.solve(start, across.T)
            a[w], b[w], c[w] = left[:params, :params], left[:params, params], left[params, params]
        return a, b, c


def completed(
    known: Sequence[Slopes],
    model: ReplayModel,
    windows: Windows,
    parameters: list[Parameter],
    theta: np.ndarray,
    log: Callable[[str], None],
) -> Slopes:
    """Derivatives of a group's replays about ``theta``, (P,), of which those of some windows may be ``known``.

    Other arguments are those of :func:`slopes_of`.
    """
    near = {name: x.shape[1:] for name, x in mismatch(windows.measured, windows.measured).items()}
    for slopes in (x for x in known if x.layout == near):
        at = slopes.at(windows)
        new, old = np.flatnonzero(at < 0), np.flatnonzero(at >= 0)
        if not len(old):
            continue
        rest = slopes_of(model, windows.some(new), parameters, theta, log) if len(new) else None
        order = np.argsort(np.concatenate([old, new]))

        def both(name: str) -> np.ndarray:
            own = getattr(slopes, name)[at[old]]  # noqa: B023
            return own if rest is None else np.concatenate([own, getattr(rest, name)])[order]  # noqa: B023

        rows = {name: both(name) for name in ("j", "z", "base")}
        return Slopes(layout=near, windows=_long_steps(windows), about=theta, **rows)
    return slopes_of(model, windows, parameters, theta, log)


def _long_steps(windows: Windows) -> Windows:
    """Windows with the steps of the replays from which derivatives are taken."""
    return windows.coarse(max(1, int(np.floor(DERIVATIVE_STEP / windows.h + 1e-6))))


def slopes_of(
    model: ReplayModel,
    windows: Windows,
    parameters: list[Parameter],
    theta: np.ndarray,
    log: Callable[[str], None],
) -> Slopes:
    """Derivatives of a group's replays about ``theta``, (P,), many changed robots at once.

    Limbs that do not move each other share replays: one robot has a number of each of them changed. What the
    strength of a drive changes is the sum of what its gains change, where these make all of its torque.
    """
    replay = Replay(model, _long_steps(windows))
    steps, count, drawn = nuisances(model), windows.count, _sums(windows, parameters)
    own = [k for k, p in enumerate(parameters) if k not in drawn and p.declared.reads is None]
    central = [i for i, k in enumerate(own) if parameters[k].declared.central]
    width = np.array([(CENTRAL_SHARE if p.declared.central else 1.0) * p.step for p in parameters])
    ahead, total = np.diag(width)[own], len(own)
    changes = np.concatenate([ahead, -ahead[central], np.zeros((len(steps), len(parameters)))])
    starts = np.concatenate([np.zeros((total + len(central), len(steps))), np.diag(steps)])
    seen, limbs = windows.measured, _Limbs(model)
    layout = {name: x.shape[1:] for name, x in mismatch(seen, seen).items()}
    places = [parameters[k].where for k in own]
    places += [places[i] for i in central] + (["robot"] * len(steps) if model.free else list(model.joints) * 2)
    robot = limbs.shared(places)
    values, begins = (np.zeros((robot.max() + 2, x.shape[1])) for x in (changes, starts))
    np.add.at(values, robot, changes)
    np.add.at(begins, robot, starts)
    values += theta  # the last robot is unchanged
    rows, at_once = [], max(1, AT_ONCE // count, replay.at_once // count)
    for first in range(0, len(values), at_once):
        part = np.arange(first, min(first + at_once, len(values)))
        log(f"{first} of {len(values)} robots, {count} windows each")
        near = ParameterBatch.of(parameters, np.repeat(values[part], count, axis=0), model)
        rows.append(replay.left(near, np.tile(np.arange(count), len(part)), np.repeat(begins[part], count, axis=0)))
    x = np.concatenate(rows).reshape(len(values), count, -1)
    rise = x[-1] - x[robot]  # mismatches fall by what readings rise
    for place, of_one in zip(places, rise, strict=True):
        of_one[:, ~limbs.moved(place, layout)] = 0.0
    rise[central] = 0.5 * (rise[central] - rise[total : total + len(central)])
    j, z = np.zeros((len(parameters), *rise.shape[1:]), dtype=rise.dtype), rise[total + len(central) :]
    j[own] = rise[:total] / width[own, None, None].astype(np.float32)
    for k, gains in drawn.items():
        j[k] = j[gains].sum(axis=0)
    _of_readings(j, windows, parameters, theta, layout, x[-1])
    if model.free:
        z = np.concatenate([z, _wandering(windows)])
    for values in (j, z):
        np.nan_to_num(values, copy=False, posinf=0.0, neginf=0.0)
    base = np.where(np.isnan(side_by_side(mismatch(seen, seen))), 0.0, x[-1])
    j, z = (np.ascontiguousarray(values.swapaxes(0, 1)) for values in (j, z))
    return Slopes(layout=layout, j=j, z=z, windows=replay.windows, about=theta, base=base)


def _of_readings(
    j: np.ndarray,
    windows: Windows,
    parameters: list[Parameter],
    theta: np.ndarray,
    layout: dict[str, tuple[int, int]],
    left: np.ndarray,
) -> None:
    """Write derivatives by what acts on readings of the torque alone, in j (P, W, N); ``left`` (W, N) is at ``theta``.

    They follow from the torque that is replayed there, without a replay of their own.
    """
    if "tau" not in layout:
        return
    names = list(layout)
    first = sum(samples * columns for samples, columns in list(layout.values())[: names.index("tau")])
    samples, columns = layout["tau"]
    own = slice(first, first + samples * columns)
    torque = windows.measured["tau"] - left[:, own].reshape(windows.count, samples, columns)
    gravity, reading = windows.gravity_read, [k for k, p in enumerate(parameters) if p.declared.reads is not None]
    nothing, one = np.zeros_like(torque), np.ones_like(torque)
    add, times = nothing.copy(), one.copy()
    for k in reading:
        p, reads = parameters[k], parameters[k].declared.reads
        assert reads is not None
        at_rest = reads(nothing, gravity)[..., p.index]
        add[..., p.index] += theta[k] * at_rest
        times[..., p.index] += theta[k] * (reads(one, gravity)[..., p.index] - at_rest)
    torque = (torque - add) / times
    for k in reading:
        p, reads = parameters[k], parameters[k].declared.reads
        assert reads is not None
        found = np.zeros_like(torque)
        found[..., p.index] = reads(torque, gravity)[..., p.index]
        j[k][:, own] = found.reshape(windows.count, -1)


def _sums(windows: Windows, parameters: list[Parameter]) -> dict[int, list[int]]:
    """Of a drive's strength, and of all drives', the gains that make all of its torque; by parameter."""
    at = {(p.cause, p.index): k for k, p in enumerate(parameters) if p.cause in DRIVE}
    found = {
        k: [at[part, joint] for part in parts]
        for (cause, joint), k in at.items()
        if (parts := CATALOGUE[cause].made_of)
        and all((part, joint) in at for part in parts)
        and not windows.feed[2, ..., joint].any()
    }
    if len(found) == windows.q.shape[1]:  # a factor on all torques is no other robot than one of that strength
        found |= {k: sum(found.values(), []) for k, p in enumerate(parameters) if p.declared.of_all}
    return found


class _Limbs:
    """Limbs of a held robot that do not move each other; of other robots there are none.

    A constraint or a tendon between joints may tie limbs together: such a robot has none either.
    """

    def __init__(self, model: ReplayModel) -> None:
        tied = model.free or model.model.neq > 0 or model.model.ntendon > 0
        self._of, self._joints = {} if tied else model.limbs, model.joints

    def shared(self, places: Sequence[str]) -> np.ndarray:
        """Robot in which each of N numbers is changed, by their places, shape (N,): in each at most one of a limb."""
        found, robots, used = np.zeros(len(places), dtype=int), 0, dict.fromkeys(self._of.values(), 0)
        common: list[int] = []
        for k, place in enumerate(places):
            limb = self._of.get(place)
            if limb is not None and used[limb] < len(common):
                found[k] = common[used[limb]]
            else:
                found[k], robots = robots, robots + 1
                common += [robots - 1] if limb is not None else []
            if limb is not None:
                used[limb] += 1
        return found

    def moved(self, place: str, layout: dict[str, tuple[int, int]]) -> np.ndarray:
        """Whether each of a window's N readings is of what a place moves, shape (N,)."""
        limb = self._of.get(place)
        own = np.array([limb is None or self._of.get(joint) == limb for joint in self._joints])
        return np.concatenate(
            [
                np.tile(own if columns == len(own) else np.ones(columns, dtype=bool), samples)
                for samples, columns in layout.values()
            ]
        )


def _wandering(windows: Windows) -> np.ndarray:
    """Readings that also drift in a window, by :data:`CREEP` of each joint and :data:`LEAN`, (Z, W, N)."""
    layout = {name: x.shape for name, x in mismatch(windows.measured, windows.measured).items()}
    wander: list[tuple[int, dict]] = [(j, {"q": CREEP * windows.t, "qd": CREEP}) for j in range(windows.q.shape[1])]
    wander += [(k, {"quat": LEAN}) for k in range(2) if "quat" in layout]
    rows = []
    for column, sizes in wander:
        drift = {name: np.zeros(shape) for name, shape in layout.items()}
        for name in sizes.keys() & drift.keys():
            drift[name][..., column] = sizes[name]
        rows.append(side_by_side(drift))
    return np.stack(rows)


def best_start(z: np.ndarray, r: np.ndarray) -> np.ndarray:
    """Likeliest start of a window, in steps, shape (Z,), by its derivatives (Z, N) and what is left in it (N,).

    Of what H robots leave in it, shape (N, H), the starts are the columns.
    """
    return np.linalg.solve(z @ z.T + np.eye(len(z)) / START_SPREAD**2, z @ r)
