"""Rate-independent memory over a prescribed path: turning points, a gap and the hysteresis of eq. 15.

Between two turning points the path is monotonic, and the hysteresis has a closed form along it. So the memory is
carried from turning point to turning point, without a time step, and every sample in between is exact. A gap is stepped
through the fine grid. Arrays are
(T, N): trajectories by samples.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Turns:
    """Monotonic stretches of paths; S is the largest number of stretches of a path."""

    at: np.ndarray
    """Sample where each stretch begins, shape (T, S); paths with fewer stretches end in empty ones."""
    sign: np.ndarray
    """Direction of each stretch, +1 or -1, shape (T, S)."""
    stretch: np.ndarray
    """Stretch of each sample, shape (T, N); a turning point counts to the stretch that ends there."""

    @classmethod
    def of(cls, x: np.ndarray) -> Turns:
        """Find the stretches of paths of shape (T, N); a pause belongs to the stretch before it."""
        count, samples = x.shape
        step = np.sign(np.diff(x, axis=1)).astype(np.int8)
        last = np.where(step != 0, np.arange(samples - 1), 0)
        np.maximum.accumulate(last, axis=1, out=last)
        step = np.take_along_axis(step, last, axis=1)
        first = np.take_along_axis(step, np.argmax(step != 0, axis=1)[:, None], axis=1)
        step = np.where(step == 0, np.where(first == 0, 1, first), step)
        turned = np.zeros((count, samples - 1), dtype=np.int64)
        turned[:, 1:] = step[:, 1:] != step[:, :-1]
        stretch = np.zeros((count, samples), dtype=np.int64)
        np.cumsum(turned, axis=1, out=stretch[:, 1:])
        at = np.full((count, int(stretch.max()) + 1), samples - 1, dtype=np.int64)
        at[:, 0] = 0
        rows, columns = np.nonzero(turned)
        at[rows, stretch[rows, columns + 1]] = columns
        sign = np.take_along_axis(step, np.minimum(at, samples - 2), axis=1).astype(float)
        return cls(at=at, sign=sign, stretch=stretch)


@dataclass(frozen=True, kw_only=True)
class Path:
    """A path with what its hysteresis needs at the samples that are asked for."""

    turning: np.ndarray
    """Position at the beginning of each stretch, shape (T, S)."""
    sign: np.ndarray
    """Direction of each stretch, shape (T, S)."""
    stretch: np.ndarray
    """Stretch of each sample, shape (T, M)."""
    travelled: np.ndarray
    """Way from the beginning of its stretch to each sample, shape (T, M)."""

    @classmethod
    def of(cls, x: np.ndarray, turns: Turns, samples: slice) -> Path:
        """The path ``x``, shape (T, N), seen at some of its samples."""
        turning = np.take_along_axis(x, turns.at, axis=1)
        stretch = turns.stretch[:, samples]
        travelled = np.abs(x[:, samples] - np.take_along_axis(turning, stretch, axis=1))
        return cls(turning=turning, sign=turns.sign, stretch=stretch, travelled=travelled)

    def hysteresis(self, beta: float, gamma: float) -> np.ndarray:
        """z of eq. 15 at the samples, shape (T, M), from z = 0 at the beginning."""
        ways = np.abs(np.diff(self.turning, axis=1))
        z = np.zeros_like(self.turning)
        for k in range(ways.shape[1]):
            z[:, k + 1] = self.sign[:, k] * _loaded(self.sign[:, k] * z[:, k], ways[:, k], beta, gamma)
        start = np.take_along_axis(self.sign * z, self.stretch, axis=1)
        return np.take_along_axis(self.sign, self.stretch, axis=1) * _loaded(start, self.travelled, beta, gamma)


def _loaded(u: np.ndarray, way: np.ndarray, beta: float, gamma: float) -> np.ndarray:
    """Where u = z*sgn(qd) is after a way in one direction: du/ds = 1 - (beta -+ gamma)*u below and above zero."""
    unloading, loading = beta - gamma, beta + gamma
    debt = np.maximum(-u, 0.0)
    to_zero = np.log1p(unloading * debt) / unloading
    below = 1.0 / unloading - (1.0 / unloading + debt) * np.exp(-unloading * way)
    above = 1.0 / loading - (1.0 / loading - np.maximum(u, 0.0)) * np.exp(-loading * np.maximum(way - to_zero, 0.0))
    return np.where(way < to_zero, below, above)


@dataclass(frozen=True, kw_only=True)
class Driven:
    """A device behind a gap at N samples of T trajectories, all (T, N)."""

    z: np.ndarray
    """z of eq. 15."""
    contact: np.ndarray
    """Side of the gap that is closed: 1, -1, or 0 in the gap."""


def behind_gap(x: np.ndarray, half_gap: float, stiffness: np.ndarray, p: Mapping[str, float], dt: float) -> Driven:
    """Path at the far side of a gap with stops that can only push; it begins in the middle of the gap.

    A force balance at each sample: the shaft follows the stop that it touches as long as that has to push; a free one
    obeys ``B*dy/dt = -K*z/(1 + alpha*|dy/dt|)``; where it would then stand beyond a stop, the stop takes it along.

    Args:
        x: Driving path, shape (T, N).
        half_gap: Half of the gap.
        stiffness: K0 + K1*I, shape (T, N).
        p: Coefficients of eqs. 14 and 15.
        dt: Sampling interval [s].
    """
    beta, gamma = p["beta"], p["gamma"]
    y, z, side = x[:, 0].copy(), np.zeros(len(x)), np.zeros(len(x))
    all_z, contact = np.zeros_like(x), np.zeros_like(x)

    def moved(z: np.ndarray, dy: np.ndarray) -> np.ndarray:
        sign = np.where(dy < 0.0, -1.0, 1.0)
        return sign * _loaded(sign * z, np.abs(dy), beta, gamma)

    for k in range(1, x.shape[1]):
        k_now = np.maximum(stiffness[:, k], 1e-9)
        along = np.where(side != 0.0, x[:, k] - side * half_gap - y, 0.0)
        z_along = moved(z, along)
        weakened = k_now / (1.0 + p["alpha"] * np.abs(along) / dt)
        pushes = (side != 0.0) & (side * (weakened * z_along + p["B"] * along / dt) >= 0.0)
        # implicit; the stress weakens with speed: alpha*B*v^2 + (B + K*dt*slope)*v = K*|z|
        drag, pull = p["B"] + k_now * dt * (1.0 + (beta - gamma) * np.abs(z)), k_now * np.abs(z)
        free = -np.sign(z) * 2.0 * pull * dt / (drag + np.sqrt(drag**2 + 4.0 * p["alpha"] * p["B"] * pull))
        dy = np.where(pushes, along, free)
        gap_now = x[:, k] - y - dy
        dy = np.where(np.abs(gap_now) > half_gap, x[:, k] - np.sign(gap_now) * half_gap - y, dy)
        z = np.where(pushes & (dy == along), z_along, moved(z, dy))
        side = np.where(pushes, side, np.where(np.abs(gap_now) > half_gap, np.sign(gap_now), 0.0))
        y = y + dy
        all_z[:, k], contact[:, k] = z, side
    return Driven(z=all_z, contact=contact)


def gear_to_locked_output(x: np.ndarray, stiffness: float, half_gap: float, dt: float) -> np.ndarray:
    """Torque on a drive whose gear wheel sits between two stops and on a spring to an output that stands still.

    The wheel has a mass (its spring swings at 40 Hz, damped by 0.3), the stops are fifty times as stiff as the spring
    and dissipate. The stiffness is that of stop and spring together.

    Args:
        x: Deflection of the drive from the middle of its gap, shape (T, N).
        stiffness: Of the closed gear.
        half_gap: Half of the gap.
        dt: Sampling interval [s].
    """
    if stiffness == 0.0:
        return np.zeros_like(x)
    spring, stop, parts = stiffness * 51.0 / 50.0, stiffness * 51.0, 3
    swing = 2.0 * np.pi * 40.0
    mass, damping, step = spring / swing**2, 0.6 * spring / swing, dt / parts
    y, v = x[:, 0] - np.clip(x[:, 0], -half_gap, half_gap), np.zeros(len(x))
    torque = np.zeros_like(x)
    for k in range(1, x.shape[1]):
        speed, force = (x[:, k] - x[:, k - 1]) / dt, np.zeros(len(x))
        for i in range(parts):
            gap_now = x[:, k - 1] + speed * (i + 1) * step - y
            pressed = gap_now - np.clip(gap_now, -half_gap, half_gap)
            force = stop * pressed + 3.0 * damping * (speed - v) * (pressed != 0.0)
            v = v + step * (force - spring * y - damping * v) / mass
            y = y + step * v
        torque[:, k] = force
    return torque


def on_spring(
    x: np.ndarray, compliance: float, stiffness: np.ndarray, p: Mapping[str, float], dt: float
) -> tuple[np.ndarray, np.ndarray]:
    """Torque that a spring carries to a device with a mass, and the device's velocity, both (T, N).

    The mass, half a gram at a radius of 0.3 m, is damped by half on its spring; eq. 15 follows it exactly along each
    small step. The fluid weakens with the speed of the drive: by its own, a mass on a spring would stick and slip.

    Args:
        x: Driving path, shape (T, N).
        compliance: Of the spring.
        stiffness: K0 + K1*I, shape (T, N).
        p: Coefficients of eqs. 14 and 15.
        dt: Sampling interval [s].
    """
    spring, mass = 1.0 / compliance, 5e-5
    parts = int(np.clip(np.ceil(2.0 * dt / np.sqrt(mass * compliance)), 4, 40))
    damping, step = np.sqrt(spring * mass), dt / parts
    y, v, z = x[:, 0].copy(), (x[:, 1] - x[:, 0]) / dt, np.zeros(len(x))
    torque, velocity = np.zeros_like(x), np.zeros_like(x)
    for k in range(1, x.shape[1]):
        speed, force = (x[:, k] - x[:, k - 1]) / dt, np.zeros(len(x))
        for i in range(parts):
            force = spring * (x[:, k - 1] + speed * (i + 1) * step - y) + damping * (speed - v)
            borne = stiffness[:, k] * z / (1.0 + p["alpha"] * np.abs(speed))
            v = (v + step * (force - borne) / mass) / (1.0 + step * p["B"] / mass)
            sign = np.where(v < 0.0, -1.0, 1.0)
            z = sign * _loaded(sign * z, np.abs(v) * step, p["beta"], p["gamma"])
            y = y + step * v
        torque[:, k], velocity[:, k] = force, v
    return torque, velocity
