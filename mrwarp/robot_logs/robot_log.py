"""A robot's log: joints, commands, base and feet over time, as a controller wrote them (format: docs/robot_logs.md)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mrwarp.recording.tables import MAX_BYTES, Table, read_table, suffix_of

LOG_FILE = "log.json"
"""What describes a folder of recordings as a robot's log."""

JOINT_CHANNELS = (
    "q", "q_des", "qd", "qd_des", "tau_ff", "tau", "kp", "kd", "current", "current_cmd", "temperature"
)  # fmt: skip
"""Columns ``CHANNEL.JOINT``."""

BASE_CHANNELS = {
    "quat": ("w", "x", "y", "z"),
    "gyro": ("x", "y", "z"),
    "acc": ("x", "y", "z"),
    "pos": ("x", "y", "z"),
    "vel": ("x", "y", "z"),
}
"""Columns ``CHANNEL.AXIS`` of the floating base."""

TauIs = Literal["command", "estimate", "measured", "none"]


class LogError(ValueError):
    """A log cannot be used; the message names the file, the place and the remedy."""


@dataclass(frozen=True, kw_only=True)
class LogRun:
    """One recording of a log; N samples, J joints in the log's order."""

    id: str
    t: np.ndarray
    """Stamps [s], rising, shape (N,)."""
    joint: Mapping[str, np.ndarray]
    """Channels of :data:`JOINT_CHANNELS` that the file has, shape (N, J); NaN for a joint that lacks one."""
    base: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Channels of :data:`BASE_CHANNELS` that the file has, shape (N, 3), ``quat`` (N, 4)."""
    feet: Mapping[str, np.ndarray] = field(default_factory=dict)
    """Force [N] or contact (0, 1) by foot, shape (N,)."""

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
    """The robot's file, as the log names it."""
    base: Literal["free", "fixed"]
    joints: tuple[str, ...]
    kp: np.ndarray
    """[N·m/rad], shape (J,)."""
    kd: np.ndarray
    """[N·m·s/rad], shape (J,)."""
    tau_is: TauIs
    runs: tuple[LogRun, ...]
    header: Mapping[str, Any] = field(default_factory=dict)
    """All of ``log.json``."""

    @property
    def seconds(self) -> float:
        """Length of all runs [s]."""
        return float(sum(run.t[-1] - run.t[0] for run in self.runs))


def is_robot_log(path: Path) -> bool:
    """Whether a path is a robot's log rather than a recording of one joint."""
    return (path / LOG_FILE).is_file()


def load_log(path: Path) -> RobotLog:
    """Read and check a log.

    Raises:
        LogError: it is refused.
    """
    header = json.loads((path / LOG_FILE).read_text(encoding="utf-8"))
    files = sorted(file for file in path.iterdir() if suffix_of(file))
    tables = [read_table(file, ["t"], MAX_BYTES, lambda _: True) for file in files]
    joints = tuple(name.partition(".")[2] for name in tables[0].columns if name.startswith("q."))
    return RobotLog(
        path=path,
        robot=header["robot"],
        base=header["base"],
        joints=joints,
        kp=np.array([float(header["kp"][joint]) for joint in joints]),
        kd=np.array([float(header["kd"][joint]) for joint in joints]),
        tau_is=header.get("tau_is", "none"),
        runs=tuple(_run(table, joints) for table in tables),
        header=header,
    )


def _run(table: Table, joints: tuple[str, ...]) -> LogRun:
    columns = table.columns
    blank = np.full(len(columns["t"]), np.nan)
    joint = {
        channel: np.stack([columns.get(f"{channel}.{name}", blank) for name in joints], axis=1)
        for channel in JOINT_CHANNELS
        if any(f"{channel}.{name}" in columns for name in joints)
    }
    base = {
        channel: np.stack([columns[f"{channel}.{axis}"] for axis in axes], axis=1)
        for channel, axes in BASE_CHANNELS.items()
        if all(f"{channel}.{axis}" in columns for axis in axes)
    }
    feet = {name.partition(".")[2]: values for name, values in columns.items() if name.startswith("foot.")}
    name = table.file.name.removesuffix(suffix_of(table.file))
    return LogRun(id=name, t=columns["t"] - columns["t"][0], joint=joint, base=base, feet=feet)
