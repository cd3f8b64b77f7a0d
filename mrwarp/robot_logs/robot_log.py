"""A robot's log: joints, commands, base and feet over time, as a controller wrote them (docs/robot_logs.md)."""

from __future__ import annotations

import difflib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np

from mrwarp.recording.data import DEGREES, RecordingError
from mrwarp.recording.tables import MAX_BYTES, SUFFIXES, Table, is_recording, read_table, suffix_of
from mrwarp.robot_logs.kinds import LOG_FILE, kind_of
from mrwarp.run_dir import no_file, one_line

JOINT_CHANNELS = ("q", "q_des", "qd", "qd_des", "tau_ff", "tau", "kp", "kd", "current", "current_cmd", "temperature")
"""Columns ``CHANNEL.JOINT``."""

BASE_CHANNELS = {
    "quat": ("w", "x", "y", "z"),
    "gyro": ("x", "y", "z"),
    "acc": ("x", "y", "z"),
    "pos": ("x", "y", "z"),
    "vel": ("x", "y", "z"),
}
"""Columns ``CHANNEL.AXIS`` of the floating base."""

SLOW = ("temperature", "pos", "vel", "foot", "battery")
"""Channels that may miss readings: gaps are filled on a line."""

MIN_SAMPLES = 50
"""Fewest rows of a recording."""

LARGEST_ANGLE = 4.0 * np.pi
"""Largest plausible angle of a joint that does not go round and round [rad]."""

LARGEST_GAP = 5.0
"""A step of the stamps this many times the usual one is a gap: no window of a replay reaches over it."""

LARGEST_STEP = 0.2
"""Largest plausible time between rows [s]: at 5 Hz no joint's motion could be replayed."""

STANDARD_GRAVITY = 9.80665
"""[m/s²]"""

_ANGLE = {"rad": 1.0, "deg": 1.0 / DEGREES, "mrad": 1e-3}
_SPEED = {"rad/s": 1.0, "deg/s": 1.0 / DEGREES, "mrad/s": 1e-3, "rpm": 2.0 * np.pi / 60.0}
_TORQUE = {"N·m": 1.0, "Nm": 1.0, "N*m": 1.0, "mN·m": 1e-3, "mNm": 1e-3}
_AMPERE = {"A": 1.0, "mA": 1e-3}
UNITS: dict[str, dict[str, float]] = {
    "t": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "q": _ANGLE, "q_des": _ANGLE, "qd": _SPEED, "qd_des": _SPEED, "tau_ff": _TORQUE, "tau": _TORQUE,
    "kp": {"N·m/rad": 1.0, "Nm/rad": 1.0, "N·m/deg": DEGREES}, "current": _AMPERE, "current_cmd": _AMPERE,
    "kd": {"N·m·s/rad": 1.0, "Nms/rad": 1.0, "N·m·s/deg": DEGREES}, "temperature": {"degC": 1.0, "°C": 1.0},
    "quat": {"1": 1.0}, "gyro": _SPEED, "acc": {"m/s²": 1.0, "m/s^2": 1.0, "g": STANDARD_GRAVITY},
    "pos": {"m": 1.0, "mm": 1e-3}, "vel": {"m/s": 1.0, "mm/s": 1e-3}, "foot": {"N": 1.0, "1": 1.0},
    "battery": {"V": 1.0, "1": 1.0, "%": 1.0},
}  # fmt: skip
"""Units of each channel that ``units`` of log.json may name; the first is the one that is kept."""

TauIs = Literal["command", "estimate", "measured", "none"]


class LogError(RecordingError):
    """A log cannot be used; the message names the file, the place and the remedy."""


@dataclass(frozen=True, kw_only=True)
class LogRun:
    """One recording of a log; N samples, J joints in the log's order."""

    id: str
    t: np.ndarray
    """Stamps since the first [s], rising, shape (N,)."""
    joint: Mapping[str, np.ndarray]
    """Channels of :data:`JOINT_CHANNELS` that the file has, shape (N, J); NaN for a joint that lacks one."""
    base: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Channels of :data:`BASE_CHANNELS` that the file has, shape (N, 3), ``quat`` (N, 4)."""
    feet: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Force [N] or contact (0, 1) by foot, shape (N,)."""
    battery: np.ndarray | None = None
    """As logged, shape (N,)."""

    @property
    def samples(self) -> int:
        """N."""
        return len(self.t)

    @property
    def dt(self) -> float:
        """Usual step of the stamps [s]."""
        return float(np.median(np.diff(self.t)))


