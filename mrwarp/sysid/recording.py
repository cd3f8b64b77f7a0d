"""Recordings: measured runs of one joint on a bench, checked when they are read."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np


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

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A set of trajectories of one device."""

    trajectories: tuple[Trajectory, ...]
    units: dict[str, str] = field(default_factory=lambda: {"q": "rad", "current": "A", "torque": "N·m"})
    """Units of q, current and torque as recorded."""
    source: Path | None = None
    """File or folder it was read from."""
    header: dict[str, object] = field(default_factory=dict)
    """What the file says about how it was made (the virtual bench writes its effects and seed)."""
