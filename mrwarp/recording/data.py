"""Content of a recording: trajectories, break-away tests, their units, and the error for one that is refused."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

COLUMNS = ("t", "q", "qd", "current", "torque")
"""Columns of a recording; ``qd`` may be missing, ``trajectory`` and ``temperature`` may be added."""

REQUIRED = ("t", "q", "current", "torque")
"""Columns that no recording is without."""

HOLDING_COLUMNS = ("current", "torque")
"""Columns of break-away tests."""

HOLDING_FILE = "holding.csv"
"""Break-away torques next to recordings; not a recording itself."""

UNITS = {"t": "s", "q": "rad", "qd": "rad/s", "current": "A", "torque": "N·m", "temperature": "degC"}
"""Unit of each column where nothing else is declared."""

DEGREES = 180.0 / np.pi
"""Degrees in a radian."""

NO_INPUT = "none"
"""Unit of the control input of a device that has none: its column may be left out and then counts as 0."""

_LEVELS, _OFTEN = 12, 0.02
"""Most values of a quantity of few levels, and the least share of samples that has the second of them."""

_NAMES = {
    "q": {"rad": "angle", "m": "displacement"},
    "current": {
        "A": "current",
        "V": "driver voltage",
        "N·m": "load torque",
        "N": "load force",
        **dict.fromkeys(("bar", "mbar", "Pa", "hPa", "kPa", "MPa", "psi"), "pressure"),
    },
    "torque": {"N·m": "torque", "N": "force", "A": "motor current", "V": "motor voltage"},
}


def quantity(column: str, units: Mapping[str, str]) -> str:
    """Quantity of ``q``, ``current`` (the control input) or ``torque`` by its unit, e.g. pressure."""
    return _NAMES[column].get(units[column], {"current": "control input"}.get(column, "torque"))


def is_load(units: Mapping[str, str]) -> bool:
    """Whether the control input is a load or a pressure by its unit, not a current or voltage that makes a field."""
    return quantity("current", units) in ("load torque", "load force", "pressure")


def is_command(current: np.ndarray) -> bool:
    """Whether a control input is a command: it stays as it is from most samples to the next; else it was measured."""
    return bool(2 * np.count_nonzero(np.diff(current)) < len(current))


def goes_one_way(qd: np.ndarray) -> bool:
    """Whether the other way is less than a hundredth of what a velocity, shape (N,), goes."""
    ways = qd.clip(0.0).sum(), -qd.clip(max=0.0).sum()
    return bool(min(ways) < 0.01 * sum(ways))


def few_levels(x: np.ndarray) -> bool:
    """Whether all samples are at two or a few more values, as of a command.

    A sensor at the end of its range has other readings in between.
    """
    counts = np.sort(np.unique(x, return_counts=True)[1])[::-1]
    return 1 < len(counts) <= _LEVELS and bool(counts[1] > _OFTEN * len(x))


def true_names(text: str, units: Mapping[str, str]) -> str:
    """A text that calls the control input "current" as it is called for a device in ``units``, such as pressure."""
    return re.sub(r"\bcurrent(s?)\b", lambda found: quantity("current", units) + found[1], text)


def with_unit(number: str, unit: str) -> str:
    """A number, as text, with its unit; nothing is written for a plain number's unit."""
    return number if unit in ("1", "", NO_INPUT) else f"{number} {unit}"


class RecordingError(ValueError):
    """A recording was refused; the message names file, row and column, and the remedy."""


