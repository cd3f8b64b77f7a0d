"""The model behind an MR prim: lossless through USD, an edited attribute wins, damage is refused by name."""

import json
import math
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd

from mrwarp.cli import main
from mrwarp.model_file import JOINT_UNITS, Effect, FittedOn, Model, Parameter, load_model, parameter_unit, save_model
from mrwarp.params import MrParams
from mrwarp.usd import record as asset_record
from mrwarp.usd.asset import load_bench, load_robot
from mrwarp.usd.edit import edit_asset, find_prim
from mrwarp.usd.open_stage import ASSETS, AssetError
from mrwarp.usd.record import PREFIX, RECORD, read_model, record_difference, record_text
from tests.messages import Refused, has_parts
from tests.usd.test_edit import foreign

SHIPPED = ASSETS / "mr_go.usda"
REQUIRED = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma")
OPTIONAL = tuple(s.name for s in MrParams.specs() if s.name not in (*REQUIRED, "q_neutral"))
TEXTS = (
    "bench/fit", "", "Prüfstand Größe/µ·τ", "磁流变 关节", "🦿🧲",
    "don't \"quote\" \\n \\", "a\nb\tc\r\n\0\x1b[2J\x7f\x85\u2028",
    "} ) def \"x\" { # '''", "@asset.usd@ <path>", "x" * 3000,
)  # fmt: skip
EXTREMES = (0.0, -0.0, 5e-324, -5e-324, 2.2250738585072014e-308, 1e-7, 1 / 3, math.pi * 1e-300, 1.0000000000000002)


def random_model(rng: np.random.Generator) -> Model:
    """Any model that the simulator takes: some parameters, some intervals, extreme numbers, any text."""

    def text() -> str:
        return TEXTS[rng.integers(len(TEXTS))]

    def number(low: float, high: float) -> float:
        kind = rng.integers(4)
        if kind == 0 and low <= (extreme := EXTREMES[rng.integers(len(EXTREMES))]) <= high:
            return extreme
        if kind == 1:
            return float((low, high, np.nextafter(low, high), np.nextafter(high, low))[rng.integers(4)])
        return float(rng.uniform(max(low, -1e3), min(high, 1e3)))

    def effect_parameter(value: float) -> Parameter:
        ci95 = (value - 1.0, value + 1.0) if rng.random() < 0.5 else None
        return Parameter(value=value, unit=text(), ci95=ci95)

    values = {}
    for name in [*rng.permutation(REQUIRED), *rng.permutation(OPTIONAL)[: rng.integers(len(OPTIONAL) + 1)]]:
        spec = MrParams.spec(str(name))
        values[spec.name] = number(spec.low, spec.high)
    if values["beta"] + values["gamma"] <= 0.0:
        values |= {"beta": 1 / 3, "gamma": -0.1}
    values |= {name: min(values[name], 9e5 * (values["beta"] + values["gamma"])) for name in ("K0", "K1")}
    parameters = {}
    for name, value in values.items():
        below, above = ((0.0, 0.0), (1e300, 5e-324), rng.exponential(size=2).tolist(), (1e-12, 1e9))[rng.integers(4)]
        ci95 = (value - below, value + above) if rng.random() < 0.6 else None
        parameters[name] = Parameter(value=value, unit=parameter_unit(name, JOINT_UNITS), ci95=ci95)
    effects = tuple(
        Effect(
            name=text() or "uncatalogued",
            parameters={f"{text()}{k}": effect_parameter(number(-1e307, 1e307)) for k in range(size)},
        )
        for size in rng.integers(4, size=rng.integers(4))
    )
    counts = [int(n) for n in rng.integers(2**60, size=2)]
    return Model(
        parameters=parameters,
        fitted_on=FittedOn(source=text(), trajectories=counts[0], samples=counts[1], rate=number(0.0, 1e6)),
        effects=effects,
        seed=int(rng.integers(2**62)) * int(rng.choice([-1, 1, 2**40])),
        versions={text() + str(k): text() for k in range(rng.integers(4))},
    )


def bits(model: Model) -> str:
    """Every field; unlike ``==`` this distinguishes -0.0 from 0.0."""
    return repr(model)


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A copy of the robot's file, alone in its folder."""
    return Path(shutil.copy(SHIPPED, tmp_path / "robot.usda"))


