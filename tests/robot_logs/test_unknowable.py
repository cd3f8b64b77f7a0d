"""Causes that a log cannot show, and the motion that would."""

import contextlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mrwarp.commands.run_log import MOTIONS as RECORDABLE
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.robot_logs import unknowable
from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.replay_model import replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.selection import Hypothesis
from mrwarp.robot_logs.unknowable import (
    ARM_MOTIONS,
    MOTIONS,
    Shown,
    cannot_know,
    friction_that_holds,
    motions_of,
    next_experiment,
)
from mrwarp.robot_logs.unknowable import GROUND as GROUND_CAUSES
from mrwarp.robot_logs.virtual.motions import AIR
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.robot_logs.windows import foot_slipped
from mrwarp.sysid.settings import Settings


@pytest.mark.parametrize("motions", [MOTIONS, ARM_MOTIONS])
@pytest.mark.parametrize("cause", MOTIONS)
def test_a_proposed_motion_can_be_recorded(cause: str, motions: dict[str, Shown]) -> None:
    """``mrwarp log record`` takes its motions together: all on the ground, or all in the air."""
    record = motions[cause].record
    assert set(record) <= set(AIR) or set(record) <= set(RECORDABLE) - set(AIR)
    assert motions[cause].what.endswith(f", {sum(record.values()):.0f} s")
    if motions is ARM_MOTIONS and cause not in GROUND_CAUSES:
        assert set(record) <= set(AIR) and "walk" not in motions[cause].how and "trunk" not in motions[cause].how


def _gain(name: str, where: str, index: int, *, field: str = "kp") -> Parameter:
    return Parameter(
        cause=name,
        where=where,
        name="gain",
        unit="1",
        field=field,
        index=index,
        step=0.05,
        spread=0.02,
        least=0.04,
        fault=0.3,
        nominal=1.0,
    )


@pytest.mark.parametrize("legged", [False, True])
def test_advice_fits_the_robot(legged: bool) -> None:
    """An arm on a table cannot walk, and has neither feet nor an inertial sensor; a held quadruped can be put down."""
    p = [_gain("kp", "elbow", 0), _gain("motor_strength", "elbow", 0), _gain("encoder_offset", "elbow", 0)]
    now = SimpleNamespace(covariance=np.eye(3), precision=np.eye(3))
    log = SimpleNamespace(runs=[], kp=np.ones(1), tau_is="none")
    model = SimpleNamespace(free=False, legged=legged, devices=())
    found = cannot_know(SimpleNamespace(sigma={}), p, model, log, now)
    names = {text.partition(":")[0] for text in found}
    assert {"kp", "motor_strength", "encoder_offset", "trunk_mass"} <= names
    assert any("walk" in text for text in found) == legged and ("ground_friction" in names) == legged
    proposed = next_experiment((), found, motions_of(model))
    assert proposed is not None and proposed.what in "".join(found)
    assert proposed.settings == ({"walk": 20.0} if legged else {"slow": 20.0})
    rival = SimpleNamespace(name="motor_strength", alternatives=("kp of elbow",))
    proposed = next_experiment((rival,), found, motions_of(model))
    assert proposed is not None and proposed.settings == ({"walk": 20.0} if legged else {"steps": 10.0})


@pytest.mark.parametrize(
    ("shown", "left"),
    [
        ([], {"kp", "torque_limit of elbow beyond 1 N·m, wrist beyond 1 N·m", "motor_strength of robot"}),
        (
            [("kp", "elbow", (0,))],
            {"kp of wrist", "torque_limit of elbow beyond 1 N·m, wrist beyond 1 N·m", "motor_strength of robot"},
        ),
        (
            [("kp", "robot", (0, 1)), ("motor_strength", "robot", ())],
            {"torque_limit of elbow beyond 1 N·m, wrist beyond 1 N·m"},
        ),
        ([("torque_limit", "wrist", (3,))], {"kp", "torque_limit of elbow beyond 1 N·m", "motor_strength of robot"}),
    ],
)
def test_what_the_verdict_speaks_of_has_shown_in_the_log(
    shown: list[tuple[str, str, tuple[int, ...]]], left: set[str]
) -> None:
    """A named Kp of one joint stood next to "kp: no size would have shown in this log", and so did a limit."""
    p = [_gain("kp", "elbow", 0), _gain("kp", "wrist", 1)]
    p += [_gain("torque_limit", "elbow", 0, field="limit"), _gain("torque_limit", "wrist", 1, field="limit")]
    now = SimpleNamespace(covariance=np.eye(4), precision=np.eye(4))
    log = SimpleNamespace(runs=[], kp=np.ones(2), tau_is="none")
    model = SimpleNamespace(
        free=False,
        legged=False,
        devices=(),
        asked=np.ones(2),
        limited=np.zeros(2, dtype=bool),
    )
    named = [Hypothesis(cause=cause, where=where, members=members) for cause, where, members in shown]
    found = cannot_know(SimpleNamespace(sigma={}), p, model, log, now, shown=named)
    speak = {text.partition(":")[0] for text in found if text.startswith(("kp", "torque_limit", "motor_strength"))}
    assert speak == left