@dataclass(frozen=True, kw_only=True)
class Repair:
    """Data put right or left out when a recording was read."""

    trajectory: str
    """Trajectory, or file, that it happened to."""
    kind: str
    """``resampled``, ``thinned``, ``unwrapped``, ``replaced``, ``filled``, ``integrated``, ``shifted``, ``split``,
    ``cut``, ``left_out``, ``saturated``, ``sized``; or ``held``, ``factor`` and ``turns``, which are said only."""
    count: int
    """Intervals, gaps or samples that are concerned."""
    at: tuple[float, ...] = ()
    """Where [s], the first ten places."""
    text: str
    """All of it for people."""


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One uninterrupted run, uniformly sampled. All arrays float64, shape (N,)."""

    id: str
    """Name of the trajectory, unique within its recording."""
    t: np.ndarray
    """Time [s]."""
    q: np.ndarray
    """Displacement [rad], or [m] for a linear device."""
    qd: np.ndarray
    """Velocity [rad/s] or [m/s]."""
    current: np.ndarray
    """Control input in the unit of the recording: coil current [A], driver voltage [V], pressure [bar], ..."""
    torque: np.ndarray
    """Measured torque [N·m], force [N] or motor current [A], positive against positive velocity (eq. 14)."""
    temperature: np.ndarray | None = None
    """Temperature [degC], if it was recorded."""
    qd_derived: bool = False
    """True where qd was derived from q by zero-phase differentiation."""
    q_integrated: bool = False
    """True where q was integrated from qd: it begins at 0, and an offset of the velocity drifts in it."""
    qd_half: int | None = None
    """Samples on each side of the window that it was derived with, if it was when the recording was read."""
    lost: np.ndarray | None = None
    """True where the torque is unknown because its sensor was at the end of its range, bool; None: nowhere."""
    header: dict[str, Any] = field(default_factory=dict)
    """The trajectory's own file on how it was made."""

    @property
    def known(self) -> np.ndarray:
        """True where the torque was measured, bool."""
        return np.ones(len(self.t), dtype=bool) if self.lost is None else ~self.lost

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))

    @property
    def one_way(self) -> bool:
        """Whether it goes one way only: then dry friction and a zero of the torque are one number."""
        return goes_one_way(self.qd)


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A set of trajectories of one device."""

    trajectories: tuple[Trajectory, ...]
    units: dict[str, str] = field(default_factory=lambda: {"q": "rad", "current": "A", "torque": "N·m"})
    """Units of q, current and torque as held here: rad or m; A, V or any unit of the control input; N·m, N or A."""
    source: Path | None = None
    """File or folder it was read from."""
    header: dict[str, Any] = field(default_factory=dict)
    """Statements shared by all files on how they were made (the virtual bench writes its effects and seed)."""
    repairs: tuple[Repair, ...] = ()
    """Data put right or left out when it was read."""
    declared: frozenset[str] = frozenset()
    """Columns whose unit was declared, so that its values are believed."""

    def repaired(self, most: int = 4) -> list[str]:
        """Repairs and omissions, one line each; beyond ``most`` of a kind their number only.

        What is the same of several trajectories is one line.
        """
        found = []
        for kind in dict.fromkeys(repair.kind for repair in self.repairs):
            of = [repair for repair in self.repairs if repair.kind == kind]
            same = {text: [r.trajectory for r in of if r.text == text] for text in dict.fromkeys(r.text for r in of)}
            for text, (first, *others) in list(same.items())[:most]:
                found.append(f"{first}{f' and {len(others)} more' if others else ''}: {text}")
            left = sum(map(len, list(same.values())[most:]))
            if left:
                found.append(f"{kind.replace('_', ' ')}: {left} more of {len(of)}, {sum(r.count for r in of)} in all")
        return found

    @property
    def samples(self) -> int:
        """Samples of all trajectories together."""
        return sum(len(trajectory.t) for trajectory in self.trajectories)

    @property
    def one_way(self) -> bool:
        """Whether no trajectory goes the other way than the others: less than a hundredth of what it goes."""
        return goes_one_way(np.concatenate([run.qd for run in self.trajectories]))

    @property
    def current_range(self) -> tuple[float, float]:
        """Smallest and largest current, in size [unit of the current]."""
        sizes = [np.abs(trajectory.current) for trajectory in self.trajectories]
        return float(min(size.min() for size in sizes)), float(max(size.max() for size in sizes))


def session_clock(recording: Recording) -> np.ndarray | None:
    """Time in the session at which each trajectory starts [s], shape (T,); None where they share no clock.

    They share one where no two of them overlap in their recorded times. The order of files is no time: where each
    begins at 0 s nobody knows which came first.
    """
    starts = np.array([run.t[0] for run in recording.trajectories])
    ends = np.array([run.t[-1] for run in recording.trajectories])
    order = np.argsort(starts, kind="stable")
    return starts - starts.min() if np.all(starts[order][1:] > ends[order][:-1]) else None


@dataclass(frozen=True, kw_only=True)
class Holding:
    """Break-away tests of a device at rest; both arrays float64, shape (N,)."""

    current: np.ndarray
    """Coil current [A] (or driver voltage [V])."""
    torque: np.ndarray
    """Torque at which the joint started to slip [N·m], or force [N]."""
    units: dict[str, str] = field(default_factory=lambda: {"current": "A", "torque": "N·m"})
    """Units of both as held here."""
    header: dict[str, Any] = field(default_factory=dict)
    """The file's statements on how it was made."""
