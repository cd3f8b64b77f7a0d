"""``model.json``: an identified joint with units, intervals and origin; what ``fit`` writes, simulator and USD load.

The file is data only. Its angle is about the bench's own zero, so ``q_neutral``, which says where the joint stands in a
robot, is no part of it: that, and the groups a bench does not identify (gate, motor), come from the robot.

An MR prim of a USD asset carries all that the file holds, see :mod:`mrwarp.usd.record`. An effect of the catalogue must
have its parameters, in the units of the device and of a sign that makes sense; any other effect is carried as it is.
"""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Protocol, TypeAlias

from mrwarp.effects.catalogue import CATALOGUE, HYSTERESIS, KNOWN
from mrwarp.effects.law import EffectParameter
from mrwarp.enums import BENCH_PARTS
from mrwarp.options.json_file import (
    JsonFileError,
    checked_interval,
    checked_mapping,
    checked_number,
    checked_object,
    checked_text,
    checked_texts,
    checked_whole,
    key_shown,
    read_json_file,
    shown,
)
from mrwarp.params import CoilParams, HoldParams, MrParams, ParameterError, ParamSpec, with_unit
from mrwarp.resources import model_path, no_model
from mrwarp.run_dir import write_text
from mrwarp.runtime import closest

SCHEMA = 1
"""Version of the file's layout."""

MAX_BYTES = 2**20
"""Largest model file that is read [bytes]."""

HOLDING_NOTE = (
    "warning: no break-away test: the holding torque is assumed equal to the slow sliding torque; "
    "record break-away tests in holding.csv (docs/data.md) and fit again"
)
"""Note on a device without break-away tests."""

JOINT_UNITS = {"q": "rad", "current": "A", "torque": "N·m"}
"""Units of a model that the simulator can run."""

MAX_MASS = 100.0
"""Largest mass of a device [kg]; brakes of cars have less."""

MAX_UNIT = 20
"""Longest unit [characters]; units stand in messages about parameters."""

_KEYS = ("schema", "units", "law", "parameters", "device_mass", "effects", "fitted_on", "seed", "versions")
_NAMES = tuple(spec.name for spec in MrParams.specs() if spec.name != "q_neutral")
_REQUIRED = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma")
_PARAMETER_KEYS = ("value", "unit", "ci95", "source")
_OF_OTHERS = ("q_offset", "q_center", "coil_time_constant", "coil_resistance")
"""Numbers of bench and coil that one device does not have of another: 0 where a model does not hold them."""
_REMEDY = "give the model.json that 'mrwarp fit' wrote"


class ModelFileError(JsonFileError):
    """A model file was refused; the message names path, key, value, what is allowed and the remedy."""


@contextmanager
def _of_a_model() -> Iterator[None]:
    """Entries that are refused are a model's."""
    try:
        yield
    except JsonFileError as error:
        raise ModelFileError(str(error)) from None


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One value with its unit and, if it was fitted, its 95 % interval."""

    value: float
    unit: str
    ci95: tuple[float, float] | None = None
    source: str = ""
    """Where it comes from, if the recording's motion does not give it."""


@dataclass(frozen=True, kw_only=True)
class Effect:
    """A named mechanism beyond eqs. 14 and 15 with its parameters."""

    name: str
    parameters: Mapping[str, Parameter]
    bench: bool = False
    """Whether it belongs to the bench, as the inertia and the weight of its arm do, and to no robot's joint."""

    @property
    def values(self) -> dict[str, float]:
        """The parameters as plain numbers."""
        return {name: p.value for name, p in self.parameters.items()}

    @property
    def acts(self) -> bool:
        """Whether the effect, or law, is part of the device and acts in the simulator.

        Effects of the kinds ``sensor`` and ``calibration`` are properties of the bench's log and do not act on a robot,
        nor does one of the bench's own, or one that the catalogue does not know.
        """
        return not self.bench and self.name in KNOWN and KNOWN[self.name].kind in ("mechanism", "law")

    def __str__(self) -> str:
        """Name, values, units and intervals on one line."""
        parts = []
        for name, p in self.parameters.items():
            interval = f", 95 % interval {p.ci95[0]!r} to {p.ci95[1]!r}" if p.ci95 else ""
            parts.append(f"{key_shown(name)} = {p.value!r}{with_unit(key_shown(p.unit))}{interval}")
        of_bench = " (of the bench)" if self.bench else ""
        return f"{key_shown(self.name)}{of_bench}{': ' if parts else ''}{'; '.join(parts)}"


