"""Stances that are solved: what they leave over is measured, and what does not stand is not called solved."""

from pathlib import Path

import numpy as np
import pytest

from mrwarp.env.rng import MOST_JOINTS
from mrwarp.robots.drives import Choices
from mrwarp.robots.foreign import RobotFileError
from mrwarp.robots.legs import UnderstoodRobot, understand
from mrwarp.robots.read_robot import read_robot

SOLE = '<geom type="box" size="0.08 0.04 0.01" pos="0.02 0 -0.02"/>'
LEG = """
<body name="{side}_hip" pos="0 {y} 0"><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
<joint name="{side}_pitch" axis="0 {c} {s}" range="-2 2"/>
<body name="{side}_out"><inertial pos="0 0 0" mass="1" diaginertia="0.01 0.01 0.01"/>
<joint name="{side}_roll" axis="1 0 0" range="-0.6 0.6"/>
<body name="{side}_thigh"><inertial pos="0 0 -0.15" mass="2" diaginertia="0.02 0.02 0.01"/>
<joint name="{side}_yaw" axis="0 0 1" range="-1 1"/>
<body name="{side}_shank" pos="0 0 -0.3"><inertial pos="0 0 -0.15" mass="1.5" diaginertia="0.02 0.02 0.01"/>
<joint name="{side}_knee" axis="0 {knee} 0" range="{bend}"/>
<body name="{side}_ankle" pos="0 0 -0.3"><inertial pos="0 0 0" mass="0.3" diaginertia="0.001 0.001 0.001"/>
<joint name="{side}_tilt" axis="0 1 0" range="{ankle}"/>
<body name="{side}_foot"><inertial pos="0 0 0" mass="0.5" diaginertia="0.001 0.001 0.001"/>
<joint name="{side}_side" axis="1 0 0" range="-0.6 0.6"/>{sole}</body></body></body></body></body></body>
"""


def biped(folder: Path, *, cant: float, knee: int = 1, ankle: str = "-1 1", tail: int = 0) -> UnderstoodRobot:
    """A biped whose hips are canted by an angle [deg], understood."""
    c, s = np.cos(np.radians(cant)), np.sin(np.radians(cant))
    bend = "0 2.4" if knee > 0 else "-2.4 0"
    legs = "".join(
        LEG.format(side=side, y=0.1 * sign, c=c, s=-s * sign, knee=knee, bend=bend, ankle=ankle, sole=SOLE)
        for side, sign in (("left", 1.0), ("right", -1.0))
    )
    link = '<body name="t{k}" pos="0 0 0.02"><inertial pos="0 0 0" mass="0.01" diaginertia="1e-4 1e-4 1e-4"/>'
    arm = "".join((link + '<joint name="t{k}" axis="1 0 0" range="-1 1"/>').format(k=k) for k in range(tail))
    box = '<geom type="box" size="0.1 0.1 0.2" pos="0 0 0.2"/>'
    trunk = f'<inertial pos="0 0 0.2" mass="15" diaginertia="0.4 0.4 0.2"/>{box}'
    path = folder / "biped.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian"/><default><joint armature="0.01" actuatorfrcrange="-80 80"/></default>'
        f'<worldbody><body name="trunk" pos="0 0 1"><freejoint/>{trunk}{legs}{arm}'
        f"{'</body>' * tail}</body></worldbody></mujoco>"
    )
    return understand(read_robot(path), Choices())


def stance_note(robot: UnderstoodRobot) -> str:
    """The note on the stance."""
    return next(note for note in robot.notes if "[stance" in note)


def soles(robot: UnderstoodRobot) -> np.ndarray:
    """Axes that point up on each foot [1], shape (2, 3)."""
    poses = robot.robot.poses(robot.layout.neutral)
    return np.array([poses[foot.body].rotation.apply([0.0, 0.0, 1.0]) for foot in robot.feet])


@pytest.mark.parametrize("cant", [0.0, 30.0, 40.0])
@pytest.mark.parametrize("knee", [1, -1])
def test_canted_hips_level_their_soles(cant: float, knee: int, tmp_path: Path) -> None:
    """By the ankles, with knees that bend about either sign of their axis; residuals stand in the note."""
    robot = biped(tmp_path, cant=cant, knee=knee)
    assert np.degrees(np.arccos(soles(robot)[:, 2])).max() < 0.3
    note = stance_note(robot)
    assert "the stance was solved (feet level to 0.0 mm, soles to 0.0°, at 0.90 of the reach" in note
    assert "inside the feet" in note


def test_a_sole_that_no_ankle_levels_is_not_called_solved(tmp_path: Path) -> None:
    """An ankle that is bent by 0.9 rad or more: the angle is named."""
    note = stance_note(biped(tmp_path, cant=0.0, ankle="0.9 1"))
    assert "no stance was found" in note and "a sole is tilted by" in note and "solved" not in note


def test_the_cases_stand(shared_data: Path) -> None:
    """Hips canted by 30°, and legs of a yaw, three pitches and a yaw, whose knees turn about -y."""
    for name, share in (("canted_hip/biped", "0.90"), ("stance_not_solved/quad", "0.74")):
        note = stance_note(understand(read_robot(shared_data / f"cases/{name}.urdf"), Choices()))
        assert "the stance was solved (feet level to 0.0 mm, soles to 0." in note and f"at {share} of the reach" in note


def test_a_robot_of_too_many_joints_is_refused_with_their_number(tmp_path: Path) -> None:
    """12 of the legs and the rest of a tail."""
    assert len(biped(tmp_path, cant=0.0, tail=MOST_JOINTS - 12).layout.joints) == MOST_JOINTS
    with pytest.raises(RobotFileError, match=r"65 joints are driven; at most 64 .* --fix"):
        biped(tmp_path, cant=0.0, tail=MOST_JOINTS - 11)