@pytest.fixture
def model() -> Model:
    """A model with intervals, without one for K1, with an effect; it does not hold the motor."""
    values = {name: value for name, value in MrParams() if name in REQUIRED}
    values |= {"D": -0.1 / 3, "T_max": 20.0}
    parameters = {
        name: Parameter(
            value=v, unit=parameter_unit(name, JOINT_UNITS), ci95=None if name == "K1" else (v - 0.25, v + 0.5)
        )
        for name, v in values.items()
    }
    origin = FittedOn(source="bench/größe", trajectories=12, samples=9600, rate=200.0)
    effect = Effect(name="coil_lag", parameters={"time_constant": Parameter(value=0.01, unit="s", ci95=(0.009, 0.012))})
    return Model(parameters=parameters, fitted_on=origin, effects=(effect,), seed=5, versions={"mrwarp": "0.1.0"})


def applied(file: Path, model: Model, prim: str = "MRDevice", out: Path | None = None) -> Path:
    """The file with a model on a prim, as ``mrwarp asset apply`` writes it, without the conversion."""
    edit_asset(file, prim, {}, out, model=model)
    return out or file


def held(file: Path, joint: str = "FL_calf"):
    """Content of a joint of the file."""
    asset = load_robot(file)
    path = next(a.prim_path for a in asset.actuators if a.joint == joint)
    return read_model(asset.stage.GetPrimAtPath(path), file)


