"""Variable projection: least squares of simulated against measured torque for models that are partly linear.

Eq. 14 is linear in D, B, C, I1, K0, K1 once alpha, beta, gamma are given. So only the few *shape* parameters are
searched; for each trial the *linear* ones follow from a small linear system (Golub and Pereyra 1973, with Kaufman's
simplification of the Jacobian). All that the search, the intervals and the warnings need is one Gram matrix per
cluster (trajectory, or block of one).
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrwarp.identify.replay import Replay, Samples

_STEP = 1e-2
"""Step of the central differences in (logarithmic) shape parameters: truncation and float32 noise both below 1e-4."""
FEW = 8
"""Fewer trajectories than this are cut into blocks to judge the errors."""
_RANK = 1e-9
"""Eigenvalues of a correlation matrix below this count as zero."""


class Structure(ABC):
    """A torque model ``columns(shape) @ linear``. All in inner units of the samples."""

    shape: tuple[str, ...]
    """Names of the shape parameters."""
    low: np.ndarray
    high: np.ndarray
    grid: tuple[np.ndarray, ...]
    """Starting values of each shape parameter."""
    linear: tuple[str, ...]
    """Names of the linear parameters."""
    non_negative: tuple[str, ...] = ()
    """Linear parameters that may not be negative."""

    @abstractmethod
    def elements(self, theta: np.ndarray) -> list[dict[str, float]]:
        """Parameters of the unit hysteresis elements to be simulated for one shape."""

    @abstractmethod
    def columns(self, samples: Samples, elements: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Torque per unit of each linear parameter, shape (N, L), from the elements' torque, shape (elements, N)."""


@dataclass(frozen=True, kw_only=True)
class Point:
    """The model at one shape, with the best linear parameters."""

    theta: np.ndarray
    linear: np.ndarray
    free: np.ndarray
    """False for linear parameters at their bound 0 or without effect, shape (L,)."""
    sse: float
    """Weighted sum of squared mismatch."""
    gram: np.ndarray
    """Per cluster: Gram matrix of [columns, d torque/d theta, measured], shape (G, L + p + 1, L + p + 1)."""
    simulated: np.ndarray
    """Torque, shape (N,)."""


