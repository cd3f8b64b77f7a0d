"""``model.json``: an identified joint with units, intervals and origin; what ``fit`` writes, simulator and USD load.

The file is data only. Its angle is about the bench's own zero, so ``q_neutral``, which says where the joint stands in a
robot, is no part of it: that, and the groups a bench does not identify (gate, motor), come from the robot.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrwarp.params import MrParams, ParameterError

if TYPE_CHECKING:
    from pxr import Usd

SCHEMA = 1
"""Version of the file's layout."""

MAX_BYTES = 2**20
"""Largest model file that is read [bytes]."""

JOINT_UNITS = {"q": "rad", "current": "A", "torque": "N·m"}
"""Units of a model that the simulator can run."""

_KEYS = ("schema", "units", "parameters", "effects", "fitted_on", "seed", "versions")
_NAMES = tuple(spec.name for spec in MrParams.specs() if spec.name != "q_neutral")
_REQUIRED = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma")


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
    """A named mechanism beyond eqs. 14 and 15 with its parameters."""

    name: str
    parameters: Mapping[str, float]


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
        """Author the joint on an MR actuator prim; what the model does not hold stays as it is there.

        Raises:
            AssetError: the prim is not an MR actuator.
            ModelFileError: as :meth:`to_params`.
        """
        from mrwarp.asset import read_parameters, write_parameters

        write_parameters(prim, self.to_params(read_parameters(prim)))


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
    path = Path(path)
    content = {"schema": SCHEMA, **dataclasses.asdict(model)}
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".part")
    partial.write_text(json.dumps(content, indent=2, allow_nan=False, ensure_ascii=False) + "\n", encoding="utf-8")
    os.replace(partial, path)
    return path


def load_model(path: str | Path) -> Model:
    """Read and check a model file.

    Raises:
        ModelFileError: the file is missing, too large, not JSON, of another schema, or one of its entries is unusable.
    """
    path = Path(path)
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ModelFileError(f"{path}: {path.stat().st_size} bytes; a model file has at most {MAX_BYTES}")
        content = json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=_unique)
    except OSError as error:
        raise ModelFileError(f"{path}: {error.strerror}; give the model.json that 'mrwarp fit' wrote") from None
    except ModelFileError as error:
        raise error if str(error).startswith(str(path)) else ModelFileError(f"{path}: {error}") from None
    except (ValueError, RecursionError) as error:
        raise ModelFileError(f"{path}: not JSON: {error}; give the model.json that 'mrwarp fit' wrote") from None
    if not isinstance(content, dict) or content.get("schema") != SCHEMA:
        found = content.get("schema") if isinstance(content, dict) else type(content).__name__
        raise ModelFileError(f"{path}: schema = {found!r}; allowed: {SCHEMA}; run 'mrwarp fit' again")
    _same_keys(content, _KEYS, f"{path}")
    units = _mapping(content["units"], f"{path}: units")
    _same_keys(units, tuple(JOINT_UNITS), f"{path}: units")
    parameters = _mapping(content["parameters"], f"{path}: parameters")
    missing = [name for name in _REQUIRED if name not in parameters]
    if missing:
        raise ModelFileError(f"{path}: parameters.{missing[0]} is missing; needed: {', '.join(_REQUIRED)}")
    effects = content["effects"]
    if not isinstance(effects, list):
        raise ModelFileError(f"{path}: effects = {effects!r}; allowed: a list of {{name, parameters}}")
    return Model(
        parameters={name: _parameter(name, entry, units, path) for name, entry in parameters.items()},
        fitted_on=_fitted_on(content["fitted_on"], f"{path}: fitted_on"),
        units={key: str(value) for key, value in units.items()},
        effects=tuple(_effect(entry, f"{path}: effects[{i}]") for i, entry in enumerate(effects)),
        seed=int(_number(content["seed"], f"{path}: seed")),
        versions={str(k): str(v) for k, v in _mapping(content["versions"], f"{path}: versions").items()},
    )


def _parameter(name: str, entry: Any, units: Mapping[str, str], path: Path) -> Parameter:
    """One checked entry of ``parameters``."""
    where = f"{path}: parameters.{name}"
    if name not in _NAMES:
        raise ModelFileError(f"{where}: there is no such parameter; known: {', '.join(_NAMES)}")
    _same_keys(_mapping(entry, where), ("value", "unit", "ci95"), where)
    value, unit = _number(entry["value"], f"{where}.value"), parameter_unit(name, units)
    if entry["unit"] != unit:
        raise ModelFileError(f"{where}.unit = {entry['unit']!r}; allowed: {unit!r}; convert the value, then the unit")
    if dict(units) == JOINT_UNITS:
        try:
            MrParams.spec(name).check(value, f"{where}.value")
        except ParameterError as error:
            raise ModelFileError(str(error)) from None
    ci95 = entry["ci95"]
    if ci95 is not None:
        if not isinstance(ci95, list) or len(ci95) != 2:
            raise ModelFileError(f"{where}.ci95 = {ci95!r}; allowed: [low, high] or null")
        ci95 = (_number(ci95[0], f"{where}.ci95[0]"), _number(ci95[1], f"{where}.ci95[1]"))
        if not ci95[0] <= value <= ci95[1]:
            raise ModelFileError(f"{where}.ci95 = {list(ci95)} leaves out the value {value:g}; correct either")
    return Parameter(value=value, unit=unit, ci95=ci95)


def _effect(entry: Any, where: str) -> Effect:
    _same_keys(_mapping(entry, where), ("name", "parameters"), where)
    if not isinstance(entry["name"], str) or not entry["name"]:
        raise ModelFileError(f"{where}.name = {entry['name']!r}; allowed: the name of an effect")
    parameters = _mapping(entry["parameters"], f"{where}.parameters")
    return Effect(
        name=entry["name"], parameters={k: _number(v, f"{where}.parameters.{k}") for k, v in parameters.items()}
    )


def _fitted_on(entry: Any, where: str) -> FittedOn:
    _same_keys(_mapping(entry, where), tuple(f.name for f in dataclasses.fields(FittedOn)), where)
    numbers = {key: _number(entry[key], f"{where}.{key}") for key in ("trajectories", "samples", "rate")}
    return FittedOn(
        source=str(entry["source"]), trajectories=int(numbers["trajectories"]), samples=int(numbers["samples"]),
        rate=numbers["rate"],
    )  # fmt: skip


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ModelFileError(f"{where} = {value!r}; allowed: a finite number")
    return float(value)


def _mapping(value: Any, where: str) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ModelFileError(f"{where} = {value!r}; allowed: an object {{...}}")
    return value


def _same_keys(content: dict[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in keys:
        if key not in content:
            raise ModelFileError(f"{where}: {key} is missing; needed: {', '.join(keys)}")
    for key in content:
        if key not in keys:
            raise ModelFileError(f"{where}: there is no key {key!r}; known: {', '.join(keys)}; remove it")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object whose keys stand once each."""
    content = dict(pairs)
    if len(content) != len(pairs):
        twice = next(key for key, _ in pairs if sum(k == key for k, _ in pairs) > 1)
        raise ModelFileError(f"{twice} stands twice in one object; remove one")
    return content