@dataclass(frozen=True, kw_only=True)
class FittedOn:
    """Where a model comes from."""

    source: str
    trajectories: int
    samples: int
    rate: float
    """Sampling rate [1/s]."""
    current: tuple[float, float] | None = None
    """Smallest and largest current of the recordings, in size [unit of the model's current]; None: not known."""


@dataclass(frozen=True, kw_only=True)
class Model:
    """An identified joint, or a device in other units: what a ``model.json`` holds.

    Example:
        >>> import mrwarp
        >>> mrwarp.load_model("model.json").to_params().coil.current_max
        1.5
    """

    parameters: Mapping[str, Parameter]
    fitted_on: FittedOn
    units: Mapping[str, str] = field(default_factory=lambda: dict(JOINT_UNITS))
    device_mass: Parameter | None = None
    """Mass of the device [kg]; None: not known."""
    effects: tuple[Effect, ...] = ()
    """Effects beyond eqs. 14 and 15; among them at most one law that takes the place of eq. 15."""
    seed: int = 0
    versions: Mapping[str, str] = field(default_factory=dict)

    @property
    def values(self) -> dict[str, float]:
        """The parameters as plain numbers."""
        return {name: p.value for name, p in self.parameters.items()}

    @property
    def law(self) -> Effect | None:
        """The published law that takes the place of eq. 15 (:mod:`mrwarp.effects.laws`); None: eq. 15 itself."""
        return next((effect for effect in self.effects if effect.name in HYSTERESIS), None)

    @property
    def not_known(self) -> tuple[str, ...]:
        """Numbers that a simulation needs beyond the recorded motion, and nobody stated."""
        resistance, top = self.values.get("coil_resistance", 0.0), self.fitted_on.current
        found = {
            "coil resistance": not resistance,
            "mass": self.device_mass is None,
            "largest current": top is None and "current_max" not in self.parameters,
        }
        return tuple(name for name, missing in found.items() if missing)

    @property
    def holding_measured(self) -> bool:
        """Whether the model states the holding law (eq. 18), as ``fit`` does with break-away tests."""
        return "T_max" in self.parameters

    def check_joint(self) -> None:
        """Refuse a device that turns no joint of the simulator.

        Raises:
            ModelFileError: the model is not in rad, A and N·m.
        """
        if dict(self.units) != JOINT_UNITS:
            theirs, ours = (", ".join(units.values()) for units in (self.units, JOINT_UNITS))
            raise ModelFileError(
                f"{shown(self.fitted_on.source)}: its model is in {theirs}, the simulator's joints are in {ours}; "
                "fit a recording in these units, converted by the lever of the device"
            )

    def to_params(self, base: MrParams | None = None, *, extrapolate: bool = False) -> MrParams:
        """The joint for the simulator.

        Of the bench's zero and of the coil it has what the model holds, else nothing: no lag, and a resistance that is
        not known (0). Its largest current is the largest that was measured, unless ``base`` has a smaller one of its
        own: the paper's 1.5 A are of the paper's device. A holding law that was not measured follows from the sliding
        torque, see :meth:`mrwarp.params.HoldParams.unmeasured`.

        Args:
            base: Gives what else the model does not hold (``q_neutral``, gates, motor); None: the paper's.
            extrapolate: Keep a largest current beyond what was measured.

        Raises:
            ModelFileError: the model is not in rad, A and N·m, or a value is out of range.
        """
        self.check_joint()
        try:
            params = (base or MrParams()).replace(**{**dict.fromkeys(_OF_OTHERS, 0.0), **self.values})
            if self.fitted_on.current and "current_max" not in self.parameters:
                own, top = params.coil.current_max, self.fitted_on.current[1]
                most = max(own, top) if own == CoilParams().current_max else own
                params = params.replace(current_max=most if extrapolate else min(most, top))
            saturation = next((x.values["u"] for x in self.effects if x.name == "current_saturation"), 0.0)
            law = HoldParams.unmeasured(params.bouc_wen, params.coil.current_max, saturation)
            return params.replace(**{name: value for name, value in law.items() if name not in self.parameters})
        except ParameterError as error:
            raise ModelFileError(str(error)) from None