class Projection:
    """A structure on samples.

    Args:
        structure: The model.
        replay: The samples on a device.
        weight: Weight of each sample, shape (N,); None: all count 1.
    """

    def __init__(self, structure: Structure, replay: Replay, weight: np.ndarray | None = None) -> None:
        self.structure, self.replay, self.samples = structure, replay, replay.samples
        self.weight = np.ones(len(self.samples.q)) if weight is None else weight
        self.clusters = _clusters(self.samples)
        self._bounded = np.array([name in structure.non_negative for name in structure.linear])

    def costs(self, thetas: Sequence[np.ndarray]) -> np.ndarray:
        """Sum of squares at the best linear parameters of each shape, shape (len(thetas),)."""
        columns = self._columns(thetas)
        return np.array([self._solve(c)[2] for c in columns])

    def evaluate(self, theta: np.ndarray) -> Point:
        """Everything about one shape: one launch simulates it and its derivative columns."""
        s, num = self.structure, len(theta)
        steps = _STEP * np.eye(num)
        trials = [theta, *(theta + d for d in steps), *(theta - d for d in steps)]
        columns = iter(self._columns(trials))
        base = next(columns)
        linear, free, sse = self._solve(base)
        tau = [c @ linear for c in columns]
        slopes = [(tau[j] - tau[num + j]) / (2 * _STEP) for j in range(num)]
        table = np.column_stack([base, *slopes, self.samples.torque]) * np.sqrt(self.weight)[:, None]
        size = len(s.linear) + num + 1
        gram = np.empty((len(self.clusters), size, size))
        for k, part in enumerate(self.clusters):
            gram[k] = table[part].T @ table[part]
        return Point(theta=theta, linear=linear, free=free, sse=sse, gram=gram, simulated=base @ linear)

    def descend(self, theta: np.ndarray, *, iterations: int = 30, tolerance: float = 1e-7) -> Point:
        """Levenberg-Marquardt within the bounds, from ``theta`` to the nearest minimum."""
        s = self.structure
        point, damping = self.evaluate(np.clip(theta, s.low, s.high)), 1e-3
        for _ in range(iterations):
            normal, gradient = _reduced(point)
            free = ~(((point.theta <= s.low) & (gradient < 0)) | ((point.theta >= s.high) & (gradient > 0)))
            step = np.zeros(len(theta))
            sub = normal[np.ix_(free, free)]
            ridge = damping * np.diag(np.diag(sub)) + 1e-14 * np.eye(len(sub)) * max(1e-300, np.trace(normal))
            step[free] = np.clip(np.linalg.lstsq(sub + ridge, gradient[free], rcond=None)[0], -1.5, 1.5)
            trial = np.clip(point.theta + step, s.low, s.high)
            cost = float(self.costs([trial])[0])
            moved = float(np.abs(trial - point.theta).max())
            gain = (point.sse - cost) / max(point.sse, 1e-300)
            if gain > 0:
                point, damping = self.evaluate(trial), max(damping / 5, 1e-12)
            else:
                damping *= 10
            if moved < 1e-7 or (0 <= gain < tolerance and moved < 1e-2) or damping > 1e8:
                break
        return point

    def starts(self, count: int) -> list[np.ndarray]:
        """The best starting values of the grid, no two of them neighbours."""
        grid = self.structure.grid
        cells = list(itertools.product(*(range(len(axis)) for axis in grid)))
        thetas = [np.array([axis[i] for axis, i in zip(grid, cell, strict=True)]) for cell in cells]
        order = np.argsort(self.costs(thetas), kind="stable")
        taken: list[int] = []
        for i in order:
            if all(max(abs(a - b) for a, b in zip(cells[i], cells[j], strict=True)) > 1 for j in taken):
                taken.append(int(i))
            if len(taken) == count:
                break
        return [thetas[i] for i in taken]

    def _columns(self, thetas: Sequence[np.ndarray]):
        """Columns of each shape, one at a time to bound the memory."""
        rows: list[Mapping[str, float]] = []
        for theta in thetas:
            rows += self.structure.elements(theta)
        torque = self.replay.torque(rows)
        per = len(torque) // len(thetas)
        for i, theta in enumerate(thetas):
            yield self.structure.columns(self.samples, torque[i * per : (i + 1) * per], theta)

    def _solve(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Best linear parameters within their bounds, which of them are free, and the sum of squares."""
        weighted = columns * self.weight[:, None]
        gram, moment = columns.T @ weighted, weighted.T @ self.samples.torque
        linear, free = bounded_solve(gram, moment, self._bounded)
        mismatch = columns @ linear - self.samples.torque
        return linear, free, float(mismatch @ (self.weight * mismatch))


def bounded_solve(gram: np.ndarray, moment: np.ndarray, bounded: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares from normal equations with some unknowns >= 0: smallest solution where columns are dependent."""
    scale = np.sqrt(np.diag(gram))
    free = scale > 1e-12 * max(scale.max(), 1e-300)
    while True:
        solution = np.zeros(len(moment))
        if not free.any():
            return solution, free
        d = scale[free]
        values, vectors = np.linalg.eigh(gram[np.ix_(free, free)] / np.outer(d, d))
        keep = values > _RANK * values[-1]
        inner = vectors[:, keep] @ ((vectors[:, keep].T @ (moment[free] / d)) / values[keep])
        solution[free] = inner / d
        outside = bounded & (solution < 0)
        if not outside.any():
            return solution, free
        free[np.argmin(np.where(outside, solution * scale, np.inf))] = False


def _clusters(samples: Samples) -> list[slice]:
    """Parts whose errors count as independent: trajectories, or blocks of them where there are few."""
    parts = samples.parts
    if len(parts) >= FEW:
        return parts
    blocks = -(-2 * FEW // len(parts))
    cuts = [np.linspace(part.start, part.stop, blocks + 1).astype(int) for part in parts]
    return [slice(int(a), int(b)) for cut in cuts for a, b in zip(cut[:-1], cut[1:], strict=True)]


def _reduced(point: Point) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrix and descent direction of the shape parameters with the linear ones projected out."""
    gram, size = point.gram.sum(axis=0), len(point.linear)
    keep = np.flatnonzero(point.free)
    shape = np.arange(size, len(gram) - 1)
    values = np.append(point.linear, np.zeros(len(shape)))
    descent = gram[:-1, -1] - gram[:-1, :-1] @ values
    inner, cross = gram[np.ix_(keep, keep)], gram[np.ix_(keep, shape)]
    lift = np.linalg.lstsq(inner, cross, rcond=_RANK)[0]
    return gram[np.ix_(shape, shape)] - cross.T @ lift, descent[shape] - lift.T @ descent[keep]
