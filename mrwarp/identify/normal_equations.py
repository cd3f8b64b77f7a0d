"""Normal equations per trajectory: everything that fits, leave-one-out errors and tests need of a table of columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mrwarp.identify.dataset import Dataset
from mrwarp.identify.least_squares import ridge_solve
from mrwarp.identify.noise import Noise


class NormalEquations:
    """Whitened Gram matrices of signals, one per trajectory, with offsets and factors marginalised.

    Args:
        rows: The signals, shape (M, N), or blocks of them.
        torque: Simulated torque, for the factor of each trajectory, shape (N,).
        samples: The samples.
        noise: The noise model.
        weight: 1 for samples that count, 0 for those that do not, shape (N,).
    """

    def __init__(
        self,
        rows: np.ndarray | Sequence[np.ndarray],
        torque: np.ndarray,
        samples: Dataset,
        noise: Noise,
        weight: np.ndarray,
    ) -> None:
        blocks = [rows] if isinstance(rows, np.ndarray) else rows
        cuts = np.cumsum([0, *(len(block) for block in blocks)])
        size, first = int(cuts[-1]), len(noise.whitening) - 1
        spread = np.maximum([noise.offset, noise.gain], 1e-9)
        parts = []
        self.count = 0.0
        for part in samples.parts:  # one after the other: a whole table would be many times the recording
            table = np.empty((size + 2, part.stop - part.start))
            for at, block in zip(cuts[:-1], blocks, strict=True):
                table[at : at + len(block)] = block[:, part]
            table[size], table[size + 1] = 1.0, torque[part]
            counted = weight[part].copy()
            counted[:first] = 0.0
            table = noise.white(table) * counted
            gram = table @ table.T
            inner = gram[size:, size:] + np.diag(1.0 / spread**2)
            cross = gram[:size, size:]
            parts.append(gram[:size, :size] - cross @ np.linalg.solve(inner, cross.T))
            self.count += float(counted.sum())
        self.parts = np.array(parts)
        """Shape (T, M, M)."""
        self.total = self.parts.sum(axis=0)


def losses(
    grams: NormalEquations, use: list[int], target: int, *, ridge: float = 1e-9, penalty: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Fit of column ``target`` by columns ``use``: solution, loss and leave-one-out loss of each trajectory.

    Args:
        grams: The table.
        use: Columns of the fit.
        target: Column that is fitted.
        ridge: Relative ridge.
        penalty: Ridge of each used column in units of its own square sum per trajectory count, or None.

    Returns:
        Solution, shape (len(use),); losses, shape (T,); leave-one-out losses, shape (T,).
    """
    a = grams.parts[:, use][:, :, use]
    b = grams.parts[:, use, target]
    c = grams.parts[:, target, target]
    total, moment = a.sum(axis=0), b.sum(axis=0)
    add = np.zeros_like(total)
    if penalty is not None:
        add = np.diag(penalty * np.maximum(np.diag(total), 1e-300))
    solution = ridge_solve(total + add, moment, ridge)
    inside = c - 2.0 * b @ solution + np.einsum("i,tij,j->t", solution, a, solution)
    left = ridge_solve(total + add - a, moment - b, ridge)
    outside = c - 2.0 * np.einsum("ti,ti->t", b, left) + np.einsum("ti,tij,tj->t", left, a, left)
    return solution, inside, outside
