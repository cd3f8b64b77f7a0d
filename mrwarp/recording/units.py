"""Units of recorded columns: what ``units.json`` declares, and the factors to the units that are kept."""

from __future__ import annotations

import difflib
import json
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.options.json_file import JsonFileError, read_json_file
from mrwarp.recording.data import DEGREES, NO_INPUT, UNITS, RecordingError

_RAD, _TURN, _NM = 1.0 / DEGREES, 2.0 * np.pi, "N·m"
_KGF, _LBF, _INCH = 9.80665, 4.4482216152605, 0.0254
"""A kilogram's and a pound's weight [N] and an inch [m], as they are defined."""
CONVERSIONS: dict[str, dict[str, tuple[float, str]]] = {
    "t": {"s": (1.0, "s"), "ms": (1e-3, "s"), **dict.fromkeys(("us", "µs", "μs"), (1e-6, "s")), "ns": (1e-9, "s")},
    "q": {
        "rad": (1.0, "rad"),
        **dict.fromkeys(("deg", "degree", "degrees", "°"), (_RAD, "rad")),
        **dict.fromkeys(("rev", "revs", "turn", "turns"), (_TURN, "rad")),
        **{"mrad": (1e-3, "rad"), "m": (1.0, "m"), "mm": (1e-3, "m")},
    },
    "qd": {
        "rad/s": (1.0, "rad/s"),
        **dict.fromkeys(("deg/s", "°/s"), (_RAD, "rad/s")),
        **dict.fromkeys(("rev/s", "revs/s", "turn/s", "turns/s"), (_TURN, "rad/s")),
        **{"mrad/s": (1e-3, "rad/s"), "rpm": (_TURN / 60.0, "rad/s"), "m/s": (1.0, "m/s"), "mm/s": (1e-3, "m/s")},
    },
    # any other unit of the control input is carried by its name
    "current": {
        **{"A": (1.0, "A"), "mA": (1e-3, "A"), "V": (1.0, "V"), "mV": (1e-3, "V"), "kV": (1e3, "V")},
        **dict.fromkeys(("uA", "µA", "μA"), (1e-6, "A")),
    },
    "torque": {
        **dict.fromkeys(("N·m", "Nm", "N*m", "N.m", "N m"), (1.0, _NM)),
        **dict.fromkeys(("mN·m", "mNm", "mN*m"), (1e-3, _NM)),
        **dict.fromkeys(("N·cm", "Ncm", "N*cm"), (1e-2, _NM)),
        **dict.fromkeys(("kN·m", "kNm"), (1e3, _NM)),
        **{"kgf·cm": (1e-2 * _KGF, _NM), "lbf·ft": (12.0 * _INCH * _LBF, _NM)},  # servos' and spanners' units
        **{"lbf·in": (_INCH * _LBF, _NM), "ozf·in": (_INCH * _LBF / 16.0, _NM)},
        **{"N": (1.0, "N"), "mN": (1e-3, "N"), "kN": (1e3, "N")},
        **{"A": (1.0, "A"), "mA": (1e-3, "A"), "V": (1.0, "V")},  # a drive's own estimate: carried, not converted
    },
    "temperature": dict.fromkeys(("degC", "°C", "C", "K"), (1.0, "degC")),
}
"""Unit as declared to its factor and the unit that is kept."""

MAX_UNIT = 20
"""Longest unit [characters]; units stand in messages, pictures and model files."""

_SCALED = '{"scale": {"torque": -1}}'

PER = {"counts_per_revolution": (2.0 * np.pi, "rad"), "counts_per_metre": (1.0, "m")}
"""Entries of units.json that say how large an encoder's counts are: what that many counts are, and its unit."""

_COUNTS = re.compile(r"(?:counts?|ticks?)(?:\s*/\s*(\d+(?:\.\d+)?))?")
"""``counts``, or ``counts/4096`` with the counts of a revolution."""

_CONTROL = ("A", "mA", "uA", "V", "mV", "kV", "bar", "mbar", "Pa", "hPa", "kPa", "MPa", "psi", "N", "N·m", NO_INPUT)
"""Units of a control input that the program knows; any other is one of its own, unless it is nearly one of these."""

_OWN = ("barg", "bara", "psig", "psia", "mN", "kN", "mN·m", "kN·m", "mbarg")
"""Units of a control input that are near those and are meant."""

