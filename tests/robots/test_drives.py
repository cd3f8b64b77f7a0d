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
