"""A robot from MJCF to a USD file that the task takes: legs, stance, scales, devices, refusals."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import torch
import warp as wp

from mrwarp.cli import main
from mrwarp.env import gait
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.natural_units import in_natural_units, scales
from mrwarp.env.rewards import weight
from mrwarp.env.sim import robot_scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.params import MrParams
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.usd.asset import RobotAsset, load_robot
from mrwarp.usd.robot import STAND_HEIGHT
from mrwarp.viewing.shapes import Part, feet, robot_shapes
from tests.messages import Refused

SIX = tuple((x, y) for x in (0.3, 0.0, -0.3) for y in (0.1, -0.1))


def imported(file: Path, *options: str) -> RobotAsset:
    """The robot of ``mrwarp robot import``."""
    out = file.with_suffix(".usda")
    assert main(["robot", "import", str(file), "--out", str(out), "--overwrite", *options]) == 0
    return load_robot(robot=str(out))


def test_no_network_is_loaded_for_a_plain_robot() -> None:
    """Torch takes a third of the time of an import, and no robot without devices needs it."""
    code = "import sys, mrwarp.robots.write_robot; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.fixture(scope="module")
def beast(robot) -> RobotAsset:  # noqa: ANN001
    """Four legs, without a keyframe."""
    return imported(robot())


def test_legs_are_found_in_the_order_of_the_gait(beast: RobotAsset) -> None:
    """Front before rear, left before right, for any order in the file; diagonal pairs share a phase."""
    layout = beast.layout
    assert (layout.trunk, layout.leg_names) == ("torso", ("leg_d", "leg_c", "leg_b", "leg_a"))
    assert [leg.phase for leg in layout.legs] == [0.0, 0.5, 0.5, 0.0]
    assert layout.legs[0].joints == ("leg_d_roll", "leg_d_pitch", "leg_d_knee")


def test_masses_inertias_limits_and_motors_arrive(beast: RobotAsset, robot) -> None:  # noqa: ANN001
    """The converted model has the mass matrix of the file's own, at the same pose, and its limits."""
    own = mujoco.MjModel.from_xml_path(str(beast.path.with_suffix(".xml")))
    scene = robot_scene(beast)
    matrices = []
    for model in (own, scene.model):
        names = [model.joint(i).name for i in range(model.njnt)]
        data = mujoco.MjData(model)
        order = [next(i for i, name in enumerate(names) if name.endswith(joint)) for joint in beast.layout.joints]
        data.qpos[:7] = (0.0, 0.0, 0.6, 1.0, 0.0, 0.0, 0.0)
        data.qpos[model.jnt_qposadr[order]] = np.linspace(-0.5, 0.6, len(order))
        mujoco.mj_forward(model, data)
        full = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, full, data.qM) if hasattr(data, "qM") else mujoco.mj_fullM(model, data, full)
        dofs = [*range(6), *model.jnt_dofadr[order]]
        matrices.append(full[np.ix_(dofs, dofs)])
        np.testing.assert_allclose(model.jnt_range[order[2]], (-2.6, -0.4), atol=1e-5)
    np.testing.assert_allclose(matrices[1], matrices[0], atol=2e-6)
    assert {a.tau_limit for a in beast.actuators} == {30.0}
    assert {a.kp for a in beast.actuators} == {45.0}


def test_the_solved_stance_stands_below_the_hips(beast: RobotAsset) -> None:
    """Feet level, below the pitch joints, at 0.73 of the reach, joints of both sides equal."""
    scene = robot_scene(beast)
    soles = scene.soles
    assert np.ptp(soles[:, 2]) < 1e-3
    np.testing.assert_allclose(np.abs(soles[:, 0]), 0.3, atol=0.02)
    np.testing.assert_allclose(np.abs(soles[:, 1]), 0.18, atol=0.01)
    reach = np.hypot(0.01, 0.25) + np.hypot(0.005, 0.24)
    assert scene.stand_height == pytest.approx(0.73 * reach + 0.025, abs=0.01)


def test_feet_of_any_chain_are_where_mujoco_has_them(beast: RobotAsset) -> None:
    """These legs have no closed form: they are followed joint by joint."""
    scene = robot_scene(beast)
    legs = gait.legs_of(scene)
    assert legs.planar == 0
    rng, data = np.random.default_rng(0), mujoco.MjData(scene.model)
    q = rng.uniform(-1.0, 1.0, size=(5, 12)).astype(np.float32)
    found = wp.zeros((5, 4), dtype=wp.vec3, device="cpu")
    wp.launch(foot_points, (5, 4), [legs, wp.array(q, device="cpu")], [found], device="cpu")
    for k in range(5):
        data.qpos[:7] = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0)
        data.qpos[scene.q_adr] = q[k]
        mujoco.mj_kinematics(scene.model, data)
        np.testing.assert_allclose(found.numpy()[k], data.geom_xpos[scene.feet], atol=2e-6)


