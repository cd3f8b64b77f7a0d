"""Devices and motions of :mod:`benchmarks.hosts`, and the trace that a host leaves along one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mrwarp.effects.catalogue import HYSTERESIS
from mrwarp.model_file import Effect, FittedOn, Model, Parameter, make_effect
from mrwarp.params import MrParams

STEPS = 120
"""Steps of a motion."""

TIMES = (0.001, 0.005, 0.02)
"""Steps of time [s]."""

RESET = 90
"""Step before which every host is reset."""

NEUTRAL = -1.5
"""Where the joint of the asset stands while the device is at its zero [rad]."""

NUMBERS: dict[str, dict[str, float]] = {
    "bouc_wen": {},
    "kwok": {"slope": 3.0, "width": 0.2, "rounding": 0.3},
    "arctangent": {"slope": 3.0, "speed": 0.2, "rounding": 8.0},
    "dahl": {"rate": 20.0},
    "lugre": {"rate": 20.0, "damping": 0.01, "stribeck": 0.4, "stribeck_speed": 0.5},
    "bouc_wen_power": {"rate": 20.0, "unloading": 0.2, "sharpness": 1.0},
    "spencer": {"rate": 30.0, "series": 2.0, "inner": 0.1, "spring": 0.5},
    "biviscous": {"speed": 0.4},
}
"""A device of each law."""

STRENGTHS: dict[str, dict[str, float]] = {
    "coil_lag": {"time_constant": 0.03},
    "command_delay": {"delay": 0.0172},
    "temperature_drift": {"yield_loss": 0.02, "viscosity_loss": 0.03, "time_constant": 37.0},
    "wear": {"rate": 0.05},
    "backlash": {"half_gap": 0.01},
    "series_compliance": {"compliance": 0.05, "difference": 0.3},
    "cogging": {"sine": 0.2, "cosine": -0.1, "periods": 24.0},
    "friction_asymmetry": {"coulomb": 0.2, "viscous": 0.05, "speed": 0.05},
}
"""Effects of the device at strengths that show."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A device and a motion: angles [rad], velocities [rad/s] and currents [A] at the steps' starts, shape (STEPS,)."""

    name: str
    model: Model
    dt: float
    q: np.ndarray
    qd: np.ndarray
    current: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Trace:
    """Torques of a host in each step [N·m], shape (STEPS,); None where it gives no such thing."""

    torque: np.ndarray | None = None
    """The law's, positive against positive motion, as a bench logs it."""
    effort: np.ndarray | None = None
    """Torque that an explicit host applies to the joint."""
    bound: np.ndarray | None = None
    """Dry friction that the solver may use."""


def device(law: str = "bouc_wen", effects: Iterable[str] = (), **values: float) -> Model:
    """A device of a law, with effects."""
    unit_loop = {
        "alpha": 0.0,
        "beta": 1.0,
        "gamma": 0.0,
        "K0": 0.2,
        "K1": 2.0,
        "D": 0.02,
        "C": 0.4,
        "I1": 0.05,
        "B": 0.05,
    }
    known = {**MrParams().to_dict(), **(unit_loop if law in HYSTERESIS else {}), "C": 0.6, **values}
    names = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma", "q_offset", "q_center", "T_max", "K", "n")
    parameters = {name: Parameter(value=known[name], unit=MrParams.spec(name).unit) for name in names}
    found: list[Effect] = [make_effect(law, NUMBERS[law])] if law in HYSTERESIS else []
    found += [make_effect(name, STRENGTHS[name]) for name in effects]
    origin = FittedOn(source="hosts", trajectories=1, samples=STEPS, rate=200.0, current=(0.0, 1.5))
    return Model(parameters=parameters, fitted_on=origin, effects=tuple(found))


def case(law: str, effects: Sequence[str], dt: float, sign: float = 1.0) -> Case:
    """A motion with reversals, rests, creeping and blows, under a current that steps; ``sign`` mirrors it."""
    k = np.arange(STEPS)
    qd = 3.0 * np.sin(2.0 * np.pi * k / 40.0)
    qd[52:60], qd[60:68], qd[100:104], qd[104:] = 0.0, 0.05, 6.0, -4.0
    q = 0.1 + np.cumsum(dt * qd)
    current = np.array([0.0, 1.0, 0.4, 1.5, 1.5, 0.7, 0.2, 1.2])[k // 15]
    q, qd, current = (x.astype(np.float32).astype(float) for x in (sign * q, sign * qd, current))
    name = f"{law}, {' + '.join(effects) or 'no effects'}, {1000 * dt:g} ms"
    return Case(name=name, model=device(law, effects), dt=dt, q=q, qd=qd, current=current)


def traced(case: Case, step: Callable[[float, float, float], dict[str, float]], reset: Callable[[], object]) -> Trace:
    """Step a host through a case."""
    rows = []
    for k, now in enumerate(zip(case.q, case.qd, case.current, strict=True)):
        if k == RESET:
            reset()
        rows.append(step(*now))
    return Trace(**{name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]})
