"""Content of an MR prim: its numbers, and the record of the model that they are of.

The numbers are the attributes ``newton:mr:*``. One text attribute next to them, :data:`RECORD`, holds as JSON
``model``, the content of the model.json that was applied (intervals, origin, effects), and ``rest``, the prim's other
numbers at that time. Any USD tool may change the numbers: where one differs from the record, the attribute counts, and
its interval is dropped, as it belongs to another value.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd

from mrwarp.model_file import (
    JOINT_UNITS,
    MAX_BYTES,
    FittedOn,
    Model,
    ModelFileError,
    Parameter,
    model_from_dict,
    model_to_dict,
    parameter_unit,
    silent_note,
)
from mrwarp.options.json_file import JsonFileError, checked_number, checked_object, key_shown, read_json, shown
from mrwarp.params import MrParams, ParameterError, ParamSpec
from mrwarp.run_dir import versions
from mrwarp.usd.open_stage import SCHEMA, AssetError

PREFIX = "newton:mr:"
"""Namespace of the MR parameters in USD."""

PD = {f"newton:{n}": MrParams.spec(s) for n, s in (("kp", "kp_base"), ("kd", "kd"), ("maxEffort", "tau_limit"))}
"""Facts about the attributes of a plain motor."""

_NUMBER_TYPES = {"double", "float", "int"}

LAW = f"{PREFIX}law"
"""Attribute of type ``string`` that names the hysteresis law; its numbers stand in the record. None: eq. 15."""

RECORD = "mr:model:record"
"""Attribute of type ``string`` that holds the record; ASCII, so that no tool's encoding matters."""

MAX_CHARACTERS = 4 * MAX_BYTES
"""Longest record that is read: any model file fits, with every letter escaped."""

_REMEDY = f"apply the model again with 'mrwarp asset apply', or remove {RECORD}: the numbers stay"


@dataclass(frozen=True, kw_only=True)
class PrimModel:
    """Content of a prim: the model as its attributes are now, and its origin."""

    model: Model
    applied: Model | None = None
    """The model as it was applied; None: the prim has no record, and the model is its bare numbers."""
    changed: Mapping[str, float] = field(default_factory=dict)
    """Parameters that differ from the record, with the number there."""

    def lines(self) -> Iterator[str]:
        """Origin, effects and what differs, for people; nothing without a record."""
        if self.applied is None:
            return
        yield f"model: {origin(self.applied)}"
        if self.applied.device_mass is not None:
            yield f"device mass: {self.applied.device_mass.value:g} kg"
        for effect in self.applied.effects:
            kind = "law" if effect == self.applied.law else "effect"
            yield f"{kind}{'' if effect.acts else ' (does not act)'}: {effect}"
        if note := silent_note(self.applied.effects):
            yield note
        if self.changed:
            yield self.note()

    def note(self) -> str:
        """Differences from the applied model, on one line; empty without any."""
        values = self.model.values
        parts = [f"{name} = {values[name]:.10g} (was {was:.10g})" for name, was in self.changed.items()]
        return f"changed since the model was applied, so without interval: {', '.join(parts)}" if parts else ""


def is_mr(prim: Usd.Prim) -> bool:
    """Whether :data:`SCHEMA` is applied to a prim, directly or through what it inherits."""
    return SCHEMA in prim.GetPrimTypeInfo().GetAppliedAPISchemas()


def read_parameters(prim: Usd.Prim, file: str | Path = "stage") -> MrParams:
    """Read and check the ``newton:mr:*`` attributes of one actuator prim.

    Raises:
        AssetError: an attribute is missing, misspelt, not a number or out of range.
    """
    where = f"{file}: {prim.GetPath()}"
    try:
        for attribute in prim.GetAuthoredPropertiesInNamespace(PREFIX.rstrip(":")):
            if attribute.GetName() != LAW:
                MrParams.spec(attribute.GetName().removeprefix(PREFIX), where)
        values = {spec.name: read_number(prim, PREFIX + spec.name, spec, file) for spec in MrParams.specs()}
        return MrParams.from_dict(values, where)
    except ParameterError as error:
        raise AssetError(str(error).replace("MR parameter '", f"MR parameter '{PREFIX}")) from None


