"""The catalogue: one line per effect, by stage in the order of the path. Adding one = its file and its line.

Laws of hysteresis are those of :data:`mrwarp.enums.HYSTERESIS_LAWS`, which command lines offer, too.
"""

from __future__ import annotations

import importlib
import inspect
import zlib
from pathlib import Path

import warp as wp

from mrwarp.effects.law import STAGES, EffectLaw, EffectParameter, dry_direction
from mrwarp.enums import HYSTERESIS_LAWS
from mrwarp.kernels import bouc_wen, coil

EFFECTS = (
    "command_delay",
    "coil_lag",
    "current_gain",
    "remanence",
    "current_saturation",
    "path_lag",
    "velocity_lag",
    "encoder_offset",
    "backlash",
    "series_compliance",
    "rotor_inertia",
    "gravity",
    "coulomb_friction",
    "friction_asymmetry",
    "load_friction",
    "position_friction",
    "stribeck",
    "cogging",
    "compliance_with_backlash",
    "current_viscosity",
    "speed_weakening",
    "temperature_drift",
    "temperature_fade",
    "wear",
    "torque_sensor_lag",
    "torque_gain",
    "torque_bias",
)
"""Files of the effects in this folder, in the order of the path."""

LAWS: tuple[EffectLaw, ...] = tuple(importlib.import_module(f"mrwarp.effects.{name}").LAW for name in EFFECTS)

CATALOGUE: dict[str, EffectLaw] = {law.name: law for stage in STAGES for law in LAWS if law.stage == stage}
"""All effects by name."""

HYSTERESIS: dict[str, EffectLaw] = {
    name: importlib.import_module(f"mrwarp.effects.laws.{name}").LAW for name in HYSTERESIS_LAWS if name != "bouc_wen"
}
"""Laws that can stand in place of eq. 15, by name; at most one does."""

OF_PUBLISHED_LAWS: dict[str, tuple[str, ...]] = {
    part: tuple(name for name, law in CATALOGUE.items() if law.of_published_laws == part)
    for part in ("term", "saturation", "direction")
}
"""Effects that these have, by their part in them."""

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
