"""Least squares by normal equations, per trajectory, and one Levenberg-Marquardt loop within bounds on top.

One evaluation simulates a model and all its derivative columns side by side, as environments of one launch, and keeps
normal equations only: all that fits, leave-one-out errors and tests need, in little memory. Small problems with a
formula take ``scipy.optimize.least_squares``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrwarp.identify.dataset import Dataset
from mrwarp.identify.noise import Noise

_RANK = 1e-9
"""Eigenvalues of a correlation matrix below this count as zero."""
_LEAST_FACTOR = 0.1
"""Smallest factor of a trajectory that derivatives are multiplied by."""
_TOGETHER = 10_000
"""Samples that are whitened together: few calls of many, while they stay in the processor's cache."""


@dataclass(frozen=True)
class Quadratic:
    """A sum of squares about a point: ``loss - 2*descent@d + d@normal@d`` after a step ``d``."""

    loss: float
    normal: np.ndarray
    """Normal matrix, shape (P, P)."""
    descent: np.ndarray
    """Half the negative gradient, shape (P,)."""
    content: Any = None
    """Further findings of the evaluation, for the caller."""

    @classmethod
    def of(cls, gram: np.ndarray, content: Any = None) -> Quadratic:
        """From the Gram matrix of [derivatives, mismatch], shape (P + 1, P + 1)."""
        return cls(float(gram[-1, -1]), gram[:-1, :-1], gram[:-1, -1], content)

    def after(self, step: np.ndarray) -> float:
        """The loss that the linear model predicts after a step."""
        return float(self.loss - 2.0 * step @ self.descent + step @ self.normal @ step)


@dataclass(frozen=True, kw_only=True)
class Rules:
    """How a search is damped and when it ends."""

    iterations: int = 12
    damping: float = 1e-4
    """First damping, relative to the normal matrix's diagonal."""
    relief: float = 10.0
    """Divisor of the damping at a better point."""
    least: float = 1e-9
    increase: float = 30.0
    """Factor on the damping at a worse point."""
    most: float = 1e4
    """Damping at which the search gives up."""
    predicted: Callable[[float, float], bool] = lambda gain, loss: gain <= 1e-12 * loss
    """Whether a predicted gain is too small to be tried."""
    gained: Callable[[float, float], bool] = lambda gain, loss: False
    """Whether a gain was so small that the search ends with it."""


def minimise(
    evaluate: Callable[[np.ndarray], Quadratic],
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    *,
    reach: np.ndarray | float = np.inf,
    rules: Rules | None = None,
    loss: Callable[[np.ndarray], float] | None = None,
) -> tuple[np.ndarray, Quadratic]:
    """Levenberg-Marquardt within bounds.

    Args:
        evaluate: The sum of squares about a point.
        x: Where the search starts, shape (P,); moved into the bounds ``low`` and ``high``, of the same shape.
        low: Lower bounds.
        high: Upper bounds.
        reach: Longest step of each coordinate, shape (P,) or one for all.
        rules: Damping and end of the search.
        loss: The sum of squares at a point, where that takes less than ``evaluate``, which is then asked about better
            points only.

    Returns:
        The best point found and the sum of squares about it.
    """
    rules = rules or Rules()
    x = np.clip(x, low, high)
    here, damping = evaluate(x), rules.damping
    for _ in range(rules.iterations):
        while True:
            room = np.maximum(low - x, -reach), np.minimum(high - x, reach)
            trial = np.clip(x + bounded_step(here, *room, damping), low, high)
            gain = here.loss - here.after(trial - x)
            if gain > 0.0 or damping > rules.most:
                break
            damping *= rules.increase  # bounds have bent the step so far that it leads uphill
        if rules.predicted(gain, here.loss):
            break
        there = evaluate(trial) if loss is None or loss(trial) < here.loss else None
        if there is not None and there.loss < here.loss:
            gain = here.loss - there.loss
            x, here, damping = trial, there, max(damping / rules.relief, rules.least)
            if rules.gained(gain, here.loss):
                break
        else:
            damping *= rules.increase
            if damping > rules.most:
                break
    return x, here


def bounded_step(here: Quadratic, low: np.ndarray, high: np.ndarray, damping: float) -> np.ndarray:
    """Damped step within bounds: numbers that push against a bound are held there, the others solved again."""
    free = np.ones(len(low), dtype=bool)
    step = np.zeros(len(low))
    for _ in range(8):
        index = np.flatnonzero(free)
        normal = here.normal[np.ix_(index, index)]
        normal = normal + damping * np.diag(np.diag(normal))
        held = np.where(free, 0.0, step)
        step[index] = ridge_solve(normal, here.descent[index] - here.normal[index] @ held)
        out = ((step < low) | (step > high)) & free
        if not out.any():
            return step
        step = np.clip(step, low, high)
        free &= ~out
    return step


def ridge_solve(gram: np.ndarray, moment: np.ndarray, ridge: float = 1e-9) -> np.ndarray:
    """Least squares from (a stack of) normal equations, with a small relative ridge."""
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", gram), 1e-300))
    normal = gram / (scale[..., :, None] * scale[..., None, :])
    normal = normal + ridge * np.eye(gram.shape[-1])
    return np.linalg.solve(normal, (moment / scale)[..., None])[..., 0] / scale


