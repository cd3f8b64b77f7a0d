"""Identification of the pre-yield holding law (eq. 18) from break-away torques."""

from __future__ import annotations

import itertools

import numpy as np
from scipy import stats
from scipy.optimize import least_squares

from mrwarp.identify.intervals import Estimate
from mrwarp.recording.load import RecordingError


def holding_curve(current: np.ndarray, T_max: float, K: float, n: float) -> np.ndarray:
    """tau_y of eq. 18 [N·m], as ``mrwarp.kernels.brake.yield_torque``, in float64."""
    ratio = (np.abs(current) / K) ** n
    return T_max * ratio / (1.0 + ratio)


def fit_holding(current: np.ndarray, torque: np.ndarray) -> dict[str, Estimate]:
    """Fit ``T_max*I^n/(K^n + I^n)`` to break-away torques by least squares in log(K), log(n) and T_max.

    Args:
        current: Current of each test [A], shape (N,).
        torque: Torque at which the joint gave way [N·m], shape (N,).

    Raises:
        RecordingError: fewer than five tests, or fewer than three levels of current above 0.
    """
    current, torque = np.abs(np.asarray(current, dtype=float)), np.abs(np.asarray(torque, dtype=float))
    levels = len(np.unique(np.round(current[current > 0], 4)))
    if len(current) < 5 or levels < 3:
        raise RecordingError(
            f"{len(current)} break-away tests at {levels} currents above 0; eq. 18 needs 5 tests at 3 currents"
        )
    scale, low, high = float(np.median(current[current > 0])), [-4.0, np.log(0.1)], [4.0, np.log(20.0)]

    def mismatch_of(x: np.ndarray) -> np.ndarray:
        return x[0] * holding_curve(current, 1.0, scale * np.exp(x[1]), np.exp(x[2])) - torque

    def derivatives(x: np.ndarray) -> np.ndarray:
        """By T_max, log(K) and log(n), shape (N, 3)."""
        unit = holding_curve(current, 1.0, scale * np.exp(x[1]), np.exp(x[2]))
        bend = x[0] * np.exp(x[2]) * unit * (1.0 - unit)
        logarithm = np.log(np.where(current > 0.0, current, 1.0) / scale) - x[1]
        return np.column_stack([unit, -bend, bend * logarithm])

    starts = []
    for k, n in itertools.product(np.linspace(-2, 2, 21), np.log(np.linspace(0.5, 8, 20))):
        unit = holding_curve(current, 1.0, scale * np.exp(k), np.exp(n))
        starts.append(np.array([unit @ torque / (unit @ unit), k, n]))
    found = least_squares(
        mismatch_of,
        min(starts, key=lambda x: float((mismatch_of(x) ** 2).sum())),
        jac=derivatives,  # pyright: ignore[reportArgumentType]
        bounds=([-np.inf, *low], [np.inf, *high]),
        x_scale="jac",
        ftol=1e-15,
        xtol=1e-12,
        gtol=1e-15,
    )
    (best, *x), table, mismatch = found.x, found.jac, found.fun
    inverse = np.linalg.pinv(table.T @ table)
    # each test left out once (HC3): the scatter of break-away torques grows with the torque
    leverage = np.einsum("ij,jk,ik->i", table, inverse, table)
    meat = table.T @ (table * (mismatch / np.maximum(1.0 - leverage, 1e-6))[:, None] ** 2)
    sigma = np.sqrt(np.diag(inverse @ meat @ inverse))
    values = {"T_max": float(best), "K": scale * float(np.exp(x[0])), "n": float(np.exp(x[1]))}
    slopes = (1.0, values["K"], values["n"])
    dof = len(current) - 3
    wide, wider = stats.t.ppf((0.975, 1 - 0.025 / 3), dof)
    return {
        name: Estimate(value=value, half=float(wide * s * slope), half_joint=float(wider * s * slope))
        for (name, value), s, slope in zip(values.items(), sigma, slopes, strict=True)
    }