@dataclass(frozen=True, kw_only=True)
class RobotLog:
    """Recordings of one robot under one set of gains."""

    path: Path
    robot: str
    """The robot's file, as the log names it; empty where it names none."""
    base: Literal["free", "fixed"]
    joints: tuple[str, ...]
    kp: np.ndarray
    """[N·m/rad], shape (J,); 0 where no position is commanded."""
    kd: np.ndarray
    """[N·m·s/rad], shape (J,)."""
    tau_is: TauIs
    runs: tuple[LogRun, ...]
    header: Mapping[str, Any] = field(default_factory=dict)
    """All of ``log.json``."""
    notes: tuple[str, ...] = ()
    """Repairs and omissions of its reading."""

    @property
    def seconds(self) -> float:
        """Length of all runs [s]."""
        return float(sum(run.t[-1] - run.t[0] for run in self.runs))


def reads_torque(log: RobotLog, run: LogRun) -> bool:
    """Whether a recording reads the torque of drives next to what was commanded."""
    return "tau" in run.joint and log.tau_is in ("measured", "estimate") and "q_des" in run.joint


def is_robot_log(path: Path) -> bool:
    """Whether a path is a robot's log, in any form, rather than a recording of one joint."""
    return kind_of(path) is not None


def load_log(path: Path, *, skip_bad: bool = False) -> RobotLog:
    """Read and check a log: a folder with ``log.json`` and its recordings.

    Args:
        path: The folder.
        skip_bad: Leave out recordings that would be refused, by name.

    Raises:
        LogError: it is refused; the message names file, row and column, and the remedy.
        RecordingError: it is refused, for a file that is no table.
    """
    path = path.parent if path.name == LOG_FILE else path
    header = _header(path)
    files = sorted(filter(is_recording, path.iterdir()))
    if not files:
        raise LogError(f"{path}: no recordings next to {LOG_FILE}; add {', '.join(SUFFIXES)} files")
    units = _units(path, header)
    joints = _joints_of(path, header)
    left, runs, notes, refused = MAX_BYTES, [], [], []
    for file in files:
        try:
            table = read_table(file, ["t"], left, _known)
            left -= table.size
            notes += [f"{file.name}: {note}" for note in table.notes]
            joints = joints or _joints_in(table)
            runs.append(_run(table, joints, units, header.get("base") == "fixed", notes))
        except RecordingError as error:
            if not skip_bad or len(files) == 1:
                hint = "; or leave this file out with --skip-bad" if len(files) > 1 else ""
                raise type(error)(f"{error}{hint}") from None
            refused.append(error)
            notes.append(f"left out: {error}")
    if not runs:
        raise LogError(f"{refused[0]}; --skip-bad leaves nothing: each of the {len(files)} files is refused")
    return make_log(path, header, tuple(joints), tuple(runs), notes)


