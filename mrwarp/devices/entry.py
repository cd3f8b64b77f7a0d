"""An entry of the library: ``model.json`` as ``fit`` and ``diagnose`` write it, and ``device.json`` on where it holds.

``device.json`` has two parts. ``stated`` is written by people: what the device is, who recorded it, its licence.
``measured`` is written by ``mrwarp device make`` alone. No recording is part of the library.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrwarp.effects.catalogue import KNOWN
from mrwarp.model_file import JOINT_UNITS, Model, Parameter, load_model
from mrwarp.options.json_file import JsonFileError, checked_object, checked_texts, read_json_file
from mrwarp.recording.data import NO_INPUT, quantity, with_unit
from mrwarp.resources import DEVICES, device_names
from mrwarp.runtime import closest

STATED = ("title", "kind", "origin", "address", "licence", "recorded", "columns")
"""Keys that people write of a device; all are needed."""

FILE = "device.json"

_LAW_OF_EQ14 = ("alpha", "beta", "gamma", "z_max")
"""Numbers of eq. 15, which say nothing where another law takes its place."""
_REMEDY = "write its part 'stated', see docs/extend.md"
_WIDTH = 118


@dataclass(frozen=True, kw_only=True)
class Device:
    """A device of the library."""

    name: str
    model: Model
    stated: Mapping[str, str]
    """Title, kind, origin, address, licence, what was recorded, what the columns hold."""
    measured: Mapping[str, Any]
    """Command, range, errors on runs that took no part, what stays unexplained."""

    @property
    def joint(self) -> bool:
        """Whether the simulator's joints can carry it: it is in rad, A and N·m."""
        return dict(self.model.units) == JOINT_UNITS

    @property
    def law(self) -> str:
        """The hysteresis law in words."""
        return KNOWN[self.model.law.name].title if self.model.law else "eqs. 14 and 15"

    @property
    def error(self) -> str:
        """Error on runs that took no part, in a few words."""
        held = self.measured["held_out"]
        rmse = f"{held['rmse']:.3g} {self.model.units['torque']}"
        return rmse if held["nrmse"] is None else f"{100 * held['nrmse']:.1f} % ({rmse})"


def load_device(name: str, folder: Path = DEVICES) -> Device:
    """A device of the library by its name.

    Raises:
        ValueError: there is no such device.
        JsonFileError: one of its files is damaged.
    """
    if name not in device_names(folder):
        hint = closest(name, device_names(folder))
        raise ValueError(f"there is no device {name!r}; {hint}see mrwarp device list")
    place = folder / name
    content = checked_object(read_json_file(place / FILE, _REMEDY), str(place / FILE), ("stated", "measured"))
    return Device(
        name=name,
        model=load_model(place / "model.json"),
        stated=stated_part(content, place / FILE),
        measured=content["measured"],
    )


def stated_part(content: Any, path: Path) -> dict[str, str]:
    """The part that people wrote of a device.

    Raises:
        JsonFileError: an entry is missing, unknown or no text.
    """
    if not isinstance(content, dict) or "stated" not in content:
        raise JsonFileError(f"{path}: stated is missing; {_REMEDY}")
    return checked_texts(checked_object(content["stated"], f"{path}: stated", STATED), f"{path}: stated")


def library(folder: Path = DEVICES) -> list[Device]:
    """All devices, by name."""
    return [load_device(name, folder) for name in device_names(folder)]


def overview(devices: list[Device]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of the table of devices."""
    head = ("name", "device", "law", "effects", "error on unseen runs", "units", "licence")
    rows = [
        (
            d.name,
            d.stated["title"],
            d.law,
            ", ".join(effect.name for effect in d.model.effects if effect is not d.model.law) or "-",
            d.error,
            ", ".join(d.model.units.values()),
            d.stated["licence"],
        )
        for d in devices
    ]
    return head, rows


def numbers(model: Model) -> list[tuple[str, str, str]]:
    """Name with unit, value and 95 % interval of every number that says something about the device."""
    own = {
        name: p
        for name, p in model.parameters.items()
        if (p.value or p.ci95) and not (model.law and name in _LAW_OF_EQ14)
    }
    rows = [_row(name, p) for name, p in own.items()]
    for effect in model.effects:
        rows += [_row(f"{effect.name}.{name}", p) for name, p in effect.parameters.items() if p.value or p.ci95]
    if model.device_mass is not None:
        rows.append(_row("device_mass", model.device_mass))
    return rows


def _row(name: str, p: Parameter) -> tuple[str, str, str]:
    interval = f"{p.ci95[0]:.4g} to {p.ci95[1]:.4g}" if p.ci95 and all(map(math.isfinite, p.ci95)) else "-"
    return f"{name}{f' [{p.unit}]' if p.unit not in ('', '1') else ''}", f"{p.value:.4g}", interval


def range_text(device: Device) -> str:
    """Where the numbers hold: the motion and the control input that were recorded."""
    found, units = device.measured["range"], device.model.units

    def span(column: str) -> str:
        low, high = found[column]
        return f"{quantity(column, units)} {low:.3g} to {with_unit(format(high, '.3g'), units[column])}"

    parts = [span("q"), f"speed up to {found['speed']:.3g} {units['q']}/s"]
    if units["current"] != NO_INPUT and any(found["current"]):
        parts.append(span("current"))
    if found["seconds"]:
        parts.append(f"{found['trajectories']} runs, {found['seconds']:.0f} s")
    return ", ".join(parts)


def not_known(device: Device) -> str:
    """Numbers that nobody stated of the device, as its mass; a coil is named where the control input is electric."""
    electric = device.model.units["current"] in ("A", "V")
    return ", ".join(name for name in device.model.not_known if electric or name == "mass")


def facts(device: Device) -> list[tuple[str, str]]:
    """All but the numbers, one entry each."""
    m, stated = device.measured, device.stated
    found = [
        ("law", device.law),
        ("holds for", range_text(device)),
        ("error on unseen runs", f"{device.error}; {m['held_out']['how']}"),
        *(("also predicted", text) for text in m["predicted"]),
        ("unexplained", m["unexplained"]),
        *(("fault of the recording", text) for text in m["faults"]),
        ("not known", not_known(device)),
        ("in a robot", "yes: --model " + device.name if device.joint else _no_joint(device)),
        ("source", f"{stated['origin']}; {stated['address']}; licence {stated['licence']}"),
        ("recorded", f"{stated['recorded']}. Columns: {stated['columns']}"),
        ("made by", "; ".join(m["commands"])),
    ]
    return [(name, text) for name, text in found if text]


def _no_joint(device: Device) -> str:
    theirs = ", ".join(device.model.units.values())
    return f"no: its numbers are in {theirs}, a robot's joint takes {', '.join(JOINT_UNITS.values())}"


def lines(device: Device) -> list[str]:
    """Everything about a device as text."""
    found = [f"{device.name}: {device.stated['title']} ({device.stated['kind']})", ""]
    for name, text in facts(device):
        found += textwrap.wrap(f"{name:20s} {text}", _WIDTH, subsequent_indent=" " * 21)
    return found
