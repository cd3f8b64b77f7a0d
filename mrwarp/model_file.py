"""``model.json``: an identified joint with units, intervals and origin; what ``fit`` writes, simulator and USD load.

The file is data only. Its angle is about the bench's own zero, so ``q_neutral``, which says where the joint stands in a
robot, is no part of it: that, and the groups a bench does not identify (gate, motor), come from the robot.

An MR prim of a USD asset carries all that the file holds, see :mod:`mrwarp.usd.record`.
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import reprlib
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrwarp.params import MrParams, ParameterError
from mrwarp.run_dir import write_text

if TYPE_CHECKING:
    from pxr import Usd

SCHEMA = 1
"""Version of the file's layout."""

MAX_BYTES = 2**20
"""Largest model file that is read [bytes]."""

JOINT_UNITS = {"q": "rad", "current": "A", "torque": "N·m"}
"""Units of a model that the simulator can run."""

_LONGEST_UNIT = 20
"""Characters of a unit; others stand in messages about parameters."""
_KEYS = ("schema", "units", "parameters", "effects", "fitted_on", "seed", "versions")
_NAMES = tuple(spec.name for spec in MrParams.specs() if spec.name != "q_neutral")
_REQUIRED = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma")
_REMEDY = "give the model.json that 'mrwarp fit' wrote"

_LARGEST = sys.float_info.max
_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother, _SHORT.maxlong = 3, 80, 80, 80