_SPELT = {
    "A": ("amp", "amps", "ampere", "amperes", "arms"),
    "mA": ("mamp", "mamps", "milliamp", "milliamps", "milliampere", "milliamperes"),
    "uA": ("uamp", "uamps", "microamp", "microamps", "microampere", "microamperes"),
    "V": ("volt", "volts"),
    "mV": ("mvolt", "mvolts", "millivolt", "millivolts"),
    "kV": ("kvolt", "kvolts", "kilovolt", "kilovolts"),
    "bar": ("bars",),
    "kPa": ("kilopascal",),
    "MPa": ("megapascal",),
    "psi": (),
    NO_INPUT: (),
    _NM: ("nm", "n*m", "n.m", "n m", "newton metre", "newton metres", "newton meter", "newton meters"),
    "N": ("newton", "newtons"),
    "mN·m": ("millinewton metre", "millinewton metres"),
    "kgf·cm": ("kgf*cm", "kgf.cm", "kgfcm", "kg·cm", "kg*cm", "kg.cm", "kgcm", "kg-cm", "kg cm"),
    "lbf·ft": ("lbf*ft", "lbf ft", "lb·ft", "lb-ft", "lb ft", "ft·lb", "ft-lb", "ft lb", "ft·lbf", "ft-lbf"),
    "lbf·in": ("lbf*in", "lbf in", "lb·in", "lb-in", "lb in", "in·lb", "in-lb", "in lb", "in·lbf", "in-lbf"),
    "ozf·in": ("ozf*in", "ozf in", "oz·in", "oz-in", "oz in", "in·oz", "in-oz", "in oz"),
    "rad": ("radian", "radians"),
    "rev": ("revolution", "revolutions"),
    "deg": ("degs",),
    "deg/s": ("deg/sec", "degrees/s", "degree/s", "dps"),
    "rpm": ("rev/min", "1/min"),
    "rev/s": ("rps", "revolutions/s"),
    "rad/s": ("rad/sec", "radians/s"),
    "s": ("sec", "second", "seconds"),
    "ms": ("msec", "millisecond", "milliseconds"),
    "us": ("usec", "microsecond", "microseconds"),
    "mm": ("millimetre", "millimetres", "millimeter", "millimeters"),
    "m": ("metre", "metres", "meter", "meters"),
    "degC": ("celsius",),
    "K": ("kelvin",),
}
"""Other spellings of units."""

_APART = re.compile(r"[\s_\[\](){}]+")
"""Between a unit and what else stands with it: ``[mA]``, ``A rms``, ``mA_cmd``."""

_NEAR = 0.8
"""Least similarity (difflib's ratio) of two spellings of a unit: ``miliamp`` has 0.93, ``steps`` and ``amps`` 0.44."""


@dataclass(frozen=True)
class Units:
    """Declarations of ``units.json``, completed."""

    declared: dict[str, str]
    given: frozenset[str] = frozenset()
    """Columns whose unit the file names; all where their values are trusted."""
    trusted: bool = False
    """Columns are not compared with each other, either."""
    count: tuple[float, str] | None = None
    """Angle or displacement of one encoder count, and its unit."""
    scale: Mapping[str, float] = field(default_factory=dict)
    """Factors by which the values of columns are multiplied, in the unit that is kept."""
    names: Mapping[str, str] = field(default_factory=dict)
    """Column that each quantity stands in, where the file calls it otherwise."""
    path: Path = Path("units.json")
    """File of the declarations, for messages."""
    stated: Mapping[str, Any] = field(default_factory=dict)
    """Its content, as it stands."""

    def declaring(self, more: Mapping[str, Any]) -> Units:
        """The units with further declarations; a scale is added to those that are there.

        Raises:
            RecordingError: they do not go together.
        """
        return units_of(self.path, self.content(more))

    def content(self, more: Mapping[str, Any]) -> dict[str, Any]:
        """Content of a ``units.json`` with further declarations."""
        found = {**self.stated, **more}
        if "scale" in more:
            found["scale"] = {**dict(self.stated.get("scale", {})), **more["scale"]}
        return found

    def _conversion(self, key: str) -> tuple[float, str]:
        unit = self.declared[key]
        if self.count and unit in ("counts", "counts/s"):
            return self.count[0], self.count[1] + unit.removeprefix("counts")
        return CONVERSIONS[key].get(unit, (1.0, unit))

    def base(self, key: str) -> str:
        """Unit that the values have after :meth:`convert`."""
        return self._conversion(key)[1]

    def convert(self, key: str, values: np.ndarray) -> np.ndarray:
        """Values in the unit that is kept."""
        if self.declared[key] == "K":
            return values - 273.15
        return values * (self._conversion(key)[0] * self.scale.get(key, 1.0))

    def periods(self) -> list[float]:
        """Lengths after which a reading of ``q`` may begin again: a turn, and what a counter of 16 or 32 bits holds."""
        turn = [2.0 * np.pi] if self.base("q") == "rad" else []
        counter = (
            [self.count[0] * 2.0**bits for bits in (16, 32)] if self.count and self.declared["q"] == "counts" else []
        )
        return turn + counter