@wp.kernel
def foot_points(legs: gait.Legs, q_in: wp.array2d[float], out: wp.array2d[wp.vec3]):
    """Centre of every foot."""
    i, leg = wp.tid()
    out[i, leg] = gait.foot_point(legs, leg, q_in, i)


@pytest.mark.parametrize(
    ("places", "phases"), [(SIX, [0.0, 0.5, 0.5, 0.0, 0.0, 0.5]), (((0.0, 0.1), (0.0, -0.1)), [0.0, 0.5])]
)
def test_other_numbers_of_legs_step(robot, places, phases) -> None:  # noqa: ANN001
    """Six legs have a tripod, two alternate; sizes of actions and observations follow."""
    asset = imported(robot(places))
    assert [leg.phase for leg in asset.layout.legs] == phases
    env = WalkEnv(TaskCfg(num_envs=2, robot=str(asset.path)))
    assert env.num_actions == 3 * len(places)
    assert env.cfg.fall_cost == (1.0 if len(places) == 2 else 0.0)
    obs, reward, _, _ = env.step(torch.zeros(2, env.num_actions))
    assert obs["actor"].shape == (2, 11 + 9 * len(places)) and bool(torch.isfinite(reward).all())


def test_the_task_scales_with_the_robot(beast: RobotAsset) -> None:
    """Lengths by the stance, times by its root, torques by mass times length; the shipped robot's task is untouched."""
    scene, cfg = robot_scene(beast), TaskCfg()
    by, scaled = scales(scene), in_natural_units(cfg, scene)
    length = scene.stand_height / STAND_HEIGHT
    assert by.length == length and by.mass == pytest.approx((8.0 + 4 * 2.1) / 12.6, rel=1e-6)
    assert scaled.gait_frequency == pytest.approx(cfg.gait_frequency / length**0.5)
    assert scaled.commands.v_x[1] == pytest.approx(cfg.commands.v_x[1] * length**0.5)
    assert weight(scaled.rewards, "effort") == pytest.approx(weight(cfg.rewards, "effort") / (by.mass * length) ** 2)
    assert in_natural_units(cfg, robot_scene()) is cfg


def test_power_has_its_price_with_the_robots_own_motors(beast: RobotAsset) -> None:
    """Motors of 30 N·m lose there what Go1's do at 23.7, times the robot's power; their work is as it is."""
    env = WalkEnv(replace(TaskCfg(num_envs=4, robot=str(beast.path)), decimation=1))
    factor = env.scales.power * 1.5 * 0.128 / 0.639**2 * (23.7 / 30.0) ** 2
    env.step(torch.full((4, 12), 0.5))
    tau, qd = env.view(env.actuator.tau_motor), env.qd  # one torque step, after which the ledger counts
    expected = (factor * tau.square() + tau * qd).sum(1)
    torch.testing.assert_close(env.power, expected, rtol=1e-3, atol=1e-2)


def test_devices_go_onto_any_joint_and_off_again(beast: RobotAsset, capsys: pytest.CaptureFixture[str]) -> None:
    """The device takes the motor's gains and limit, measures from the stance, and leaves the motor as it was."""
    file = str(beast.path)
    other = str(beast.path.with_name("other.usda"))
    assert main(["robot", "fit-device", file, "--joint", "*_pitch", "leg_a_knee", "--out", other]) == 0
    found = {a.joint: a for a in load_robot(robot=other).actuators}
    assert sorted(name for name, a in found.items() if a.mr) == ["leg_a_knee", *(f"leg_{x}_pitch" for x in "abcd")]
    device = found["leg_a_knee"].mr
    assert device is not None
    assert (device.motor.kp_base, device.motor.tau_limit) == (45.0, 30.0)
    assert device.bouc_wen.q_neutral == beast.layout.neutral["leg_a_knee"]
    assert device.bouc_wen.K1 == MrParams().bouc_wen.K1
    env = WalkEnv(TaskCfg(num_envs=2, robot=other))
    assert len(env.actuator.mr_joints) == 5
    env.step(torch.zeros(2, 12))
    assert main(["robot", "fit-device", other, "--joint", "*", "--remove"]) == 0
    left = load_robot(robot=other).actuators
    assert [(a.kp, a.kd, a.tau_limit, a.mr) for a in left] == [
        (pytest.approx(a.kp), pytest.approx(a.kd), pytest.approx(a.tau_limit), None) for a in beast.actuators
    ]
    assert "leg_a_knee" in capsys.readouterr().out