@pytest.mark.parametrize("seed", range(4))
def test_apply_and_export_are_lossless(robot: Path, seed: int) -> None:
    """Any model comes back from the commands with every bit of every field, from the class, a leg and a binary file."""
    a, b = robot.with_name("a.json"), robot.with_name("b.json")
    save_model(random_model(np.random.default_rng(seed)), a)
    prim = ("MRDevice", "RL_calf")[seed % 2]
    out = robot.with_name(("out.usda", "out.usdc")[seed // 2 % 2])
    assert main(["asset", "apply", str(robot), str(a), "--prim", prim, "--out", str(out)]) == 0
    assert main(["asset", "export", str(out), *([] if prim == "MRDevice" else [prim]), "--out", str(b)]) == 0
    assert load_model(a) == load_model(b)
    assert bits(load_model(a)) == bits(load_model(b))


def test_many_random_models_are_lossless(tmp_path: Path) -> None:
    """Eight random models edited into the text of one file, one over the other."""
    rng = np.random.default_rng(7)
    text = Path(shutil.copy(ASSETS / "mr_bench.usda", tmp_path / "bench.usda"))
    for _ in range(8):
        model = random_model(rng)
        bench = load_bench(applied(text, model, "bench_joint"))
        assert bits(read_model(bench.stage.GetPrimAtPath(bench.actuators[0].prim_path)).model) == bits(model)


def test_without_a_record_the_numbers_are_the_model(robot: Path) -> None:
    """A file that no model was applied to exports its 27 numbers, without intervals, with itself as source."""
    found = held(robot)
    assert found.applied is None and not found.changed and list(found.lines()) == []
    assert found.model.values == {name: value for name, value in MrParams() if name != "q_neutral"}
    assert found.model.fitted_on.source == f"{robot}: /mr_go/actuators/FL_calf"


def test_an_edited_attribute_wins(robot: Path, model: Model, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Its value is exported without interval; all else stays; show, check and export say so in one line."""
    applied(robot, model)
    edit_asset(robot, "FL_calf", {"D": 0.5, "kp_base": 30})
    found = held(robot)
    assert found.changed == {"D": -0.1 / 3, "kp_base": 35.0}
    expected = {
        **model.parameters,
        "D": Parameter(value=0.5, unit="N·m"),
        "kp_base": Parameter(value=30.0, unit="N·m/rad"),
    }
    assert found.model == replace(model, parameters=expected)
    assert held(robot, "FR_calf").model == model
    line = "changed since the model was applied, so without interval: "
    line += "D = 0.5 (was -0.03333333333), kp_base = 30 (was 35)"
    assert main(["asset", "show", str(robot)]) == 0
    shown = capsys.readouterr().out
    assert shown.count(line) == 1
    assert "model: 'bench/größe', 12 trajectories, 9600 samples at 200 1/s, seed 5, mrwarp 0.1.0" in shown
    assert "effect: coil_lag: time_constant = 0.01 s, 95 % interval 0.009 to 0.012" in shown
    assert "model; 95 % interval 19.75 to 20.5" in shown and "model; no interval" in shown
    assert "this file; -0.03333333333 when the model was applied" in shown
    assert main(["asset", "check", str(robot)]) == 0
    assert f"\nnote  FL_calf: {line}\n" in capsys.readouterr().out
    assert main(["asset", "export", str(robot), "FL_calf", "--out", str(tmp_path / "b.json")]) == 0
    assert capsys.readouterr().err == f"mrwarp asset export: notice: {line}\n"
    assert load_model(tmp_path / "b.json") == found.model
    assert main(["asset", "export", str(robot), "--out", str(tmp_path / "b.json")]) == 2
    edit_asset(robot, "FL_calf", {"D": -0.1 / 3, "kp_base": 35})
    assert held(robot).model == model


def test_a_leg_keeps_its_own_model(robot: Path, model: Model, capsys: pytest.CaptureFixture) -> None:
    """A model on the class does not reach a leg that has its own; both can be exported, and diff names the record."""
    own = replace(model, seed=6)
    applied(robot, own, "RR_calf")
    report = edit_asset(robot, "MRDevice", {}, model=model)
    assert any(
        line.startswith("/mr_go/actuators/RR_calf keeps its own mr:model:record = model ") for line in report.kept
    )
    assert (held(robot).model, held(robot, "RR_calf").model) == (model, own)
    other = applied(robot, replace(own, seed=7, effects=()), "RR_calf", robot.with_name("other.usda"))
    assert main(["asset", "diff", str(robot), str(other)]) == 1
    variants = "[robot=mr_go payload=0; robot=mr_go payload=3]"
    value = "effects.0.parameters.time_constant.value 0.01 -> None"
    effects = f"effects.0.name 'coil_lag' -> None, {value}, effects.0.parameters.time_constant.unit 's' -> None"
    assert capsys.readouterr().out == f"actuators/RR_calf {RECORD}: {effects} and 2 more   {variants}\n"
    text = record_text(model, MrParams())
    assert record_difference(text, text.replace(",", ", "), ("a", "b")) == "the same, written otherwise"
    assert main(["asset", "diff", str(SHIPPED), str(robot)]) == 1
    assert f"actuators/FL_calf {RECORD}: none -> model 'bench/größe', 12 traj" in capsys.readouterr().out
    assert main(["asset", "apply", str(robot), str(save_model(model, robot.with_name("m.json")))]) == 0
    assert "MRDevice has these numbers already" in capsys.readouterr().out


@pytest.mark.parametrize("kind", ["exported", "usdc", "flattened", "float", "reordered", "unlocked"])
def test_files_of_another_tool(robot: Path, model: Model, kind: str) -> None:
    """Exported, binary, flattened, with 32-bit numbers, in another order, custom: the model is the same."""
    applied(robot, model)

    def change(device: Sdf.PrimSpec) -> None:
        if kind == "unlocked":
            device.attributes[RECORD].custom = True
        kept = [(s.name, s.typeName, s.default) for s in device.attributes] if kind == "reordered" else []
        for name, type_name, value in reversed(kept):
            device.RemoveProperty(device.attributes[name])
            Sdf.AttributeSpec(device, name, type_name).default = value

    assert bits(held(foreign(robot, kind, change)).model) == bits(model)


def test_another_tool_edits_or_drops(robot: Path, model: Model) -> None:
    """A number changed by USD itself wins; a record that is gone, blocked or emptied leaves the bare numbers."""
    applied(robot, model)
    stage = Usd.Stage.Open(str(robot))
    device = stage.GetPrimAtPath("/mr_go/parts/MRDevice")
    device.GetAttribute(PREFIX + "D").Set(0.25)
    stage.Save()
    assert held(robot).changed == {"D": -0.1 / 3}
    for change in (
        lambda: device.GetAttribute(RECORD).Block(),
        lambda: device.GetAttribute(RECORD).Set(""),
        lambda: device.RemoveProperty(RECORD),
    ):
        change()
        stage.Save()
        assert held(robot).applied is None
        assert held(robot).model.values["D"] == 0.25


def entry(*keys: Any, to: Any) -> Callable[[dict], str]:
    """A record with one entry changed; ``...`` removes it."""

    def change(content: dict) -> str:
        inner = content
        for key in keys[:-1]:
            inner = inner[key]
        if to is ...:
            del inner[keys[-1]]
        else:
            inner[keys[-1]] = to
        return json.dumps(content)

    return change


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda _: "{", "not JSON"),
        (lambda _: "[" * 100_000, "not JSON"),
        (lambda _: "x" * 200_001, "200001 .. 200000"),
        (lambda _: '{"model": 1, "model": 2}', "model stands twice"),
        (lambda _: "[1]", " = [1] .. object"),
        (lambda c: json.dumps(c) + "\n\x1b[2J", "not JSON"),
        (entry("model", to="x" * 10_000), "object"),
        (entry("model", "schema", to=7), "model: schema = 7 .. 1"),
        (entry("model", "parameters", "D", "value", to=1.1e6), "D = 1.1e+06 .. -1e+06 to 1e+06 N·m"),
        (entry("model", "parameters", "\x1b[2J", to={}), "parameters.'\\x1b[2J'"),
        (entry("model", "units", "q", to="deg"), "convert .. unit"),
        (lambda c: json.dumps(c).replace("rad", "m"), "model: units = {'current': 'A', 'q': 'm'"),
        (entry("rest", "kd", to=...), "rest: kd is missing"),
        (entry("rest", "kd", to=float("inf")), "rest.kd = inf .. finite"),
        (entry("rest", "D", to=1.0), "rest .. 'D'"),
        (entry("rest", to=[]), "rest = [] .. object"),
    ],
)
def test_damaged_record_is_refused(
    robot: Path,
    model: Model,
    damage: Callable[[dict], str],
    words: str,
    refused: Refused,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The robot still loads; show names prim, key, value and remedy in one short line.

    What a model's content may be is tested with model.json.
    """
    monkeypatch.setattr(asset_record, "MAX_CHARACTERS", 200_000)
    stage = Usd.Stage.Open(str(robot))
    device = stage.GetPrimAtPath("/mr_go/parts/MRDevice")
    text = damage(json.loads(record_text(model, MrParams())))
    device.CreateAttribute(RECORD, Sdf.ValueTypeNames.String).Set(text)
    stage.Save()
    assert load_robot(robot).actuators[2].mr == MrParams()
    said = refused("asset", "show", robot)
    assert said.startswith(f"mrwarp asset show: {robot}: /mr_go/actuators/FL_calf: {RECORD}")
    assert has_parts(said, f"{words} .. mrwarp asset apply .. remove {RECORD}")
    assert len(said) < 700 and "\x1b" not in said


@pytest.mark.parametrize("text", ["{", "[1]", '{"model": {"schema": 7}}'])
def test_a_damaged_record_is_compared_and_repaired(robot: Path, model: Model, text: str) -> None:
    """The robots differ in it; applying a model again repairs it."""
    stage = Usd.Stage.Open(str(robot))
    stage.GetPrimAtPath("/mr_go/parts/MRDevice").CreateAttribute(RECORD, Sdf.ValueTypeNames.String).Set(text)
    stage.Save()
    assert main(["asset", "diff", str(SHIPPED), str(robot)]) in (1, 2)
    applied(robot, model)
    assert held(robot).model == model


@pytest.mark.parametrize(
    ("type_name", "value", "words"),
    [
        ("Double", math.nan, "double mr:model:record = nan .. string"),
        ("Token", "{}", "token mr:model:record = '{}' .. string"),
        ("StringArray", ["{}"] * 1000, "string[] mr:model:record = "),
    ],
)
def test_record_of_another_type_is_refused(robot: Path, model: Model, type_name: str, value: Any, words: str) -> None:
    """A record that is no string is refused with its type; a changing one too. Applying again repairs the type."""
    stage = Usd.Stage.Open(str(robot))
    device = stage.GetPrimAtPath("/mr_go/parts/MRDevice")
    device.CreateAttribute(RECORD, getattr(Sdf.ValueTypeNames, type_name)).Set(value)
    stage.Save()
    with pytest.raises(AssetError) as error:
        held(robot)
    assert has_parts(str(error.value), words) and len(str(error.value)) < 500
    applied(robot, model)
    assert held(robot).model == model


def test_record_that_varies_with_time_is_refused(robot: Path) -> None:
    """Time samples are refused; the robot loads."""
    stage = Usd.Stage.Open(str(robot))
    prim = find_prim(stage, "MRDevice", robot)
    prim.CreateAttribute(RECORD, Sdf.ValueTypeNames.String).Set("{}", 1.0)
    stage.Save()
    assert load_robot(robot).actuators[2].mr == MrParams()
    with pytest.raises(AssetError, match="varies with time; allowed: one text"):
        held(robot)


def test_failed_apply_writes_nothing(robot: Path, model: Model, refused: Refused) -> None:
    """A model of a device in other units, and one for a plain motor, are refused; the file stays as it was."""
    units = {"q": "m", "current": "A", "torque": "N"}
    parameters = {n: replace(p, unit=parameter_unit(n, units)) for n, p in model.parameters.items()}
    damper = save_model(replace(model, units=units, parameters=parameters), robot.with_name("damper.json"))
    assert "converted by the lever of the device" in refused("asset", "apply", robot, damper)
    joint = save_model(model, robot.with_name("joint.json"))
    assert "plain motor" in refused("asset", "apply", robot, joint, "--prim", "FL_hip")
    refused("asset", "set", robot, "FL_calf", RECORD, "{}")
    assert robot.read_bytes() == SHIPPED.read_bytes()
