"""What :mod:`mrwarp.env.watch` tells of an environment in which a number went wrong; loads nothing but numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

KEPT = 100
"""States kept per environment: as many torque steps, half a second."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One number of a kept state."""

    quantity: str
    """What it is, e.g. ``torque``."""
    part: str
    """Joint, leg or axis; empty where there is one only."""
    unit: str
    """Unit; empty for plain numbers."""

    def __str__(self) -> str:
        return f"{self.quantity} of {self.part}" if self.part else self.quantity


@dataclass(frozen=True, kw_only=True)
class Break:
    """What went wrong in one environment, and its last states."""

    env: int
    """Index of the environment."""
    column: int
    """The first wrong number."""
    finite: bool
    """Whether it is a number, but beyond its bounds."""
    columns: tuple[Column, ...]
    """What the columns of ``states`` are; the first is the time in the episode [s]."""
    states: np.ndarray
    """Up to :data:`KEPT` torque steps, oldest first, the last one is the wrong one; shape (n, D)."""
    bounds: np.ndarray
    """Least and largest value of each column of a state that is not broken, shape (2, D)."""

    @property
    def value(self) -> float:
        """The wrong value."""
        return float(self.states[-1, self.column])

    @property
    def time(self) -> float:
        """When, in the episode [s]."""
        return float(self.states[-1, 0])

    def __str__(self) -> str:
        column = self.columns[self.column]
        unit = f" {column.unit}" if column.unit else ""
        low, high = self.bounds[:, self.column]
        beyond = f", beyond [{low:g}, {high:g}]{unit}: the physics blew up" if self.finite else ""
        return f"environment {self.env}, {self.time:.3f} s into its episode: {column} is {self.value:g}{unit}{beyond}"
