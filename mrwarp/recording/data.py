"""What a recording holds: trajectories, break-away tests, and the error for one that is refused."""

from __future__ import annotations

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
"""Break-away torques beside recordings (see :func:`load_holding`); not a recording itself."""

UNITS = {"t": "s", "q": "rad", "qd": "rad/s", "current": "A", "torque": "N·m", "temperature": "degC"}
"""Unit of each column where nothing else is declared."""


class RecordingError(ValueError):
    """A recording was refused; the message names file, row and column, and the remedy."""


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
    """Coil current [A] (or driver voltage [V])."""
    torque: np.ndarray
    """Measured torque [N·m] or force [N], positive against positive velocity (eq. 14)."""
    temperature: np.ndarray | None = None
    """Temperature [degC], if it was recorded."""
    qd_derived: bool = False
    """True where qd was derived from q by zero-phase differentiation."""
    header: dict[str, Any] = field(default_factory=dict)
    """What the trajectory's own file says about how it was made."""

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A set of trajectories of one device."""

    trajectories: tuple[Trajectory, ...]
    units: dict[str, str] = field(default_factory=lambda: {"q": "rad", "current": "A", "torque": "N·m"})
    """Units of q, current and torque as held here: rad or m, A or V, N·m or N; anything else was converted."""
    source: Path | None = None
    """File or folder it was read from."""
    header: dict[str, Any] = field(default_factory=dict)
    """What all files say alike about how they were made (the virtual bench writes its effects and seed)."""

    @property
    def samples(self) -> int:
        """Samples of all trajectories together."""
        return sum(len(trajectory.t) for trajectory in self.trajectories)


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
    """What the file says about how it was made."""
