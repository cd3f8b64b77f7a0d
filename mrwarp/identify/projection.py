"""Variable projection: least squares of simulated against measured torque for models that are partly linear.

Eq. 14 is linear in D, B, C, I1, K0, K1 once alpha, beta, gamma are given. So only the few *shape* parameters are
searched; for each trial the *linear* ones follow from a small linear system (Golub and Pereyra 1973, with Kaufman's
simplification of the Jacobian). All that the search, the intervals and the warnings need is one Gram matrix per
cluster (trajectory, or block of one).
"""

from __future__ import annotations

import itertools
from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrwarp.identify.checks.lone_samples import find_spikes
from mrwarp.identify.dataset import Dataset
from mrwarp.identify.normal_equations import bounded_solve
from mrwarp.identify.replay import Replay
from mrwarp.sysid.least_squares import RANK, Rules, minimise, minimum_within
from mrwarp.sysid.left_out import predicted
from mrwarp.sysid.pieces import Pieces, Quadratic
from mrwarp.sysid.settings import Search

_STEP = 1e-2
"""Step of the central differences in (logarithmic) shape parameters: truncation and float32 noise both below 1e-4."""
FEW = 8
"""Fewer trajectories than this are cut into blocks to judge the errors."""
_SUBSET = 20_000
"""Samples on which the starts are searched."""
_STARTS = 3
_RULES = Rules(damping=1e-3, relief=5.0, least=1e-12, increase=10.0, most=1e8)

Progress = Callable[[str], None]


class Structure(ABC):
    """A torque model ``columns(shape) @ linear``. All in normalised units of the samples."""

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

    def linear_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the linear parameters, each of shape (L,)."""
        low = np.array([0.0 if name in self.non_negative else -np.inf for name in self.linear])
        return low, np.full(len(low), np.inf)

    def slowest(self, theta: np.ndarray) -> float:
        """How fast z forgets along the path where it does so least [1/normalised unit of q]."""
        loop = self.loop(theta)
        return float(loop["beta"] - abs(loop["gamma"]))

    @abstractmethod
    def loop(self, theta: np.ndarray) -> dict[str, float]:
        """Parameters of the hysteresis of one shape."""

    @abstractmethod
    def elements(self, loop: Mapping[str, float]) -> list[dict[str, float]]:
        """Parameters of the unit elements to be simulated for a hysteresis."""

    @abstractmethod
    def columns(self, samples: Dataset, elements: np.ndarray) -> np.ndarray:
        """Torque per unit of each linear parameter, shape (N, L), from the elements' torque, shape (elements, N)."""


@dataclass(frozen=True)
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


class NextTo(Structure):
    """A structure with further linear columns."""

    def __init__(self, inner: Structure, columns: Mapping[str, np.ndarray], positive: Collection[str] = ()) -> None:
        self.inner, self.added, self.positive = inner, columns, positive
        self.shape, self.low, self.high, self.grid = inner.shape, inner.low, inner.high, inner.grid
        self.linear = (*inner.linear, *columns)

    def linear_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Those of the structure; some of the further ones are positive."""
        low, high = self.inner.linear_bounds()
        own = [0.0 if name in self.positive else -np.inf for name in self.added]
        return np.append(low, own), np.append(high, np.full(len(own), np.inf))

    def loop(self, theta: np.ndarray) -> dict[str, float]:
        """As of the structure."""
        return self.inner.loop(theta)

    def elements(self, loop: Mapping[str, float]) -> list[dict[str, float]]:
        """As of the structure."""
        return self.inner.elements(loop)

    def columns(self, samples: Dataset, elements: np.ndarray) -> np.ndarray:
        """Those of the structure, and the further ones, shape (N, L)."""
        return np.column_stack([self.inner.columns(samples, elements), *self.added.values()])


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
        self._low, self._high = structure.linear_bounds()
        self._signs_only = bool(np.isin(self._low, (0.0, -np.inf)).all() and np.isinf(self._high).all())

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
        return Point(theta, linear, free, sse, gram, base @ linear)

    def descend(self, theta: np.ndarray, *, iterations: int = 30, tolerance: float = 1e-7) -> Point:
        """Levenberg-Marquardt within the bounds, from ``theta`` to the nearest minimum."""
        s = self.structure
        rules = replace(_RULES, iterations=iterations, gained=lambda gain, loss: gain < tolerance * loss)
        found = minimise(lambda x: _reduced(self.evaluate(x)), theta, s.low, s.high, reach=1.5, rules=rules)
        return found.quadratic.content

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
            rows += self.structure.elements(self.structure.loop(theta))
        torque = self.replay.torque(rows)
        per = len(torque) // len(thetas)
        for i in range(len(thetas)):
            yield self.structure.columns(self.samples, torque[i * per : (i + 1) * per])

    def _solve(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Best linear parameters within their bounds, which of them are free, and the sum of squares."""
        weighted = columns * self.weight[:, None]
        gram, moment = columns.T @ weighted, weighted.T @ self.samples.torque
        if self._signs_only:
            linear, free = bounded_solve(gram, moment, self._low == 0.0)
        else:
            linear, held = minimum_within(gram, moment, self._low, self._high)
            free = ~held & (self._low < self._high)
        mismatch = columns @ linear - self.samples.torque
        return linear, free, float(mismatch @ (self.weight * mismatch))