class ModelFileError(ValueError):
    """A model file was refused; the message names path, key, value, what is allowed and the remedy."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One value with its unit and, if it was fitted, its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float] | None = None


@dataclass(frozen=True, kw_only=True)
class Effect:
    """A named mechanism beyond eqs. 14 and 15 with its parameters; which act: :mod:`mrwarp.actuator.device_effects`."""

    name: str
    parameters: Mapping[str, Parameter]

    @property
    def values(self) -> dict[str, float]:
        """The parameters as plain numbers."""
        return {name: p.value for name, p in self.parameters.items()}


@dataclass(frozen=True, kw_only=True)
class FittedOn:
    """Where a model comes from."""

    source: str
    trajectories: int
    samples: int
    rate: float
    """Sampling rate [1/s]."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """An identified joint, or a device in other units."""

    parameters: Mapping[str, Parameter]
    fitted_on: FittedOn
    units: Mapping[str, str] = field(default_factory=lambda: dict(JOINT_UNITS))
    effects: tuple[Effect, ...] = ()
    seed: int = 0
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        """The parameters as plain numbers."""
        return {name: p.value for name, p in self.parameters.items()}

    def to_params(self, base: MrParams | None = None) -> MrParams:
        """The joint for the simulator.

        Args:
            base: Gives what the model does not hold (``q_neutral``, gates, motor); None: the paper's.

        Raises:
            ModelFileError: the model is not in rad, A and N·m, or a value is out of range.
        """
        if dict(self.units) != JOINT_UNITS:
            raise ModelFileError(
                f"units = {dict(self.units)}: the simulator's joints are in {JOINT_UNITS}; "
                "fit a recording in these units, converted by the lever of the device"
            )
        try:
            return (base or MrParams()).replace(**self.values)
        except ParameterError as error:
            raise ModelFileError(str(error)) from None

    def write_usd(self, prim: Usd.Prim) -> None:
        """Author the joint and its record on an MR actuator prim; what the model does not hold stays as it is there.

        Raises:
            AssetError: the prim is not an MR actuator.
            ModelFileError: as :meth:`to_params`.
        """
        from mrwarp.usd.asset import read_parameters, write_parameters
        from mrwarp.usd.record import write_record

        params = self.to_params(read_parameters(prim))
        write_parameters(prim, params)
        write_record(prim, self, params)

    @staticmethod
    def read_usd(prim: Usd.Prim) -> Model:
        """The model that an MR actuator prim holds; what :meth:`write_usd` wrote, to the last bit.

        A number that was changed since has no interval; without a record the prim's bare numbers are the model.

        Raises:
            AssetError: the prim is not an MR actuator, or an attribute of it is unusable.
        """
        from mrwarp.usd.record import read_model

        return read_model(prim).model


def parameter_unit(name: str, units: Mapping[str, str]) -> str:
    """Unit of a parameter for a device in ``units``: that of ``mrwarp.params`` with rad, A and N·m exchanged."""
    unit = MrParams.spec(name).unit
    for plain, key in (("rad", "q"), ("A", "current"), ("N·m", "torque")):
        unit = unit.replace(plain, f"<{key}>")
    for key in ("q", "current", "torque"):
        unit = unit.replace(f"<{key}>", units[key])
    return unit


def save_model(model: Model, path: str | Path) -> Path:
    """Write a model in one piece; every number is stored without loss."""
    text = json.dumps(model_to_dict(model), indent=2, allow_nan=False, ensure_ascii=False)
    return write_text(Path(path), text + "\n")


def load_model(path: str | Path) -> Model:
    """Read and check a model file.

    Raises:
        ModelFileError: the file is missing, too large, not JSON, of another schema, or one of its entries is unusable.
    """
    path = Path(path)
    with contextlib.suppress(OSError):  # told when it is read
        if path.stat().st_size > MAX_BYTES:
            raise ModelFileError(f"{path}: {path.stat().st_size} bytes; a model file has at most {MAX_BYTES}")
    return model_from_dict(read_json_file(path), str(path))


def model_to_dict(model: Model) -> dict[str, Any]:
    """The content of a model file: objects, lists, texts and numbers as JSON has them."""
    return _as_json({"schema": SCHEMA, **dataclasses.asdict(model)})


def model_from_dict(content: Any, where: str = "model") -> Model:
    """Check the content of a model file, as JSON gives it; the inverse of :func:`model_to_dict`.

    Args:
        content: What the file holds.
        where: Its place, at the front of every message.

    Raises:
        ModelFileError: it is of another schema, or one of its entries is unusable.
    """
    if not isinstance(content, dict):
        raise ModelFileError(f"{where}: holds {shown(content)}; allowed: an object {{...}}; {_REMEDY}")
    if content.get("schema") != SCHEMA:
        found = shown(content.get("schema"))
        raise ModelFileError(f"{where}: schema = {found}; allowed: {SCHEMA}; run 'mrwarp fit' again")
    checked_object(content, where, _KEYS)
    units = _texts(checked_object(content["units"], f"{where}: units", tuple(JOINT_UNITS)), f"{where}: units")
    for key, unit in units.items():
        if not unit.isprintable() or len(unit) > _LONGEST_UNIT:
            raise ModelFileError(
                f"{where}: units.{key} = {shown(unit)}; allowed: a unit of at most {_LONGEST_UNIT} characters"
            )
    parameters = _mapping(content["parameters"], f"{where}: parameters")
    missing = [name for name in _REQUIRED if name not in parameters]
    if missing:
        raise ModelFileError(f"{where}: parameters.{missing[0]} is missing; needed: {', '.join(_REQUIRED)}")
    effects = content["effects"]
    if not isinstance(effects, list):
        raise ModelFileError(f"{where}: effects = {shown(effects)}; allowed: a list of {{name, parameters}}")
    if effects:
        from mrwarp.effects.model_entries import read_effects

        effects = read_effects(effects, units, f"{where}: effects")
    return Model(
        parameters={name: _parameter(name, entry, units, where) for name, entry in parameters.items()},
        fitted_on=_fitted_on(content["fitted_on"], f"{where}: fitted_on"),
        units=units,
        effects=tuple(effects),
        seed=_whole(content["seed"], f"{where}: seed"),
        versions=_texts(content["versions"], f"{where}: versions"),
    )


def read_json_file(path: Path, remedy: str = _REMEDY) -> Any:
    """What a JSON file holds.

    Raises:
        ModelFileError: it cannot be read, is not JSON, or a key stands twice in one object.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ModelFileError(f"{path}: not JSON: {error}; {remedy}") from None
    except OSError as error:
        raise ModelFileError(f"{path}: {error.strerror}; {remedy}") from None
    return read_json(text, str(path), remedy)


def read_json(text: str, where: str, remedy: str = _REMEDY) -> Any:
    """What a JSON text holds.

    Raises:
        ModelFileError: it is not JSON, or a key stands twice in one object.
    """
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except ModelFileError as error:
        raise ModelFileError(f"{where}: {error}") from None
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{where}: not JSON: {error}; {remedy}") from None


def shown(value: Any) -> str:
    """A value of a file for a message: as Python writes it, on one line, shortened."""
    found = _SHORT.repr(value)
    return found if len(found) <= _SHORT.maxstring else found[: _SHORT.maxstring - 3] + "..."


def key_shown(name: str) -> str:
    """A key of a file for a message: as it is, unless it is long or cannot be printed."""
    return name if name.isprintable() and len(name) <= _SHORT.maxstring else shown(name)


