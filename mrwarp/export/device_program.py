"""A model.json as a program of a few functions: what the writers of :mod:`mrwarp.export` turn into text."""

from __future__ import annotations

from dataclasses import dataclass

from mrwarp.actuator.effect_runtime import added_inertia, in_kernels, longest_delay, values_row
from mrwarp.effects import path
from mrwarp.effects.catalogue import COLUMN, HYSTERESIS, KNOWN, SLOT
from mrwarp.effects.law import EffectLaw
from mrwarp.export.device_step import step
from mrwarp.export.specialise import NotExportableError, Program, Value
from mrwarp.kernels.mr_joint import FIELDS
from mrwarp.model_file import Model
from mrwarp.params import MrParams

FIXED: dict[str, Value] = {"held": 1, "begins": 0, "qdd": 0.0, "qdd_before": 0.0}
"""Fields of a step that the simulator never changes: it holds command and torque, and knows no acceleration."""

STATE = ("z", "coil", "bound", "speed", "caught", "heat", "steps", "newest")
"""Numbers that a device remembers from step to step, in addition to states of effects and past commands."""


@dataclass(frozen=True, kw_only=True)
class DeviceProgram:
    """A device that can be written in other languages."""

    model: Model
    params: MrParams
    program: Program
    dt: float
    inertia: float
    """To be added to the joint [kg·m²]."""
    depth: int
    """Past commands that are kept; 0 without a delay."""
    docs: dict[str, str]
    """Sentence on each constant."""

    @property
    def state(self) -> dict[str, str]:
        """Numbers that the functions keep, by name, with their types."""
        counts = {"steps": "wear" in self.acting, "newest": self.depth > 0, "heat": "temperature_drift" in self.acting}
        return {name: "int" if name in ("steps", "newest") else "float" for name in STATE if counts.get(name, True)}

    @property
    def acting(self) -> tuple[str, ...]:
        """Effects and the law that act, by name."""
        return tuple(effect.name for effect in self.model.effects if in_kernels([effect]))


def device_program(model: Model, dt: float) -> DeviceProgram:
    """Reduce the kernels to one device.

    Args:
        model: The device.
        dt: Step [s].

    Raises:
        ModelFileError: the model is not in rad, A and N·m, or a value is out of range.
        NotExportableError: the model has an effect that the catalogue does not know.
        ValueError: the step is not positive and finite.
    """
    if not 0.0 < dt < float("inf"):
        raise ValueError(f"dt = {dt} s must be positive and finite")
    unknown = [effect.name for effect in model.effects if effect.name not in KNOWN]
    if unknown:
        raise NotExportableError(
            f"effects: {', '.join(unknown)}: unknown to the catalogue, so nobody can export what it does; "
            "remove it from the model file"
        )
    params = model.to_params().alone()
    acting = [effect for effect in model.effects if in_kernels([effect])]
    names = {effect.name for effect in acting}
    depth = int(longest_delay(acting) / dt) + 3 if "command_delay" in names else 0
    law = next((k + 1 for k, name in enumerate(HYSTERESIS) if name in names), 0)
    program = Program(
        numbers=_numbers(params, acting, dt, depth),
        effects=_columns(),
        fixed=FIXED,
        known={"law_in_force": law, "law_slot": _law_slot(law)},
        replaced={
            **{stage: [x for x in getattr(path, stage) if x.name in names] for stage in _STAGES},
            "EFFECTS": int(bool(acting)),
            "DELAYED": int(depth > 0),
            "WORN": int("wear" in names),
            "WARMED": int("temperature_drift" in names),
        },
    )
    program.function(step, {})
    docs = {_capital(spec.name): spec.doc for spec in MrParams.specs()}
    return DeviceProgram(
        model=model, params=params, program=program, dt=dt, inertia=added_inertia(model.effects), depth=depth, docs=docs
    )


_STAGES = ("_CURRENT", "_MOTION", "_SHAFT", "_TORQUE", "_SENSOR")
"""Lists of laws in :mod:`mrwarp.effects.path`; of the hysteresis laws one is chosen by its number."""


def _capital(name: str) -> str:
    return name.upper() if name != "K" else "K_HOLD"


def _columns() -> dict[int, str]:
    """Name of the constant of each column of a row of values."""
    laws: list[EffectLaw] = list(KNOWN.values())
    return {COLUMN[x.name] + k: f"{x.name}_{p.name}".upper() for x in laws for k, p in enumerate(x.parameters)}


def _numbers(params: MrParams, acting: list, dt: float, depth: int) -> dict[str, tuple[Value, str]]:
    values = params.to_dict()
    found: dict[str, tuple[Value, str]] = {"DT": (dt, "s"), "COMMANDS": (depth, "past commands")}
    found |= {_capital(name): (float(values[name]), MrParams.spec(name).unit) for name in FIELDS}
    row = values_row(acting)
    units = {COLUMN[x.name] + k: p.unit for x in KNOWN.values() for k, p in enumerate(x.parameters)}
    return found | {name: (float(row[at]), units[at]) for at, name in _columns().items()}


def _law_slot(law: int) -> int:
    return SLOT[list(HYSTERESIS)[law - 1]] if law else 0
