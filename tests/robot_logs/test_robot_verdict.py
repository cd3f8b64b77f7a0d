"""The verdict's sentence says what a replay is still off by."""

import pytest

from mrwarp.robot_logs.robot_verdict import sentence_of
from mrwarp.sysid.settings import Robot
from mrwarp.sysid.verdict import Unexplained


@pytest.mark.parametrize(
    ("outside", "left", "said"),
    [
        (False, 1.4, "Nothing is wrong with the simulation that this log could show."),
        (False, float("nan"), "Nothing is wrong with the simulation that this log could show."),
        (False, 23.52, "No cause is proven, and the replay's error is 23.5 times a healthy robot's."),
        (True, 1.4, "something outside the catalogue: a pull."),
        (
            True,
            9.0,
            "something outside the catalogue: a pull; even so the replay's error is 9 times a healthy robot's.",
        ),
    ],
)
def test_nothing_is_called_right_that_is_far_off(outside: bool, left: float, said: str) -> None:
    """Whether or not anything is named."""
    unexplained = Unexplained(depends_on=(), form="a pull", share=0.5) if outside else None
    assert sentence_of((), unexplained, left, Robot().worst) == said