def completed(model: Model, earlier: Model) -> Model:
    """A model with what an earlier one of the same device also knows: parameters, effects, measured currents.

    What the model holds itself stands. Effects of the catalogue are the model's; others are carried along.

    Raises:
        ModelFileError: the two are in other units.
    """
    if model.units != earlier.units:
        theirs, ours = (", ".join(x.units.values()) for x in (earlier, model))
        source = shown(earlier.fitted_on.source)
        raise ModelFileError(f"the model of {source} is in {theirs}, the recording in {ours}; convert one of them")
    ranges = [current for current in (model.fitted_on.current, earlier.fitted_on.current) if current]
    current = (min(r[0] for r in ranges), max(r[1] for r in ranges)) if ranges else None
    carried = tuple(effect for effect in earlier.effects if effect.name not in KNOWN)
    return dataclasses.replace(
        model,
        parameters={**earlier.parameters, **model.parameters},
        device_mass=model.device_mass or earlier.device_mass,
        effects=(*model.effects, *carried),
        fitted_on=dataclasses.replace(model.fitted_on, current=current),
    )


def parameter_unit(name: str, units: Mapping[str, str]) -> str:
    """Unit of a parameter for a device in ``units``: that of ``mrwarp.params`` with rad, A and N·m exchanged."""
    return _exchanged(MrParams.spec(name).unit, units)


def effect_unit(parameter: EffectParameter, units: Mapping[str, str]) -> str:
    """Unit of an effect's number for a device in ``units``: the catalogue's with rad, A and N·m exchanged."""
    derived = {"kg·m²": "N·m·s²/rad", "1/J": "1/(N·m·rad)"}  # units that contain those of torque and angle
    if (units["torque"], units["q"]) == ("N·m", "rad"):
        derived = {}
    elif (units["torque"], units["q"]) == ("N", "m"):
        derived = {"kg·m²": "kg"}
    return _exchanged(derived.get(parameter.unit, parameter.unit), units)


def _exchanged(unit: str, units: Mapping[str, str]) -> str:
    for key, own in JOINT_UNITS.items():
        unit = unit.replace(own, f"<{key}>")
    if units["current"] in ("1", "none"):  # a plain number, a flag, or nothing
        unit = unit.replace("·<current>", "").replace("1/<current>", "1").replace("/<current>", "")
    for key, own in JOINT_UNITS.items():
        whole = units[key] if units[key] == own or unit == f"<{key}>" else re.sub(r"(.*[·/* ].*)", r"(\1)", units[key])
        unit = unit.replace(f"<{key}>", whole)
    return re.sub(r"\((\w+)\)", r"\1", unit)


def save_model(model: Model, path: str | Path) -> Path:
    """Write a model in one piece; every number is stored without loss.

    Example:
        >>> import mrwarp
        >>> mrwarp.save_model(mrwarp.load_model("model.json"), "copy.json").name
        'copy.json'
    """
    text = json.dumps(model_to_dict(model), indent=2, allow_nan=False, ensure_ascii=False)
    return write_text(Path(path), text + "\n")


class HasModel(Protocol):
    """A result with a model, as ``mrwarp.fit`` and ``mrwarp.diagnose`` return it."""

    @property
    def model(self) -> Model | None:
        """The device."""
        ...


Device: TypeAlias = "str | Path | Model | HasModel | MrParams | None"
"""A device as people have it: a file or a name of the library, its content, a fit, parameters; None is the paper's."""


def read_device(device: Device) -> Model | MrParams:
    """The model, or the parameters, that a device stands for.

    Raises:
        ModelFileError: the model file cannot be used, or a diagnosis came to no model.
        TypeError: it is none of these.
    """
    if isinstance(device, str | Path):
        return load_model(device)
    if device is None:
        return MrParams()
    found = device if isinstance(device, Model | MrParams) else getattr(device, "model", device)
    if found is None:
        raise ModelFileError("the diagnosis came to no model, so there is no device; give the model of a fit")
    if not isinstance(found, Model | MrParams):
        allowed = "a model.json, a device of 'mrwarp device list', a Model, what mrwarp.fit returned, or MrParams"
        raise TypeError(f"{type(device).__name__} is no device; give {allowed}")
    return found


