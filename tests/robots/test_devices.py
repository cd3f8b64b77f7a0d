"""Devices at any joint: their size, joints that no foot loads, and joints that are held."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
import warp as wp

from mrwarp.cli import main
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.sim import robot_scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.params import MrParams
from mrwarp.robots.fit_device import LIMIT
from mrwarp.usd.asset import load_robot

ARM = """<body name="arm" pos="0.1 0 0.1"><inertial pos="0 0 0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
<joint name="shoulder" type="hinge" axis="0 1 0" range="-2 2" armature="0.01"/>
<geom type="capsule" fromto="0 0 0 0 0 0.2" size="0.02" contype="0" conaffinity="0"/>
<body name="hand" pos="0 0 0.3"><inertial pos="0.05 0 0" mass="0.5" diaginertia="0.001 0.002 0.003"/>
<joint name="wrist" type="hinge" axis="1 0 0" range="-2 2" armature="0.01"/></body></body>"""


def imported(file: Path, *options: str) -> str:
    """File of ``mrwarp robot import``."""
    out = file.with_suffix(".usda")
    assert main(["robot", "import", str(file), "--out", str(out), "--overwrite", *options]) == 0
    return str(out)


@pytest.fixture(scope="module")
def plain(robot, tmp_path_factory: pytest.TempPathFactory) -> Callable[[], str]:  # noqa: ANN001
    """Makes a copy of a robot with four legs, imported once."""
    file = imported(robot())

    def copy() -> str:
        return str(shutil.copy(file, tmp_path_factory.mktemp("robot")))

    return copy


def test_held_joints_leave_one_body_of_the_same_mass_moment_and_inertia(robot) -> None:  # noqa: ANN001
    """The trunk with the arm at an angle, composed by hand."""
    file = imported(
        robot(tail=ARM), "--torque-limit", "*=30", "--fix", "shoulder", "wrist", "--pose", "shoulder=0.5", "wrist=1"
    )
    scene = robot_scene(load_robot(robot=file))
    assert "shoulder" not in scene.joints and len(scene.joints) == 12
    model, trunk = scene.model, 1
    c, s = np.cos(0.5), np.sin(0.5)
    pitch = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    roll = np.array([[1, 0, 0], [0, np.cos(1), -np.sin(1)], [0, np.sin(1), np.cos(1)]])
    base = np.array([0.1, 0.0, 0.1])
    points = [np.zeros(3), base + pitch @ [0, 0, 0.1], base + pitch @ ([0, 0, 0.3] + roll @ [0.05, 0, 0])]
    turns = [np.eye(3), pitch, pitch @ roll]
    own = [np.diag(x) for x in ([0.1, 0.3, 0.3], [0.01] * 3, [0.001, 0.002, 0.003])]
    masses = np.array([8.0, 1.0, 0.5])
    com = masses @ points / masses.sum()
    inertia = sum(
        R @ J @ R.T + m * ((p - com) @ (p - com) * np.eye(3) - np.outer(p - com, p - com))
        for R, J, m, p in zip(turns, own, masses, points, strict=True)
    )
    assert model.body_mass[trunk] == pytest.approx(9.5)
    np.testing.assert_allclose(model.body_ipos[trunk], com, atol=1e-6)
    np.testing.assert_allclose(model.body_inertia[trunk], np.sort(np.linalg.eigvalsh(inertia))[::-1], rtol=1e-4)


def test_a_stronger_device_has_its_torques_and_currents(plain: Callable[[], str]) -> None:
    """Torques in proportion, the coil by the third root, gates by the weight; angles and currents as they were."""
    file = plain()
    assert main(["robot", "fit-device", file, "--joint", "*_knee", "--scale", "limit"]) == 0
    device = next(a.mr for a in load_robot(robot=file).actuators if a.mr)
    factor, paper = 30.0 / LIMIT, MrParams()
    assert device.hold.T_max == pytest.approx(factor * paper.hold.T_max)
    assert device.bouc_wen.sliding_torque(1.5) == pytest.approx(factor * paper.bouc_wen.sliding_torque(1.5))
    assert device.coil.coil_resistance == pytest.approx(4.0 * factor ** (1 / 3))
    assert (device.hold.K, device.bouc_wen.beta, device.coil.current_max) == (
        paper.hold.K,
        paper.bouc_wen.beta,
        paper.coil.current_max,
    )
    assert device.motor.tau_limit == 30.0
    assert device.gate.f_th == pytest.approx(5.0 * (8.0 + 4 * 2.1) / 12.6, abs=1e-3)


def test_several_kinds_at_once_and_a_joint_without_a_foot(robot) -> None:  # noqa: ANN001
    """Weak devices at hips, a strong one at a joint of no leg: it has the current under any load of feet, and holds."""
    file = imported(robot(tail=ARM), "--torque-limit", "*=30", "--kd", "shoulder=5")
    assert main(["robot", "fit-device", file, "--joint", "*_pitch", "--scale", "0.5"]) == 0
    assert main(["robot", "fit-device", file, "--joint", "shoulder", "--scale", "2"]) == 0
    env = WalkEnv(TaskCfg(num_envs=2, robot=file, randomize="none"))
    env.current_e.fill_(1.5)
    legs = env.sim.scene.legs
    slots = [legs[joint] for joint in env.actuator.mr_joints]
    assert slots == [0, 1, 2, 3, -1] and env.sim.scene.device_names[-1] == "shoulder"
    assert wp.to_torch(env.actuator.param("T_max"))[0].tolist() == pytest.approx([0.5 * 26.59697] * 4 + [2 * 26.59697])
    for _ in range(20):
        env.step(torch.zeros(2, env.num_actions))
    env.actuator.predict()
    current, bound = env.view(env.actuator.current), env.view(env.actuator.bound)
    joint = env.actuator.mr_joints[-1]
    assert current[:, -1].tolist() == [1.5, 1.5]
    assert env.view(env.actuator.m_hold)[:, -1].tolist() == [0.0, 0.0]
    slow = env.qd[:, joint].abs() < 0.2
    held = MrParams().hold
    yields = 2.0 * held.T_max * 1.5**held.n / (held.K**held.n + 1.5**held.n)
    assert bool(slow.any()) and torch.allclose(bound[slow, joint], torch.tensor(yields, dtype=torch.float32), rtol=1e-4)


def test_a_robot_without_devices_steps(plain: Callable[[], str]) -> None:
    """A plain robot is one."""
    env = WalkEnv(TaskCfg(num_envs=2, robot=plain()))
    _, reward, _, _ = env.step(torch.zeros(2, env.num_actions))
    assert not env.actuator.mr_joints and bool(torch.isfinite(reward).all())
