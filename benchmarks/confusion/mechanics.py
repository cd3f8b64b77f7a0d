"""Joints without a device: a pendulum, a mass on a spring, an arm's joint and a geared motor, each with its drive.

The equations of motion are integrated forwards by Runge's and Kutta's rule at 10 kHz under a drive that follows sines;
what is logged is the drive's torque. No line is shared with the simulator or with the diagnosis.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from benchmarks.confusion.truth import lagged
from mrwarp.recording.load import Recording, Trajectory

RATE, LOGGED, SECONDS, RUNS = 10_000.0, 200.0, 4.0, 12
"""Steps and logged samples per second; length [s] and number of the runs."""

JOINTS: dict[str, dict[str, float]] = {
    "pendulum": {"inertia": 0.15, "weight": 3.0, "spring": 0.0, "viscous": 0.05, "dry": 0.2, "reach": 0.9},
    "spring": {"inertia": 0.1, "weight": 0.0, "spring": 3.0, "viscous": 0.05, "dry": 0.2, "reach": 0.6},
    "arm": {"inertia": 0.8, "weight": 8.0, "spring": 0.0, "viscous": 0.6, "dry": 0.8, "reach": 0.8},
    "geared": {"inertia": 0.01, "weight": 0.0, "spring": 0.0, "viscous": 0.06, "dry": 0.35, "reach": 0.5},
}
"""Typical numbers of each joint [kg·m², N·m, N·m/rad, N·m·s/rad, N·m, rad], drawn within 30 %."""

LAWS = tuple(JOINTS)
"""Joints by name."""

HIDDEN = ("none", "cogging", "none", "torque_sensor_lag", "friction_asymmetry")
"""Effects hidden in them, in turn; their number and that of the joints have no common divisor."""

SPREAD = 0.3
"""Largest deviation of the numbers from the typical ones."""


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One joint with what is hidden in it."""

    numbers: dict[str, float]
    """Numbers of :data:`JOINTS`, and ``down``, the angle where the weight hangs [rad]."""
    hidden: dict[str, float]
    """Size of each hidden effect: amplitude [N·m] of the cogging, time constant [s], viscosity [N·m·s/rad]."""
    waves: float
    """Periods of the cogging [1/rad]."""
    seed: int

    @classmethod
    def drawn(cls, name: str, kind: str, share: float, seed: int) -> Joint:
        """A joint whose hidden effect changes the torque by about ``share`` of its RMS."""
        rng = np.random.default_rng([seed, 1])
        numbers = {key: x * (1.0 + SPREAD * rng.uniform(-1.0, 1.0)) for key, x in JOINTS[name].items()}
        numbers["down"] = rng.uniform(-np.pi, np.pi) if name == "arm" else 0.0
        plain = cls(numbers=numbers, hidden={}, waves=float(rng.integers(8, 30)), seed=seed)
        if kind == "none":
            return plain
        _, qd, torque = plain.motion
        size = share * torque.std()
        per_unit = {
            "cogging": np.sqrt(0.5),
            "friction_asymmetry": np.abs(qd).std(),
            "torque_sensor_lag": (np.diff(torque, axis=0) * RATE).std(),
        }
        return cls(numbers=numbers, hidden={kind: float(size / per_unit[kind])}, waves=plain.waves, seed=seed)

    def load(self, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        """Torque that resists the drive in addition to the inertia [N·m]."""
        p = self.numbers
        tau = p["spring"] * q + p["viscous"] * qd + p["dry"] * np.tanh(qd / 0.01)
        if p["weight"]:
            tau = tau + p["weight"] * np.sin(q - p["down"])
        if "cogging" in self.hidden:
            tau = tau + self.hidden["cogging"] * np.sin(self.waves * q + 0.7)
        return tau + self.hidden.get("friction_asymmetry", 0.0) * np.abs(qd)

    @cached_property
    def motion(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Angle, velocity and the drive's torque at 10 kHz, each (N, T)."""
        p, rng, dt = self.numbers, np.random.default_rng([self.seed, 2]), 1.0 / RATE
        size = p["reach"] * rng.uniform(0.3, 1.0, RUNS)
        share = rng.uniform(0.4, 0.8, RUNS)
        waves = ((share * size, 0.4, 1.2), ((1.0 - share) * size, 1.2, 2.5))
        parts = [(a, 2.0 * np.pi * rng.uniform(low, high, RUNS), rng.uniform(0.0, 6.3, RUNS)) for a, low, high in waves]
        stiff, damping = 900.0 * p["inertia"], 45.0 * p["inertia"]

        steps = int(SECONDS * RATE)
        half = 0.5 * dt * np.arange(2 * steps + 2)[:, None]
        goal = sum(a * np.sin(w * half + phase) for a, w, phase in parts) + np.zeros((1, RUNS))
        goal = stiff * goal + damping * sum(a * w * np.cos(w * half + phase) for a, w, phase in parts)

        def pull(k: int, q: np.ndarray, qd: np.ndarray) -> np.ndarray:
            """Acceleration at the half step k."""
            return (goal[k] - stiff * q - damping * qd - self.load(q, qd)) / p["inertia"]

        q, qd = sum(a * np.sin(phase) for a, _, phase in parts) + np.zeros(RUNS), np.zeros(RUNS)
        out = np.empty((3, steps, RUNS))
        for k in range(steps):
            out[:, k] = q, qd, goal[2 * k] - stiff * q - damping * qd
            a1 = pull(2 * k, q, qd)
            a2 = pull(2 * k + 1, q + 0.5 * dt * qd, qd + 0.5 * dt * a1)
            a3 = pull(2 * k + 1, q + 0.5 * dt * qd + 0.25 * dt * dt * a1, qd + 0.5 * dt * a2)
            a4 = pull(2 * k + 2, q + dt * qd + 0.5 * dt * dt * a2, qd + dt * a3)
            q = q + dt * qd + dt * dt / 6.0 * (a1 + a2 + a3)
            qd = qd + dt / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        return out[0], out[1], out[2]

    def recording(self) -> Recording:
        """The log: a 14-bit encoder, a noisy velocity, the drive's torque with 1 % of noise."""
        q, qd, torque = self.motion
        rng, every = np.random.default_rng([self.seed, 3]), int(RATE / LOGGED)
        if "torque_sensor_lag" in self.hidden:
            torque = lagged(torque.T, self.hidden["torque_sensor_lag"], 1.0 / RATE).T
        q, qd, torque = q[::every], qd[::every], torque[::every]
        torque = torque + 0.01 * torque.std() * rng.standard_normal(torque.shape)
        qd = qd + 0.003 * rng.standard_normal(qd.shape)
        notch = 2.0 * np.pi / 2**14
        q, t = np.round(q / notch) * notch, np.arange(len(q)) / LOGGED
        runs = [
            Trajectory(
                id=f"{k:02d}", t=t + 20.0 * k, q=q[:, k], qd=qd[:, k], current=np.zeros(len(t)), torque=torque[:, k]
            )
            for k in range(RUNS)
        ]
        return Recording(trajectories=tuple(runs), units={"q": "rad", "current": "none", "torque": "N·m"})

    @property
    def parameters(self) -> dict[str, dict[str, Any]]:
        """True sizes of what has to be named, as :class:`benchmarks.confusion.case.Truth` has them."""
        p = self.numbers
        stated = {"rotor_inertia": ("inertia", p["inertia"], "kg·m²")}
        if p["weight"]:
            stated["gravity"] = ("amplitude", p["weight"], "N·m")
        names = {"cogging": "amplitude", "torque_sensor_lag": "time_constant", "friction_asymmetry": "viscous"}
        stated |= {kind: (names[kind], size, "") for kind, size in self.hidden.items()}
        return {
            name: {"parameter": key, "value": value, "unit": unit, "exact": True, "level": None, "draws": {}}
            for name, (key, value, unit) in stated.items()
        }
