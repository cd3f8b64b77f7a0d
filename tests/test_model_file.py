"""Model files: lossless round trips through JSON and USD, and one clear refusal for each kind of damage."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.model_file import (
    JOINT_UNITS,
    Effect,
    FittedOn,
    Model,
    ModelFileError,
    Parameter,
    load_model,
    make_effect,
    model_from_dict,
    model_to_dict,
    parameter_unit,
    save_model,
)
from mrwarp.params import MrParams
from tests.messages import has_parts

VALUES = {
    "D": -0.1 / 3, "B": 0.1, "C": 0.2, "I1": -1e-4 / 7, "K0": 0.4, "K1": 10.4, "alpha": 0.77, "beta": 16.5,
    "gamma": -10.5, "q_offset": 1e-5 / 3, "T_max": 20.0, "K": 0.5, "n": 3.0,
}  # fmt: skip


def model(units: dict[str, str] = JOINT_UNITS) -> Model:
    """A model with awkward numbers."""
    parameters = {
        name: Parameter(value=value, unit=parameter_unit(name, units), ci95=(value - 1 / 3, value + 1 / 3))
        for name, value in VALUES.items()
    }
    origin = FittedOn(source="bench/fit", trajectories=12, samples=9600, rate=200.0)
    lag = Parameter(value=0.01 / 3, unit="s", ci95=(0.003, 0.0035))
    other = {"slope": Parameter(value=-1 / 3, unit="m/s"), "rise": Parameter(value=0.1, unit="", ci95=(0.0, 1 / 7))}
    effects = (Effect(name="coil_lag", parameters={"time_constant": lag}), Effect(name="leak", parameters=other))
    return Model(parameters=parameters, fitted_on=origin, units=units, effects=effects, seed=5, versions={"numpy": "2"})


def test_json_round_trip_is_lossless(tmp_path: Path) -> None:
    """A saved and loaded model equals the one it was, to the last bit."""
    assert load_model(save_model(model(), tmp_path / "sub/model.json")) == model()


def test_bare_numbers_of_effects_take_the_units_of_the_catalogue() -> None:
    """A bare number has no interval; its unit is the catalogue's in the device's units, or empty if it is not there."""
    units = {"q": "mm", "current": "V", "torque": "kN"}
    laws = {
        "coil_lag": {"time_constant": 0.01}, "current_viscosity": {"B1": 1.0}, "current_saturation": {"u": 0.5},
        "rotor_inertia": {"inertia": 2.0}, "wear": {"rate": -1e-4}, "unheard": {"x": 3},
        "temperature_drift": {"yield_loss": 0.1, "viscosity_loss": 0.0, "time_constant": 60.0},
    }  # fmt: skip
    content = model_to_dict(model(units))
    content["effects"] = [{"name": name, "parameters": values} for name, values in laws.items()]
    loaded = model_from_dict(content)
    assert {e.name: e.values for e in loaded.effects} == laws
    found = [p for e in loaded.effects for p in e.parameters.values()]
    assert [p.unit for p in found] == "s|kN·s/(mm·V)|1/V|kN·s²/mm|1/s||1/(kN·mm)|1/(kN·mm)|s".split("|")
    assert all(p.ci95 is None for p in found)
    assert model_from_dict(model_to_dict(loaded)) == loaded


def test_every_effect_of_the_catalogue_can_be_written() -> None:
    """Each effect of the catalogue at null, but for what the law divides by, is accepted and comes back."""
    effects = tuple(
        make_effect(law.name, {p.name: 0.1 if p.divides else p.null for p in law.parameters})
        for law in CATALOGUE.values()
    )
    extended = replace(model(), effects=effects)
    assert model_from_dict(model_to_dict(extended)) == extended
    with pytest.raises(ModelFileError, match="there is no effect 'coil_lagg'; did you mean 'coil_lag'"):
        make_effect("coil_lagg", {})


def test_dictionary_round_trip() -> None:
    """The content as JSON types makes the same model; a seed of any length keeps its digits."""
    long = replace(model(), seed=2**62 + 1)
    content = model_to_dict(long)
    assert json.loads(json.dumps(content)) == content
    assert model_from_dict(content) == long
    with pytest.raises(ModelFileError, match=r"here: holds \[\]; allowed: an object \{...\}; give the model.json"):
        model_from_dict([], "here")


def test_missing_groups_take_defaults() -> None:
    """Numbers that a bench does not identify come from the defaults, or from a given joint."""
    params = model().to_params()
    assert params.bouc_wen.D == VALUES["D"]
    assert params.hold.T_max == 20.0
    assert params.gate == MrParams().gate and params.motor == MrParams().motor
    assert params.bouc_wen.q_neutral == MrParams().bouc_wen.q_neutral
    assert model().to_params(MrParams().replace(q_neutral=-1.0, kp_low=7.0)).motor.kp_low == 7.0


def test_linear_damper_keeps_its_units_and_is_no_joint(tmp_path: Path) -> None:
    """A damper in m and N round-trips with its own units; the simulator's joint refuses it with the remedy."""
    units = {"q": "m", "current": "A", "torque": "N"}
    loaded = load_model(save_model(model(units), tmp_path / "model.json"))
    assert loaded.parameters["K1"].unit == "N/(m·A)"
    assert loaded.parameters["B"].unit == "N·s/m"
    with pytest.raises(ModelFileError, match="converted by the lever"):
        loaded.to_params()


