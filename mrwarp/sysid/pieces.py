"""Pieces of a recording as quadratic forms: what all fits, predictions and tests need, in little memory.

Around numbers ``x`` of a plant the mismatch of a piece is ``r - J*(change of x) - Z*nuisance``. Nuisances are what
every piece has of its own: the offset of a run, the start of a window. They are removed with their normal prior; what
is left of a piece is a quadratic form in the change. Samples of a piece are not independent, so pieces are the units by
which evidence counts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self, TypeVar

import numpy as np

T = TypeVar("T", bound="Pieces")


def without_nuisances(grams: np.ndarray, count: int, precision: np.ndarray | float) -> tuple[np.ndarray, np.ndarray]:
    """Gram matrices of signals whose nuisances are removed.

    Args:
        grams: Gram matrices of [signals, columns of the nuisances], shape (..., M + Z, M + Z).
        count: M.
        precision: Inverse variances of the nuisances' normal prior, shape (Z,) or one for all.

    Returns:
        Gram matrices of the signals, shape (..., M, M), and the likeliest nuisances of each signal, shape (..., Z, M).
    """
    inner = grams[..., count:, count:] + precision * np.eye(grams.shape[-1] - count)
    cross = grams[..., :count, count:]
    found = np.linalg.solve(inner, cross.swapaxes(-1, -2))
    return grams[..., :count, :count] - cross @ found, found


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
        """From the Gram matrix of [derivatives, mismatch], shape (P + 1, P + 1).

        One that is not finite, as of a replay that overflows, has an infinite loss, and no step leads on from there.
        """
        if not np.isfinite(gram).all():
            gram = np.zeros_like(gram)
            gram[-1, -1] = np.inf
        return cls(float(gram[-1, -1]), gram[:-1, :-1], gram[:-1, -1], content)

    def gain(self, step: np.ndarray) -> float:
        """Fall of the sum of squares that the linear model predicts of a step."""
        return float(2.0 * step @ self.descent - step @ self.normal @ step)

    def after(self, step: np.ndarray) -> float:
        """The sum of squares that the linear model predicts after a step."""
        return self.loss - self.gain(step)


@dataclass(frozen=True, kw_only=True)
class Pieces:
    """Sums of squares of N pieces: ``square - 2*score@d + d@information@d`` after a change ``d`` of P numbers."""

    information: np.ndarray
    """Shape (N, P, P)."""
    score: np.ndarray
    """Shape (N, P)."""
    square: np.ndarray
    """Where nothing is changed, shape (N,)."""

    @classmethod
    def of_grams(cls, grams: np.ndarray) -> Self:
        """From Gram matrices of [derivatives, mismatch], shape (N, P + 1, P + 1); see :meth:`Quadratic.of`."""
        finite = np.all(np.isfinite(grams), axis=(1, 2))
        if not finite.all():
            grams = np.where(finite[:, None, None], grams, 0.0)
            grams[~finite, -1, -1] = np.inf
        return cls(information=grams[:, :-1, :-1], score=grams[:, :-1, -1], square=grams[:, -1, -1])

    def left(self, change: np.ndarray) -> np.ndarray:
        """Sum of squares of each piece after a change, one for all, shape (P,), or each its own, (N, P); shape (N,)."""
        change = np.broadcast_to(change, self.score.shape)
        moved = np.einsum("np,npq->nq", change, self.information)
        return self.square - 2.0 * np.einsum("np,np->n", self.score, change) + np.einsum("nq,nq->n", moved, change)

    def sums(self) -> tuple[np.ndarray, np.ndarray]:
        """Information, (P, P), and score, (P,), of all pieces."""
        return self.information.sum(axis=0), self.score.sum(axis=0)

    def times(self, weight: np.ndarray) -> Self:
        """The pieces with weights, shape (N,)."""
        return replace(
            self,
            information=weight[:, None, None] * self.information,
            score=weight[:, None] * self.score,
            square=weight * self.square,
        )

    def some(self, which: Sequence[int] | np.ndarray) -> Self:
        """Some of the pieces, by index."""
        return replace(self, information=self.information[which], score=self.score[which], square=self.square[which])


def about_origin(pieces: T, x: np.ndarray) -> T:
    """Pieces about numbers ``x``, (P,), as forms in the numbers themselves."""
    return replace(pieces, score=pieces.score + pieces.information @ x, square=pieces.left(-x))