@_of_a_model()
def load_model(path: str | Path) -> Model:
    """Read and check a model file, or a device of the library by its name (``mrwarp device list``).

    Example:
        >>> import mrwarp
        >>> model = mrwarp.load_model("model.json")
        >>> model.parameters["K1"].unit
        'N·m/(rad·A)'
        >>> mrwarp.load_model("mr_utfsm").units["torque"]
        'N'

    Raises:
        ModelFileError: the file is missing, too large, not JSON, of another schema, or one of its entries is unusable.
    """
    path = model_path(path)
    if path.is_file() and (size := path.stat().st_size) > MAX_BYTES:
        raise ModelFileError(f"{path}: {size} bytes; a model file has at most {MAX_BYTES}")
    return model_from_dict(read_json_file(path, _REMEDY if path.exists() else no_model(path)), str(path))


def model_to_dict(model: Model) -> dict[str, Any]:
    """The content of a model file: objects, lists, texts and numbers as JSON has them."""
    content = json.loads(json.dumps({"schema": SCHEMA, **dataclasses.asdict(model)}))
    for entry in [*content["parameters"].values(), *(p for e in content["effects"] for p in e["parameters"].values())]:
        if not entry["source"]:
            del entry["source"]
    for entry in content["effects"]:
        if not entry["bench"]:
            del entry["bench"]
    if model.device_mass is None:
        del content["device_mass"]
    if model.law is not None:
        content["law"] = next(entry for entry in content["effects"] if entry["name"] == model.law.name)
        content["effects"].remove(content["law"])
    return content


@_of_a_model()
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
    content = {"law": None, "device_mass": None, **content}
    checked_object(content, where, _KEYS)
    units = checked_texts(checked_object(content["units"], f"{where}: units", tuple(JOINT_UNITS)), f"{where}: units")
    for key, unit in units.items():
        if not unit.isprintable() or len(unit) > MAX_UNIT:
            allowed = f"a unit of at most {MAX_UNIT} characters"
            raise ModelFileError(f"{where}: units.{key} = {shown(unit)}; allowed: {allowed}")
    parameters = checked_mapping(content["parameters"], f"{where}: parameters")
    missing = [name for name in _REQUIRED if name not in parameters]
    if missing:
        raise ModelFileError(f"{where}: parameters.{missing[0]} is missing; needed: {', '.join(_REQUIRED)}")
    return Model(
        parameters={name: _parameter(name, entry, units, where) for name, entry in parameters.items()},
        fitted_on=_fitted_on(content["fitted_on"], f"{where}: fitted_on"),
        units=units,
        device_mass=_device_mass(content["device_mass"], f"{where}: device_mass"),
        effects=_law(content["law"], units, f"{where}: law") + _effects(content["effects"], units, f"{where}: effects"),
        seed=checked_whole(content["seed"], f"{where}: seed"),
        versions=checked_texts(content["versions"], f"{where}: versions"),
    )


def stated(model: Model, numbers: Mapping[str, Parameter]) -> Model:
    """The model with what somebody states of its device: ``coil_resistance`` [Ohm], ``device_mass`` [kg]."""
    values = dict(numbers)
    mass = values.pop("device_mass", model.device_mass)
    return dataclasses.replace(model, parameters={**model.parameters, **values}, device_mass=mass)


def of_bench(model: Model, parts: Collection[str]) -> Model:
    """The model with its effects marked that belong to these parts of the bench, and no others.

    Args:
        model: A fitted device.
        parts: Of :data:`mrwarp.enums.BENCH_PARTS`.
    """
    marked = {name for part in parts for name in BENCH_PARTS[part]}
    effects = tuple(dataclasses.replace(effect, bench=effect.name in marked) for effect in model.effects)
    return dataclasses.replace(model, effects=effects)


def bench_note(model: Model) -> str:
    """One line that asks which of a model's mechanics are the bench's own; empty where none was found.

    Dry friction is left out: it is the device's own far more often than the bench's.
    """
    asked = [p for p in ("inertia", "gravity") if any(e.name in BENCH_PARTS[p] for e in model.effects)]
    if not asked:
        return ""
    own = [p for p in asked if any(e.bench for e in model.effects if e.name in BENCH_PARTS[p])]
    travel = [p for p in asked if p not in own]
    words = [f"of the bench: {', '.join(own)}"] if own else []
    words += [f"part of the device in a robot's joint: {', '.join(travel)}"] if travel else []
    return f"note: {'; '.join(words)}; --bench {' '.join(asked)} marks what belongs to the bench"


