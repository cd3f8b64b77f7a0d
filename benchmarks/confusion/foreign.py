"""Devices by other laws than eqs. 14 and 15: as on a real bench, unknown to the diagnosis.

Each law gives the torque of the device without effects along a motion and the current that magnetises, on the fine
grid. Its shaft turns with the encoder, or behind a dead zone or a spring that bear what the device bears. Numbers are
drawn within 20 % of values that give some newton-metres on the benchmark's motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from benchmarks.confusion import outside

Numbers = Mapping[str, float]

TYPICAL: dict[str, dict[str, float]] = {
    "spencer": {
        "alpha0": 6.0,
        "alpha1": 18.0,
        "c0": 0.10,
        "c0_current": 0.05,
        "c1": 3.0,
        "c1_current": 2.0,
        "k0": 1.0,
        "k1": 0.25,
        "gamma": 8.0,
        "beta": 8.0,
        "A": 1.6,
    },
    "kwok": {
        "c": 0.08,
        "c_current": 0.08,
        "k": 0.3,
        "beta": 1.6,
        "delta": 0.45,
        "yield0": 0.25,
        "yield1": 1.2,
        "offset": 0.03,
    },
    "guo": {"c": 0.10, "yield0": 0.25, "yield1": 1.7, "steepness": 3.0, "speed0": 0.25, "rise": 6.0, "k": 0.2},
}

LAWS = tuple(TYPICAL)
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
    "backlash",
    "none",
    "series_compliance",
)
"""Effects hidden in them, in turn; a delay that changes a tenth of the torque would be longer than any driver's."""

STOP = 2e4
"""Stiffness of the stops of a dead zone [N·m/rad]: they give way by about a tenth of a milliradian."""

BEHIND = {"backlash": "half_gap", "series_compliance": "compliance"}
"""Effects between encoder and shaft, and what their strength is in :func:`behind`."""

SPREAD = 0.2
"""Largest deviation of the numbers from the typical ones."""


def drawn(law: str, seed: np.random.SeedSequence) -> dict[str, float]:
    """Numbers of one device, by a law of this module or of :mod:`benchmarks.confusion.outside`."""
    rng = np.random.default_rng(seed)
    typical = (TYPICAL | outside.TYPICAL)[law]
    return {name: value * (1.0 + SPREAD * rng.uniform(-1.0, 1.0)) for name, value in typical.items()}


def torque(
    law: str, p: Numbers, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, current: np.ndarray, dt: float
) -> np.ndarray:
    """Torque of a device along a motion, arrays (T, N) [N·m]."""
    if law in outside.LAWS:
        return outside.torque(law, p, q, qd, qdd, current, dt)
    return _TORQUES[law](p, q, qd, qdd, current, dt)


def spencer(p: Numbers, q: np.ndarray, qd: np.ndarray, qdd: np.ndarray, current: np.ndarray, dt: float) -> np.ndarray:
    """Modified Bouc-Wen (Spencer, Dyke, Sain, Carlson 1997): a Bouc-Wen element in series with a dashpot, by Heun."""
    state, out = (q[:, 0], np.zeros(len(q))), np.empty_like(q)
    for k in range(q.shape[1]):
        yd, zd, bears = _spencer_rates(p, q[:, k], qd[:, k], current[:, k], state)
        out[:, k] = bears
        if k + 1 < q.shape[1]:
            state = _spencer_step(p, q[:, k + 1], qd[:, k + 1], current[:, k + 1], state, (yd, zd), dt)
    return out


_State = tuple[np.ndarray, np.ndarray]
"""Place of the inner node and z of Spencer's law, or their rates."""


