"""Effects that can be hidden: one law per effect, none of them written as the diagnosis would write it.

An effect has a strength, which is searched, and draws (signs, phases, wave numbers), which come from the seed. Laws act
at one place of the chain in :mod:`benchmarks.confusion.truth`: on the command, on the path, as a factor of the
hysteretic torque, as a torque of their own, or at the sensors. Where physics leaves one law only (lag, delay, inertia,
gain, bias) the truth differs from any fit by its integration alone; elsewhere another law of the same mechanism is
taken: hard signs, Lorentz for Stribeck, u/sqrt(1 + u^2) for saturation, three plays for remanence, a second harmonic
in cogging, exponentials in temperature, wear by way instead of time, a gear wheel between stops for play before a
spring, a mass on a spring for compliance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

Draws = dict[str, float]
_Draw = Callable[[np.random.Generator], Draws]


@dataclass(frozen=True, kw_only=True)
class Spec:
    """One effect: what its strength is and how it is found."""

    name: str
    parameter: str
    """The strength's name for a user."""
    unit: str
    powers: tuple[int, int, int]
    """Powers of the units of motion, current and torque in the strength; the rest is seconds."""
    guess: float
    """Strength at which the search begins."""
    draw: _Draw = field(default=lambda rng: {})
    """All random numbers but the strength."""
    exact: bool = True
    """Whether a fit of the usual law should find the strength itself, not only the mechanism."""
    depends_on: frozenset[str] = frozenset()
    """For an effect outside the catalogue: the variables of which one has to be named."""
    size: float | None = None
    """For a shift of calibration, of which nothing survives re-fitting: its physical size."""
    largest: float = np.inf
    """Strength at which the law ends when its drawn sign is negative."""


def _sign(rng: np.random.Generator) -> Draws:
    return {"sign": float(rng.choice((-1.0, 1.0)))}


def _asymmetry(rng: np.random.Generator) -> Draws:
    return {"viscous": float(rng.integers(2)), **_sign(rng)}


def _cogging(rng: np.random.Generator) -> Draws:
    phases = {"phase": rng.uniform(0.0, 2.0 * np.pi), "second": rng.uniform(0.0, 2.0 * np.pi)}
    return {"waves": float(rng.integers(8, 49)), **phases}


def _room(rng: np.random.Generator) -> Draws:
    return {"swing": rng.uniform(4.0, 12.0), "waves": rng.uniform(0.3, 1.5), "phase": rng.uniform(0.0, 2.0 * np.pi)}


def _heat(rng: np.random.Generator) -> Draws:
    # a rise of some 10 K at a few watts; minutes to get there
    return {"time_constant": rng.uniform(60.0, 200.0), "capacity": rng.uniform(30.0, 60.0)}


