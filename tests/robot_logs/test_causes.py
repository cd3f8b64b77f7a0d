"""The catalogue of a robot's causes: each declares all that the method, the advice and the extended robot ask of it."""

import ast
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import mrwarp
from mrwarp.robot_logs.causes.cause import Cause
from mrwarp.robot_logs.causes.of_links import _weighted
from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.places import PLACES
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE, DECLARED, DRIVE, NUISANCES, ORDINARY, OUTSIDE
from mrwarp.robot_logs.selection import hypotheses_of
from mrwarp.robot_logs.unknowable import ARM_MOTIONS, MOTIONS
from mrwarp.robot_logs.virtual.hidden_effects import EFFECTS

OWN = {"clock_shift": "seen against the joints' clock in any motion"}
"""Causes without a motion that shows them, and why."""

SPOKEN_OF = {
    **dict.fromkeys(
        ("extended_robot.py", "replay_engine.py", "replay_model.py", "robot_log.py", "windows.py"), {"kp", "kd"}
    ),  # gains of a log
    "window_replay.py": {"kp", "kd", "coil_lag", "stribeck", "torque_lag", "command_lag"},  # arrays of the replay
}
"""Names of causes that stand outside their declarations, by file: there they name something else, too."""


@pytest.mark.parametrize("name", CATALOGUE)
def test_a_cause_has_a_place_a_size_and_a_motion(name: str) -> None:
    """And what it can look like is a cause of the same places."""
    cause = CATALOGUE[name]
    assert cause.place in PLACES and cause.title and cause.unit
    assert callable(cause.least) or np.isfinite(cause.least)
    assert (cause.shown is not None) == (not cause.outside and name not in OWN)
    if cause.looks_like:
        assert CATALOGUE[cause.looks_like].place == cause.place
    if not cause.outside:
        assert name in EFFECTS, "a virtual robot can hide it, so that a test can look for it"
    if name in DRIVE:
        assert cause.change == "relative" and cause.shared


def test_rules_follow_from_declarations() -> None:
    """No name of a cause is listed a second time."""
    assert len(CATALOGUE) + len(NUISANCES) == len(DECLARED)
    assert {name for name in CATALOGUE if CATALOGUE[name].ordinary} == set(ORDINARY)
    assert {name for name in CATALOGUE if CATALOGUE[name].outside} == set(OUTSIDE)
    assert len(DRIVE) == 3
    assert set(MOTIONS) == set(ARM_MOTIONS) == {name for name in CATALOGUE if CATALOGUE[name].shown}


def test_the_method_knows_no_cause_by_its_name() -> None:
    """Causes themselves declare what they are made of, look like and need."""
    robot, found = Path(mrwarp.__file__).parent / "robot_logs", {}
    for path in [*robot.glob("*.py"), *robot.glob("report/*.py"), *robot.parent.glob("sysid/**/*.py")]:
        nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if names := {node.value for node in nodes if isinstance(node, ast.Constant)} & set(CATALOGUE):
            found[path.name] = names
    assert found == SPOKEN_OF


@pytest.mark.parametrize("cause", DECLARED, ids=lambda cause: f"{cause.name}-{cause.field}")
def test_causes_that_a_declaration_speaks_of_are_there(cause: Cause) -> None:
    """Those that it is made of, does nearly the same as, or is at all joints or where it is negative."""
    others = {*cause.made_of, cause.nearly, cause.looks_like, cause.of_all, *cause.if_negative[:1]} - {""}
    assert others <= set(CATALOGUE) - {cause.name}
    assert not cause.nearly or CATALOGUE[cause.nearly].nearly == cause.name
    assert bool(cause.of_all) == bool(cause.unseen) == bool(cause.measured_in)


def _parameter(cause: str, index: int = 0, **numbers: float) -> Parameter:
    sizes = {"step": 0.1, "spread": 0.1, "least": 0.1, "fault": 1.0} | numbers
    declared, where = CATALOGUE[cause], f"place{index}"
    return Parameter(cause=cause, where=where, name="x", unit="1", field=declared.field, index=index, **sizes)


@pytest.mark.parametrize(
    ("cause", "value"), [("coulomb_friction", 0.5), ("kp", 15.0), ("ground_stiffness", 10.0 / 1.5)]
)
def test_a_change_makes_a_value_as_declared(cause: str, value: float) -> None:
    """As it is; times the described value; or, of stiffnesses, that value over it."""
    assert _parameter(cause, nominal=10.0, lowest=-0.95).absolute(0.5) == pytest.approx(value)


@pytest.mark.parametrize(("cause", "common"), [("kp", True), ("encoder_offset", False), ("link_mass", False)])
def test_what_joints_share_is_one_hypothesis_more(cause: str, common: bool) -> None:
    """A gain comes from one configuration; a mass or a zero is each joint's own."""
    both = [_parameter(cause), _parameter(cause, 1)]
    assert [h.where for h in hypotheses_of(both)] == ["place0", "place1", *(["robot"] if common else [])]


def test_a_limit_acts_on_robots_that_have_it() -> None:
    """A lower one counts from the most that was asked for; without a change the described range stays."""
    written = np.full((2, 1, 2), np.nan)
    robot = SimpleNamespace(model=SimpleNamespace(actuator_forcerange=np.array([[-9.0, 9.0]])), asked=np.array([5.0]))
    replay = SimpleNamespace(robot=robot, model=lambda _: written)
    acts = CATALOGUE["torque_limit"].acts
    assert acts is not None
    acts(replay, np.array([[0.0], [-0.2]]))
    np.testing.assert_allclose(written[:, 0], [[-9.0, 9.0], [-4.0, 4.0]])


@pytest.mark.parametrize("more", [0.3, 5.0])
def test_a_weight_far_off_a_link_is_a_point(more: float) -> None:
    """Steiner's theorem about the centre of both, to the weight of which none is left undivided by zero.

    Off by 20 radii of gyration; without a weight, inertias stay, and at the centre they grow as the mass does.
    """
    mass, inertia, off = 2.0, np.array([0.01, 0.02, 0.03]), np.array([1.5, 2.0, 0.0])
    point = inertia + mass * more / (mass + more) * (off @ off - off**2)
    soft = (0.1 * mass / more) ** 2
    np.testing.assert_allclose(_weighted(mass, inertia, np.array(more), more * off), point, rtol=soft)
    np.testing.assert_allclose(_weighted(mass, inertia, np.array(0.0), off), inertia)
    np.testing.assert_allclose(_weighted(mass, inertia, np.array(more), 0.0 * off), inertia * (1.0 + more / mass))


def test_words_of_a_verdict() -> None:
    """Every declared sentence takes any value; titles have no underscores."""
    for cause in CATALOGUE.values():
        assert not re.search("_", cause.title)
        if cause.says is not None:
            assert cause.says(0.25, "x") != cause.says(-0.75, "y")


@pytest.mark.parametrize(("delay", "said"), [(0.003, "that is how the log was written"), (0.006, "more than 4.5 ms")])
def test_a_delay_is_the_logs_own_up_to_what_is_usual(delay: float, said: str) -> None:
    """One beyond it is no matter of how rows were written, proven or not."""
    remark = CATALOGUE["command_delay"].remark
    assert remark is not None and said in remark(delay, (0.0, 0.0045))