def leave_out(parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Prediction of each trajectory by the fit to the others, linearised at the optimum.

    Args:
        parts: Gram matrices of [derivatives, mismatch] of the trajectories, shape (T, P + 1, P + 1).

    Returns:
        Change of the parameters, shape (T, P), and squared error of the trajectory, shape (T,).
    """
    a, b = parts[:, :-1, :-1], parts[:, :-1, -1]
    d = ridge_solve(a.sum(axis=0) - a, b.sum(axis=0) - b)
    return d, parts[:, -1, -1] - 2.0 * np.einsum("ti,ti->t", b, d) + np.einsum("ti,tij,tj->t", d, a, d)


def bounded_solve(gram: np.ndarray, moment: np.ndarray, bounded: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least squares from normal equations with some unknowns >= 0: smallest solution where columns are dependent.

    Args:
        gram: Gram matrix of the columns, shape (P, P).
        moment: Products of the columns and the target, shape (P,).
        bounded: True for unknowns that may not be negative, shape (P,).

    Returns:
        The solution, and False for unknowns at their bound or without effect; both of shape (P,).
    """
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


class NormalEquations:
    """Whitened Gram matrices of signals, one per trajectory, with offsets and factors marginalised.

    Args:
        blocks: The signals, in blocks of shape (k, N) that together have M rows.
        torque: Simulated torque, for the factor of each trajectory, shape (N,).
        samples: The samples.
        noise: The noise model.
        weight: 1 for samples that count, 0 for those that do not, shape (N,).
        threads: CPU threads.
        derivatives: The last row is the mismatch, the others are derivatives of the simulated torque, which a
            trajectory's factor multiplies as well.
    """

    def __init__(
        self,
        blocks: Sequence[np.ndarray],
        torque: np.ndarray,
        samples: Dataset,
        noise: Noise,
        weight: np.ndarray,
        threads: int = 1,
        derivatives: bool = False,
    ) -> None:
        cuts = np.cumsum([0, *(len(block) for block in blocks)])
        size, first = int(cuts[-1]), len(noise.whitening) - 1
        spread = np.maximum([noise.offset, noise.gain], 1e-9)
        counts = weight.copy()
        for part in samples.parts:  # the first samples have no past that whitens them
            counts[part][:first] = 0.0

        def reduced(parts: Sequence[slice]) -> list[np.ndarray]:
            """Gram matrices of trajectories in a row: a table of all would be many times the recording."""
            here = slice(parts[0].start, parts[-1].stop)
            table = np.empty((size + 2, here.stop - here.start))
            for at, block in zip(cuts[:-1], blocks, strict=True):
                table[at : at + len(block)] = block[:, here]
            table[size], table[size + 1] = 1.0, torque[here]
            table = noise.white(table)
            table *= counts[here]
            inside = [table[:, part.start - here.start : part.stop - here.start] for part in parts]
            return [signals @ signals.T for signals in inside]

        with ThreadPoolExecutor(threads) as pool:
            grams = np.array([gram for some in pool.map(reduced, _together(samples.parts)) for gram in some])
        inner = grams[:, size:, size:] + np.diag(1.0 / spread**2)
        cross = grams[:, :size, size:]
        found = np.linalg.solve(inner, cross.transpose(0, 2, 1))
        self.parts = grams[:, :size, :size] - cross @ found
        """Shape (T, M, M)."""
        if derivatives:
            factors = np.maximum(1.0 + found[:, 1, -1], _LEAST_FACTOR)[:, None, None]
            self.parts[:, :-1] *= factors
            self.parts[:, :, :-1] *= factors
        self.count = float(counts.sum())
        """Samples that count."""
        self.total = self.parts.sum(axis=0)


def _together(parts: Sequence[slice]) -> list[list[slice]]:
    """Trajectories that follow each other, of about :data:`_TOGETHER` samples."""
    groups: list[list[slice]] = []
    for part in parts:
        if groups and part.stop - groups[-1][0].start <= _TOGETHER:
            groups[-1].append(part)
        else:
            groups.append([part])
    return groups


def losses(
    grams: NormalEquations, use: list[int], target: int, *, ridge: float = 1e-9
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit of column ``target`` by columns ``use``: solution, loss and leave-one-out loss of each trajectory.

    Args:
        grams: The table.
        use: Columns of the fit.
        target: Column that is fitted.
        ridge: Relative ridge.

    Returns:
        Solution, shape (len(use),); losses, shape (T,); leave-one-out losses, shape (T,).
    """
    a = grams.parts[:, use][:, :, use]
    b = grams.parts[:, use, target]
    c = grams.parts[:, target, target]
    total, moment = a.sum(axis=0), b.sum(axis=0)
    solution = ridge_solve(total, moment, ridge)
    inside = c - 2.0 * b @ solution + np.einsum("i,tij,j->t", solution, a, solution)
    left = ridge_solve(total - a, moment - b, ridge)
    outside = c - 2.0 * np.einsum("ti,ti->t", b, left) + np.einsum("ti,tij,tj->t", left, a, left)
    return solution, inside, outside
