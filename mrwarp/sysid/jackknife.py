"""Intervals with pieces as the units of chance: the jackknife, and Student's quantile by the pieces that bear on it.

Errors of a recording live at the level of pieces (zero drift, gain, temperature), so samples are not independent. The
covariance is the leave-one-piece-out jackknife (cluster-robust, CR3), linearised at the optimum, and its quantile is
Student's with the effective number of pieces (Carter, Schnepel and Steigerwald 2017).
"""

from __future__ import annotations

import numpy as np
from scipy import stats


def jackknife(changes: np.ndarray) -> np.ndarray:
    """Covariance of numbers, shape (P, P), by their changes where each of N pieces is left out, shape (N, P)."""
    count = len(changes)
    spread = changes - changes.mean(axis=0)
    return (count - 1) / count * spread.T @ spread


def effective_count(information: np.ndarray) -> float:
    """Number of equal pieces that bear as much on a number as pieces with this information on it, shape (N,)."""
    return float(information.sum() ** 2 / max(float((information**2).sum()), 1e-300))


def student(level: float, dof: float) -> float:
    """Half the width of a two-sided interval that holds a number with this chance, in standard errors."""
    return float(stats.t.ppf(0.5 + 0.5 * level, dof))


def sum_and_error(differences: np.ndarray) -> tuple[float, float]:
    """Sum over pieces, shape (N,), and its standard error; infinite for one piece."""
    count = len(differences)
    error = float(np.std(differences, ddof=1) * np.sqrt(count)) if count > 1 else float("inf")
    return float(differences.sum()), error
