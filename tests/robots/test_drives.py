"""Joints without a motor in a file whose other joints have one."""

from collections.abc import Callable
from pathlib import Path

import pytest

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
