"""Every effect of the catalogue at a strength that shows, for tests that need them all."""

from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.effects.law import EffectParameter, Ranges

RANGES = Ranges(q=0.8, qd=6.0, current=1.5, torque=0.7, dt=0.005, session=240.0)
"""Coverage of the made-up data of these tests."""

CHOSEN = {
    "command_delay": {"delay": 0.0172},
    "coil_lag": {"time_constant": 0.03},
    "current_gain": {"gain": 1.3},
    "remanence": {"half_width": 0.15},
    "current_saturation": {"u": 0.6},
    "path_lag": {"length": 0.05},
    "velocity_lag": {"time_constant": 0.01},
    "encoder_offset": {"offset": 0.1},
    "backlash": {"half_gap": 0.01},
    "series_compliance": {"compliance": 0.05, "difference": 0.3},
    "rotor_inertia": {"inertia": 0.01},
    "gravity": {"sine": 0.3, "cosine": -0.2, "periods": 1.0},
    "coulomb_friction": {"torque": 0.4, "speed": 0.05},
    "friction_asymmetry": {"coulomb": 0.2, "viscous": 0.05, "speed": 0.05, "thinning": 0.1, "yielding": 0.1},
    "load_friction": {"F1": 0.1, "speed": 0.05, "inertia": 0.003},
    "position_friction": {"F1": 0.4, "F2": -0.2, "speed": 0.05},
    "stribeck": {"torque": 0.5, "stribeck_speed": 0.4, "speed": 0.05},
    "cogging": {"sine": 0.2, "cosine": -0.1, "periods": 24.0},
    "compliance_with_backlash": {"stiffness": 1.5, "half_gap": 0.05, "difference": -0.2},
    "current_viscosity": {"B1": 0.05},
    "speed_weakening": {"power": 0.6},
    "temperature_drift": {"yield_loss": 0.02, "viscosity_loss": 0.03, "time_constant": 37.0},
    "temperature_fade": {"yield_loss": 0.02, "viscosity_loss": 0.03, "reference": 22.0, "temperature": 28.0},
    "wear": {"rate": 0.05},
    "torque_sensor_lag": {"time_constant": 0.006},
    "torque_gain": {"gain": 0.8},
    "torque_bias": {"bias": 0.1},
}
"""Strengths that are chosen by hand."""


def middle(parameter: EffectParameter) -> float:
    """A visible value: the middle start, the preset, or a third of what its unit is on these data."""
    if parameter.starts is not None:
        starts = parameter.starts(RANGES)
        return starts[len(starts) // 2]
    if parameter.preset is not None:
        return parameter.preset(RANGES)
    angle, current, torque = parameter.scale
    return parameter.null + 0.3 * RANGES.q**angle * RANGES.current**current * RANGES.torque**torque


STRENGTHS = {
    name: CHOSEN.get(name) or {p.name: middle(p) for p in law.parameters if not p.form}
    for name, law in CATALOGUE.items()
}
"""A visible strength of every effect."""
