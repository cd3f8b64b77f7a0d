"""The robot of a log in MuJoCo: its mass, where its feet end, and which of them stand."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from mrwarp.robot_logs.replay_model import _hold, _sole, read_spec
from mrwarp.robot_logs.windows import _loaded
from mrwarp.sysid.settings import Settings

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


@pytest.mark.parametrize(
    ("drives", "held"),
    [
        ('<motor joint="elbow"/><position joint="grip"/>', ("grip",)),  # the spring has no drive
        ('<motor joint="elbow"/>', ()),
        ("", ("spring", "grip")),  # as of a URDF, which names none
    ],
)
def test_a_joint_that_the_log_lacks_is_held_by_its_drive(drives: str, held: tuple[str, ...]) -> None:
    """Left to itself a gripper would swing in the replay, and its arm be blamed; passive joints do move."""
    names, end = ("elbow", "spring", "grip"), "</body>" * 3
    links = "".join(f'<body><joint name="{x}"/><geom size="0.1" mass="1"/>' for x in names)
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><worldbody>{links}{end}</worldbody><actuator>{drives}</actuator></mujoco>"
    )
    assert _hold(spec, ["elbow"], ()) == held
    for drive in spec.actuators:
        spec.delete(drive)
    assert spec.compile().nv == len(names) - len(held)