def acting(effects: Iterable[Effect]) -> dict[str, dict[str, float]]:
    """Numbers of the law and the effects that act in the simulator, by name."""
    return {effect.name: effect.values for effect in effects if effect.acts}


@_of_a_model()
def make_effect(name: str, values: Mapping[str, float]) -> Effect:
    """An effect of the catalogue from bare numbers, for a joint in rad, A and N·m.

    Raises:
        ModelFileError: there is no such effect or parameter, one is missing, or a value makes no sense.
    """
    if name not in KNOWN:
        raise ModelFileError(f"there is no effect {name!r}; {_known(name, CATALOGUE)}")
    return _effect(name, dict(values), JOINT_UNITS, f"effect {name}")


@_of_a_model()
def check_effects(effects: Iterable[Effect], where: str) -> None:
    """Check effects that were made in Python as those of a file are; their numbers are in rad, A and N·m.

    Raises:
        ModelFileError: an effect is unusable, or one of the catalogue stands twice; ``where`` says in what.
    """
    _effects(json.loads(json.dumps([dataclasses.asdict(effect) for effect in effects])), JOINT_UNITS, where)


def silent_note(effects: Iterable[Effect]) -> str:
    """One line that names the effects that do not act and why; empty if all do."""
    found: dict[str, list[str]] = {}
    for effect in effects:
        if effect.name not in KNOWN:
            found.setdefault("unknown to the catalogue of effects", []).append(key_shown(effect.name))
        elif effect.bench:
            found.setdefault("the bench's own", []).append(effect.name)
        elif not effect.acts:
            found.setdefault("of the bench's log, not of the device", []).append(effect.name)
    parts = [f"{', '.join(names)} ({reason})" for reason, names in found.items()]
    return f"does not act in the simulator: {'; '.join(parts)}" if parts else ""


def not_known_note(names: Collection[str], device: str = "the device") -> str:
    """One line on what is not known of a device; empty if nothing is missing."""
    if not names:
        return ""
    return (
        f"note: not known of {device}: {', '.join(names)}; what hangs on it is left out; state it with 'mrwarp fit "
        "--coil-resistance R --device-mass M', or in the recording's header"
    )


def _parameter(name: str, entry: Any, units: Mapping[str, str], file: str) -> Parameter:
    where = f"{file}: parameters.{key_shown(name)}"
    if name not in _NAMES:
        raise ModelFileError(f"{where}: there is no such parameter; known: {', '.join(_NAMES)}")
    entry = checked_object({"source": "", **checked_mapping(entry, where)}, where, _PARAMETER_KEYS)
    spec = MrParams.spec(name) if dict(units) == JOINT_UNITS else None
    return _with_unit(entry, parameter_unit(name, units), where, spec)


def _with_unit(entry: dict[str, Any], expected: str | None, where: str, spec: ParamSpec | None = None) -> Parameter:
    """A checked ``{value, unit, ci95}``; without an expected unit any text is one, without ``spec`` any value."""
    unit = entry["unit"]
    if not isinstance(unit, str) or expected not in (None, unit):
        allowed = "a text" if expected is None else repr(expected)
        raise ModelFileError(f"{where}.unit = {shown(unit)}; allowed: {allowed}; convert the value, then the unit")
    value = checked_number(entry["value"], f"{where}.value")
    try:
        value = value if spec is None else spec.check(value, f"{where}.value")
    except ParameterError as error:
        raise ModelFileError(str(error)) from None
    ci95 = checked_interval(entry["ci95"], f"{where}.ci95")
    if ci95 and not ci95[0] <= value <= ci95[1]:
        raise ModelFileError(f"{where}.ci95 = {list(ci95)} leaves out the value {value:g}; correct either")
    return Parameter(value=value, unit=unit, ci95=ci95, source=checked_text(entry["source"], f"{where}.source"))


def _device_mass(entry: Any, where: str) -> Parameter | None:
    """The checked entry ``device_mass``; None where there is none."""
    if entry is None:
        return None
    entry = checked_object({"source": "", **checked_mapping(entry, where)}, where, _PARAMETER_KEYS)
    found = _with_unit(entry, "kg", where)
    if not 0.0 < found.value <= MAX_MASS:
        raise ModelFileError(f"{where}.value = {found.value:g}; allowed: above 0, at most {MAX_MASS:g} kg")
    return found