_SPECS = (
    Spec(name="coil_lag", parameter="time_constant", unit="s", powers=(0, 0, 0), guess=0.005),
    Spec(name="command_delay", parameter="delay", unit="s", powers=(0, 0, 0), guess=0.003),
    Spec(name="remanence", parameter="half_width", unit="A", powers=(0, 1, 0), guess=0.02),
    Spec(name="current_saturation", parameter="curvature", unit="1/A", powers=(0, -1, 0), guess=0.3, exact=False),
    Spec(name="path_lag", parameter="length", unit="rad", powers=(1, 0, 0), guess=0.01),
    Spec(name="current_gain", parameter="gain", unit="1", powers=(0, 0, 0), guess=1.0, size=1.15),
    Spec(name="torque_sensor_lag", parameter="time_constant", unit="s", powers=(0, 0, 0), guess=0.001),
    Spec(name="velocity_lag", parameter="time_constant", unit="s", powers=(0, 0, 0), guess=0.001),
    Spec(name="encoder_offset", parameter="offset", unit="rad", powers=(1, 0, 0), guess=0.1, size=0.15),
    Spec(name="torque_bias", parameter="bias", unit="N·m", powers=(0, 0, 1), guess=0.03, size=0.03),
    Spec(name="torque_gain", parameter="gain", unit="1", powers=(0, 0, 0), guess=1.0, size=1.15),
    Spec(name="backlash", parameter="half_gap", unit="rad", powers=(1, 0, 0), guess=0.0005),
    Spec(name="series_compliance", parameter="compliance", unit="rad/(N·m)", powers=(1, 0, -1), guess=0.003),
    Spec(name="rotor_inertia", parameter="inertia", unit="kg·m²", powers=(-1, 0, 1), guess=0.0005),
    Spec(
        name="gravity", parameter="amplitude", unit="N·m", powers=(0, 0, 1), guess=0.5,
        draw=lambda rng: {"down": rng.uniform(-np.pi, np.pi)},
    ),
    Spec(name="coulomb_friction", parameter="torque", unit="N·m", powers=(0, 0, 1), guess=0.03),
    Spec(name="friction_asymmetry", parameter="torque", unit="N·m", powers=(0, 0, 1), guess=0.03, draw=_asymmetry),
    Spec(name="load_friction", parameter="F1", unit="N·m/A", powers=(0, -1, 1), guess=0.03),
    Spec(name="position_friction", parameter="F2", unit="N·m/rad²", powers=(-2, 0, 1), guess=0.1, exact=False),
    Spec(
        name="stribeck", parameter="torque", unit="N·m", powers=(0, 0, 1), guess=0.03, exact=False,
        draw=lambda rng: {"speed": 0.15 * 4.0 ** rng.uniform()},
    ),
    Spec(name="cogging", parameter="amplitude", unit="N·m", powers=(0, 0, 1), guess=0.01, draw=_cogging),
    Spec(
        name="compliance_with_backlash", parameter="stiffness", unit="N·m/rad", powers=(-1, 0, 1), guess=1.0,
        draw=lambda rng: {"half_gap": rng.uniform(0.04, 0.15)},
    ),
    Spec(name="current_viscosity", parameter="viscosity", unit="N·m·s/(rad·A)", powers=(-1, -1, 1), guess=0.01),
    Spec(
        name="speed_weakening", parameter="exponent", unit="1", powers=(0, 0, 0), guess=0.2, draw=_sign, largest=0.9,
        exact=False,
    ),
    Spec(
        name="temperature_drift", parameter="drift", unit="1/K", powers=(0, 0, 0), guess=0.01, exact=False, draw=_heat,
    ),
    Spec(name="wear", parameter="loss", unit="1", powers=(0, 0, 0), guess=0.1, exact=False),
    Spec(
        name="temperature_fade", parameter="fade", unit="1/K", powers=(0, 0, 0), guess=0.01, exact=False, draw=_room,
    ),
    # outside the catalogue
    Spec(
        name="position_current", parameter="amplitude", unit="N·m/A²", powers=(0, -2, 1), guess=0.03, draw=_sign,
        depends_on=frozenset({"q", "current"}),
    ),
    Spec(
        name="position_viscosity", parameter="viscosity", unit="N·m·s/rad³", powers=(-3, 0, 1), guess=0.05, draw=_sign,
        depends_on=frozenset({"q", "qd"}),
    ),
    Spec(
        name="creep", parameter="share", unit="1", powers=(0, 0, 0), guess=0.1,
        depends_on=frozenset({"memory"}),
    ),
    Spec(
        name="line", parameter="amplitude", unit="N·m", powers=(0, 0, 1), guess=0.012,
        draw=lambda rng: {"phases": float(rng.integers(2**31))}, depends_on=frozenset({"frequency"}),
    ),
    Spec(
        name="loop_asymmetry", parameter="share", unit="1", powers=(0, 0, 0), guess=0.05, draw=_sign,
        depends_on=frozenset({"qd", "memory"}),
    ),
    Spec(
        name="position_gain", parameter="share", unit="1", powers=(0, 0, 0), guess=0.1, draw=_sign,
        depends_on=frozenset({"q", "memory"}),
    ),
)  # fmt: skip

EFFECTS: dict[str, Spec] = {spec.name: spec for spec in _SPECS}
"""Every effect by name."""

UNCATALOGUED = tuple(spec.name for spec in _SPECS if spec.depends_on)
"""Effects that no name of the contract fits."""

CALIBRATION = tuple(spec.name for spec in _SPECS if spec.size is not None)
"""Shifts of calibration, which re-fitting absorbs."""

SINGLE = tuple(spec.name for spec in _SPECS if not spec.depends_on and spec.size is None)
"""Mechanisms of the contract."""