def edit(*keys: Any, to: Any) -> Callable[[dict], None]:
    """A change of one entry; ``...`` removes it."""

    def change(content: dict) -> None:
        for key in keys[:-1]:
            content = content[key]
        if to is ...:
            del content[keys[-1]]
        else:
            content[keys[-1]] = to

    return change


LAG = ("effects", 0, "parameters", "time_constant")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (edit("schema", to=2), "schema = 2 .. 1"),
        (
            edit("parameters", "beta", "value", to=-1.0),
            "parameters.beta.value: beta = -1 .. 0 to",
        ),
        (edit("parameters", "beta", "value", to="fast"), "parameters.beta.value = 'fast' .. finite"),
        (edit("parameters", "beta", "value", to=True), "parameters.beta.value = True .. finite"),
        (edit("parameters", "beta", "value", to=float("nan")), "parameters.beta.value = nan .. finite"),
        (edit("parameters", "beta", "unit", to="1/deg"), "parameters.beta.unit = '1/deg' .. '1/rad'"),
        (edit("parameters", "beta", "ci95", to=[1.0, 2.0]), "parameters.beta.ci95 = [1.0, 2.0]"),
        (edit("parameters", "beta", "ci95", to=[1.0]), "parameters.beta.ci95 = [1.0] .. [low, high] .. null"),
        (edit("parameters", "beta", to=...), "parameters.beta is missing"),
        (edit("parameters", "Beta", to={}), "parameters.Beta"),
        (edit("parameters", to=[]), "parameters = [] .. object"),
        (edit("units", "q", to=...), "units: q is missing"),
        (edit("units", "q", to="(" * 10_000), " .. 20 characters"),
        (edit("units", "q", to="a\nb"), "units.q = 'a\\nb' .. 20 characters"),
        (edit("effects", to={}), "effects = {} .. list"),
        (edit("effects", to=[3]), "effects[0] = 3 .. object"),
        (edit("effects", 0, "name", to="\ud800"), "effects[0].name = '\\ud800' .. text"),
        (edit("seed", to=0.5), "seed = 0.5 .. whole number"),
        (edit("seed", to=10**400), " .. finite"),
        (
            edit("fitted_on", "source", to=["a"] * 1000),
            "fitted_on.source = ['a', 'a', 'a', 'a', 'a', 'a', ...]; allowed",
        ),
        (edit("versions", "k" * 1000, to=3), "kkkkk' = 3 .. text"),
        (edit("effects", 0, "parameters", "time_constant", to=None), "effects[0].parameters.time_constant = None"),
        (edit(*LAG, to=-0.01), "time_constant = -0.01 .. 0 or more, in s"),
        (edit(*LAG, "value", to=-0.01), "time_constant.ci95 = [0.003, 0.0035]"),
        (edit(*LAG, "value", to=10**400), "time_constant.value = 1000"),
        (edit(*LAG, "unit", to="ms"), "time_constant.unit = 'ms' .. convert .. unit"),
        (edit(*LAG, "ci95", to=[0.1, 0.2]), "time_constant.ci95 = [0.1, 0.2]"),
        (edit(*LAG, to=...), "effects[0].parameters.time_constant .. missing .. 0 or more, in s"),
        (edit("effects", 0, "parameters", "T", to=0.1), "parameters.T .. coil_lag"),
        (edit("effects", 1, "name", to="coil_lag"), "effects[1] .. coil_lag .. twice .. remove"),
        (
            edit("effects", 1, to={"name": "coulomb_friction", "parameters": {"torque": 1.0, "speed": 0.0}}),
            "effects[1].parameters.speed = 0 .. above 0, in rad/s",
        ),
        (edit("fitted_on", "rate", to="fast"), "fitted_on.rate = 'fast'"),
        (edit("note", to="hello"), "'note'"),
    ],
)
def test_damage_is_refused_with_path_key_and_remedy(tmp_path: Path, change: Callable, words: str) -> None:
    """Each broken entry is named with its file, key, value and what is allowed."""
    path = save_model(model(), tmp_path / "model.json")
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ModelFileError) as error:
        load_model(path)
    assert str(error.value).startswith(str(path))
    assert has_parts(str(error.value), words)


@pytest.mark.parametrize(
    ("raw", "words"),
    [
        (None, r"model.json: .*give the model.json"),
        (b"", "not JSON"),
        (b"\x80\x04model", "not JSON"),
        (b"[" * 100_000, "not JSON"),
        (b"[1, 2]", r"\[1, 2\].*object.*model.json"),
        (b'{"schema": 1, "schema": 1}', "schema stands twice"),
        (b'{"schema": 1, "seed": NaN}', "units is missing"),
        (b" " * (2**20 + 1), "a model file has at most"),
    ],
)
def test_files_that_are_no_model_are_refused(tmp_path: Path, raw: bytes | None, words: str) -> None:
    """Missing, empty, binary (a pickle), deeply nested, listed, doubled and huge files get one clear error."""
    path = tmp_path / "model.json"
    if raw is not None:
        path.write_bytes(raw)
    with pytest.raises(ModelFileError, match=words):
        load_model(path)
