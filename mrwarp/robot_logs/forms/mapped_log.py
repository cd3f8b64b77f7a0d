"""Logs in forms of other projects: a map adds what their files do not say, and their columns become a log."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.recording.data import RecordingError
from mrwarp.robot_logs.kinds import is_bag
from mrwarp.robot_logs.robot_log import (
    LARGEST_STEP,
    MIN_SAMPLES,
    UNITS,
    LogError,
    LogRun,
    RobotLog,
    check_run,
    factors,
    make_log,
)
from mrwarp.run_dir import no_file, one_line

MAP_FILE = "map.json"
"""A map next to a log, which is read with it."""

MAP_KEYS = (
    "robot",
    "base",
    "state",
    "command",
    "command_order",
    "command_is",
    "imu",
    "pose",
    "joints",
    "feet",
    "kp",
    "kd",
    "tau_is",
    "clock",
    "units",
)
"""Keys of a map; anything else goes into log.json as it is, if it begins with ``x_``."""

NORMALISED = ("range_m100_100", "range_0_100", "normalised", "normalized", "percent", "%")
"""Units by which a share of a joint's calibrated range may be declared: LeRobot's names, and plain ones."""


def read_map(path: Path) -> dict[str, Any]:
    """Read a map.

    Raises:
        LogError: it is no JSON object, or holds keys that mean nothing.
    """
    if not path.is_file():
        raise LogError(f"{path}: {no_file(path, 'map')}; write one, see docs/robot_logs.md")
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise LogError(f"{path}: is no JSON ({one_line(error)}); correct it") from None
    if not isinstance(found, dict):
        raise LogError(f'{path}: holds a {type(found).__name__}; needed is an object such as {{"command": "/topic"}}')
    for key in found:
        if key not in MAP_KEYS and not key.startswith("x_"):
            near = difflib.get_close_matches(key, MAP_KEYS, 1)
            hint = f"is it {near[0]}? " if near else ""
            raise LogError(f"{path}: {key!r} means nothing; {hint}keys: {', '.join(MAP_KEYS)}")
    return found


def map_of(path: Path, file: Path | None = None, units: Mapping[str, str] | None = None) -> dict[str, Any]:
    """The map of a log: ``file``, or ``map.json`` next to its files if it is there; ``units`` go before its own.

    Raises:
        LogError: the map is refused, see :func:`read_map`.
    """
    near = (path if path.is_dir() else path.parent) / MAP_FILE
    found = read_map(file) if file is not None else read_map(near) if near.is_file() else {}
    return found | ({"units": dict(found.get("units") or {}) | dict(units)} if units else {})


def joints_of_map(path: Path, m: Mapping[str, Any], source: list[str], width: int) -> tuple[tuple[str, ...], list[int]]:
    """The robot's own joint names and the columns of the state that hold them.

    Args:
        path: The log, for messages.
        m: Its map; without ``joints`` the log's own names are the robot's.
        source: Names in the log.
        width: Columns of the state; it may be fewer than there are names.

    Raises:
        LogError: ``joints`` of the map does not fit.
    """
    given = m.get("joints")
    if given is None:
        given = {name: name for name in source[:width]}
    if isinstance(given, list):  # names in the order of the motors; null leaves one out
        if len(given) > width:
            raise LogError(f"{path}: the map names {len(given)} joints, the state has {width}; name as many")
        pairs = [(name, k) for k, name in enumerate(given) if name]
    elif isinstance(given, dict):
        pairs = []
        for theirs, ours in given.items():
            if theirs not in source:
                near = difflib.get_close_matches(str(theirs), source, 1)
                hint = f"is it {near[0]}?" if near else f"joints: {', '.join(source)}"
                raise LogError(
                    f"{path}: the map's joint {theirs!r} is not in the {'bag' if is_bag(path) else 'log'}; {hint}"
                )
            if ours:
                pairs.append((ours, source.index(theirs)))
    else:
        raise LogError(
            f'{path}: the map\'s joints = {str(given)[:60]}; write {{"name in the log": "the robot\'s name"}}'
        )
    names = [name for name, _ in pairs]
    if double := next((name for name in names if names.count(name) > 1), ""):
        raise LogError(f"{path}: {double} would be two of the log's joints; name it once in the map's joints")
    return tuple(names), [k for _, k in pairs]


@dataclass(frozen=True, kw_only=True)
class Columns:
    """One recording as a file holds it: N rows of C columns."""

    id: str
    t: np.ndarray
    """[s], shape (N,)."""
    joint: Mapping[str, np.ndarray]
    """Channels of a robot's log in the file's units, shape (N, C); NaN where a joint has none."""


@dataclass(frozen=True, kw_only=True)
class Source:
    """Statements of a form of files on all their recordings."""

    names: Sequence[str]
    """Of the C columns, each a joint."""
    units: Mapping[str, str]
    """By channel, where the files or their documentation say them."""
    question: str
    """Question for the unit of angles where nobody says it."""
    notes: list[str] = field(default_factory=list)


def log_of(
    path: Path, m: Mapping[str, Any], source: Source, recordings: Sequence[Columns], *, skip_bad: bool
) -> RobotLog:
    """Columns as a log, by a map.

    Args:
        path: Where they come from.
        m: What the map says, see :func:`read_map`.
        source: What the files say.
        recordings: Their recordings.
        skip_bad: Leave out recordings that would be refused, by name.

    Raises:
        LogError: they are refused, or map and files do not say enough; the message names place and remedy.
    """
    joints, columns = joints_of_map(path, m, list(source.names), len(source.names))
    channels = {channel for one in recordings for channel in one.joint}
    factor = _factors(path, m, source, channels)
    runs, notes, short = [], list(source.notes), 0
    for one in recordings:
        if len(one.t) < MIN_SAMPLES and len(recordings) > 1:
            short += 1
            continue
        try:
            joint = {c: factor.get(c, 1.0) * x[:, columns] for c, x in one.joint.items()}
            joint = {c: x for c, x in joint.items() if np.isfinite(x).any()}
            runs.append(_checked(path, LogRun(id=one.id, t=one.t - one.t[0], joint=joint), joints))
        except RecordingError as error:
            if not skip_bad:
                raise
            notes.append(f"left out: {error}")
    if short:
        notes.append(f"{short} of {len(recordings)} recordings are left out: they have fewer than {MIN_SAMPLES} rows")
    if not runs:
        raise LogError(f"{path}: no recording has {MIN_SAMPLES} rows or more; record longer")
    if "base" not in m:
        notes.append('the base is taken as held, for the files do not say it; "base": "free" in the map says otherwise')
    header = {
        "robot": m.get("robot", ""), "base": m.get("base", "fixed"), "joints": list(joints), "kp": m.get("kp", {}),
        "kd": m.get("kd", {}), "tau_is": m.get("tau_is", "none"), "source": {"files": str(path)},
    } | {k: v for k, v in m.items() if k.startswith("x_")}  # fmt: skip
    return make_log(path, header, joints, tuple(runs), notes)


def _factors(path: Path, m: Mapping[str, Any], source: Source, channels: set[str]) -> dict[str, float]:
    """Factor of each channel to its unit: commands and speeds follow the angles where nobody says theirs."""
    said = dict(source.units) | dict(m.get("units") or {})
    for channel, unit in said.items():
        if str(unit).lower() in NORMALISED:
            raise LogError(
                f"{path}: {channel} in {unit!r} is a share of the robot's calibrated range, no angle; "
                "convert it by the calibration's range_min and range_max, "
                "or record with use_degrees=true"
            )
    if "q" not in said:
        raise LogError(f"{path}: {source.question}")
    angle = said["q"]
    for channel, unit in (("q_des", angle), ("qd", f"{angle}/s"), ("qd_des", f"{angle}/s")):
        if channel in channels and unit in UNITS[channel]:
            said.setdefault(channel, unit)
    return factors(f"{path}: the map or --units", said)


def _checked(path: Path, run: LogRun, joints: tuple[str, ...]) -> LogRun:
    """A recording whose time rises and whose readings can be.

    Raises:
        LogError: it is refused.
    """

    def refuse(text: str, column: str) -> LogError:
        return LogError(
            f"{path}: {run.id}, {column!r}: {text.replace('into log.json', 'into the map, or give it by --units')}"
        )

    if run.samples < MIN_SAMPLES:
        raise refuse(f"{run.samples} rows, {MIN_SAMPLES} or more are needed; record longer", "t")
    late = np.flatnonzero(~(np.diff(run.t) > 0.0))
    if len(late):
        raise refuse(f"row {late[0] + 2}: time must increase; sort or remove the row", "t")
    if run.dt > LARGEST_STEP:
        raise refuse(f"{run.dt:.4g} s between rows; record at 5 Hz or more, 50 Hz for a diagnosis", "t")
    return check_run(run, joints, refuse)
