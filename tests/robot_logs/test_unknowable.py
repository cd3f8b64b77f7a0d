"""What a log cannot tell, and the motion that would."""

import contextlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from mrwarp.resources import DEFAULT_POLICY
from mrwarp.robot_logs import unknowable
from mrwarp.robot_logs.causes import Parameter
from mrwarp.robot_logs.replay_model import replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.unknowable import MOTIONS, cannot_know, friction_that_holds, next_experiment
from mrwarp.robot_logs.virtual.motions import AIR, GROUND
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.robot_logs.windows import foot_slipped


@pytest.mark.parametrize("cause", MOTIONS)
def test_a_proposed_motion_can_be_recorded(cause: str) -> None:
    """``mrwarp log record`` takes its motions together: all on the ground, or all in the air."""
    record = MOTIONS[cause].record
    assert set(record) <= set(AIR) or set(record) <= set(GROUND)
    assert MOTIONS[cause].what.endswith(f", {sum(record.values()):.0f} s")


@pytest.mark.parametrize(("amps", "known"), [([0.0, 0.0], False), ([0.0, 0.8], True)])
def test_a_coil_that_was_asked_for_no_current_shows_nothing(amps: list[float], known: bool) -> None:
    """Measured noise that dies away with a coil's lag looks like information about it."""
    p = Parameter(
        cause="coil_lag", where="calf", name="time_constant", unit="s", field="coil_lag", index=0, step=0.004,
        spread=0.001, least=0.003, fault=0.02,
    )  # fmt: skip
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
    """Else a log shows only that the ground is not so slippery that they would: in the replay, below 0.3 for 0.8."""
    p = Parameter(
        cause="ground_friction", where="robot", name="coefficient", unit="1", field="mu", index=0, step=-0.1,
        spread=0.1, least=0.1, fault=0.4, nominal=0.8,
    )  # fmt: skip
    monkeypatch.setattr(unknowable, "foot_slipped", lambda model, log: slipped)
    monkeypatch.setattr(unknowable, "replayed", lambda e, m, g, p, x: (1e6 * max(0.3 - 0.8 * (1.0 + x[0]), 0.0), None))
    model, log = SimpleNamespace(free=True, devices=()), SimpleNamespace(runs=[], kp=np.ones(1), tau_is="estimate")
    evidence = SimpleNamespace(sigma={}, scale=1.0)
    holds = friction_that_holds(evidence, model, log, [], [p], np.array([0.1]))
    assert (holds is None) == slipped
    assert holds is None or holds == pytest.approx(0.3, abs=0.03)
    now = SimpleNamespace(covariance=np.array([[1e-8]]), precision=np.array([[1e2]]))  # by derivatives it is known
    found = [x for x in cannot_know(evidence, [p], model, log, now, holds) if x.startswith("ground_friction")]
    assert len(found) == int(not slipped)
    if found:
        assert found[0].startswith("ground_friction of robot beyond 0.3: no foot slipped; walk")
        proposed = next_experiment((), found)
        assert proposed is not None and proposed.settings == {"walk": 20.0}


@pytest.mark.parametrize(("motion", "slips"), [("squat", False), ("walk", True)])
def test_feet_slip_in_a_walk_and_not_where_they_stand(tmp_path: Path, motion: str, slips: bool) -> None:
    """By what the log says of joints, trunk and load: feet that stay on the ground keep their places beside another."""
    with contextlib.suppress(OSError):
        record(LogCfg(robot="mr_go", motions=((motion, 4.0),), policy=DEFAULT_POLICY, seed=1), tmp_path)
    log = load_log(tmp_path)
    assert foot_slipped(replay_model(Path("mr_go"), log), log) == slips