def make_log(
    path: Path, header: Mapping[str, Any], joints: tuple[str, ...], runs: tuple[LogRun, ...], notes: Sequence[str] = ()
) -> RobotLog:
    """A log of checked recordings.

    Raises:
        LogError: base, gains or the meaning of ``tau`` are missing or cannot be.
    """
    mapped, base = kind_of(path) not in ("own", None), header.get("base")
    where = f"{path}: the map" if mapped else str(path / LOG_FILE)
    if base is None and "robot" in header:
        base = "free" if any(run.base for run in runs) else "fixed"
        notes = [*notes, f"log.json names no base: taken as {base}"]
    if base not in ("free", "fixed"):
        raise LogError(f'{where}: base = {base!r}; write "free" for a trunk that floats, "fixed" for one that is held')
    seen = {name for run in runs for name in run.joint}
    tau_is = header.get("tau_is", "none")
    if tau_is not in get_args(TauIs):
        raise LogError(f"{where}: tau_is = {tau_is!r}; allowed: {', '.join(get_args(TauIs))}")
    if "tau" in seen and tau_is == "none":
        notes = [*notes, "tau is not used: log.json does not say what it is (tau_is: command, estimate or measured)"]
    for run in runs:
        if not {"q_des", "tau_ff"} & run.joint.keys() and ("tau" not in run.joint or tau_is in ("none", "command")):
            raise LogError(
                f"{path}: {run.id}: no command and no torque: nothing could drive a simulation; add q_des.J or "
                "tau_ff.J, or tau.J with tau_is = estimate or measured"
            )
    kp, kd = (_gains(where, header, name, joints) for name in ("kp", "kd"))
    for k, joint in enumerate(joints):
        for run in runs:
            varies = "kp" in run.joint and np.isfinite(run.joint["kp"][:, k]).all()
            if _filled(run, "q_des", k) and not np.isfinite(kp[k]) and not varies:
                raise LogError(_no_gain(path, joint, mapped))
    undamped = [
        joint
        for k, joint in enumerate(joints)
        if not np.isfinite(kd[k]) and any(_filled(run, "q_des", k) and not _filled(run, "kd", k) for run in runs)
    ]
    if undamped:
        given = "the map" if mapped else "log.json"
        notes = [*notes, f"Kd of {', '.join(undamped)} is taken as 0: {given} gives none; kd of {given} does"]
    if base == "free" and not any("quat" in run.base for run in runs):
        notes = [*notes, "the trunk floats, but its orientation (quat) was not logged: it is taken as level at first"]
    return RobotLog(
        path=path,
        robot=str(header.get("robot", "")),
        base=base,
        joints=joints,
        kp=np.nan_to_num(kp),
        kd=np.nan_to_num(kd),
        tau_is=tau_is,
        runs=runs,
        header=header,
        notes=tuple(notes),
    )


def _filled(run: LogRun, channel: str, k: int) -> bool:
    """Whether a channel has a number of the k-th joint."""
    return channel in run.joint and bool(np.isfinite(run.joint[channel][:, k]).any())


def _no_gain(path: Path, joint: str, mapped: bool) -> str:
    """Refusal of a joint whose command is a target, with where its gain goes."""
    if not mapped:
        return f"{path / LOG_FILE}: {joint} has q_des but no gain; add it to kp, or a column kp.{joint}"
    return (
        f'{path}: {joint} has targets but no gain; a map gives it, {{"kp": {{"{joint}": NUMBER}}}}, or one number '
        "for all joints, by --map MAP.json, or as map.json in the bag's folder or next to the files"
    )


def _header(path: Path) -> dict[str, Any]:
    file = path / LOG_FILE
    if not file.is_file():
        raise LogError(f"{file}: {no_file(file, 'description of a log')}; write one, see docs/robot_logs.md")
    try:
        header = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise LogError(f"{file}: is no JSON ({one_line(error)}); correct it") from None
    if not isinstance(header, dict):
        raise LogError(f'{file}: holds a {type(header).__name__}, needed is an object {{"robot": ..., "base": ...}}')
    if not isinstance(header.get("robot", ""), str):
        raise LogError(f"{file}: robot = {header['robot']!r} is no file name; write the robot's file as text")
    return header


def _joints_of(path: Path, header: Mapping[str, Any]) -> list[str]:
    """Joints in the order that log.json gives, if it does."""
    joints = header.get("joints", [])
    if not isinstance(joints, list) or not all(isinstance(joint, str) for joint in joints):
        raise LogError(
            f"{path / LOG_FILE}: joints = {str(joints)[:60]} is no list of names; correct it or leave it out"
        )
    if double := next((joint for joint in joints if joints.count(joint) > 1), ""):
        raise LogError(f"{path / LOG_FILE}: joints names {double} twice; name it once")
    return joints


