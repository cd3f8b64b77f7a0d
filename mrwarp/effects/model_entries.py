"""The effects of a model file: read, checked against the catalogue, and the units of their numbers."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mrwarp.model_file import (
    JOINT_UNITS,
    Effect,
    ModelFileError,
    Parameter,
    checked_interval,
    checked_number,
    checked_object,
    key_shown,
    shown,
)

if TYPE_CHECKING:
    from mrwarp.effects.law import EffectLaw, EffectParameter


def read_effects(entries: list[Any], units: Mapping[str, str], where: str) -> tuple[Effect, ...]:
    """The effects of a model file.

    An effect of the catalogue must have its parameters, in the units of the device, of a sign that makes sense; any
    other is carried as it is. A bare number is a parameter without interval.

    Args:
        entries: What the file holds: ``{"name": ..., "parameters": {NAME: {"value", "unit", "ci95"} or number}}`` each.
        units: Units of the device.
        where: Place of the list, at the front of every message.

    Raises:
        ModelFileError: an entry is unusable, or an effect of the catalogue stands twice.
    """
    from mrwarp.effects.catalogue import CATALOGUE  # here, for it starts Warp, which a model without effects needs not

    found: list[Effect] = []
    for i, entry in enumerate(entries):
        place = f"{where}[{i}]"
        checked_object(entry, place, ("name", "parameters"))
        name = entry["name"]
        if not isinstance(name, str) or not name or any("\ud800" <= c <= "\udfff" for c in name):
            raise ModelFileError(f"{place}.name = {shown(name)}; allowed: a text that names an effect")
        if name in CATALOGUE and any(effect.name == name for effect in found):
            raise ModelFileError(f"{place}: {name} stands twice; remove one")
        if not isinstance(entry["parameters"], dict):
            raise ModelFileError(f"{place}.parameters = {shown(entry['parameters'])}; allowed: an object {{...}}")
        found.append(_effect(name, entry["parameters"], CATALOGUE.get(name), units, place))
    return tuple(found)


def check_effects(effects: tuple[Effect, ...], where: str) -> None:
    """Check effects that were made in Python as those of a file.

    Raises:
        ModelFileError: as :func:`read_effects`.
    """
    entries = [
        {
            "name": effect.name,
            "parameters": {
                name: {"value": p.value, "unit": p.unit, "ci95": None if p.ci95 is None else list(p.ci95)}
                for name, p in effect.parameters.items()
            },
        }
        for effect in effects
    ]
    read_effects(entries, JOINT_UNITS, where)


def effect_unit(parameter: EffectParameter, units: Mapping[str, str]) -> str:
    """Unit of an effect's number for a device in ``units``: the catalogue's with rad, A and N·m exchanged."""
    unit = parameter.unit
    if dict(units) == JOINT_UNITS:
        return unit
    # derived units hide angle and torque
    hidden = {"kg·m²": "N·m·s²/rad", "1/J": "1/(N·m·rad)"}
    if (units["torque"], units["q"]) == ("N·m", "rad"):
        hidden = {}
    elif (units["torque"], units["q"]) == ("N", "m"):
        hidden = {"kg·m²": "kg", "1/J": "1/J"}
    unit = hidden.get(unit, unit)
    for plain, key in (("rad", "q"), ("N·m", "torque"), ("A", "current")):
        unit = unit.replace(plain, f"<{key}>")
    for key in ("q", "current", "torque"):
        unit = unit.replace(f"<{key}>", units[key])
    return unit


def make_effect(name: str, values: Mapping[str, float]) -> Effect:
    """An effect of the catalogue from bare numbers, for a joint in rad, A and N·m.

    Raises:
        ModelFileError: there is no such effect or parameter, one is missing, or a value makes no sense.
    """
    from mrwarp.effects.catalogue import CATALOGUE

    if name not in CATALOGUE:
        near = difflib.get_close_matches(name, CATALOGUE, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ModelFileError(f"there is no effect {name!r}; {hint}known: {', '.join(CATALOGUE)}")
    return _effect(name, dict(values), CATALOGUE[name], JOINT_UNITS, f"effect {name}")


def _effect(name: str, content: dict[str, Any], law: EffectLaw | None, units: Mapping[str, str], where: str) -> Effect:
    parameters: dict[str, Parameter] = {}
    known = {} if law is None else {p.name: p for p in law.parameters}
    for key, entry in content.items():
        place = f"{where}.parameters.{key_shown(key)}"
        if law is not None and key not in known:
            near = difflib.get_close_matches(key, known, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise ModelFileError(f"{place}: {name} has no such parameter; {hint}known: {', '.join(known)}")
        parameters[key] = _parameter(entry, known.get(key), units, place)
    for key, spec in known.items():
        if key not in parameters and not (spec.choices or spec.form):
            text = f"needed: {spec.allowed()}{_in(effect_unit(spec, units))}"
            raise ModelFileError(f"{where}.parameters.{key} is missing; {text}")
    return Effect(name=name, parameters=parameters)


def _in(unit: str | None) -> str:
    """The unit of a range that was just named; nothing for that of a ratio."""
    return f", in {unit}" if unit not in (None, "", "1") else ""


def _parameter(entry: Any, spec: EffectParameter | None, units: Mapping[str, str], where: str) -> Parameter:
    expected = None if spec is None else effect_unit(spec, units)
    if not isinstance(entry, dict):
        parameter = Parameter(value=checked_number(entry, where), unit=expected or "")
    else:
        checked_object(entry, where, ("value", "unit", "ci95"))
        unit = entry["unit"]
        if not isinstance(unit, str) or (expected is not None and unit != expected):
            allowed = repr(expected) if expected is not None else "a text"
            raise ModelFileError(f"{where}.unit = {shown(unit)}; allowed: {allowed}; convert the value, then the unit")
        value = checked_number(entry["value"], f"{where}.value")
        parameter = Parameter(value=value, unit=unit, ci95=checked_interval(entry["ci95"], value, f"{where}.ci95"))
    if spec is not None and not spec.allows(parameter.value):
        raise ModelFileError(f"{where} = {parameter.value:g}; allowed: {spec.allowed()}{_in(expected)}")
    return parameter