def read_units(folder: Path, file: Path | None = None) -> Units:
    """The units of a folder's recordings.

    Args:
        folder: Where ``units.json`` may lie.
        file: Declarations that stand in its place; None: none do.

    Raises:
        RecordingError: ``units.json`` is refused; the message names the entry and what may stand there.
    """
    path = file or folder / "units.json"
    declared: Any = {}
    if path.is_file():
        try:
            declared = read_json_file(path, "repair or remove it")
        except JsonFileError as error:
            raise RecordingError(str(error)) from None
        if not isinstance(declared, dict):
            raise RecordingError(f'{path}: must hold one object, e.g. {{"q": "deg", "current": "mA"}}')
    elif file is not None:
        raise RecordingError(f"{file}: there is no such file; name a JSON file that declares units and columns")
    return units_of(path, declared)


def units_of(path: Path, content: Mapping[str, Any]) -> Units:
    """The units that declarations state; ``path`` is their file, for messages.

    Raises:
        RecordingError: an entry is refused; the message names it and what may stand there.
    """
    declared = dict(content)
    trusted = declared.pop("trust_units", False)
    if not isinstance(trusted, bool):
        raise RecordingError(f"{path}: trust_units = {trusted!r} must be true or false")
    scale, names = _scale(path, declared.pop("scale", {})), _names(path, declared.pop("columns", {}))
    count = _count(path, declared)
    for key, unit in declared.items():
        if key not in CONVERSIONS:
            takes = [name for name, known in CONVERSIONS.items() if isinstance(unit, str) and unit in known]
            remedy = f"; write {json.dumps({'columns': {takes[0]: key}, takes[0]: unit})}" if takes else ""
            raise RecordingError(f"{path}: there is no column {key!r}; known: {', '.join(CONVERSIONS)}{remedy}")
        if key in ("q", "qd") and count and unit == ("counts" if key == "q" else "counts/s"):
            continue
        declared[key] = _known_unit(path, key, unit, trusted)
    given = frozenset(UNITS if trusted else declared)
    if "q" in declared and "qd" not in declared:
        declared["qd"] = ("deg" if declared["q"] in ("degree", "degrees") else declared["q"]) + "/s"
    if "qd" in declared and "q" not in declared and Units(declared, count=count).base("qd") == "m/s":
        declared["q"] = "m"
    result = Units({**UNITS, **declared}, given, trusted, count, scale, names, path, dict(content))
    linear = result.base("q") == "m"
    for key, *wanted in (("qd", "m/s" if linear else "rad/s"), ("torque", "N" if linear else "N·m", "A", "V")):
        if result.base(key) not in wanted:
            units = result.declared
            raise RecordingError(
                f"{path}: q in {units['q']} does not go with {key} in {units[key]}; declare {key} in {wanted[0]}"
            )
    return result


def _scale(path: Path, found: Any) -> dict[str, float]:
    """Factors of columns, checked."""
    for key, factor in found.items() if isinstance(found, dict) else ():
        number = isinstance(factor, int | float) and not isinstance(factor, bool) and math.isfinite(factor)
        if key not in CONVERSIONS or not number or not factor:
            raise RecordingError(f"{path}: scale of {key!r} = {factor!r}: write a column and a number, e.g. {_SCALED}")
    if not isinstance(found, dict):
        raise RecordingError(f"{path}: scale must be an object of columns and their factors, e.g. {_SCALED}")
    return {key: float(factor) for key, factor in found.items()}