def _units(path: Path, header: Mapping[str, Any]) -> dict[str, float]:
    """Factor of each channel to the unit that is kept."""
    declared = header.get("units") or {}
    if not isinstance(declared, dict):
        raise LogError(f'{path / LOG_FILE}: units = {str(declared)[:60]}; write an object such as {{"q": "deg"}}')
    return factors(f"{path / LOG_FILE}: units", declared)


def factors(where: str, declared: Mapping[str, Any]) -> dict[str, float]:
    """Factor of each channel to the unit that is kept, see :data:`UNITS`.

    Raises:
        LogError: there is no such channel, or no such unit of it; ``where`` begins the message.
    """
    found = {}
    for channel, unit in declared.items():
        if channel not in UNITS:
            near = difflib.get_close_matches(str(channel), UNITS, 1)
            hint = f"is it {near[0]}? " if near else ""
            raise LogError(f"{where}: there is no channel {channel!r}; {hint}channels: {', '.join(UNITS)}")
        if unit not in UNITS[channel]:
            raise LogError(f"{where}: {channel} in {unit!r}; allowed: {', '.join(UNITS[channel])}")
        found[channel] = UNITS[channel][unit]
    return found


def _gains(where: str, header: Mapping[str, Any], name: str, joints: tuple[str, ...]) -> np.ndarray:
    """A gain by joint, NaN where it is not given; one number stands for all joints."""
    given = header.get(name, {})
    if isinstance(given, int | float) and not isinstance(given, bool):
        given = dict.fromkeys(joints, given)
    if not isinstance(given, dict):
        raise LogError(f'{where}: {name} = {str(given)[:60]}; write a number, or an object {{"JOINT": number}}')
    found = np.full(len(joints), np.nan)
    for joint, value in given.items():
        if joint not in joints:
            near = difflib.get_close_matches(joint, joints, 1)
            hint = f"is it {near[0]}?" if near else f"joints: {', '.join(joints)}"
            raise LogError(f"{where}: {name} of {joint!r}, of which there is no column q.{joint}; {hint}")
        if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 <= value < 1e6:
            raise LogError(f"{where}: {name} of {joint} = {value!r}; write a number from 0 to 1e6")
        found[joints.index(joint)] = float(value)
    return found


def _known(name: str) -> bool:
    """Whether a column is one of the contract's."""
    channel, _, axis = name.partition(".")
    if channel in BASE_CHANNELS:
        return axis in BASE_CHANNELS[channel]
    return name in ("t", "battery") or (channel in (*JOINT_CHANNELS, "foot") and bool(axis))


def _joints_in(table: Table) -> list[str]:
    joints = [name.partition(".")[2] for name in table.columns if name.startswith("q.")]
    if not joints:
        raise table.refuse(
            "no joint: there is no column q.JOINT; name each joint's angle by the robot's own joint name"
        )
    return joints


def _run(table: Table, joints: Sequence[str], units: Mapping[str, float], fixed: bool, notes: list[str]) -> LogRun:
    """A checked recording."""
    columns = table.columns
    for name in columns:
        channel, _, joint = name.partition(".")
        if channel in JOINT_CHANNELS and joint not in joints:
            near = difflib.get_close_matches(joint, joints, 1)
            hint = f"is it {near[0]}?" if near else f"joints: {', '.join(joints)}"
            raise table.refuse(f"there is no joint {joint!r} in this log; {hint}", column=name)
    for joint in joints:
        if f"q.{joint}" not in columns:
            raise table.refuse(f"q.{joint} is missing; log the joint's angle, or take the joint out of log.json")
    t = columns["t"] * units.get("t", 1.0)
    _check_times(table, t)
    for name, values in columns.items():
        if name != "t":
            _check_finite(table, name, values, t, notes)
    scaled = {name: values * units.get(name.partition(".")[0], 1.0) for name, values in columns.items()}
    blank = np.full(len(t), np.nan)
    joint = {
        channel: np.stack([scaled.get(f"{channel}.{name}", blank) for name in joints], axis=1)
        for channel in JOINT_CHANNELS
        if any(f"{channel}.{name}" in scaled for name in joints)
    }
    base = {}
    for channel, axes in BASE_CHANNELS.items():
        missing = [axis for axis in axes if f"{channel}.{axis}" not in scaled]
        if 0 < len(missing) < len(axes):
            raise table.refuse(
                f"{channel}.{missing[0]} is missing where the others are given; add it or leave {channel} out"
            )
        if not missing:
            base[channel] = np.stack([scaled[f"{channel}.{axis}"] for axis in axes], axis=1)
    feet = {name.partition(".")[2]: values for name, values in scaled.items() if name.startswith("foot.")}
    name = table.file.name.removesuffix(suffix_of(table.file))
    run = LogRun(id=name, t=t - t[0], joint=joint, base=base, feet=feet, battery=scaled.get("battery"))
    checked = check_run(run, joints, lambda text, column: table.refuse(text, column=column))
    gaps = int((np.diff(run.t) > LARGEST_GAP * run.dt).sum())
    if gaps:
        notes.append(f"{name}: {gaps} gaps of more than {LARGEST_GAP:g} rows; no window of the replay reaches over one")
    return replace(checked, base={}) if fixed and "pos" not in base else checked