def read_number(prim: Usd.Prim, name: str, spec: ParamSpec, file: str | Path) -> float:
    """The authored value of a numeric attribute; a 32-bit value is read as its shortest decimal (23.7).

    Raises:
        AssetError: it is missing, not a number or out of the range of ``spec``.
    """
    attribute = prim.GetAttribute(name)
    where = f"{file}: {prim.GetPath()}"
    if not attribute or not attribute.HasAuthoredValue():
        raise AssetError(f"{where}: {name} is missing; {spec.allowed()}")
    opinion = next(s for s in attribute.GetPropertyStack() if s.HasDefaultValue() or s.HasInfo("timeSamples"))
    value: Any = opinion.default
    if opinion.HasInfo("timeSamples"):
        raise AssetError(f"{where}: {name} varies with time; author one value; {spec.allowed()}")
    # USD keeps a path or a list that stands in place of a number, regardless of the attribute's type
    if str(opinion.typeName) not in _NUMBER_TYPES or not isinstance(value, int | float):
        raise AssetError(f"{where}: {opinion.typeName} {name} = {value!r} is not a number; {spec.allowed()}")
    if str(opinion.typeName) == "float" and math.isfinite(value):
        value = float(str(np.float32(value)))
    try:
        return spec.check(value, where)
    except ParameterError:
        raise AssetError(f"{where}: {name} = {value:g} is out of range; {spec.allowed()}") from None


def read_model(prim: Usd.Prim, file: str | Path = "stage") -> PrimModel:
    """The model that an MR prim holds.

    Raises:
        AssetError: an attribute is unusable (see :func:`read_parameters`), or the record is.
    """
    values = {name: value for name, value in read_parameters(prim, file) if name != "q_neutral"}
    place = f"{file}: {prim.GetPath()}"
    bare = {name: Parameter(value=value, unit=parameter_unit(name, JOINT_UNITS)) for name, value in values.items()}
    found = _record(prim, place)
    applied, rest = parse_record(found, place) if found else (None, {})
    _check_law(prim, applied, place)
    if applied is None:
        origin = FittedOn(source=place, trajectories=0, samples=0, rate=0.0)
        return PrimModel(model=Model(parameters=bare, fitted_on=origin, versions=versions()))
    recorded = {**applied.values, **rest}
    changed = {name: recorded[name] for name in values if not _same(prim, name, values[name], recorded[name])}
    parameters = {**applied.parameters, **{name: bare[name] for name in changed}}
    return PrimModel(model=replace(applied, parameters=parameters), applied=applied, changed=changed)


def record_text(model: Model, params: MrParams) -> str:
    """The record of a model for a prim whose numbers, in addition to the model's, are those of ``params``."""
    rest = {name: value for name, value in params if name != "q_neutral" and name not in model.parameters}
    return json.dumps({"model": model_to_dict(model), "rest": rest}, allow_nan=False, separators=(",", ":"))


def parse_record(text: str, place: str) -> tuple[Model, dict[str, float]]:
    """Read and check a record: the model, and the prim's other numbers when it was applied.

    Raises:
        AssetError: it is too long, not JSON, or one of its entries is unusable; names ``place``, entry and value.
    """
    where = f"{place}: {RECORD}"
    try:
        if len(text) > MAX_CHARACTERS:
            raise ModelFileError(f"{where}: {len(text)} characters; a record has at most {MAX_CHARACTERS}")
        content = checked_object(read_json(text, where), where, ("model", "rest"))
        model = model_from_dict(content["model"], f"{where}: model")
        if model.units != JOINT_UNITS:
            raise ModelFileError(f"{where}: model: units = {shown(model.units)}; allowed: {JOINT_UNITS}")
        names = tuple(s.name for s in MrParams.specs() if s.name != "q_neutral" and s.name not in model.parameters)
        rest = checked_object(content["rest"], f"{where}: rest", names)
        return model, {name: checked_number(value, f"{where}: rest.{name}") for name, value in rest.items()}
    except JsonFileError as error:
        raise AssetError(f"{error}; {_REMEDY}") from None


def origin(model: Model) -> str:
    """Where a model comes from, on one line."""
    at = model.fitted_on
    size = f"{at.trajectories} trajectories, {at.samples} samples at {at.rate:g} 1/s, seed {model.seed}"
    size = size if at.trajectories or at.samples else "not fitted"
    by = f", mrwarp {key_shown(model.versions['mrwarp'])}" if "mrwarp" in model.versions else ""
    return f"{shown(at.source)}, {size}{by}"


def summary(value: Any) -> str:
    """A record for a message, with any content."""
    try:
        return f"model {origin(parse_record(value, '')[0])}" if value else "none"
    except (AssetError, TypeError):
        return "unreadable"


