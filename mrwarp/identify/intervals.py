"""Evidence on each parameter: intervals that survive correlated errors, and parameters that cannot be distinguished.

Trajectories, or blocks of one, are the pieces of :mod:`mrwarp.sysid.jackknife`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrwarp.identify.projection import Point
from mrwarp.sysid.jackknife import effective_count, jackknife, student
from mrwarp.sysid.left_out import left_out
from mrwarp.sysid.pieces import Pieces

_RANK = 1e-8
"""Eigenvalues of the parameters' correlation matrix below this count as directions without information."""
_TOGETHER = 0.995
"""Correlation of two estimates above which they count as not distinguished."""


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A value with its 95 % interval; ``half`` and ``half_joint`` are infinite where the data say nothing.

    ``half_joint`` holds for all parameters of the fit at once (Bonferroni), ``half`` for this one alone.
    """

    value: float
    half: float
    half_joint: float

    @classmethod
    def of(cls, value: float, ci95: Sequence[float] | None) -> Estimate:
        """An estimate by its interval alone."""
        half = 0.5 * (ci95[1] - ci95[0]) if ci95 else np.inf
        return cls(value=value, half=half, half_joint=np.inf)

    @property
    def ci95(self) -> tuple[float, float] | None:
        """Interval, or None where the data say nothing."""
        return (self.value - self.half, self.value + self.half) if np.isfinite(self.half) else None


@dataclass(frozen=True)
class Assessment:
    """Intervals of all parameters asked for, and those that cannot be distinguished."""

    estimates: dict[str, Estimate]
    condition: float
    """Condition number of the normalised normal matrix."""
    together: list[tuple[str, ...]]
    """Groups of parameters of which only a combination is known."""
    correlations: dict[str, dict[str, float]]
    """Correlation of the errors of each pair of parameters that have an interval, by name [1]."""


def assess(
    point: Point,
    transform: Callable[[np.ndarray], Mapping[str, float]],
    count: int,
    names: tuple[str, ...],
    searched: np.ndarray | None = None,
) -> Assessment:
    """Intervals of ``transform(inner parameters)`` at a fitted point.

    Args:
        point: The optimum.
        transform: From inner parameters (linear, then shape) to named values; the first ``count`` are the parameters.
        count: Number of parameters among the named values, for the joint intervals.
        names: Names of the inner parameters.
        searched: Which of the shape's are not given, shape (p,); None: all.
    """
    vector = np.concatenate([point.linear, point.theta])
    free = np.append(point.free, np.ones(len(point.theta), dtype=bool) if searched is None else searched)
    parts = point.gram[:, :-1, :-1]
    score = point.gram[:, :-1, -1] - parts @ np.append(point.linear, np.zeros(len(point.theta)))
    hessian = parts.sum(axis=0)
    scale = np.sqrt(np.maximum(np.diag(hessian), 1e-300))
    free &= scale > 1e-12 * scale.max()
    use = np.flatnonzero(free)
    parts = parts[:, use][:, :, use] / np.outer(scale[use], scale[use])
    score = score[:, use] / scale[use]
    correlation = parts.sum(axis=0)
    values, vectors = np.linalg.eigh(correlation)
    known = values > _RANK * values[-1]
    blind = (vectors[:, ~known] ** 2).sum(axis=1)

    pieces = Pieces(information=parts, score=score, square=np.zeros(len(parts)))
    covariance = jackknife(left_out(pieces, solve=_least))
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T

    base = transform(vector)
    slopes = _slopes(transform, vector, use, scale)
    estimates = {}
    for row, (name, value) in zip(slopes, base.items(), strict=True):
        size, blind_part = float(np.linalg.norm(row)), np.abs(row @ vectors[:, ~known])
        lost = size == 0.0 or (blind_part > 1e-3 * size).any()  # along a direction without information
        variance = float(row @ covariance @ row)
        share = np.einsum("i,gij,j->g", row @ inverse, parts, inverse @ row)
        dof = max(effective_count(share) - 1.0, 1.0)
        sigma = float("inf") if lost else float(np.sqrt(variance))
        half, half_joint = (student(level, dof) * sigma for level in (0.95, 1.0 - 0.05 / count))
        estimates[name] = Estimate(value=float(value), half=half, half_joint=half_joint)
    together = _groups(inverse, blind, [names[i] for i in use])
    known_names = [name for name in list(base)[:count] if np.isfinite(estimates[name].half)]
    rows = np.array([row for name, row in zip(base, slopes, strict=True) if name in known_names])
    correlations = _correlations(known_names, rows @ covariance @ rows.T) if known_names else {}
    return Assessment(estimates, float(values[-1] / max(values[0], 1e-300)), together, correlations)


def _correlations(names: list[str], covariance: np.ndarray) -> dict[str, dict[str, float]]:
    """Correlations by pairs of names; parameters without an error are left out."""
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    use = np.flatnonzero(sigma > 0.0)
    return {names[i]: {names[j]: float(covariance[i, j] / (sigma[i] * sigma[j])) for j in use if j != i} for i in use}


def _least(information: np.ndarray, score: np.ndarray) -> np.ndarray:
    """Shortest solutions of normal equations with directions without information."""
    return np.stack([np.linalg.lstsq(h, u, rcond=_RANK)[0] for h, u in zip(information, score, strict=True)])


def _slopes(
    transform: Callable[[np.ndarray], Mapping[str, float]], vector: np.ndarray, use: np.ndarray, scale: np.ndarray
) -> np.ndarray:
    """Derivatives of the named values by the used, normalised inner parameters, shape (values, used)."""
    columns = []
    for i in use:
        step = np.zeros(len(vector))
        step[i] = 1e-6 * max(1.0, abs(vector[i]))
        up, down = transform(vector + step), transform(vector - step)
        columns.append((np.array(list(up.values())) - np.array(list(down.values()))) / (2.0 * step[i]) / scale[i])
    return np.array(columns).T


def _groups(inverse: np.ndarray, blind: np.ndarray, names: list[str]) -> list[tuple[str, ...]]:
    """Parameters that lie in blind directions, and pairs whose estimates are nearly one."""
    groups: list[tuple[str, ...]] = []
    unseen = tuple(name for name, share in zip(names, blind, strict=True) if share > 1e-3)
    if unseen:
        groups.append(unseen)
    sigma = np.sqrt(np.maximum(np.diag(inverse), 1e-300))
    for i in range(len(names)):
        for j in range(i):
            if abs(inverse[i, j]) > _TOGETHER * sigma[i] * sigma[j] and not {names[i], names[j]} <= set(unseen):
                groups.append((names[j], names[i]))
    return groups
