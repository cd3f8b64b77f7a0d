"""Tests that a cause must pass before it is named; none rests on a model of the noise, all count pieces as units."""

from __future__ import annotations

import functools

import numpy as np
from scipy import stats

from mrwarp.sysid.jackknife import jackknife, sum_and_error
from mrwarp.sysid.least_squares import ridge_solve
from mrwarp.sysid.left_out import left_out
from mrwarp.sysid.pieces import Pieces

BY_CHANCE, NEARLY_ALL = 5e-5, 0.85
"""Largest chance that pieces agree as much on a cause that explains nothing, by Wilcoxon's signed ranks: one in a
hundred over 200 causes and places. Few pieces cannot reach it: there, this share of the score that they can reach."""


def gain_and_t(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Sum of the differences of losses, shape (N,), and its ratio to its standard error over pieces."""
    gain, error = sum_and_error(before - after)
    return gain, gain / max(error, 1e-12)


def by_ratio(before: np.ndarray, after: np.ndarray) -> float:
    """Mean logarithm of the ratio of pieces' squared errors, shape (N,), over its standard error."""
    ratio = np.log(np.maximum(before, 1e-300) / np.maximum(after, 1e-300))
    return float(ratio.mean()) * np.sqrt(len(ratio)) / max(float(ratio.std(ddof=1)), 1e-12)


def agreement(gain: np.ndarray) -> float:
    """Wilcoxon's signed-rank score over pieces, whose gains differ by orders of magnitude, in what is needed of it."""
    ranks = stats.rankdata(np.abs(gain))
    return float((np.sign(gain) * ranks).sum() / max(np.sqrt((ranks**2).sum()), 1e-12)) / _needed(len(gain))


@functools.cache
def _needed(count: int) -> float:
    """Score for :data:`BY_CHANCE` of so many pieces, by the exact distribution: a normal one has longer tails."""
    chance = np.ones(1)  # of each sum of the ranks that gain
    for rank in range(1, count + 1):
        without = np.pad(chance, (0, rank))
        chance = 0.5 * (without + np.roll(without, rank))
    most, spread = 0.5 * count * (count + 1), float(np.sqrt(count * (count + 1) * (2 * count + 1) / 6.0))
    rare = np.flatnonzero(np.cumsum(chance[::-1])[::-1] <= BY_CHANCE)
    return min(float(2 * rare[0] - most) / spread if len(rare) else np.inf, NEARLY_ALL * most / spread)


def two_sizes(grams: np.ndarray) -> tuple[np.ndarray, float]:
    """Sizes of a cause in two halves of the data, shape (2,), and the standard error of their difference.

    Args:
        grams: Gram matrices of [other derivatives, cause in the first half, cause in the second half, mismatch] of the
            pieces, shape (N, P + 3, P + 3).
    """
    pieces = Pieces.of_grams(grams)
    differences = np.diff(left_out(pieces)[:, -2:])
    return ridge_solve(*pieces.sums())[-2:], float(np.sqrt(jackknife(differences)[0, 0]))


def clearness(value: float, half: float, usual: tuple[float, float]) -> float:
    """Distance of a number from the range of what is no fault, in half of its 95 % interval: clear from 1 on."""
    return float(abs(value - np.clip(value, *usual)) / half)