def check_run(run: LogRun, joints: Sequence[str], refuse: Callable[[str, str], Exception]) -> LogRun:
    """Faults that no file format knows: no numbers, angles in degrees, speeds of another unit, impossible orientations.

    Raises:
        Exception: what ``refuse`` makes of a problem and the column that has it.
    """
    _check_numbers(run, joints, refuse)
    _check_angles(run, joints, refuse)
    for k, joint in enumerate(joints if "qd" in run.joint else ()):
        slope = _slope(run, k)
        if slope is not None and (20.0 < abs(slope) < 200.0 or 0.005 < abs(slope) < 0.05):
            hint = 'is it in deg/s? then write "units": {"qd": "deg/s"} into log.json'
            raise refuse(f"{slope:.3g} times what the angle's change gives; {hint}", f"qd.{joint}")
        if slope is not None and slope < -0.5:
            raise refuse("turns the other way than the angle; change the sign of one of them", f"qd.{joint}")
    if "quat" in run.base:
        size = np.linalg.norm(run.base["quat"], axis=1)
        if np.abs(size - 1.0).max() > 0.05:
            row = int(np.argmax(np.abs(size - 1.0)))
            text = f"row {row + 1}: a length of {size[row]:.3g}, no rotation; log w, x, y, z of a unit quaternion"
            raise refuse(text, "quat.w")
    if "acc" in run.base:
        size = float(np.median(np.linalg.norm(run.base["acc"], axis=1)))
        if 0.8 < size < 1.25:
            raise refuse(f'a mean of {size:.3g} m/s²; is it in g? then write "units": {{"acc": "g"}}', "acc.z")
    return run


def _check_numbers(run: LogRun, joints: Sequence[str], refuse: Callable[[str, str], Exception]) -> None:
    """Refuse rows that are no numbers, but for slow channels, and those that a joint does not have."""
    for channel, values in (*run.joint.items(), *run.base.items()):
        for k, x in enumerate(values.T):
            bad = np.flatnonzero(~np.isfinite(x))
            lacking = channel in run.joint and len(bad) == len(x) and channel != "q"
            if len(bad) and channel not in SLOW and not lacking:
                where = joints[k] if channel in run.joint else BASE_CHANNELS[channel][k]
                raise refuse(f"row {bad[0] + 1}: no number; leave the channel out, or repair it", f"{channel}.{where}")


def _check_angles(run: LogRun, joints: Sequence[str], refuse: Callable[[str, str], Exception]) -> None:
    """Refuse angles in degrees; a wheel goes round in one direction."""
    for channel in ("q", "q_des"):
        for k, joint in enumerate(joints if channel in run.joint else ()):
            x = run.joint[channel][:, k]
            x = x[np.isfinite(x)]
            if len(x) == 0:
                continue
            large, path = float(np.quantile(np.abs(x), 0.99)), float(np.abs(np.diff(x)).sum())
            if large > LARGEST_ANGLE and abs(x[-1] - x[0]) <= 0.8 * path:
                hint = 'are these degrees? then write "units": {"q": "deg", "q_des": "deg"} into log.json'
                raise refuse(f"angles of up to {large:.4g} rad; {hint}", f"{channel}.{joint}")