PAIRS = (
    ("coil_lag", "cogging"),
    ("command_delay", "coulomb_friction"),
    ("backlash", "current_viscosity"),
    ("remanence", "stribeck"),
    ("torque_sensor_lag", "wear"),
    ("rotor_inertia", "current_saturation"),
)
"""Pairs of mechanisms that are not each other's rivals."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """An effect of a device."""

    strength: float
    """In the unit of its :class:`Spec`; always positive, directions are drawn."""
    draws: Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class State:
    """The device along its motion at M samples of T trajectories; all arrays (T, M) unless stated."""

    t: np.ndarray
    """Time from the start of the trajectory [s], shape (M,)."""
    q: np.ndarray
    """Displacement [rad]."""
    qd: np.ndarray
    """Velocity of the device [rad/s], 0 in a gap."""
    qdd: np.ndarray
    """Acceleration of the drive [rad/s^2]."""
    current: np.ndarray
    """Current as the fluid sees it [A]."""
    warmth: np.ndarray | None = None
    """Temperature rise of the fluid [K], where it acts."""
    room: np.ndarray | None = None
    """Temperature of the room [degC], shape (T, 1), where it acts."""
    slid: np.ndarray | None = None
    """Way slid in the session as a share of its end, where it acts."""
    touched: np.ndarray | None = None
    """Whether the device is driven, where there is a gap."""

    @property
    def rubbing(self) -> np.ndarray:
        """Direction of dry friction, -1 to 1: that of the last move, which stays at rest; 0 before it and in a gap."""
        moved = np.where(self.qd != 0.0, np.arange(self.qd.shape[1]), 0)
        last = np.sign(np.take_along_axis(self.qd, np.maximum.accumulate(moved, axis=1), axis=1))
        return last if self.touched is None else np.where(self.touched, last, 0.0)


@dataclass(frozen=True, kw_only=True)
class Value:
    """The true value of an effect's parameter as a user would state it."""

    parameter: str
    value: float
    unit: str
    powers: tuple[int, int, int]
    """As in :class:`Spec`."""
    exact: bool
    """As in :class:`Spec`."""


def true_value(name: str, effect: Effect) -> Value:
    """Figures of an effect that a perfect diagnosis would report."""
    spec, sign = EFFECTS[name], effect.draws.get("sign", 1.0)
    value = {
        "wear": effect.strength / (1.0 + effect.strength),
        "speed_weakening": 1.0 + sign * effect.strength,
    }.get(name, sign * effect.strength)
    parameter, unit, powers = spec.parameter, spec.unit, spec.powers
    if effect.draws.get("viscous"):
        parameter, unit, powers = "viscosity", "N·m·s/rad", (-1, 0, 1)
    return Value(parameter=parameter, value=value, unit=unit, powers=powers, exact=spec.exact)


# --- factors of the hysteretic torque ---


def speed_weakening(e: Effect, s: State, alpha: float) -> np.ndarray:
    """(1 + a/2 ln(1 + alpha|qd|))^-2: for small a the exponent becomes 1 + a, for a = 0.4 a fit finds 1.3."""
    bent = 1.0 + 0.5 * e.draws["sign"] * e.strength * np.log1p(alpha * np.abs(s.qd))
    return 1.0 / (bent * bent)


def temperature_drift(e: Effect, s: State) -> np.ndarray:
    """exp(-c*dT); the viscous torque takes the power 1.5 of it."""
    assert s.warmth is not None
    return np.exp(-e.strength * s.warmth)


def room_temperature(e: Effect, start: np.ndarray) -> np.ndarray:
    """Of each trajectory, as a thermometer on the device reads it [degC], shape (T,)."""
    share = start / max(float(start[-1]), 1.0)
    swing = e.draws["swing"] * np.sin(2.0 * np.pi * e.draws["waves"] * share + e.draws["phase"])
    return np.round(22.0 + swing, 1)


def temperature_fade(e: Effect, s: State) -> np.ndarray:
    """1/(1 + c*(T - 22 degC)); the viscous torque takes the power 1.5 of it."""
    assert s.room is not None
    return 1.0 / (1.0 + e.strength * (s.room - 22.0))


