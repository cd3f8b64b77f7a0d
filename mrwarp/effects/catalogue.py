"""The catalogue: one line per effect, by stage in the order of the path. Adding one = its file and its line."""

from __future__ import annotations

import inspect
import zlib
from pathlib import Path

import warp as wp

from mrwarp.effects import (
    backlash,
    cogging,
    coil_lag,
    command_delay,
    compliance_with_backlash,
    coulomb_friction,
    current_gain,
    current_saturation,
    current_viscosity,
    encoder_offset,
    friction_asymmetry,
    load_friction,
    position_friction,
    remanence,
    rotor_inertia,
    series_compliance,
    speed_weakening,
    stribeck,
    temperature_drift,
    torque_bias,
    torque_gain,
    torque_sensor_lag,
    velocity_lag,
    wear,
)
from mrwarp.effects.law import STAGES, EffectLaw, EffectParameter, dry_direction
from mrwarp.effects.laws import arctangent, biviscous, bouc_wen_power, dahl, kwok, lugre, spencer
from mrwarp.kernels import bouc_wen, coil

LAWS: tuple[EffectLaw, ...] = (
    command_delay.LAW,
    coil_lag.LAW,
    current_gain.LAW,
    remanence.LAW,
    current_saturation.LAW,
    velocity_lag.LAW,
    encoder_offset.LAW,
    backlash.LAW,
    series_compliance.LAW,
    rotor_inertia.LAW,
    coulomb_friction.LAW,
    friction_asymmetry.LAW,
    load_friction.LAW,
    position_friction.LAW,
    stribeck.LAW,
    cogging.LAW,
    compliance_with_backlash.LAW,
    current_viscosity.LAW,
    speed_weakening.LAW,
    temperature_drift.LAW,
    wear.LAW,
    torque_sensor_lag.LAW,
    torque_gain.LAW,
    torque_bias.LAW,
)

CATALOGUE: dict[str, EffectLaw] = {law.name: law for stage in STAGES for law in LAWS if law.stage == stage}
"""All effects by name."""

HYSTERESIS: dict[str, EffectLaw] = {
    law.name: law
    for law in (
        kwok.LAW,
        arctangent.LAW,
        dahl.LAW,
        lugre.LAW,
        bouc_wen_power.LAW,
        spencer.LAW,
        biviscous.LAW,
    )
}
"""Laws that can stand in place of eq. 15, by name; at most one does."""

KNOWN: dict[str, EffectLaw] = CATALOGUE | HYSTERESIS
"""Effects and laws: all that a row of values holds."""


def _offsets() -> tuple[dict[str, int], dict[str, int], int, int]:
    columns, slots, column, slot = {}, {}, 0, 0
    for law in KNOWN.values():
        columns[law.name], slots[law.name] = column, slot
        column, slot = column + len(law.parameters), slot + law.states
    return columns, slots, column, slot


COLUMN, SLOT, COLUMNS, SLOTS = _offsets()
"""First parameter column and first state of each effect; number of columns and of states."""

_HELPERS = [f for module in (bouc_wen, coil) for f in vars(module).values() if isinstance(f, wp.Function)]
_HELPERS.append(dry_direction)
_FILES = sorted({inspect.getfile(f.func) for f in (*(law.law for law in KNOWN.values()), *_HELPERS)})
SOURCES: int = zlib.crc32(f"{[Path(file).read_text(encoding='utf-8') for file in _FILES]}{COLUMN}{SLOT}".encode()) // 2
"""Checksum of all laws' files, of what they call and of their places, for kernels composed of them."""

NULLS: tuple[float, ...] = tuple(p.null for law in KNOWN.values() for p in law.parameters)
"""The row of parameters at which no effect acts."""


def column_of(effect: str, parameter: str) -> int:
    """Column of a parameter in a row of values."""
    return COLUMN[effect] + [p.name for p in KNOWN[effect].parameters].index(parameter)


def parameter_of(effect: str, parameter: str) -> EffectParameter:
    """Specification of a parameter."""
    return next(p for p in KNOWN[effect].parameters if p.name == parameter)