def test_a_keyframe_options_and_hands_decide(robot) -> None:  # noqa: ANN001
    """The file's keyframe is the stance; options win over it; what stands in the USD file wins at last."""
    keyframe = [0.0, 0.7, -1.4] * 4
    file = robot(keyframe=keyframe)
    assert imported(file).layout.neutral["leg_a_knee"] == pytest.approx(-1.4)
    asset = imported(file, "--pose", "*_knee=-1.3", "--kp", "*=60", "--gait", "trot")
    assert asset.layout.neutral["leg_c_knee"] == pytest.approx(-1.3) and asset.actuators[0].kp == 60.0
    text = asset.path.read_text()
    line = next(row for row in text.splitlines() if "double mrwarp:neutral = -74.4" in row)
    asset.path.write_text(text.replace(line, line.replace("-74.4", "-74.0"), 1))
    assert sorted(load_robot(robot=str(asset.path)).layout.default_q)[3] == pytest.approx(-1.2929, abs=0.002)


JOINT = '<body name="arm"><joint name="extra" type="{kind}"/>{inertial}</body>'

BAD = {
    "no torque limit": ({"limit": None}, [], ("leg_", "torque limit", "--torque-limit")),
    "a joint that is not there": ({}, ["--kp", "*_wrist=3"], ("*_wrist", "leg_a_knee")),
    "a misspelt joint": ({}, ["--kp", "leg_a_kne=3"], ("leg_a_kne;", "did you mean 'leg_a_knee'?")),
    "a gait of other robots": ({}, ["--gait", "tripod"], ("tripod", "6 legs", "4")),
    "a stance beyond limits": ({}, ["--pose", "*_knee=0.5"], ("_knee", "0.500 rad", "-2.600 to -0.400")),
    "a foot that is none": ({}, ["--feet", "torso"], ("torso", "leg_a_lower")),
    "a joint without a motor": (
        {"tail": JOINT.format(kind="hinge", inertial='<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>')},
        [],
        ("extra", "no torque limit where other joints have an actuator", "--fix extra", "--torque-limit 'extra=NM'"),
    ),
    "a body without mass": ({"tail": JOINT.format(kind="hinge", inertial="")}, [], ("mass",)),
    "a mesh that is missing": (
        {"tail": '<geom type="mesh" mesh="shell"/>', "head": '<asset><mesh name="shell" file="shell.stl"/></asset>'},
        [],
        ("shell.stl",),
    ),
    "two trunks": (
        {"more": '<body name="twin"><freejoint/><geom type="sphere" size="0.1" mass="1"/></body>'},
        [],
        ("torso", "twin", "two trunks"),
    ),
    "a gain that is none": ({}, ["--kp", "*=nan"], ("--kp: *: nan must be a positive number",)),
    "a torque limit below 0": ({}, ["--torque-limit", "*=-3"], ("--torque-limit: *: -3 must be a positive number",)),
    "an angle without a joint": ({}, ["--pose", "=1"], ("'=1' is not NAME=VALUE",)),
    "a slider": (
        {"tail": JOINT.format(kind="slide", inertial='<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>')},
        [],
        ("extra", "slide", "hinges"),
    ),
}


@pytest.mark.parametrize("what", BAD)
def test_bad_robots_are_refused_in_one_line(
    robot,  # noqa: ANN001
    what: str,
    refused: Refused,
) -> None:
    """Exit code 2, one line that says where and what to write, nothing written."""
    choices, options, parts = BAD[what]
    file = robot(**choices)
    out = file.with_suffix(".usda")
    error = refused("robot", "import", file, "--out", out, *options)
    assert all(part in error for part in parts), error
    assert sorted(file.parent.iterdir()) == [file]


