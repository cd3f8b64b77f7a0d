"""Identification of the pre-yield holding law (eq. 18) from break-away torques."""

from __future__ import annotations

import numpy as np

from mrwarp.identify.identifiability import Estimate, student
from mrwarp.recording.load import RecordingError


def holding_curve(current: np.ndarray, T_max: float, K: float, n: float) -> np.ndarray:
    """tau_y of eq. 18 [N·m], as ``mrwarp.kernels.hold.yield_torque``, in float64."""
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
    scale = float(np.median(current[current > 0]))

    def columns(x: np.ndarray) -> np.ndarray:
        return holding_curve(current, 1.0, scale * np.exp(x[0]), float(np.exp(x[1])))

    def gain(x: np.ndarray) -> float:
        c = columns(x)
        return float(c @ torque / (c @ c))

    def cost(x: np.ndarray) -> float:
        return float(((gain(x) * columns(x) - torque) ** 2).sum())

    grid = [np.array([a, b]) for a in np.linspace(-2, 2, 21) for b in np.log(np.linspace(0.5, 8, 20))]
    x, damping = min(grid, key=cost), 1e-3
    for _ in range(100):
        table = _table(x, gain(x), columns)
        normal = table.T @ table
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), table.T @ (torque - gain(x) * columns(x)))
        trial = np.clip(x + np.clip(step[1:], -0.5, 0.5), [-4.0, np.log(0.1)], [4.0, np.log(20.0)])
        if cost(trial) < cost(x):
            x, damping = trial, damping / 5
        else:
            damping *= 10
        if np.abs(step[1:]).max() < 1e-10 or damping > 1e10:
            break
    best = gain(x)
    table, mismatch = _table(x, best, columns), best * columns(x) - torque
    inverse = np.linalg.pinv(table.T @ table)
    # each test left out once (HC3): the scatter of break-away torques grows with the torque
    leverage = np.einsum("ij,jk,ik->i", table, inverse, table)
    meat = table.T @ (table * (mismatch / np.maximum(1.0 - leverage, 1e-6))[:, None] ** 2)
    sigma = np.sqrt(np.diag(inverse @ meat @ inverse))
    values = {"T_max": best, "K": scale * float(np.exp(x[0])), "n": float(np.exp(x[1]))}
    slopes = (1.0, values["K"], values["n"])
    dof = len(current) - 3
    wide, wider = student(0.975, dof), student(1 - 0.025 / 3, dof)
    return {
        name: Estimate(value=value, half=wide * s * slope, half_joint=wider * s * slope)
        for (name, value), s, slope in zip(values.items(), sigma, slopes, strict=True)
    }


def _table(x: np.ndarray, gain: float, columns) -> np.ndarray:
    """Derivatives by T_max, log(K) and log(n), shape (N, 3)."""
    steps = 1e-6 * np.eye(2)
    slopes = [gain * (columns(x + d) - columns(x - d)) / 2e-6 for d in steps]
    return np.column_stack([columns(x), *slopes])
