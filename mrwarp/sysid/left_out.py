"""Every piece predicted by the others: the only error by which causes and models are judged."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mrwarp.sysid.least_squares import ridge_solve
from mrwarp.sysid.pieces import Pieces

Solve = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Changes, shape (F, P), from information, (F, P, P), and score, (F, P)."""


def left_out(pieces: Pieces, folds: Sequence[np.ndarray] | None = None, solve: Solve = ridge_solve) -> np.ndarray:
    """Change by all pieces but those of each fold, linearised, shape (F, P).

    Args:
        pieces: The pieces.
        folds: Indices of the pieces of each of F folds; None: each piece is one.
        solve: The fit.
    """
    information, score = pieces.information, pieces.score
    if folds is not None:
        information, score = (np.stack([x[fold].sum(axis=0) for fold in folds]) for x in (information, score))
    whole = pieces.sums()
    return solve(whole[0] - information, whole[1] - score)


def predicted(
    pieces: Pieces, folds: Sequence[np.ndarray] | None = None, solve: Solve = ridge_solve
) -> tuple[np.ndarray, np.ndarray]:
    """Change of each piece's prediction, shape (N, P), and what it leaves of the piece, shape (N,); see left_out."""
    change = left_out(pieces, folds, solve)
    if folds is not None:
        own = np.empty_like(pieces.score)
        for fold, one in zip(folds, change, strict=True):
            own[fold] = one
        change = own
    return change, pieces.left(change)


def one_step(pieces: Pieces, folds: Sequence[np.ndarray], x: np.ndarray, inverse: np.ndarray) -> np.ndarray:
    """Change of numbers ``x``, (P,), where each of F folds is left out, by the ``inverse`` information of all, (F, P).

    To first order as :func:`left_out`. Where few folds say unequally much of many numbers, a fit without one of them
    would rest on what priors say of the others.
    """
    scores = pieces.score - pieces.information @ x
    each = np.stack([scores[fold].sum(axis=0) for fold in folds]) @ inverse
    return -len(folds) / (len(folds) - 1) * each


def in_a_row(count: int, folds: int) -> list[np.ndarray]:
    """Indices of ``count`` pieces in ``folds`` parts of neighbours, whose errors are similar."""
    return np.array_split(np.arange(count), folds)
