"""Devices by other laws than eqs. 14 and 15: what a bench has, and nobody told the diagnosis.

Each law gives the torque of the device without effects along a motion and the current that magnetises, on the fine
grid. Numbers are drawn within 20 % of values that give some newton-metres on the benchmark's motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

Numbers = Mapping[str, float]

_TYPICAL: dict[str, dict[str, float]] = {
    "spencer": {
        "alpha0": 6.0, "alpha1": 18.0, "c0": 0.10, "c0_current": 0.05, "c1": 3.0, "c1_current": 2.0, "k0": 1.0,
        "k1": 0.25, "gamma": 8.0, "beta": 8.0, "A": 1.6,
    },
    "kwok": {
        "c": 0.08, "c_current": 0.08, "k": 0.3, "beta": 1.6, "delta": 0.45, "yield0": 0.25, "yield1": 1.2,
        "offset": 0.03,
    },
    "guo": {"c": 0.10, "yield0": 0.25, "yield1": 1.7, "steepness": 3.0, "speed0": 0.25, "rise": 6.0, "k": 0.2},
}  # fmt: skip

LAWS = tuple(_TYPICAL)
"""Laws by name."""

HIDDEN = (
    "none",
    "cogging",
    "rotor_inertia",
    "friction_asymmetry",
    "none",
    "coulomb_friction",
    "torque_sensor_lag",
    "cogging+rotor_inertia",
    "compliance_with_backlash",
    "none",
    "load_friction",
    "coil_lag",
    "coulomb_friction+cogging+rotor_inertia",
    "none",
    "friction_asymmetry+torque_sensor_lag",
    "compliance_with_backlash+rotor_inertia",
)
"""What is hidden in them, in turn; a delay that changes a tenth of the torque would be longer than any driver's."""

SPREAD = 0.2
"""Largest deviation of the numbers from the typical ones."""


def drawn(law: str, seed: np.random.SeedSequence) -> dict[str, float]:
    """Numbers of one device."""
    rng = np.random.default_rng(seed)
    return {name: value * (1.0 + SPREAD * rng.uniform(-1.0, 1.0)) for name, value in _TYPICAL[law].items()}


def torque(
    law: str, p: Numbers, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, current: np.ndarray, dt: float
) -> np.ndarray:
    """Torque of a device along a motion, arrays (T, N) [N·m]."""
    return _TORQUES[law](p, q, qd, qdd, current, dt)


def spencer(p: Numbers, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, current: np.ndarray, dt: float) -> np.ndarray:
    """Modified Bouc-Wen (Spencer, Dyke, Sain, Carlson 1997): a Bouc-Wen element in series with a dashpot, by Heun."""
    alpha = p["alpha0"] + p["alpha1"] * current
    c0, c1 = p["c0"] + p["c0_current"] * current, p["c1"] + p["c1_current"] * current

    def rates(k: int, y: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        yd = (alpha[:, k] * z + c0[:, k] * qd[:, k] + p["k0"] * (q[:, k] - y)) / (c0[:, k] + c1[:, k])
        slip = qd[:, k] - yd
        return yd, p["A"] * slip - p["gamma"] * np.abs(slip) * z * np.abs(z) - p["beta"] * slip * z * z

    y, z = q[:, 0].copy(), np.zeros(len(q))
    out = np.empty_like(q)
    for k in range(q.shape[1]):
        yd, zd = rates(k, y, z)
        out[:, k] = c1[:, k] * yd + p["k1"] * q[:, k]
        if k + 1 < q.shape[1]:
            ahead = rates(k + 1, y + dt * yd, z + dt * zd)
            y, z = y + 0.5 * dt * (yd + ahead[0]), z + 0.5 * dt * (zd + ahead[1])
    return out


def kwok(p: Numbers, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, current: np.ndarray, dt: float) -> np.ndarray:
    """Hyperbolic tangent with a sign of the position (Kwok, Ha, Nguyen, Li, Samali 2006)."""
    z = np.tanh(p["beta"] * qd + p["delta"] * np.tanh(20.0 * q))
    size = p["yield0"] + p["yield1"] * current
    return (p["c"] + p["c_current"] * current) * qd + p["k"] * q + size * z + p["offset"]


def guo(p: Numbers, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, current: np.ndarray, dt: float) -> np.ndarray:
    """Arctangent of a velocity that is shifted by the sign of the acceleration (Guo, Hu 2005)."""
    size = p["yield0"] + p["yield1"] * current
    shifted = qd + p["speed0"] * np.tanh(-qdd / p["rise"])
    return p["c"] * qd + p["k"] * q + size * (2.0 / np.pi) * np.arctan(p["steepness"] * shifted)


_TORQUES: dict[str, Callable[..., np.ndarray]] = {"spencer": spencer, "kwok": kwok, "guo": guo}
