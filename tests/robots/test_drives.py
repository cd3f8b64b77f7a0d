"""Joints without a motor in a file whose other joints have one."""

from collections.abc import Callable
from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.robots.drives import Choices
from mrwarp.robots.foreign import RobotFileError
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from tests.robots.test_strange_robots import DOG, ROD, body

PLAY = "".join(
    body(f"flap{k}", f"0 {0.02 * k} 0.06", f"play{k}", "0 1 0", "-1 1", ROD.format(end="0.05 0 0")) for k in (1, 2)
)


def test_passive_joints_are_held_rather_than_driven(file: Callable[..., Path]) -> None:
    """--fix comes first, with all of them; then the robot is imported."""
    path = file(DOG + PLAY, passive="play")
    with pytest.raises(RobotFileError) as error:
        understand(read_robot(path), Choices())
    text = str(error.value)
    assert "play1, play2 have no torque limit where other joints have an actuator" in text
    assert 0 < text.index("--fix play1 play2") < text.index("--torque-limit")
    assert len(understand(read_robot(path), Choices(fix=("play1", "play2"))).layout.joints) == 12


def test_without_any_motor_a_limit_is_asked_for(file: Callable[..., Path]) -> None:
    """Nothing shows which joints are passive."""
    with pytest.raises(RobotFileError, match="FL_roll has no torque limit; give --torque-limit"):
        understand(read_robot(file(DOG, passive="_")), Choices())


@pytest.mark.parametrize("choices", [Choices(), Choices(kp={"*": 50.0})])
def test_damping_by_rule_is_a_guess(choices: Choices, file: Callable[..., Path]) -> None:
    """Kp of the file or of the user without a Kd: by joint, less those that have one."""
    text = "no damping for FL_pitch, FL_knee, FR_roll and others: Kd = 0.02 s of Kp; --kd changes it"
    more = Choices(kp=choices.kp, kd={"FL_roll": 2.0})
    understood = understand(read_robot(file(DOG)), more)
    assert any(text in note and "[gains" in note for note in understood.notes), understood.notes
    assert understood.drives["FL_knee"].kd == pytest.approx(0.02 * understood.drives["FL_knee"].kp)
    every = understand(read_robot(file(DOG)), Choices(kp=choices.kp, kd={"*": 2.0}))
    assert not any("[gains" in note for note in every.notes)


ARM = """<mujoco><worldbody><body name="base"><geom size=".05"/><body name="l1" pos="0 0 .1">
<joint name="j1" axis="0 1 0" range="-60 60" damping=".3" armature=".01"/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1"/></body></body></worldbody>
<actuator>{}</actuator></mujoco>"""
SERVO = '<position name="a" joint="j1" kp="50" kv="1" forcerange="-15 15"/>'
SUMS = {
    "a motor": ('<motor name="b" joint="j1" ctrlrange="-5 5" gear="2"/>', (50.0, 1.3, 25.0)),
    "damping": ('<velocity name="b" joint="j1" kv="0.5" gear="2" forcerange="-3 3"/>', (50.0, 3.3, 21.0)),
    "a servo": ('<position name="b" joint="j1" kp="20" kv="2" forcerange="-4 4"/>', (70.0, 3.3, 19.0)),
}


@pytest.mark.parametrize("more", SUMS)
def test_actuators_of_one_joint_add_up(more: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Kp, Kd with the joint's damping, and torque limit, as MuJoCo reads them; the note has their names."""
    second, numbers = SUMS[more]
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(SERVO + second))
    (joint,) = read_robot(path).joints
    assert (joint.kp, joint.kd, joint.torque_limit) == pytest.approx(numbers)
    assert main(["robot", "import", str(path), "--out", str(tmp_path / "arm.usda"), "--base", "fixed"]) == 0
    said = capsys.readouterr().out
    assert "share a joint were added up: a and b of j1" in said and "are what MuJoCo reads" in said


@pytest.mark.parametrize(
    ("second", "fault"),
    [
        ('<motor name="b" joint="j1" ctrlrange="0 5"/>', "the range of one is 0 to 5"),
        ('<motor name="b" joint="j1" ctrlrange="-5 5" gear="-1"/>', "by 50, -1 for a command of 1"),
        ('<general name="b" joint="j1" biastype="affine" biasprm="0 3 0"/>', "the gains of one drive away: 3 and 0"),
    ],
)
def test_actuators_that_do_not_add_up(second: str, fault: str, tmp_path: Path) -> None:
    """Refused with both names, the value and the remedy."""
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(SERVO + second))
    with pytest.raises(RobotFileError, match=f"j1 has the actuators a and b, .*{fault}; write one actuator"):
        read_robot(path)
