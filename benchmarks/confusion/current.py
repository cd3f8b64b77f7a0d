"""The current from the command to the fluid, exact between the edges of a stepwise command.

A command is a list of edges. Behind a lag each stretch between two edges is an exponential, so also monotonic, and
play operators (remanence) have a closed form on it. Nothing is tied to a sampling grid: edges fall where they fall.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Current:
    """Currents of T trajectories with up to E edges each."""

    edge: np.ndarray
    """Time of each edge from the start of its trajectory [s], shape (T, E); the first is 0, unused ones infinite."""
    target: np.ndarray
    """Current that follows each edge [A], shape (T, E)."""
    start: np.ndarray
    """Current at each edge, behind the lag [A], shape (T, E); without lag the target itself."""
    time_constant: float = 0.0
    """Lag [s]."""
    half_widths: tuple[float, ...] = ()
    """Play operators whose mean is the field [A]; none: the field is the current."""
    held: tuple[np.ndarray, ...] = ()
    """State of each play at each edge [A], shape (T, E)."""

    @classmethod
    def steps(cls, edges: list[np.ndarray], levels: list[np.ndarray]) -> Current:
        """A stepwise command; each list holds one array per trajectory, the first edge of each at 0 s."""
        most = max(len(edge) for edge in edges)
        edge = np.stack([np.pad(e, (0, most - len(e)), constant_values=np.inf) for e in edges])
        level = np.stack([np.pad(x, (0, most - len(x)), mode="edge") for x in levels])
        return cls(edge=edge, target=level, start=level)

    def delayed(self, delay: float) -> Current:
        """Every edge but the first later by ``delay`` [s]."""
        edge = self.edge.copy()
        edge[:, 1:] += delay
        return replace(self, edge=edge)

    def scaled(self, gain: float) -> Current:
        """The command times a gain; before lag and remanence."""
        return replace(self, target=gain * self.target, start=gain * self.start)

    def lagged(self, time_constant: float) -> Current:
        """Behind a first-order lag [s] that is settled at the start; before remanence."""
        if time_constant <= 0.0:
            return self
        start = self.target.copy()
        with np.errstate(invalid="ignore"):  # from one unused edge to the next
            kept = np.exp(-np.nan_to_num(np.diff(self.edge, axis=1), nan=0.0, posinf=1e9) / time_constant)
        for k in range(kept.shape[1]):
            start[:, k + 1] = self.target[:, k] + (start[:, k] - self.target[:, k]) * kept[:, k]
        return replace(self, start=start, time_constant=time_constant)

    def magnetised(self, half_widths: tuple[float, ...]) -> Current:
        """With remanence: the field is the mean of plays of these half-widths [A], each from the middle of its gap."""
        reached = self.start if self.time_constant > 0.0 else self.target
        held = []
        for width in half_widths:
            state = reached.copy()
            for k in range(1, state.shape[1]):
                state[:, k] = np.clip(state[:, k - 1], reached[:, k] - width, reached[:, k] + width)
            held.append(state)
        return replace(self, half_widths=half_widths, held=tuple(held))

    def at(self, t: np.ndarray) -> np.ndarray:
        """Field, in amperes of the current that makes it, at times ``t`` of shape (M,): shape (T, M)."""
        last = np.stack([np.searchsorted(edge, t, side="right") - 1 for edge in self.edge])
        current = np.take_along_axis(self.target, last, axis=1)
        if self.time_constant > 0.0:
            since = t - np.take_along_axis(self.edge, last, axis=1)
            ahead = np.take_along_axis(self.start, last, axis=1) - current
            current = current + ahead * np.exp(-since / self.time_constant)
        if not self.half_widths:
            return current
        field = np.zeros_like(current)
        for width, state in zip(self.half_widths, self.held, strict=True):
            before = np.take_along_axis(state, last, axis=1)
            field += np.clip(before, current - width, current + width) / len(self.half_widths)
        return field