def test_pictures_and_ground_need_not_be_there(robot) -> None:  # noqa: ANN001
    """Textures and height fields are not read; meshes that other shapes are fitted to are left out like drawn ones."""
    head = (
        '<asset><texture name="sky" type="skybox" file="sky.png"/><texture name="skin" type="2d" file="skin.png"/>'
        '<material name="skin" texture="skin"/><hfield name="hills" file="hills.png" size="1 1 1 1"/>{}</asset>'
    )
    shapes = '<geom type="sphere" size="0.01" material="skin" mass="0"/>{}'
    ground = '<geom type="hfield" hfield="hills"/>'
    shell = ('<mesh name="shell" file="shell.stl"/>', '<geom type="box" mesh="shell" mass="0"/>')
    whole = imported(robot(head=head.format(""), tail=shapes.format(""), more=ground))
    fitted = robot(head=head.format(shell[0]), tail=shapes.format(shell[1]), more=ground)
    assert imported(fitted, "--skip-meshes").layout == whole.layout
    assert main(["robot", "import", str(fitted), "--out", str(fitted.with_name("out.usda"))]) == 2


def test_the_robot_is_drawn(beast: RobotAsset, tmp_path: Path) -> None:
    """A picture of the robot standing."""
    picture = tmp_path / "beast.png"
    assert main(["robot", "show", str(beast.path), "--png", str(picture)]) == 0
    assert picture.read_bytes()[:4] == b"\x89PNG"


def test_meshes_are_drawn_in_place_of_what_collides(robot, tmp_path: Path) -> None:  # noqa: ANN001
    """The trunk's box is hidden by its mesh, which lies where the file has it; feet stay."""
    corners = "-0.3 -0.1 0 0.3 -0.1 0 0.3 0.1 0 -0.3 0.1 0 0 0 0.2"
    head = f'<asset><mesh name="shell" vertex="{corners}"/></asset>'
    tail = '<geom type="mesh" mesh="shell" contype="0" conaffinity="0" mass="0" pos="0.05 0 0.05"/>'
    asset = imported(robot(head=head, tail=tail))
    scene = robot_scene(asset)
    shapes = robot_shapes(scene)
    (trunk,) = (shape for shape in shapes if shape.part is Part.TRUNK)
    assert trunk.kind == mujoco.mjtGeom.mjGEOM_MESH and len(feet(scene, shapes)) == 4
    assert trunk.points is not None and trunk.faces is not None
    np.testing.assert_allclose(trunk.points.min(axis=0), (-0.25, -0.1, 0.05), atol=1e-6)
    np.testing.assert_allclose(trunk.points.max(axis=0), (0.35, 0.1, 0.25), atol=1e-6)
    picture = tmp_path / "shell.png"
    assert main(["robot", "show", str(asset.path), "--png", str(picture)]) == 0 and picture.is_file()


@pytest.fixture(scope="module")
def three(robot) -> Path:  # noqa: ANN001
    """A robot of three legs."""
    return imported(robot(((0.3, 0.0), (-0.2, 0.2), (-0.2, -0.2)))).path


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An arm of one joint."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.xml").write_text(
        '<mujoco><worldbody><body><joint name="j" range="-90 90" actuatorfrcrange="-9 9"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -1" size="0.02"/></body></worldbody></mujoco>'
    )
    return imported(folder / "arm.xml").path


@pytest.mark.parametrize(
    ("line", "parts"),
    [
        ("mission --robot go2.usda", ("'go2.usda'", "go1, mr_go, mr_go_sal", "mrwarp walk --robot go2.usda")),
        ("impact --robot {three}", ("beast.usda", "--policy", "mrwarp train")),
        ("impact --robot {three} --policy {policy}", ("12 joints", "beast.usda has 9", "mrwarp train")),
        ("walk --robot {three} --policy {policy}", ("12 joints", "beast.usda has 9", "mrwarp train")),
        ("play --robot {three} --policy {policy} --png {png}", ("12 joints", "beast.usda has 9", "mrwarp train")),
        ("train --robot {arm}", ("arm.usda", "no legs to walk with", "--agent sine")),
        ("walk --robot {arm} --policy {policy}", ("arm.usda", "no legs to walk with", "mrwarp impact")),
        ("log record --robot {arm} --motion walk=5", ("arm.usda", "stands on no feet", "chirp, slow, steps")),
    ],
)
def test_a_robot_that_does_not_fit_is_refused_at_once(
    line: str,
    parts: tuple[str, ...],
    three: Path,
    arm: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    refused: Refused,
) -> None:
    """One line with both sides and a remedy; nothing is made."""
    monkeypatch.chdir(tmp_path)
    words = line.format(three=three, arm=arm, policy=DEFAULT_POLICY, png="w.png").split()
    error = refused(*words)
    assert all(part in error for part in parts), error
    assert not list(tmp_path.iterdir())