@pytest.mark.parametrize(("amps", "known"), [([0.0, 0.0], False), ([0.0, 0.8], True)])
def test_a_coil_that_was_asked_for_no_current_shows_nothing(amps: list[float], known: bool) -> None:
    """Measured noise that dies away with a coil's lag looks like information about it."""
    p = Parameter(
        cause="coil_lag",
        where="calf",
        name="time_constant",
        unit="s",
        field="coil_lag",
        index=0,
        step=0.004,
        spread=0.001,
        least=0.003,
        fault=0.02,
    )
    now = SimpleNamespace(covariance=np.array([[1e-8]]), precision=np.array([[1e6]]))
    run = SimpleNamespace(joint={"current_cmd": np.array(amps)[:, None]})
    log = SimpleNamespace(runs=[run], kp=np.ones(1), tau_is="estimate")
    model = SimpleNamespace(free=True, devices=True)
    found = cannot_know(SimpleNamespace(sigma={}), [p], model, log, now)
    assert any(text.startswith("coil_lag") for text in found) != known
    log.runs.append(SimpleNamespace(joint={}))  # nobody knows what this one asked for
    found_with_other = cannot_know(SimpleNamespace(sigma={}), [p], model, log, now)
    assert not any(text.startswith("coil_lag") for text in found_with_other)
    if not known:
        proposed = next_experiment((), found)
        assert proposed is not None and proposed.settings == {"walk": 10.0} and proposed.seconds == 10.0


@pytest.mark.parametrize("slipped", [False, True])
def test_how_well_feet_hold_is_told_where_they_slip(monkeypatch: pytest.MonkeyPatch, slipped: bool) -> None:
    """Else a log shows only that the ground is not so slippery that they would: in the replay, below 0.3 for 0.8.

    The range down to no friction is halved some times.
    """
    p = Parameter(
        cause="ground_friction",
        where="robot",
        name="coefficient",
        unit="1",
        field="mu",
        index=0,
        step=-0.1,
        spread=0.1,
        least=0.1,
        fault=0.4,
        nominal=0.8,
    )
    monkeypatch.setattr(unknowable, "foot_slipped", lambda model, log: slipped)
    monkeypatch.setattr(unknowable, "replayed", lambda e, m, g, p, x: (1e6 * max(0.3 - 0.8 * (1.0 + x[0]), 0.0), None))
    model, log = SimpleNamespace(free=True, devices=()), SimpleNamespace(runs=[], kp=np.ones(1), tau_is="estimate")
    likelihood = SimpleNamespace(sigma={}, scale=1.0, settings=Settings())
    holds = friction_that_holds(likelihood, model, log, [], [p], np.array([0.1]))
    assert (holds is None) == slipped
    assert holds is None or holds == pytest.approx(0.3, abs=0.8 / 2**unknowable.HALVED)
    now = SimpleNamespace(covariance=np.array([[1e-8]]), precision=np.array([[1e2]]))  # by derivatives it is known
    found = [x for x in cannot_know(likelihood, [p], model, log, now, holds) if x.startswith("ground_friction")]
    assert len(found) == int(not slipped)
    if found:
        assert found[0].startswith("ground_friction of robot beyond 0.3: no foot slipped; walk")
        proposed = next_experiment((), found)
        assert proposed is not None and proposed.settings == {"walk": 20.0}


@pytest.mark.parametrize(("motion", "seconds", "slips"), [("squat", 2.5, False), ("walk", 2.0, True)])
def test_feet_slip_in_a_walk_and_not_where_they_stand(tmp_path: Path, motion: str, seconds: float, slips: bool) -> None:
    """By the log's joints, trunk and load: feet that stay on the ground keep their relative places."""
    with contextlib.suppress(OSError):
        record(LogCfg(robot="mr_go", motions=((motion, seconds),), policy=DEFAULT_POLICY, seed=1), tmp_path)
    log = load_log(tmp_path)
    assert foot_slipped(replay_model(Path("mr_go"), log), log) == slips
