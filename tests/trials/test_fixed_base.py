"""An arm whose root stands still, and a leg on a rail: imported, moved and pushed, with devices without gates."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.trials import fixed_base
from mrwarp.usd.asset import load_robot
from tests.messages import Refused

ARM = """<robot name="arm">
<link name="world"/>
{links}
</robot>"""

LINK = """<link name="link{k}"><inertial><origin xyz="0.1 0 0"/><mass value="0.5"/>
<inertia ixx="0.001" iyy="0.002" izz="0.002" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn{k}" type="revolute"><parent link="{parent}"/><child link="link{k}"/><origin xyz="{x} 0 0"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="12" velocity="20"/></joint>"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two links that turn in the horizontal plane, a weak device on the second joint."""
    folder = tmp_path_factory.mktemp("arm")
    links = LINK.format(k=1, parent="world", x=0) + LINK.format(k=2, parent="link1", x=0.2)
    (folder / "arm.urdf").write_text(ARM.format(links=links))
    out = folder / "arm.usda"
    assert main(["robot", "import", str(folder / "arm.urdf"), "--out", str(out)]) == 0
    assert main(["robot", "fit-device", str(out), "--joint", "turn2", "--scale", "limit"]) == 0
    return out


def test_a_push_turns_the_arm_as_a_lagrangian_has_it(arm: Path) -> None:
    """The first instants of a sideways push on the resting arm: the mass matrix of two bars, by hand."""
    asset = load_robot(robot=str(arm))
    assert fixed_base.is_arm(asset) and fixed_base.weight(asset) == pytest.approx(9.81, rel=1e-6)
    scene, trace = fixed_base.move(asset, (0.0, 1.5), seconds=0.01, force=(0.0, 20.0, 0.0))
    assert scene.joints == ("turn1", "turn2")
    rotor = 0.005 * asset.actuators[0].kd  # of the import's rule
    inner, outer, cross = 0.5 * 0.1**2 + 0.002, 0.5 * 0.1**2 + 0.002, 0.5 * 0.2 * 0.1
    matrix = np.array([[inner + outer + 0.5 * 0.2**2 + 2 * cross, outer + cross], [outer + cross, outer]])
    matrix += rotor * np.eye(2)
    wanted = 0.005 * np.linalg.solve(matrix, [20.0 * 0.3, 20.0 * 0.1])
    np.testing.assert_allclose(trace.qd[0, 0], wanted, rtol=0.08)  # the drag of a device without current slows it
    stuck = 20.0 * 0.3 / matrix[0, 0]  # as one bar
    assert abs(trace.qd[1, 0, 1]) < 1e-2  # 9 N·m hold against 2
    assert trace.qd[1, 0, 0] == pytest.approx(0.005 * stuck, rel=1e-2)


def test_play_and_impact_take_an_arm(
    arm: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Refused
) -> None:
    """Tables, pictures, figures; what needs a trunk or a policy is refused in one line."""
    line = ["--robot", str(arm), "--out", str(tmp_path / "out")]
    picture = tmp_path / "sine.png"
    assert main(["play", *line, "--agent", "sine", "--seconds", "1", "--png", str(picture)]) == 0
    assert picture.read_bytes()[:4] == b"\x89PNG" and (tmp_path / "out" / "result.json").is_file()
    assert main(["impact", *line, "--coupling", "explicit", "--current", "0", "1"]) == 0
    assert main(["robot", "show", str(arm), "--png", str(picture)]) == 0
    capsys.readouterr()
    assert "--kind drop" in refused("impact", *line, "--kind", "drop")
    assert "--agent sine" in refused("play", "--agent", "sine")
    assert "has no legs" in refused("play", "--robot", arm, "--agent", "zero", "--png", picture)


def test_an_arm_is_pushed_where_it_gives_way(arm: Path) -> None:
    """Across the stretched links, in the plane in which they turn, with the weight of both."""
    assert fixed_base.default_push(load_robot(robot=str(arm))) == pytest.approx((0.0, 9.81, 0.0), abs=1e-5)


LEG = """<mujoco><compiler angle="radian"/><worldbody><body name="carriage" pos="0 0 0.9">
<joint name="rail" type="slide" axis="0 0 1"/>
<inertial pos="0 0 0" mass="3" diaginertia="0.01 0.01 0.01"/>
<body name="thigh"><joint name="hip" axis="0 1 0" range="-2 2"/>
<inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.01"/>
<body name="shank" pos="0 0 -0.2"><joint name="knee" axis="0 1 0" range="-2.6 -0.1"/>
<inertial pos="0 0 -0.1" mass="0.3" diaginertia="0.003 0.003 0.003"/><geom type="sphere" size="0.02" pos="0 0 -0.2"/>
</body></body></body></worldbody>
<actuator><motor joint="hip" ctrlrange="-24 24"/><motor joint="knee" ctrlrange="-36 36"/></actuator></mujoco>"""


def test_a_leg_on_a_rail_stands_is_pushed_and_jumps_about(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Nothing drives the rail: the foot bears the weight, and a current lets the carriage go less far down."""
    (tmp_path / "leg.xml").write_text(LEG)
    file = str(tmp_path / "leg.usda")
    pose = ["--pose", "hip=0.8", "knee=-1.5", "--kp", "*=80"]
    assert main(["robot", "import", str(tmp_path / "leg.xml"), "--out", file, *pose]) == 0
    assert main(["robot", "fit-device", file, "--joint", "knee"]) == 0
    asset = load_robot(robot=file)
    assert asset.layout.joints == ("hip", "knee") and "rail rail" in capsys.readouterr().out
    scene, trace = fixed_base.move(asset, (0.0, 1.5), seconds=0.4, force=(0.0, 0.0, -4.3 * 9.81))
    data = mujoco.MjData(scene.model)
    data.qpos[:] = fixed_base.on_the_ground(scene)
    mujoco.mj_kinematics(scene.model, data)
    ball = int(np.flatnonzero(scene.model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE)[0])
    assert data.geom_xpos[ball, 2] == pytest.approx(0.02, abs=1e-6)  # it begins on the ground, not in it
    stretched = 0.2 * (np.cos(0.8) + np.cos(0.7)) + 0.02  # of a stance that no weight bends
    assert 0.7 * stretched < trace.end[0, 0, 2] < stretched
    down = trace.end[:, 0, 2] - trace.end[..., 2].min(axis=1)
    assert down[0] > 0.002 and down[1] < 0.5 * down[0]
    assert np.ptp(trace.end[..., :2], axis=1).max() < 1e-9
    assert main(["impact", "--robot", file, "--out", str(tmp_path / "out"), "--coupling", "constraint"]) == 0
    assert main(["play", "--robot", file, "--agent", "sine", "--seconds", "1", "--png", str(tmp_path / "s.png")]) == 0
    assert "carriage" in capsys.readouterr().out