def record_difference(old: Any, new: Any, places: tuple[str, str]) -> str:
    """Differences between two records, on one line: at most three entries.

    Raises:
        AssetError: one of them is unusable; ``places`` says where they stand.
    """
    if not (old and new and isinstance(old, str) and isinstance(new, str)):
        return f"{summary(old)} -> {summary(new)}"
    left, right = (dict(_leaves(text, place)) for text, place in zip((old, new), places, strict=True))
    keys = [key for key in left | right if left.get(key) != right.get(key)]
    parts = [f"{key_shown(key)} {shown(left.get(key))} -> {shown(right.get(key))}" for key in keys[:3]]
    return (", ".join(parts) or "the same, written otherwise") + (f" and {len(keys) - 3} more" if keys[3:] else "")


def _leaves(text: str, place: str) -> Iterator[tuple[str, Any]]:
    """Every entry of a record, its keys joined with dots."""
    model, rest = parse_record(text, place)
    content = {**model_to_dict(model), "rest": rest}
    content["effects"] = dict(enumerate(content["effects"]))
    left = list(content.items())
    while left:
        key, item = left.pop(0)
        if isinstance(item, dict):
            left[:0] = [(f"{key}.{inner}", value) for inner, value in item.items()]
        else:
            yield key, item


def _record(prim: Usd.Prim, place: str) -> str:
    """The text of the record; empty if there is none."""
    attribute = prim.GetAttribute(RECORD)
    if not attribute or not attribute.HasAuthoredValue():
        return ""
    if attribute.GetNumTimeSamples():
        raise AssetError(f"{place}: {RECORD} varies with time; allowed: one text; {_REMEDY}")
    value = attribute.Get()
    if not isinstance(value, str) or attribute.GetTypeName() != Sdf.ValueTypeNames.String:
        raise AssetError(f"{place}: {attribute.GetTypeName()} {RECORD} = {shown(value)}; allowed: a string; {_REMEDY}")
    return value


def law_name(model: Model | None) -> str:
    """Value of :data:`LAW` for a model."""
    return model.law.name if model is not None and model.law is not None else "bouc_wen"


def _check_law(prim: Usd.Prim, applied: Model | None, place: str) -> None:
    """Refuse a law whose numbers the prim does not hold."""
    attribute = prim.GetAttribute(LAW)
    value = attribute.Get() if attribute and attribute.HasAuthoredValue() else None
    held = law_name(applied)
    if value not in (None, held):
        raise AssetError(
            f"{place}: {LAW} = {shown(value)}, but its record holds the numbers of {held!r}; allowed: {held!r}; "
            "give the prim another law with 'mrwarp asset apply'"
        )


def _same(prim: Usd.Prim, name: str, value: float, recorded: float) -> bool:
    """Whether an attribute still holds the recorded number, as far as its type can (``float``: 32 bits)."""
    if value == recorded:
        return True
    opinions = prim.GetAttribute(PREFIX + name).GetPropertyStack()
    single = str(next(s for s in opinions if s.HasDefaultValue()).typeName) == "float"
    with np.errstate(over="ignore"):
        return single and np.float32(value) == np.float32(recorded)


def plain(item: Usd.Property) -> Any:
    """The value of a property without its precision: a 32-bit number as its shortest decimal, the rest as text."""
    if isinstance(item, Usd.Relationship):
        return [str(target) for target in item.GetTargets()]
    assert isinstance(item, Usd.Attribute)
    if item.GetNumTimeSamples() or item.HasAuthoredConnections():
        return [repr(item.Get(time)) for time in item.GetTimeSamples()] + [str(p) for p in item.GetConnections()]
    authored = next((spec for spec in authored_values(item)), None)
    return decimal(item.Get(), str(authored.typeName if authored else item.GetTypeName()))


def authored_values(item: Usd.Property) -> Iterator[Sdf.AttributeSpec]:
    """The specs that state a value of a property, strongest first."""
    yield from (s for s in item.GetPropertyStack() if isinstance(s, Sdf.AttributeSpec) and s.HasDefaultValue())


def decimal(value: Any, type_name: str) -> Any:
    """A number as Python float; a value of type ``float`` as the shortest decimal that rounds to it."""
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(str(np.float32(value))) if type_name == "float" else float(value)
    return value if isinstance(value, (bool, str, type(None))) else str(value)
