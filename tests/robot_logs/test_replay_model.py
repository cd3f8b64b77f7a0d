"""The robot of a log in MuJoCo: its mass, where its feet end, and which of them stand."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from mrwarp.robot_logs.replay_model import Stance, _sole, read_spec, replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.windows import _loaded
from mrwarp.sysid.settings import Settings
from tests.robot_logs.arm_log import arm_log

CORNERS = "0 0 0  0.1 0 0  0 0.08 0  0 0 0.06  0.03 0.02 -0.05"
"""Of a mesh [m]."""


@pytest.mark.parametrize(
    "foot",
    [
        '<geom type="sphere" size="0.02"/>',
        '<geom type="box" size="0.11 0.05 0.015"/>',
        '<geom type="capsule" size="0.02 0.08"/>',
        '<geom type="cylinder" size="0.04 0.02"/>',
        '<geom type="ellipsoid" size="0.09 0.04 0.02"/>',
        '<geom type="mesh" mesh="toe"/>',
        '<geom size="0.01" pos="0.1 0 0"/><geom size="0.01" pos="-0.1 0.05 0"/>',
    ],
)
def test_a_foot_ends_where_its_shape_touches_the_ground(foot: str) -> None:
    """However it is turned: 1 mm below the ground MuJoCo sees it 1 mm deep."""
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><mesh name="toe" vertex="{CORNERS}"/></asset><worldbody><geom type="plane" size="1 1 1"/>'
        f"<body><freejoint/>{foot}</body></worldbody></mujoco>"
    )
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(20):
        data.qpos[:] = [0.3, -0.2, 1.0, *rng.normal(size=4)]
        mujoco.mj_kinematics(model, data)
        data.qpos[2] -= _sole(model, data, list(range(1, model.ngeom)))[2] + 0.001
        mujoco.mj_forward(model, data)
        assert data.contact.dist[: data.ncon].min() == pytest.approx(-0.001, abs=2e-5)


def test_a_foot_that_lands_or_lifts_does_not_stand() -> None:
    """A foot that bears less than half of its load still moves: the trunk's speed is not that of it."""
    mj = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="FL_calf"><geom size="0.02"/></body></worldbody></mujoco>'
    )
    model: Any = SimpleNamespace(model=mj, feet=(0,), settings=Settings())
    force = np.array([0.0] * 40 + [16.0, 24.0] + [40.0] * 40)
    run: Any = SimpleNamespace(samples=len(force), feet={"FL": force})
    assert _loaded(model, run)[:, 0].tolist() == [False] * 41 + [True] * 41


def test_a_fixed_link_without_inertial_has_no_mass(tmp_path: Path) -> None:
    """In a URDF a shape has no density; MuJoCo alone would add 1 kg of water for this one."""
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    links = "".join(
        f'<link name="{x}"><inertial><mass value="2"/>{inertia}</inertial></link>' for x in ("trunk", "leg")
    )
    sole = '<link name="sole"><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision></link>'
    joints = (("trunk", "leg", "revolute"), ("leg", "sole", "fixed"))
    rest = "".join(
        f'<joint name="{b}" type="{kind}"><parent link="{a}"/><child link="{b}"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="9" velocity="9"/></joint>'
        for a, b, kind in joints
    )
    (tmp_path / "robot.urdf").write_text(f'<robot name="robot">{links}{sole}{rest}</robot>')
    model = read_spec(tmp_path / "robot.urdf").compile()
    assert model.body("leg").mass[0] == pytest.approx(2.0)


@pytest.mark.parametrize(("effort", "limit"), [(30.0, 30.0), (8.0, 8.0), (4.0, None)])
def test_a_limit_that_the_torque_goes_far_beyond_is_none(effort: float, limit: float | None, tmp_path: Path) -> None:
    """As of a URDF whose effort is a placeholder: the replay would be too weak, and the robot be blamed."""
    joint = f'<joint name="a" axis="0 1 0" actuatorfrcrange="{-effort} {effort}"/>'
    (tmp_path / "robot.xml").write_text(
        f'<mujoco><worldbody><body>{joint}<geom size="0.1" pos="0.3 0 0"/></body></worldbody></mujoco>'
    )
    t = 0.01 * np.arange(200)
    rows = np.column_stack([t, np.zeros_like(t), np.zeros_like(t), 10.0 * np.sin(5.0 * t)])
    np.savetxt(tmp_path / "run.csv", rows, delimiter=",", header="t,q.a,q_des.a,tau.a", comments="")
    header = {"robot": "robot.xml", "base": "fixed", "kp": 300, "kd": 9, "tau_is": "estimate"}
    (tmp_path / "log.json").write_text(json.dumps(header))
    model = replay_model(tmp_path / "robot.xml", load_log(tmp_path))
    assert list(model.beyond) == ([] if limit else ["a"]) and bool(model.limited[0]) == bool(limit)
    assert bool(model.model.jnt_actfrclimited[0]) == bool(limit)
    assert model.model.actuator_forcerange[0, 1] == (limit or 1e6)


