"""Which chains are legs: all of one build, in the pose that was given or one in which the robot stands."""

from collections.abc import Callable
from pathlib import Path

import pytest

from mrwarp.robots.drives import Choices
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from tests.robots.test_strange_robots import BALL, DOG, ROD, legs_of

FOUR = ("FL", "FR", "RL", "RR")
UNLIMITED = DOG.replace('range="-2.6 -0.5"', "")
SHANK = ROD.format(end="0 0 -0.2") + BALL


def key(front: str, rear: str, quat: str = "1 0 0 0", name: str = "home") -> str:
    """A keyframe of the dog, whose front legs come first in its file."""
    return f'<keyframe><key name="{name}" qpos="0 0 1 {quat} {f"{front} " * 2}{f"{rear} " * 2}"/></keyframe>'


STALE = {
    "front legs in the air, on the hind knees": key("0 2.2 -1.3", "0 -0.9 -1.5"),
    "front legs in the air": key("0 2.2 -1.3", "0 0.7 -1.4"),
    "on all knees": key("0 0.2 -2.5", "0 0.2 -2.5"),
    "on its side": key("0 0.7 -1.4", "0 0.7 -1.4", "0.7071 0.7071 0 0"),
}


@pytest.mark.parametrize(("what", "shank"), [*((what, "ball") for what in STALE), ([*STALE][0], "rod")])
def test_a_stale_keyframe_takes_no_legs(file: Callable[..., Path], what: str, shank: str) -> None:
    """Four legs on their feet, and a note; with a pose the robot stands in it."""
    inner = UNLIMITED.replace(BALL, SHANK) if shank == "rod" else UNLIMITED
    path = file(inner, more=STALE[what])
    found = understand(read_robot(path), Choices())
    assert tuple(legs_of(found)) == FOUR and all(len(joints) == 3 for joints in legs_of(found).values())
    assert [foot.radius for foot in found.feet] == [0.02] * 4 and found.height > 0.2
    assert any("keyframe is no stance" in note for note in found.notes)
    posed = understand(read_robot(path), Choices(pose={"*_pitch": 0.8, "*_knee": -1.5}))
    assert tuple(legs_of(posed)) == FOUR and posed.layout.neutral["RR_knee"] == -1.5
    assert not any(
        "stance was solved" in note or "one was solved" in note for note in posed.notes if "side" not in what
    )


def test_the_keyframe_in_which_it_stands_counts(file: Callable[..., Path]) -> None:
    """One after a stale one is taken, by any name, and the notes say which."""
    stale, other = key("0 2.2 -1.3", "0 -0.9 -1.5"), key("0 0.6 -1.2", "0 0.6 -1.2", name="up")
    both = stale.replace("</keyframe>", other.removeprefix("<keyframe>"))
    found = understand(read_robot(file(DOG, more=both)), Choices())
    assert found.layout.neutral["FL_knee"] == -1.2
    assert ["keyframe up of 2 is the stance" in note for note in found.notes if "keyframe" in note] == [True]


def test_twins_off_the_ground_are_legs(file: Callable[..., Path]) -> None:
    """Hind legs whose hips lie lower do not make a biped of a dog: all four stand on one ground."""
    inner = DOG
    for place in ("0.2 -0.1", "0.2 0.1"):
        inner = inner.replace(f'pos="{place} 0"', f'pos="{place} 0.08"')
    found = understand(read_robot(file(inner)), Choices())
    assert tuple(legs_of(found)) == FOUR
    assert found.layout.neutral["FL_knee"] > found.layout.neutral["RL_knee"] + 0.3  # stretched further


def test_legs_that_are_named_leave_a_word_on_their_twins(file: Callable[..., Path]) -> None:
    """Two of four by the user's word."""
    found = understand(
        read_robot(file(DOG)), Choices(feet=("RL_calf", "RR_calf"), pose={"F?_pitch": 1.5, "F?_knee": -2.5})
    )
    assert tuple(legs_of(found)) == ("RL", "RR")
    assert any("FR_calf, FL_calf ends a chain that is built as the legs" in note for note in found.notes)
