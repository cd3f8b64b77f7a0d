"""Names of legs against where they are."""

from collections.abc import Callable
from pathlib import Path

import pytest

from mrwarp.robots.drives import Choices
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from tests.robots.test_strange_robots import PLACES, leg, walker

WORDS = {"FR": "motor_front_right", "FL": "motor_front_left", "RR": "motor_rear_right", "RL": "motor_rear_left"}
AXES = {"x": lambda x, y: (x, y), "-x": lambda x, y: (-x, -y), "y": lambda x, y: (-y, x), "-y": lambda x, y: (y, -x)}


@pytest.mark.parametrize(("axis", "words"), [*((axis, True) for axis in AXES), ("-x", False)])
def test_names_say_where_it_looks(file: Callable[..., Path], axis: str, words: bool) -> None:
    """A note with the option where names and geometry differ; none with that option."""
    inner = "".join(leg(WORDS[name] if words else name, *AXES[axis](*at)) for name, at in PLACES.items())
    robot = read_robot(file(inner))
    said = [note for note in understand(robot, Choices()).notes if "looks along" in note]
    assert len(said) == (axis != "x") and all(f"--forward {axis} turns it" in note for note in said)
    assert not any("looks along" in note for note in understand(robot, Choices(forward=axis)).notes)


def test_left_and_right_of_a_biped(file: Callable[..., Path]) -> None:
    """Without a front there are sides."""
    path = file(walker("left", -0.1) + walker("right", 0.1), limit=100.0)
    assert any("--forward -x turns it" in note for note in understand(read_robot(path), Choices()).notes)