@pytest.mark.parametrize(("height", "soft"), [(0.0, 0.02), (-0.7, 0.02), (0.3, 0.09)])
def test_a_robot_stands_on_the_floor_of_its_file(height: float, soft: float, tmp_path: Path) -> None:
    """Its feet sink as far as MuJoCo lets them, however soft they are and wherever the floor is."""
    legs = "".join(
        f'<body pos="{x} {y} 0"><joint name="{name}" axis="0 1 0"/><geom type="capsule" size="0.02" '
        f'fromto="0 0 0 0 0 -0.3" mass="0.2" solref="{soft} 1"/></body>'
        for name, x, y in (("a", 0.2, 0.1), ("b", 0.2, -0.1), ("c", -0.2, 0.1), ("d", -0.2, -0.1))
    )
    (tmp_path / "robot.xml").write_text(
        f'<mujoco><worldbody><geom type="plane" size="3 3 1" pos="0 0 {height}" solref="{soft} 1"/>'
        '<body name="ramp" pos="2 0 0"><geom type="box" size="0.1 0.1 0.01"/></body>'
        '<body name="ball"><freejoint/><geom size="0.1"/></body><body name="trunk" pos="0 0 1"><freejoint/>'
        f'<geom type="box" size="0.2 0.1 0.05" mass="10"/>{legs}</body></worldbody><actuator>'
        '<motor joint="a" gear="5" armature="4e-5" ctrlrange="-2 3"/></actuator></mujoco>'
    )
    names, t = "abcd", 0.01 * np.arange(60)
    zeros = np.zeros((len(t), 8))
    header = ",".join(["t", *(f"q.{x}" for x in names), *(f"q_des.{x}" for x in names)])
    np.savetxt(tmp_path / "run.csv", np.column_stack([t, zeros]), delimiter=",", header=header, comments="")
    (tmp_path / "log.json").write_text(json.dumps({"robot": "robot.xml", "base": "free", "kp": 300, "kd": 9}))
    model = replay_model(tmp_path / "robot.xml", load_log(tmp_path))
    mj, data = model.model, mujoco.MjData(model.model)
    assert len(model.feet) == 4 and model.free and mj.nq == 11
    assert mj.dof_armature[model.v_adr].tolist() == [pytest.approx(0.001), 0.0, 0.0, 0.0]
    assert model.limited.tolist() == [True, False, False, False]
    assert mj.actuator_forcerange[0].tolist() == [pytest.approx(-10.0), pytest.approx(15.0)]
    data.qpos[2], _ = Stance(model, mj).trunk(mj.qpos0, np.zeros(mj.nv), np.ones(4, dtype=bool))
    begun = data.qpos[2]
    mj.actuator_biasprm[:, 1:3] = -300.0, -9.0
    for _ in range(2000):
        mujoco.mj_step(mj, data)
    assert data.qpos[2] == pytest.approx(begun, abs=0.1 * model.sink[3])


def test_a_centre_of_mass_at_a_link_s_origin_can_be_moved(tmp_path: Path) -> None:
    """MuJoCo takes one that was compiled there as one that stays: its gravity torque would not change."""
    model = replay_model(tmp_path / "arm.xml", load_log(arm_log(tmp_path, seconds=1.0)))
    spec = model.spec.copy()
    lower = spec.body("lower")
    lower.mass, lower.inertia, lower.ipos, lower.explicitinertial = 0.5, [0.01] * 3, [0.0] * 3, True
    mj = replace(model, spec=spec, compiled={}).at_step(0.001)
    data = mujoco.MjData(mj)
    mj.body_ipos[mj.body("lower").id] = 0.1, 0.0, 0.0
    mujoco.mj_forward(mj, data)
    assert abs(data.qfrc_bias[1]) == pytest.approx(9.81 * 0.5 * 0.1)
