"""Units of a recording: what ``units.json`` declares, and how it is converted."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.recording.data import UNITS, RecordingError

DEGREES = 180.0 / np.pi
"""Degrees in a radian."""

_CONVERSIONS: dict[str, dict[str, tuple[float, str]]] = {
    "t": {"s": (1.0, "s"), "ms": (1e-3, "s"), "us": (1e-6, "s"), "µs": (1e-6, "s")},
    "q": {
        "rad": (1.0, "rad"), "deg": (1.0 / DEGREES, "rad"), "degree": (1.0 / DEGREES, "rad"),
        "degrees": (1.0 / DEGREES, "rad"), "°": (1.0 / DEGREES, "rad"), "mrad": (1e-3, "rad"),
        "m": (1.0, "m"), "mm": (1e-3, "m"),
    },
    "qd": {
        "rad/s": (1.0, "rad/s"), "deg/s": (1.0 / DEGREES, "rad/s"), "°/s": (1.0 / DEGREES, "rad/s"),
        "mrad/s": (1e-3, "rad/s"), "rpm": (2.0 * np.pi / 60.0, "rad/s"), "m/s": (1.0, "m/s"), "mm/s": (1e-3, "m/s"),
    },
    "current": {"A": (1.0, "A"), "mA": (1e-3, "A"), "V": (1.0, "V"), "mV": (1e-3, "V")},
    "torque": {
        "N·m": (1.0, "N·m"), "Nm": (1.0, "N·m"), "N*m": (1.0, "N·m"), "N.m": (1.0, "N·m"), "N m": (1.0, "N·m"),
        "mN·m": (1e-3, "N·m"), "mNm": (1e-3, "N·m"), "mN*m": (1e-3, "N·m"), "kN·m": (1e3, "N·m"),
        "kNm": (1e3, "N·m"), "N": (1.0, "N"), "mN": (1e-3, "N"), "kN": (1e3, "N"),
    },
    "temperature": {"degC": (1.0, "degC"), "°C": (1.0, "degC"), "C": (1.0, "degC"), "K": (1.0, "degC")},
}  # fmt: skip
"""Unit as declared to its factor and the unit that is kept."""


@dataclass(frozen=True)
class Units:
    """What ``units.json`` declares, completed."""

    declared: dict[str, str]
    trusted: bool = False
    """Values are not compared with what is plausible."""

    def base(self, key: str) -> str:
        """Unit that the values have after :meth:`convert`."""
        return _CONVERSIONS[key][self.declared[key]][1]

    def convert(self, key: str, values: np.ndarray) -> np.ndarray:
        """Values in the unit that is kept."""
        factor = _CONVERSIONS[key][self.declared[key]][0]
        if self.declared[key] == "K":
            return values - 273.15
        return values if factor == 1.0 else values * factor


def read_units(folder: Path) -> Units:
    """The units of a folder's recordings."""
    path = folder / "units.json"
    declared: dict[str, Any] = {}
    if path.is_file():
        try:
            declared = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise RecordingError(f"{path}: not readable as JSON ({error}); repair or remove it") from None
        if not isinstance(declared, dict):
            raise RecordingError(f'{path}: must hold one object, e.g. {{"q": "deg", "current": "mA"}}')
    trusted = declared.pop("trust_units", False)
    if not isinstance(trusted, bool):
        raise RecordingError(f"{path}: trust_units = {trusted!r} must be true or false")
    units = dict(UNITS)
    for key, unit in declared.items():
        if key not in _CONVERSIONS:
            raise RecordingError(f"{path}: there is no column {key!r}; known: {', '.join(_CONVERSIONS)}")
        if not isinstance(unit, str) or unit not in _CONVERSIONS[key]:
            known = ", ".join(_CONVERSIONS[key])
            raise RecordingError(f"{path}: the unit {unit!r} of {key} is not known; use one of {known}")
        units[key] = unit
    if "q" in declared and "qd" not in declared:
        units["qd"] = {"degree": "deg", "degrees": "deg"}.get(units["q"], units["q"]) + "/s"
    result = Units(units, trusted)
    linear = result.base("q") == "m"
    for key, wanted in (("qd", "m/s" if linear else "rad/s"), ("torque", "N" if linear else "N·m")):
        if result.base(key) != wanted:
            raise RecordingError(
                f"{path}: q in {units['q']} does not go with {key} in {units[key]}; declare {key} in {wanted}"
            )
    return result