def wear(e: Effect, s: State) -> np.ndarray:
    """1/(1 + d*w) with the share w of the way slid in the session; at its end the share d/(1 + d) is lost."""
    assert s.slid is not None
    return 1.0 / (1.0 + e.strength * s.slid)


def loop_asymmetry(e: Effect, s: State) -> np.ndarray:
    """Another gain in each direction."""
    return 1.0 + e.draws["sign"] * e.strength * np.sign(s.qd)


def position_gain(e: Effect, s: State) -> np.ndarray:
    """A gap that changes along the stroke."""
    return 1.0 + e.draws["sign"] * e.strength * np.sin(2.0 * s.q)


# --- torques of their own ---


def coulomb_friction(e: Effect, s: State) -> np.ndarray:
    """Hard sign that turns with the motion and stays at rest."""
    return e.strength * s.rubbing


def friction_asymmetry(e: Effect, s: State) -> np.ndarray:
    """Dry or viscous friction that is larger in one direction, as the draw says."""
    if e.draws["viscous"]:
        return e.draws["sign"] * e.strength * np.abs(s.qd)
    return e.draws["sign"] * e.strength * np.abs(np.sign(s.qd))


def load_friction(e: Effect, s: State) -> np.ndarray:
    """Hard sign, in proportion to the size of the current."""
    return e.strength * np.abs(s.current) * s.rubbing


def position_friction(e: Effect, s: State) -> np.ndarray:
    """Hard sign, in proportion to the square of the displacement."""
    return e.strength * s.q**2 * s.rubbing


def stribeck(e: Effect, s: State) -> np.ndarray:
    """Lorentz curve over the speed."""
    return e.strength * s.rubbing / (1.0 + (s.qd / e.draws["speed"]) ** 2)


def cogging(e: Effect, s: State) -> np.ndarray:
    """Two harmonics with phases of their own."""
    turn = e.draws["waves"] * s.q
    return e.strength * (np.sin(turn + e.draws["phase"]) + 0.2 * np.sin(2.0 * turn + e.draws["second"]))


def current_viscosity(e: Effect, s: State) -> np.ndarray:
    """B1*I*qd that flattens slowly above 40 rad/s."""
    return e.strength * s.current * s.qd / np.sqrt(1.0 + (s.qd / 40.0) ** 2)


def rotor_inertia(e: Effect, s: State) -> np.ndarray:
    """J*qdd."""
    return e.strength * s.qdd


def gravity(e: Effect, s: State) -> np.ndarray:
    """The lever of a weight: its horizontal distance from the axis, by complex turning."""
    return e.strength * (np.exp(1j * s.q) * np.exp(-1j * e.draws["down"])).imag


def position_current(e: Effect, s: State) -> np.ndarray:
    """A*sin(4q)*I^2."""
    return e.draws["sign"] * e.strength * np.sin(4.0 * s.q) * s.current**2


def position_viscosity(e: Effect, s: State) -> np.ndarray:
    """B*q^2*qd."""
    return e.draws["sign"] * e.strength * s.q**2 * s.qd


def line(e: Effect, s: State) -> np.ndarray:
    """A line at 7.3 Hz with a new phase in each trajectory."""
    phase = np.random.default_rng(int(e.draws["phases"])).uniform(0.0, 2.0 * np.pi, (len(s.q), 1))
    return e.strength * np.sin(2.0 * np.pi * 7.3 * s.t + phase)


TORQUES: dict[str, Callable[[Effect, State], np.ndarray]] = {
    law.__name__: law
    for law in (
        coulomb_friction, friction_asymmetry, load_friction, position_friction, stribeck, cogging, current_viscosity,
        rotor_inertia, gravity, position_current, position_viscosity, line,
    )
}  # fmt: skip
"""Torques that add to those of eq. 14."""

FACTORS: dict[str, Callable[[Effect, State], np.ndarray]] = {
    law.__name__: law for law in (wear, loop_asymmetry, position_gain)
}
"""Factors of the hysteretic torque alone."""

THINNING: dict[str, Callable[[Effect, State], np.ndarray]] = {
    law.__name__: law for law in (temperature_drift, temperature_fade)
}
"""Factors of the hysteretic torque; the viscous torque takes the power 1.5 of them."""
