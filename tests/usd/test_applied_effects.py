"""A model with effects on the robot: from Python, from a file, from the USD record; what acts is said."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

from mrwarp.cli import main
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.env.sim import robot_scene
from mrwarp.env.sim_model import build_scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.model_file import (
    HOLDING_NOTE,
    Effect,
    ModelFileError,
    Parameter,
    load_model,
    make_effect,
    save_model,
)
from mrwarp.usd.asset import device_lines, load_bench, load_robot, with_model
from mrwarp.usd.edit import edit_asset
from mrwarp.usd.open_stage import ASSETS
from mrwarp.usd.record import RECORD
from mrwarp.usd.robot import CALVES
from tests.messages import Refused
from tests.models import paper_model as model

LAG = make_effect("coil_lag", {"time_constant": 0.03})
LOG = make_effect("velocity_lag", {"time_constant": 0.01})
INERTIA = make_effect("rotor_inertia", {"inertia": 0.004})


def test_a_model_reaches_every_mr_joint(tmp_path: Path) -> None:
    """Numbers and effects stand on the four calves and nowhere else, from an object and from its file."""
    extended = model(LAG, LOG, K1=12.0)
    path = save_model(extended, tmp_path / "model.json")
    for found in (with_model(load_robot(), extended), with_model(load_robot(), path)):
        for actuator in found.actuators:
            assert (actuator.joint in CALVES) == (actuator.mr is not None)
            assert actuator.effects == (extended.effects if actuator.mr else ())
            assert actuator.mr is None or actuator.mr.bouc_wen.K1 == 12.0
    scene = robot_scene(with_model(load_robot(), extended), SimCfg(num_envs=1))
    acting, silent, holding, unknown = device_lines(scene.actuators)
    assert acting == "effects on FL_calf, FR_calf, RL_calf, RR_calf: coil_lag: time_constant = 0.03 s"
    assert silent == "note: does not act in the simulator: velocity_lag (of the bench's log, not of the device)"
    assert holding.startswith(HOLDING_NOTE) and "yields at 3.08 N·m with 1.5 A" in holding
    assert unknown.startswith("note: not known of FL_calf, FR_calf, RL_calf, RR_calf: coil resistance, mass, largest")
    assert list(device_lines(load_robot().actuators)) == []


@pytest.mark.parametrize(
    ("effect", "words"),
    [
        (Effect(name="coil_lag", parameters={}), "time_constant is missing"),
        (Effect(name="coil_lag", parameters={"T": Parameter(value=0.1, unit="s")}), "no such parameter"),
        (Effect(name="coil_lag", parameters={"time_constant": Parameter(value=-0.1, unit="s")}), "allowed: 0 or more"),
        (
            Effect(name="coil_lag", parameters={"time_constant": Parameter(value=float("nan"), unit="s")}),
            "time_constant.value = nan; allowed: a finite number",
        ),
    ],
)
def test_effects_made_in_python_are_checked(effect: Effect, words: str) -> None:
    """An object is refused as its file would be."""
    with pytest.raises(ModelFileError, match=words):
        with_model(load_robot(), model(effect))


def test_robot_without_devices_refuses_a_model() -> None:
    """Variant go1, or devices taken away, have no joint for it."""
    with pytest.raises(ModelFileError, match="robot 'go1' has no MR joint"):
        with_model(load_robot(robot="go1"), model())
    cfg = replace(TaskCfg(num_envs=1, actuator="none"), model=model(LAG))
    with pytest.raises(ModelFileError, match="leave the model out"):
        WalkEnv(cfg)


def test_inertia_acts_as_armature() -> None:
    """Each calf's armature grows by the effect's inertia, implicitly in the model; a negative one is refused."""
    plain = build_scene(load_robot(), dt=0.005)
    heavy = build_scene(with_model(load_robot(), model(INERTIA)), dt=0.005)
    added = heavy.model.dof_armature - plain.model.dof_armature
    calves = [v for v, a in zip(plain.v_adr, plain.actuators, strict=True) if a.mr]
    want = np.zeros_like(added)
    want[calves] = 0.004
    np.testing.assert_allclose(added, want, atol=1e-15)
    # all else is the same, but for what follows from the inertia
    assert np.array_equal(heavy.model.dof_invweight0[calves], plain.model.dof_invweight0[calves])
    assert np.array_equal(heavy.model.body_mass, plain.model.body_mass)
    with pytest.raises(ValueError, match="FL_calf: effect rotor_inertia.inertia = -1 kg·m² leaves a negative armature"):
        build_scene(with_model(load_robot(), model(make_effect("rotor_inertia", {"inertia": -1.0}))), dt=0.005)


def test_effects_reach_the_simulator_through_usd(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    """Applied to the robot's file, effects are said, shown, loaded, simulated, and come back by export."""
    robot = Path(shutil.copy(ASSETS / "mr_go.usda", tmp_path / "robot.usda"))
    extended = model(LAG, INERTIA, LOG)
    path = save_model(extended, tmp_path / "model.json")
    assert main(["asset", "apply", str(robot), str(path)]) == 0
    said = capsys.readouterr().out
    assert "acts in the simulator: coil_lag: time_constant = 0.03 s\n" in said
    assert "does not act in the simulator: velocity_lag (of the bench's log, not of the device)\n" in said
    assert main(["asset", "show", str(robot)]) == 0
    said = capsys.readouterr().out
    assert "effect: rotor_inertia: inertia = 0.004 kg·m²" in said and "effect (does not act): velocity_lag" in said
    asset = load_robot(robot)
    assert all(a.effects == (extended.effects if a.mr else ()) for a in asset.actuators)
    env = WalkEnv(replace(TaskCfg(num_envs=2), asset=str(robot)))
    twin = WalkEnv(replace(TaskCfg(num_envs=2), model=str(path)))
    assert env.actuator.effects is not None
    one, other = env.step(env.action)[0], twin.step(twin.action)[0]
    assert one["critic"].equal(other["critic"])
    assert main(["asset", "export", str(robot), "--out", str(tmp_path / "back.json")]) == 0
    assert load_model(tmp_path / "back.json") == extended


