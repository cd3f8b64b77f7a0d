"""Normal equations of a joint's trajectories: the pieces on which :mod:`mrwarp.sysid` works.

One evaluation simulates a model and all its derivative columns side by side, as environments of one launch, and keeps
normal equations only. Nuisances are the offset and the factor of each trajectory. Small problems with a formula take
``scipy.optimize.least_squares``.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from mrwarp.identify.dataset import Dataset
from mrwarp.identify.noise import Noise
from mrwarp.sysid.least_squares import RANK, ridge_solve
from mrwarp.sysid.left_out import predicted
from mrwarp.sysid.pieces import Pieces, without_nuisances

_LEAST_FACTOR = 0.1
"""Smallest factor of a trajectory that derivatives are multiplied by."""
_TOGETHER = 10_000
"""Samples that are whitened together: few calls of many, while they stay in the processor's cache."""


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
        keep = values > RANK * values[-1]
        inner = vectors[:, keep] @ ((vectors[:, keep].T @ (moment[free] / d)) / values[keep])
        solution[free] = inner / d
        outside = bounded & (solution < 0)
        if not outside.any():
            return solution, free
        free[np.argmin(np.where(outside, solution * scale, np.inf))] = False


class NormalEquations:
    """Whitened Gram matrices of signals, one per trajectory, with offsets and factors marginalised.

    That of signals that are not finite, as of a replay that overflows, is infinite.

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
            with np.errstate(invalid="ignore"):
                table = noise.white(table)
                table *= counts[here]
                inside = [table[:, part.start - here.start : part.stop - here.start] for part in parts]
                return [signals @ signals.T for signals in inside]

        with ThreadPoolExecutor(threads) as pool:
            grams = np.array([gram for some in pool.map(reduced, _together(samples.parts)) for gram in some])
        finite = np.all(np.isfinite(grams), axis=(1, 2))
        self.parts, found = without_nuisances(np.where(finite[:, None, None], grams, 0.0), size, 1.0 / spread**2)
        """Shape (T, M, M)."""
        if derivatives:
            factors = np.maximum(1.0 + found[:, 1, -1], _LEAST_FACTOR)[:, None, None]
            self.parts[:, :-1] *= factors
            self.parts[:, :, :-1] *= factors
        self.parts[~finite] = np.inf
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
    columns = [*use, target]
    pieces = Pieces.of_grams(grams.parts[:, columns][:, :, columns])

    def solve(information: np.ndarray, score: np.ndarray) -> np.ndarray:
        return ridge_solve(information, score, ridge)

    solution = solve(*pieces.sums())
    return solution, pieces.left(solution), predicted(pieces, solve=solve)[1]
