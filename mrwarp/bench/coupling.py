"""Coupling between the bench's drive and the device: play and a spring, with the stress of eq. 15 behind them."""

from __future__ import annotations

import numpy as np

from mrwarp.params import MrParams


def stressed(z: np.ndarray, way: np.ndarray, rising: float, falling: float) -> np.ndarray:
    """z after a way in one direction."""
    s, sign = np.abs(way), np.sign(way)
    u = sign * z
    below = np.minimum(u, 0.0)
    to_zero = np.log1p(-falling * below) / falling
    first = np.minimum(s, to_zero)
    u = u + np.where(below < 0.0, (1.0 - falling * u) * -np.expm1(-falling * first) / falling, 0.0)
    u = u - (u - 1.0 / rising) * -np.expm1(-rising * (s - first))
    return np.where(s > 0.0, sign * u, z)


def behind_gap(
    q: np.ndarray, half_gap: float, stiffness: np.ndarray, params: MrParams, dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """z of eq. 15 behind a gap, 0 while that is open, and whether it is closed; it begins open, in its middle.

    A stop can only push. A shaft that no stop holds moves as its own stress drives it against B, to zero stress.

    Args:
        q: Angle of the drive, shape (N, T) [rad].
        half_gap: Half of the gap [rad].
        stiffness: K0 + K1*I, shape (N, T) [N·m/rad].
        params: The device's.
        dt: Step [s].
    """
    p = params.bouc_wen
    shaft, z, side = q[0].copy(), np.zeros(q.shape[1]), np.zeros(q.shape[1])
    out, touched = np.zeros_like(q), np.zeros(q.shape, dtype=bool)

    def along(z: np.ndarray, way: np.ndarray) -> np.ndarray:
        return stressed(z, way, p.beta + p.gamma, p.beta - p.gamma)

    for k in range(1, len(q)):
        followed = q[k] - side * half_gap - shaft
        torque = stiffness[k] * along(z, followed) / (1.0 + p.alpha * np.abs(followed) / dt) + p.B * followed / dt
        held = (side != 0.0) & (side * torque >= 0.0)
        slope = 1.0 + (p.beta - p.gamma) * np.abs(z)
        speed = stiffness[k] * np.abs(z) / max(p.B, 1e-12)  # of a free shaft, were it not for alpha
        speed = 2.0 * speed / (1.0 + np.sqrt(1.0 + 4.0 * p.alpha * speed))
        drag = p.B * (1.0 + p.alpha * speed) + stiffness[k] * slope * dt
        way = np.where(held, followed, -stiffness[k] * z * dt / (drag + 1e-12))
        stretch = q[k] - shaft - way
        side = np.where(held, side, np.where(np.abs(stretch) >= half_gap, np.sign(stretch), 0.0))
        way = np.where(side != 0.0, q[k] - side * half_gap - shaft, way)
        z, shaft = along(z, way), shaft + way
        touched[k] = side != 0.0
        out[k] = np.where(touched[k], z, 0.0)
    return out, touched


def behind_spring(
    q: np.ndarray, compliance: float, half_gap: float, stiffness: np.ndarray, params: MrParams, dt: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """z of eq. 15 and velocity of a device that a spring drives, and whether the play before it is closed.

    By implicit steps of the shaft's velocity. A device in the open play bears nothing, and stands.

    Args:
        q: Angle of the drive, shape (N, T) [rad].
        compliance: Of the spring [rad/(N·m)].
        half_gap: Half of the play before it [rad].
        stiffness: K0 + K1*I, shape (N, T) [N·m/rad].
        params: The device's.
        dt: Step [s].
    """
    p = params.bouc_wen
    shaft, z, v = q[0].copy(), np.zeros(q.shape[1]), np.zeros(q.shape[1])
    all_z, all_v = np.zeros_like(q), np.zeros_like(q)
    touched = np.ones(q.shape, dtype=bool)
    for k in range(1, len(q)):
        for i in range(6 if half_gap == 0.0 else 20):  # Newton: the spring bears what the device bears
            reached = stressed(z, v * dt, p.beta + p.gamma, p.beta - p.gamma)
            stiff = stiffness[k] / (1.0 + p.alpha * np.abs(v))
            stretch = q[k] - shaft - v * dt
            pressed = stretch - np.clip(stretch, -half_gap, half_gap)
            miss = pressed / compliance - stiff * reached - p.B * v
            u = np.sign(v) * reached
            slope = np.maximum(1.0 - p.beta * u - p.gamma * np.abs(u), 0.0)
            closed = 1.0 if half_gap == 0.0 else np.abs(stretch) > half_gap
            v = v + (1.0 if i < 6 else 0.5) * miss / (closed * dt / compliance + stiff * slope * dt + p.B)
        z, shaft = stressed(z, v * dt, p.beta + p.gamma, p.beta - p.gamma), shaft + v * dt
        touched[k] = np.abs(q[k] - shaft) >= half_gap
        all_z[k], all_v[k] = np.where(touched[k], z, 0.0), np.where(touched[k], v, 0.0)
    return all_z, all_v, touched
