"""Intervals of a fitted model's numbers: what the noise allows, and what trajectories disagree about."""

from __future__ import annotations

import numpy as np
from scipy import stats

from mrwarp.diagnose.engine import Fitted
from mrwarp.identify.least_squares import ridge_solve


def covariance(fit: Fitted) -> np.ndarray:
    """Covariance of the coordinates, shape (P, P): the larger of the noise's and of the jackknife over trajectories."""
    parts, size = fit.grams.parts, len(fit.x)
    total = fit.grams.total[:size, :size]
    scale = np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.pinv(total / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    noise = inverse * max(1.0, float(fit.grams.total[size, size]) / fit.grams.count)
    count = len(parts)
    least = np.zeros(size) if fit.least_variance is None else fit.least_variance
    if count >= 3:
        left = ridge_solve(total - parts[:, :size, :size], fit.grams.total[:size, size] - parts[:, :size, size])
        left = left - left.mean(axis=0)
        least = np.maximum(least, (count - 1) / count * np.einsum("ti,ti->i", left, left))
    ratio = np.sqrt(np.maximum(1.0, least / np.maximum(np.diag(noise), 1e-300)))
    return noise * np.outer(ratio, ratio)


def interval(fit: Fitted, index: int, spread: np.ndarray) -> tuple[float, float]:
    """95 % interval of one coordinate."""
    parts, size = fit.grams.parts, len(fit.x)
    information = parts[:, index, index] if index < size else np.ones(len(parts))
    effective = float(information.sum() ** 2 / max(float((information**2).sum()), 1e-300))
    half = stats.t.ppf(0.975, max(effective - 1.0, 2.0)) * float(np.sqrt(spread[index, index]))
    return float(fit.x[index] - half), float(fit.x[index] + half)