def _names(path: Path, found: Any) -> dict[str, str]:
    """Names of columns in the file, checked."""
    allowed = (*CONVERSIONS, "trajectory")
    if not isinstance(found, dict) or not all(k in allowed and isinstance(v, str) and v for k, v in found.items()):
        raise RecordingError(
            f"{path}: columns = {json.dumps(found)[:60]} must name the file's column of {', '.join(allowed[:5])} ...; "
            'e.g. {"columns": {"q": "pos", "torque": "tau"}}'
        )
    return dict(found)


def _known_unit(path: Path, key: str, unit: Any, trusted: bool) -> str:
    """A declared unit; one that is not known is refused, of the control input where it is nearly a known one."""
    known = CONVERSIONS[key]
    if isinstance(unit, str) and unit in known:
        return unit
    near = _near(unit, _CONTROL if key == "current" else known) if isinstance(unit, str) else []
    meant = f": did you mean {' or '.join(near)}?" if near else ""
    if key == "current" and isinstance(unit, str) and unit.isprintable() and len(unit) <= MAX_UNIT:
        if not near or trusted:
            return unit.strip() or "1"
        raise RecordingError(
            f'{path}: the unit {unit!r} of current{meant} Declare {{"current": "{near[0]}"}}; where {unit!r} is a unit '
            'of its own, add "trust_units": true'
        )
    names = ", ".join(known) + (f", or any text of at most {MAX_UNIT} characters" if key == "current" else "")
    if key in ("q", "qd"):
        names += f', or {"counts" if key == "q" else "counts/s"} with "{next(iter(PER))}"'
    raise RecordingError(f"{path}: the unit {unit!r} of {key} is not known{meant or ';'} use one of {names}")


def _near(unit: str, known: Collection[str]) -> list[str]:
    """Known units that a text nearly is or begins with, nearest first; none for one that is meant as it stands."""
    text = unit.strip()
    if text in known or text in _OWN:
        return []
    first = next(filter(None, _APART.split(text)), "")
    text = text.casefold()
    spelt = {name: (name.casefold(), *_SPELT.get(name, ())) for name in known}
    exact = [name for name, texts in spelt.items() if text in texts] or [name for name in known if name == first]
    near = difflib.get_close_matches(text, [each for texts in spelt.values() for each in texts], n=3, cutoff=_NEAR)
    return exact or [name for name, texts in spelt.items() if near and near[0] in texts]


def _count(path: Path, declared: dict[str, Any]) -> tuple[float, str] | None:
    """Size of an encoder's count and its unit; its entries are taken out of what is declared.

    Raises:
        RecordingError: counts whose size is not declared, or a size that is no number above 0.
    """
    sizes = {key: declared.pop(key) for key in PER if key in declared}
    for key in ("q", "qd"):
        unit = declared.get(key)
        found = _COUNTS.fullmatch(unit.strip().removesuffix("/s").strip().lower()) if isinstance(unit, str) else None
        if found:
            declared[key] = "counts" if key == "q" else "counts/s"
            if found[1]:
                sizes.setdefault("counts_per_revolution", float(found[1]))
    if sizes and not {"q", "qd"} & set(declared):
        declared["q"] = "counts"
    named = next((key for key in ("q", "qd") if str(declared.get(key)).startswith("counts")), None)
    if not named and not sizes:
        return None
    example = '{"q": "counts", "counts_per_revolution": 4096}'
    if not named or len(sizes) > 1:
        raise RecordingError(f"{path}: {', '.join(sizes)} do not go with these units; declare {example}")
    if not sizes:
        raise RecordingError(
            f"{path}: {named} is in counts: how many are there in one revolution of the joint? Declare {example} (four "
            "for each line of a quadrature encoder, times the gear's ratio where the encoder is on the motor; of a "
            'linear scale "counts_per_metre")'
        )
    ((key, number),) = sizes.items()
    if isinstance(number, bool) or not isinstance(number, int | float) or not math.isfinite(number) or number <= 0:
        raise RecordingError(f"{path}: {key} = {number!r} must be a number above 0, e.g. {example}")
    whole, unit = PER[key]
    return whole / number, unit