def _as_json(value: Any) -> Any:
    """The same with lists for tuples."""
    if isinstance(value, dict):
        return {key: _as_json(item) for key, item in value.items()}
    return [_as_json(item) for item in value] if isinstance(value, list | tuple) else value


def _parameter(name: str, entry: Any, units: Mapping[str, str], file: str) -> Parameter:
    """One checked entry of ``parameters``."""
    where = f"{file}: parameters.{key_shown(name)}"
    if name not in _NAMES:
        raise ModelFileError(f"{where}: there is no such parameter; known: {', '.join(_NAMES)}")
    checked_object(entry, where, ("value", "unit", "ci95"))
    value, unit = checked_number(entry["value"], f"{where}.value"), parameter_unit(name, units)
    if entry["unit"] != unit:
        raise ModelFileError(
            f"{where}.unit = {shown(entry['unit'])}; allowed: {unit!r}; convert the value, then the unit"
        )
    if dict(units) == JOINT_UNITS:
        try:
            MrParams.spec(name).check(value, f"{where}.value")
        except ParameterError as error:
            raise ModelFileError(str(error)) from None
    return Parameter(value=value, unit=unit, ci95=checked_interval(entry["ci95"], value, f"{where}.ci95"))


def _fitted_on(entry: Any, where: str) -> FittedOn:
    checked_object(entry, where, tuple(f.name for f in dataclasses.fields(FittedOn)))
    return FittedOn(
        source=_text(entry["source"], f"{where}.source"),
        trajectories=_whole(entry["trajectories"], f"{where}.trajectories"),
        samples=_whole(entry["samples"], f"{where}.samples"),
        rate=checked_number(entry["rate"], f"{where}.rate"),
    )


def checked_number(value: Any, where: str) -> float:
    """A finite number of a file, as float.

    Raises:
        ModelFileError: it is none.
    """
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _LARGEST:
        return float(value)
    raise ModelFileError(f"{where} = {shown(value)}; allowed: a finite number")


def checked_interval(ci95: Any, value: float, where: str) -> tuple[float, float] | None:
    """A 95 % interval of a file around a value; None if there is none.

    Raises:
        ModelFileError: it is none, or leaves the value out.
    """
    if ci95 is None:
        return None
    if not isinstance(ci95, list) or len(ci95) != 2:
        raise ModelFileError(f"{where} = {shown(ci95)}; allowed: [low, high] or null")
    low, high = checked_number(ci95[0], f"{where}[0]"), checked_number(ci95[1], f"{where}[1]")
    if not low <= value <= high:
        raise ModelFileError(f"{where} = {[low, high]} leaves out the value {value:g}; correct either")
    return low, high


def _whole(value: Any, where: str) -> int:
    """A whole number; an integer of any length keeps all its digits."""
    checked_number(value, where)
    if value != int(value):
        raise ModelFileError(f"{where} = {shown(value)}; allowed: a whole number")
    return int(value)


def _text(value: Any, where: str) -> str:
    """A text that UTF-8 can write."""
    if not isinstance(value, str) or any("\ud800" <= c <= "\udfff" for c in value):
        raise ModelFileError(f"{where} = {shown(value)}; allowed: a text")
    return value


def _texts(value: Any, where: str) -> dict[str, str]:
    """An object of texts."""
    found = _mapping(value, where)
    return {_text(k, f"{where}: key"): _text(v, f"{where}.{key_shown(k)}") for k, v in found.items()}


def _mapping(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ModelFileError(f"{where} = {shown(value)}; allowed: an object {{...}}")
    return value


def checked_object(value: Any, where: str, keys: tuple[str, ...]) -> dict[str, Any]:
    """A JSON object that has these keys and no others.

    Raises:
        ModelFileError: it is none.
    """
    content = _mapping(value, where)
    for key in keys:
        if key not in content:
            raise ModelFileError(f"{where}: {key} is missing; needed: {', '.join(keys)}")
    for key in content:
        if key not in keys:
            raise ModelFileError(f"{where}: there is no key {shown(key)}; known: {', '.join(keys)}; remove it")
    return content


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object whose keys stand once each."""
    content = dict(pairs)
    if len(content) != len(pairs):
        [(twice, _)] = Counter(key for key, _ in pairs).most_common(1)
        raise ModelFileError(f"{key_shown(twice)} stands twice in one object; remove one")
    return content
