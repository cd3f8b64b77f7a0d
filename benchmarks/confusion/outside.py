"""Devices whose hysteresis is in no list of laws: the diagnosis cannot fit them exactly, whichever law it takes.

Each function gives the torque of the device without effects along a motion, as in
:mod:`benchmarks.confusion.foreign`. States are stepped exactly for a constant speed and current in each fine step.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

Numbers = Mapping[str, float]

TYPICAL: dict[str, dict[str, float]] = {
    "bristle": {"c": 0.08, "yield0": 0.25, "yield1": 1.3, "stiffness": 25.0, "damping": 0.02, "rise": 0.1, "slow": 0.3},
    "preisach": {"c": 0.08, "k": 0.2, "yield0": 0.25, "yield1": 1.3, "narrow": 0.002, "wide": 0.25, "tilt": 0.3},
    "elastoplastic": {"c": 0.08, "k": 0.2, "yield0": 0.25, "yield1": 1.3, "bend": 0.06, "elastic": 0.5},
    "smooth": {"c": 0.08, "k": 0.2, "yield0": 0.25, "yield1": 1.5, "speed": 0.4, "power": 1.4},
}

LAWS = tuple(TYPICAL)
"""Laws by name."""

HIDDEN = (
    "none",
    "cogging",
    "none",
    "coulomb_friction",
    "torque_sensor_lag",
    "none",
    "coil_lag",
    "rotor_inertia",
    "none",
    "friction_asymmetry",
    "load_friction",
)
"""Effects hidden in them, in turn; their number and that of the laws have no common divisor."""

ALSO = {"bristle": ("path_lag", "series_compliance")}
"""Effects that a law is itself: bristles are an elastic element, and follow a current over limit/stiffness."""

STOPS = 24
"""Elements of the Preisach operator."""


def torque(
    law: str, p: Numbers, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, current: np.ndarray, dt: float
) -> np.ndarray:
    """Torque of a device along a motion, arrays (T, N) [N·m]; ``qdd`` is not used."""
    return _TORQUES[law](p, q, qd, current, dt)


def bristle(p: Numbers, q: np.ndarray, qd: np.ndarray, current: np.ndarray, dt: float) -> np.ndarray:
    """LuGre with a current: bristles of one stiffness whose *limit* follows the current (Canudas de Wit et al. 1995).

    ``dz/dt = qd - stiffness*|qd|*z/g(qd, I)``, ``tau = stiffness*z + damping*dz/dt + c*qd``, where g is the torque that
    slides. After a step of the current the torque follows over a path of g/stiffness, however long that takes.
    """
    z, out = np.zeros(len(q)), np.empty_like(q)
    for k in range(q.shape[1]):
        moved = q[:, k] - q[:, max(k - 1, 0)]
        slides = p["yield0"] + p["yield1"] * current[:, k]
        slides = slides * (1.0 + p["rise"] * np.exp(-((qd[:, k] / p["slow"]) ** 2)))
        end = np.sign(moved) * slides / p["stiffness"]
        z = np.where(moved == 0.0, z, end + (z - end) * np.exp(-p["stiffness"] * np.abs(moved) / slides))
        rate = qd[:, k] - p["stiffness"] * np.abs(qd[:, k]) * z / slides
        out[:, k] = p["stiffness"] * z + p["damping"] * rate + p["c"] * qd[:, k]
    return out


def preisach(p: Numbers, q: np.ndarray, qd: np.ndarray, current: np.ndarray, dt: float) -> np.ndarray:
    """Preisach's operator of the angle whose density depends on the relays' width alone: stops in parallel (Iwan 1966).

    Widths from ``narrow`` to ``wide`` [rad], evenly in their logarithm; ``tilt`` moves weight to the wide ones.
    """
    width = np.geomspace(p["narrow"], p["wide"], STOPS)
    weight = 1.0 + p["tilt"] * np.linspace(-1.0, 1.0, STOPS)
    weight = weight / (weight.sum() * width)
    bent, out = np.zeros((len(q), STOPS)), np.empty_like(q)
    for k in range(q.shape[1]):
        moved = q[:, k] - q[:, max(k - 1, 0)]
        bent = np.clip(bent + moved[:, None], -width, width)
        out[:, k] = bent @ weight
    return p["c"] * qd + p["k"] * q + (p["yield0"] + p["yield1"] * current) * out


def elastoplastic(p: Numbers, q: np.ndarray, qd: np.ndarray, current: np.ndarray, dt: float) -> np.ndarray:
    """Elasto-plastic friction (Dupont, Hayward, Armstrong, Altpeter 2002): purely elastic below a part of its limit.

    ``dz/dt = qd*(1 - a(z)*|z|/bend)`` while it loads, ``qd`` while it unloads; a rises as a half sine from 0 at
    ``elastic`` to 1 at the limit. Stepped by Heun's rule over the path.
    """
    z, out = np.zeros(len(q)), np.empty_like(q)

    def slope(z: np.ndarray, sign: np.ndarray) -> np.ndarray:
        share = np.clip((sign * z / p["bend"] - p["elastic"]) / (1.0 - p["elastic"]), 0.0, 1.0)
        return 1.0 - 0.5 * (1.0 - np.cos(np.pi * share)) * np.abs(z) / p["bend"]

    for k in range(q.shape[1]):
        moved = q[:, k] - q[:, max(k - 1, 0)]
        first = slope(z, np.sign(moved))
        z = z + 0.5 * moved * (first + slope(z + moved * first, np.sign(moved)))
        out[:, k] = z / p["bend"]
    return p["c"] * qd + p["k"] * q + (p["yield0"] + p["yield1"] * current) * out


def smooth(p: Numbers, q: np.ndarray, qd: np.ndarray, current: np.ndarray, dt: float) -> np.ndarray:
    """Algebraic saturation over the speed, without memory: ``u/(1 + |u|^power)^(1/power)``, ``u = qd/speed``."""
    u = qd / p["speed"]
    h = u / (1.0 + np.abs(u) ** p["power"]) ** (1.0 / p["power"])
    return p["c"] * qd + p["k"] * q + (p["yield0"] + p["yield1"] * current) * h


_TORQUES: dict[str, Callable[..., np.ndarray]] = {
    "bristle": bristle,
    "preisach": preisach,
    "elastoplastic": elastoplastic,
    "smooth": smooth,
}
