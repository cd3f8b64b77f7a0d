"""Sensors of a virtual robot: noise, resolution, stale rows, stamps of a clock that is not the simulation's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

NOISE = {
    "q": (8e-5, 1.5e-4), "qd": (0.015, 0.004), "tau": (0.05, 0.02), "current": (0.004, 0.001), "gyro": (0.004, 0.001),
    "acc": (0.05, 0.005), "pos": (0.0005, 1e-4), "vel": (0.005, 1e-4), "foot": (1.5, 1.0),
}  # fmt: skip
"""Standard deviation and resolution of each channel in its unit. Angles and speeds as a Go2's public air logs show them
(resolution 0.15 mrad, 0.004 rad/s), the inertial sensor that of a MEMS."""

LEAN_NOISE = 0.002
"""Slow error of the estimated roll and pitch [rad]."""

STALE, LOST = 0.01, 0.002
"""Share of rows that repeat the joints' last reading, as 1 to 7 % of the Go2's do, and of rows that are missing."""

CLOCK, JITTER, STAMP = 0.001, 1e-4, 1e-5
"""Largest error of the clock's rate [1], standard deviation of a stamp and its resolution [s]."""


@dataclass(frozen=True, kw_only=True)
class Clean:
    """Readings without noise at N ticks: columns by name, shape (N, C)."""

    t: np.ndarray
    columns: Mapping[str, np.ndarray]


def sense(clean: Clean, shifts: Mapping[str, float], noise: float, rng: np.random.Generator) -> tuple[np.ndarray, dict]:
    """Stamps (N,) and channels (N, C) as a logger writes them.

    Args:
        clean: What happened.
        shifts: How late the stamps of a group of channels are [s], see ``hidden_effects.CHANNELS``.
        noise: Factor on noise, jitter, stale and missing rows; 0 logs what happened.
        rng: Draws.
    """
    columns = {name: _shifted(clean.t, x, shifts.get(group_of(name), 0.0), name) for name, x in clean.columns.items()}
    for name, x in columns.items():
        if name in NOISE:
            spread, step = NOISE[name]
            x = x + noise * spread * rng.standard_normal(x.shape)
            columns[name] = np.round(x / step) * step if noise else x
    count = len(clean.t)
    if "quat" in columns and noise:
        drift = np.cumsum(rng.standard_normal((count, 2)), axis=0) * 0.02
        lean = LEAN_NOISE * noise * np.sin(drift) * np.array([1.0, 1.0])
        turn = Rotation.from_rotvec(np.concatenate([lean, np.zeros((count, 1))], axis=1))
        whole = turn * Rotation.from_quat(np.roll(columns["quat"], -1, axis=1))
        columns["quat"] = np.round(np.roll(whole.as_quat(canonical=False), 1, axis=1), 6)
        columns["quat"] *= np.sign(columns["quat"][:, :1])
    stale = np.flatnonzero(rng.random(count) < STALE * noise)
    for name in ("q", "qd", "tau"):
        for k in stale[stale > 0] if name in columns else []:
            columns[name][k] = columns[name][k - 1]
    dt = float(clean.t[1] - clean.t[0])
    stamps = clean.t * (1.0 + noise * rng.uniform(-CLOCK, CLOCK))
    stamps = stamps + np.clip(noise * JITTER * rng.standard_normal(count), -0.4 * dt, 0.4 * dt)
    stamps = np.round(stamps / STAMP) * STAMP if noise else stamps
    keep = rng.random(count) >= LOST * noise
    keep[[0, 1, -1]] = True
    return stamps[keep] - stamps[keep][0], {name: x[keep] for name, x in columns.items()}


def group_of(name: str) -> str:
    """Group of a channel whose stamps can be shifted together."""
    groups = {
        "joints": ("q", "qd", "tau", "current"),
        "imu": ("quat", "gyro", "acc"),
        "commands": ("q_des", "kp", "kd", "current_cmd"),
        "feet": ("foot",),
    }
    return next((group for group, names in groups.items() if name in names), "")


def _shifted(t: np.ndarray, x: np.ndarray, late: float, name: str) -> np.ndarray:
    """A channel as it was ``late`` earlier [s]; commands are held, readings run on a line."""
    if not late:
        return x.copy()
    if group_of(name) == "commands":
        begun = np.searchsorted(t, t - late + 1e-9, side="right")  # whole rows late are as many in every row
        return x[np.clip(begun - 1, 0, len(t) - 1)]
    return np.stack([np.interp(t - late, t, column) for column in x.T], axis=1)