def _effects(entries: Any, units: Mapping[str, str], where: str) -> tuple[Effect, ...]:
    """The checked entries of ``effects``: ``{"name": ..., "parameters": {NAME: {value, unit, ci95} or number}}``."""
    if not isinstance(entries, list):
        raise ModelFileError(f"{where} = {shown(entries)}; allowed: a list of {{name, parameters}}")
    found: list[Effect] = []
    for i, entry in enumerate(entries):
        place = f"{where}[{i}]"
        entry = {"bench": False, **checked_mapping(entry, place)}
        checked_object(entry, place, ("name", "parameters", "bench"))
        if not isinstance(entry["bench"], bool):
            raise ModelFileError(f"{place}.bench = {shown(entry['bench'])}; allowed: true or false")
        name = checked_text(entry["name"] or None, f"{place}.name")
        if name in CATALOGUE and any(effect.name == name for effect in found):
            raise ModelFileError(f"{place}: {name} stands twice; remove one")
        if name in HYSTERESIS and any(effect.name in HYSTERESIS for effect in found):
            raise ModelFileError(f"{place}: {name} is a second law; a device has one")
        effect = _effect(name, checked_mapping(entry["parameters"], f"{place}.parameters"), units, place)
        found.append(dataclasses.replace(effect, bench=entry["bench"]))
    return tuple(found)


def _law(entry: Any, units: Mapping[str, str], where: str) -> tuple[Effect, ...]:
    """The checked entry ``law``: ``{"name": ..., "parameters": ...}`` as of an effect, or null for eq. 15."""
    if entry is None:
        return ()
    checked_object(entry, where, ("name", "parameters"))
    name = checked_text(entry["name"] or None, f"{where}.name")
    if name not in HYSTERESIS:
        raise ModelFileError(f"{where}.name = {shown(name)}: there is no such law; {_known(name, HYSTERESIS)}")
    return (_effect(name, checked_mapping(entry["parameters"], f"{where}.parameters"), units, where),)


def _effect(name: str, content: dict[str, Any], units: Mapping[str, str], where: str) -> Effect:
    known = {spec.name: spec for spec in KNOWN[name].parameters} if name in KNOWN else {}
    parameters: dict[str, Parameter] = {}
    for key, entry in content.items():
        place = f"{where}.parameters.{key_shown(key)}"
        if name in KNOWN and key not in known:
            raise ModelFileError(f"{place}: {name} has no such parameter; {_known(key, known)}")
        parameters[key] = _effect_parameter(entry, known.get(key), units, place)
    for key, spec in known.items():
        if key not in parameters and not (spec.choices or spec.form or spec.optional):
            raise ModelFileError(f"{where}.parameters.{key} is missing; needed: {_allowed(spec, units)}")
    return Effect(name=name, parameters=parameters)


def _effect_parameter(entry: Any, spec: EffectParameter | None, units: Mapping[str, str], where: str) -> Parameter:
    """A checked number of an effect; a bare one has no interval."""
    expected = None if spec is None else effect_unit(spec, units)
    if isinstance(entry, dict):
        parameter = _with_unit(checked_object({"source": "", **entry}, where, _PARAMETER_KEYS), expected, where)
    else:
        parameter = Parameter(value=checked_number(entry, where), unit=expected or "")
    if spec is not None and not spec.allows(parameter.value):
        raise ModelFileError(f"{where} = {parameter.value:g}; allowed: {_allowed(spec, units)}")
    return parameter


def _allowed(spec: EffectParameter, units: Mapping[str, str]) -> str:
    """Sensible values of an effect's parameter, with the unit."""
    unit = with_unit(effect_unit(spec, units))
    return spec.allowed() + (f", in{unit}" if unit else "")


def _known(name: str, known: Collection[str]) -> str:
    """The nearest of the known names, and all of them."""
    return f"{closest(name, known)}known: {', '.join(known)}"


def _fitted_on(entry: Any, where: str) -> FittedOn:
    entry = {"current": None, **checked_mapping(entry, where)}  # files of mrwarp 0.1 have none
    checked_object(entry, where, tuple(f.name for f in dataclasses.fields(FittedOn)))
    return FittedOn(
        source=checked_text(entry["source"], f"{where}.source"),
        trajectories=checked_whole(entry["trajectories"], f"{where}.trajectories"),
        samples=checked_whole(entry["samples"], f"{where}.samples"),
        rate=checked_number(entry["rate"], f"{where}.rate"),
        current=checked_interval(entry["current"], f"{where}.current"),
    )