def test_effects_on_the_bench_asset(tmp_path: Path) -> None:
    """The one-joint bench reads them from its prim too."""
    edit_asset(ASSETS / "mr_bench.usda", "bench_joint", {}, tmp_path / "bench.usda", model=model(LAG))
    assert load_bench(tmp_path / "bench.usda").actuators[0].effects == (LAG,)


def test_damaged_record_loads_without_effects_and_says_so(tmp_path: Path) -> None:
    """The robot still loads, and a warning names prim, entry and remedy."""
    robot = Path(shutil.copy(ASSETS / "mr_go.usda", tmp_path / "robot.usda"))
    assert main(["asset", "apply", str(robot), str(save_model(model(LAG), tmp_path / "model.json"))]) == 0
    stage = Usd.Stage.Open(str(robot))
    attribute = stage.GetPrimAtPath("/mr_go/parts/MRDevice").GetAttribute(RECORD)
    attribute.Set(attribute.Get().replace("0.03", "-0.03"))
    stage.Save()
    found = load_robot(robot)
    assert not any(a.effects for a in found.actuators)
    with pytest.warns(UserWarning, match="without effects.*FL_calf.*time_constant = -0.03.*0 or"):
        build_scene(found, dt=0.005)
    build_scene(with_model(found, model(LAG)), dt=0.005)


@pytest.mark.parametrize("command", ["impact", "train", "play"])
def test_commands_refuse_a_bad_model_in_one_line(command: str, tmp_path: Path, refused: Refused) -> None:
    """An unknown parameter of an effect: one line with file, place and what is known, exit code 2."""
    path = save_model(model(LAG), tmp_path / "model.json")
    path.write_text(path.read_text().replace("time_constant", "lag"))
    argv = {"impact": [], "train": ["--num-envs", "2"], "play": ["--agent", "zero", "--num-envs", "1"]}[command]
    said = refused(command, *argv, "--model", path, "--out", tmp_path / "out")
    assert f"{path}: effects[0].parameters.lag: coil_lag has no such parameter; known: time_constant, hold" in said
    assert not (tmp_path / "out").exists()