def _clusters(samples: Dataset) -> list[slice]:
    """Parts whose errors count as independent: trajectories, or blocks of them where there are few."""
    parts = samples.parts
    if len(parts) >= FEW:
        return parts
    blocks = -(-2 * FEW // len(parts))
    cuts = [np.linspace(part.start, part.stop, blocks + 1).astype(int) for part in parts]
    return [slice(int(a), int(b)) for cut in cuts for a, b in zip(cut[:-1], cut[1:], strict=True)]


def _reduced(point: Point) -> Quadratic:
    """Sum of squares about a point by the shape parameters, the linear ones projected out."""
    gram, size = point.gram.sum(axis=0), len(point.linear)
    keep = np.flatnonzero(point.free)
    shape = np.arange(size, len(gram) - 1)
    values = np.append(point.linear, np.zeros(len(shape)))
    descent = gram[:-1, -1] - gram[:-1, :-1] @ values
    inner, cross = gram[np.ix_(keep, keep)], gram[np.ix_(keep, shape)]
    lift = np.linalg.lstsq(inner, cross, rcond=RANK)[0]
    return Quadratic(
        point.sse, gram[np.ix_(shape, shape)] - cross.T @ lift, descent[shape] - lift.T @ descent[keep], point
    )


def search(
    structure: Structure, replay: Replay, *, robust: bool = False, seed: int = 0, log: Progress = lambda text: None
) -> tuple[Point, list[str]]:
    """Grid of starts on a subset, descent from the best, refinement on all samples.

    Returns:
        The optimum and warnings about the search.
    """
    log("searching starts")
    points, samples, warnings = search_starts(structure, replay, seed=seed), replay.samples, []
    most = (1.0 + Search.same) * points[0].sse
    rivals = [p for p in points[1:] if p.sse < most and np.abs(p.theta - points[0].theta).max() > 0.3]
    if rivals:
        warnings.append("two different parameter sets fit a part of the data equally well: record richer motion")
    log(f"refining on {len(samples.q)} samples")
    projection = Projection(structure, replay, samples.settled(structure.slowest(points[0].theta)))
    point = projection.descend(points[0].theta)
    for rival in rivals[:1]:
        point = min(point, projection.descend(rival.theta), key=lambda p: p.sse)
    base = projection.weight
    outliers = float(find_spikes(samples.torque - point.simulated, point.simulated, samples, base > 0.0).mean())
    for _ in range(4 if robust else 0):
        log("weighing down outliers")
        deviation = 1.4826 * float(np.median(np.abs(point.simulated - samples.torque)))
        far = np.abs(point.simulated - samples.torque) / (1.345 * deviation)
        projection.weight = base / np.maximum(far, 1.0)
        point = projection.descend(point.theta, iterations=8)
    if outliers and not robust:
        warnings.append(f"{100 * outliers:.2g} % of the samples are spikes: consider --robust")
    return point, warnings


def held_out_ratio(structure: Structure, point: Point, trajectories: int) -> float:
    """RMS error of trajectories that are left out in turn, over that of the fit to all of them, linearised."""
    size = len(point.linear)
    inside = (point.theta > structure.low + 1e-9) & (point.theta < structure.high - 1e-9)
    free = [*np.flatnonzero(point.free), *(size + np.flatnonzero(inside)), -1]
    clusters = point.gram.reshape(trajectories, -1, *point.gram.shape[1:]).sum(axis=1)
    into = np.eye(clusters.shape[1])
    into[:size, -1] = -point.linear  # the last column becomes the mismatch
    parts = into.T @ clusters @ into
    _, losses = predicted(Pieces.of_grams(parts[:, free][:, :, free]))
    return float(np.sqrt(losses.sum() / max(float(parts[:, -1, -1].sum()), 1e-300)))


def search_starts(structure: Structure, replay: Replay, *, limit: int = _SUBSET, seed: int) -> list[Point]:
    """Optima on about ``limit`` samples, from the best starts of the structure's grid, best first."""
    small = replay.samples.subset(limit, seed)
    rough = Projection(structure, Replay(small, exact=replay.exact, substeps=replay.substeps), small.counts)
    points = [rough.descend(theta, tolerance=1e-5) for theta in rough.starts(_STARTS)]
    return sorted(points, key=lambda p: p.sse)