def _slope(run: LogRun, k: int) -> float | None:
    """Logged speed relative to the change of the angle, or None where the joint hardly moves."""
    q, qd = run.joint["q"][:, k], run.joint["qd"][:, k]
    step = max(1, round(0.02 / run.dt))
    dq = (q[step:] - q[:-step]) / (run.t[step:] - run.t[:-step])
    mean = np.convolve(qd, np.full(step, 1.0 / step), "valid")[: len(dq)]
    power = float((dq**2).mean())
    if not np.isfinite(mean).all() or np.sqrt(power) < 0.05 or q.std() < 0.02:
        return None
    slope = float((dq * mean).mean() / power)
    return slope if ((mean - slope * dq) ** 2).mean() < 0.5 * (mean**2).mean() else None


def _check_times(table: Table, t: np.ndarray) -> None:
    if len(t) < MIN_SAMPLES:
        raise table.refuse(f"{len(t)} rows, {MIN_SAMPLES} or more are needed; record longer")
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad):
        raise table.refuse("no time; fill it in or remove the row", row=int(bad[0]), column="t")
    late = np.flatnonzero(np.diff(t) <= 0.0)
    if len(late):
        row = int(late[0]) + 1
        raise table.refuse(
            f"{t[row]:.9g} s after {t[row - 1]:.9g} s; time must increase, sort or remove the row", row=row, column="t"
        )
    dt = float(np.median(np.diff(t)))
    if dt > LARGEST_STEP:
        hint = 'are these milliseconds? then write "units": {"t": "ms"} into log.json; else log at 50 Hz or more'
        raise table.refuse(f"{dt:.4g} s between rows; {hint}", column="t")


def _check_finite(table: Table, name: str, values: np.ndarray, t: np.ndarray, notes: list[str]) -> None:
    """Refuse what is no number where a replay needs one; fill the gaps of slow channels in place."""
    bad = ~np.isfinite(values)
    if not bad.any():
        return
    row = int(np.flatnonzero(bad)[0])
    channel = name.partition(".")[0]
    if channel in SLOW and bad.mean() < 0.5:
        values[bad] = np.interp(t[bad], t[~bad], values[~bad])
        notes.append(f"{table.file.name}: {int(bad.sum())} missing readings of {name} were filled on a line")
        return
    hint = "leave the column out" if channel not in ("q",) else "remove the row"
    raise table.refuse(
        f"{'no number' if np.isnan(values[row]) else 'infinite'}; fill it in or {hint}", row=row, column=name
    )


def sources(log: RobotLog) -> list[str]:
    """Which topic or file became what, for the terminal."""
    return [f"{role:13s} {source}" for role, source in dict(log.header.get("source") or {}).items()]


def describe(log: RobotLog) -> list[str]:
    """Content of a log, for the terminal."""
    rates = sorted({round(1.0 / run.dt) for run in log.runs})
    channels = sorted({c for run in log.runs for c in (*run.joint, *run.base, *(["foot"] if run.feet else []))})
    shown = (
        ", ".join(log.joints)
        if len(log.joints) <= 12
        else f"{', '.join(log.joints[:11])} and {len(log.joints) - 11} more"
    )
    lines = [
        f"robot         {log.robot or 'not named'}, base {log.base}",
        f"joints        {len(log.joints)}: {shown}",
        f"recordings    {len(log.runs)}, {log.seconds:.1f} s at {' and '.join(map(str, rates))} Hz",
        f"channels      {', '.join(channels)}; tau is {log.tau_is}",
        f"gains         Kp {_range(log.kp)} N·m/rad, Kd {_range(log.kd)} N·m·s/rad",
    ]
    for run in log.runs:
        moved = np.ptp(run.joint["q"], axis=0)
        lines.append(f"  {run.id:12s}{run.t[-1]:7.1f} s, {run.samples} rows, joints move up to {moved.max():.2g} rad")
    return lines


def _range(values: np.ndarray) -> str:
    low, high = float(values.min()), float(values.max())
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"
