"""The noise of a data set: its spectrum, and what differs from trajectory to trajectory.

Measured torque errs in three ways: sample by sample, with the sensor's and the stand's spectrum, by an offset per
trajectory and by a factor per trajectory. Counting samples as independent would make every drift an effect. So
mismatch is compared after an autoregressive whitening, and with offsets and factors of a known spread taken out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.optimize import root_scalar

from mrwarp.identify.dataset import Dataset

_ORDER = 4


@dataclass(frozen=True, kw_only=True)
class Noise:
    """A noise model."""

    whitening: np.ndarray
    """Filter that makes it white, first coefficient 1, shape (order + 1,)."""
    sigma: float
    """Standard deviation of a whitened sample [inner torque]."""
    rms: float
    """Standard deviation of a sample before whitening [inner torque]."""
    offset: float
    """Spread of the trajectories' offsets [inner torque]."""
    gain: float
    """Spread of the trajectories' factors [1]."""

    def white(self, rows: np.ndarray) -> np.ndarray:
        """Whitened signals in units of sigma, shape (..., N); the first samples of a trajectory have no past."""
        out = rows / self.sigma
        for lag, coefficient in enumerate(self.whitening[1:] / self.sigma, start=1):
            out[..., lag:] += coefficient * rows[..., :-lag]
        return out


def estimate_noise(residual: np.ndarray, torque: np.ndarray, samples: Dataset, offset: float, gain: float) -> Noise:
    """Noise from what no model explains.

    Args:
        residual: Mismatch after everything predictable was taken out, shape (N,).
        torque: Simulated torque, shape (N,).
        samples: The samples.
        offset: Spread of the trajectories' offsets.
        gain: Spread of the trajectories' factors.
    """
    shortest = min(part.stop - part.start for part in samples.parts)
    order = max(1, min(_ORDER, shortest // 50))
    covariance, count = np.zeros(order + 1), 0
    for part in samples.parts:
        counts = samples.counts[part] > 0.0
        r = np.where(counts, residual[part] - residual[part][counts].mean(), 0.0)
        covariance += [float(r[: len(r) - k] @ r[k:]) for k in range(order + 1)]
        count += int(counts.sum())
    covariance /= max(count, 1)
    floor = 1e-12 * max(float(torque.var()), 1e-300)
    covariance[0] = covariance[0] * (1.0 + 1e-6) + floor
    coefficients = solve_toeplitz(covariance[:-1], covariance[1:])
    variance = float(covariance[0] - coefficients @ covariance[1:])
    sigma, size = np.sqrt([max(variance, floor), covariance[0]]).tolist()
    return Noise(whitening=np.concatenate([[1.0], -coefficients]), sigma=sigma, rms=size, offset=offset, gain=gain)


def trajectory_spread(
    mismatch: np.ndarray, torque: np.ndarray, samples: Dataset, trends: np.ndarray
) -> tuple[float, float]:
    """Spread of offsets and of factors between trajectories, after the errors of finding them are taken out.

    Args:
        mismatch: Measured minus simulated, shape (N,).
        torque: Simulated, shape (N,).
        samples: The samples.
        trends: What offsets and factors may depend on from trajectory to trajectory without being noise, shape (T, k);
            each costs one of the T trajectories.
    """
    found, variances = [], []
    for part in samples.parts:
        f = torque[part] - torque[part].mean()
        table = np.column_stack([np.ones(len(f)), f])
        gram = table.T @ table
        gram[np.diag_indices(2)] += 1e-12 * np.trace(gram)
        solution = np.linalg.solve(gram, table.T @ mismatch[part])
        rest = mismatch[part] - table @ solution
        # samples are correlated over about 50 ms: count blocks of that length
        effective = float(np.mean(rest**2)) * max(1.0, 0.05 / samples.dt[0])
        found.append(solution)
        variances.append(effective * np.diag(np.linalg.inv(gram)))
    table = np.column_stack([np.ones(len(found)), trends])
    table = table[:, : max(1, len(found) // 2)]
    values, errors = np.array(found).T, np.array(variances).T
    return excess_spread(values[0], errors[0], table), excess_spread(values[1], errors[1], table)


def excess_spread(values: np.ndarray, variances: np.ndarray, table: np.ndarray) -> float:
    """Standard deviation beyond the known errors of values about a regression, one standard error on the safe side.

    The estimate is that of Paule and Mandel (1982). Values and ``variances`` of their known errors are of shape (T,),
    the ``table`` of regressors of shape (T, k) with k < T.
    """
    free = len(values) - np.linalg.matrix_rank(table)
    if free < 1:
        return 0.0

    def surplus(square: float) -> float:
        root = 1.0 / np.sqrt(variances + square)
        solution = np.linalg.lstsq(table * root[:, None], values * root, rcond=None)[0]
        return float((((values - table @ solution) * root) ** 2).sum()) - free

    square, high = 0.0, float(np.var(values)) * len(values) / free
    if surplus(0.0) > 0.0 and high > 0.0:
        square = high if surplus(high) >= 0.0 else root_scalar(surplus, bracket=(0.0, high), rtol=1e-6).root
    return float(np.sqrt(square + (square + float(np.median(variances))) * np.sqrt(2.0 / free)))