def _spencer_rates(
    p: Numbers, q: np.ndarray, qd: np.ndarray, current: np.ndarray, state: _State
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rates of the state, and the torque."""
    (y, z), c0, c1 = state, p["c0"] + p["c0_current"] * current, p["c1"] + p["c1_current"] * current
    yd = ((p["alpha0"] + p["alpha1"] * current) * z + c0 * qd + p["k0"] * (q - y)) / (c0 + c1)
    slip = qd - yd
    zd = p["A"] * slip - p["gamma"] * np.abs(slip) * z * np.abs(z) - p["beta"] * slip * z * z
    return yd, zd, c1 * yd + p["k1"] * q


def _spencer_step(
    p: Numbers, q: np.ndarray, qd: np.ndarray, current: np.ndarray, state: _State, rates: _State, dt: float
) -> _State:
    """The state after a step that ends at q, qd and the current."""
    (y, z), (yd, zd) = state, rates
    ahead = _spencer_rates(p, q, qd, current, (y + dt * yd, z + dt * zd))
    return y + 0.5 * dt * (yd + ahead[0]), z + 0.5 * dt * (zd + ahead[1])


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


def behind(
    law: str,
    p: Numbers,
    q: np.ndarray,
    qd: np.ndarray,
    qdd: np.ndarray,
    current: np.ndarray,
    dt: float,
    *,
    half_gap: np.ndarray | float = 0.0,
    compliance: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Torque at the encoder of devices behind a dead zone or a spring, arrays (T, N) [N·m].

    The shaft has no mass: in each step it moves so that the device bears what stops or spring bear, which is nothing in
    the gap. Places are those at the steps' ends, speeds and torques those in their middles, where a mean speed is the
    speed; the torque at a sample is the mean of the steps on both sides. The acceleration of Guo's law is the
    encoder's. ``half_gap`` [rad] and ``compliance`` [rad/(N·m)] are one number or of shape (T,); the stops give way by
    :data:`STOP`.
    """
    give, out = compliance + 1.0 / STOP, np.zeros((len(q), q.shape[1] + 1))
    y, v, state = q[:, 0], np.zeros(len(q)), (q[:, 0], np.zeros(len(q)))
    rates = _spencer_rates(p, y, v, current[:, 0], state)[:2] if law == "spencer" else state
    for k in range(1, q.shape[1]):
        x, now, pace = q[:, k], 0.5 * (current[:, k - 1] + current[:, k]), 0.5 * (qdd[:, k - 1] + qdd[:, k])

        def borne(v: np.ndarray) -> tuple[np.ndarray, _State, _State]:
            """Torque that the device bears when its shaft has this speed, its state and the rates of that."""
            at = y + 0.5 * v * dt  # noqa: B023
            if law != "spencer":
                return _TORQUES[law](p, at, v, pace, now, dt), state, rates  # noqa: B023
            half = _spencer_step(p, at, v, now, state, rates, 0.5 * dt)  # noqa: B023
            *middle, tau = _spencer_rates(p, at, v, now, half)  # noqa: B023
            after = tuple(old + dt * rate for old, rate in zip(state, middle, strict=True))  # noqa: B023
            return tau, (after[0], after[1]), (middle[0], middle[1])

        low, high = np.full(len(y), -1e3), np.full(len(y), 1e3)
        for _ in range(20):  # Newton's steps within a bracket: what bears falls with the speed, what is borne grows
            wound = x - y - v * dt
            tau, after, ahead = borne(v)
            over = (wound - np.clip(wound, -half_gap, half_gap)) / give - tau
            if np.abs(over).max() < 1e-6:
                break
            slope = (borne(v + 1e-4)[0] - tau) / 1e-4 + np.where(np.abs(wound) > half_gap, dt / give, 0.0)
            low, high = np.where(over > 0.0, v, low), np.where(over < 0.0, v, high)
            step = v + over / np.maximum(slope, 1e-3)
            v = np.where((step > low) & (step < high), step, 0.5 * (low + high))
        y, state, rates, out[:, k] = y + v * dt, after, ahead, tau
    out[:, -1] = out[:, -2]
    return 0.5 * (out[:, :-1] + out[:, 1:])
