"""Speeds, stamps and targets that contradict the angles are named with their size; healthy ones are kept."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp.robot_logs.channels.motion_channels import one_motion
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import LogError, LogRun, RobotLog, load_log
from mrwarp.sysid.settings import Settings

Change = Callable[[LogRun], LogRun]


@pytest.fixture
def healthy(measured: tuple[ReplayModel, RobotLog]) -> RobotLog:
    """A held arm of three joints, with the noise of its sensors."""
    return measured[1]


def changed(log: RobotLog, change: Change) -> RobotLog:
    """The log with other recordings."""
    return replace(log, runs=tuple(change(run) for run in log.runs))


def with_channel(name: str, change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """A change of one channel, (N, J)."""
    return lambda run: replace(run, joint={**run.joint, name: change(run.joint[name])})


def later(rows: int) -> Callable[[np.ndarray], np.ndarray]:
    """Readings that come some rows late."""
    return lambda x: np.concatenate([np.repeat(x[:1], rows, axis=0), x[:-rows]])


def test_a_healthy_log_is_kept(healthy: RobotLog) -> None:
    """As it is, and with what filters and stamps of real drives do: 2 % and one row."""
    assert one_motion(healthy, Settings()) is healthy
    fair = changed(changed(healthy, with_channel("qd", later(1))), with_channel("qd", lambda x: 1.02 * x))
    assert one_motion(fair, Settings()) is fair


@pytest.mark.parametrize(
    ("change", "joints", "said"),
    [
        (
            with_channel("qd", lambda x: x * [1.0, 9.0, 1.0]),
            {"j2"},
            "is 8.99 times the change of its angle (95 %: 8.97 to 9)",
        ),
        (with_channel("qd", lambda x: x * [1.0, 1.0, 0.8]), {"j3"}, "is 0.8"),
        (with_channel("qd", lambda x: x[:, [0, 2, 1]]), {"j2", "j3"}, "columns that changed places"),
        (with_channel("qd", lambda x: 0.0 * x + 0.3), {"j1", "j2", "j3"}, "no speed"),
        (with_channel("qd", later(5)), {"j1", "j2", "j3"}, "ms after the change of its angle"),
        (lambda run: replace(run, t=0.5 * run.t), {"j1", "j2", "j3"}, "the stamps count 0.5 times the time"),
    ],
    ids=["motor side", "gain", "swapped", "constant", "late", "stamps"],
)
def test_a_speed_that_is_none_is_left_out(change: Change, joints: set[str], said: str, healthy: RobotLog) -> None:
    """With what it is instead; the speeds of other joints stay."""
    log = changed(healthy, change)
    seen = one_motion(log, Settings())
    notes = " | ".join(seen.notes[len(log.notes) :])
    assert said in notes and "left out" in notes
    for run, before in zip(seen.runs, log.runs, strict=True):
        for k, joint in enumerate(seen.joints):
            assert np.isnan(run.joint["qd"][:, k]).all() == (joint in joints), notes
            assert joint in joints or (run.joint["qd"][:, k] == before.joint["qd"][:, k]).all()


def test_targets_that_changed_places_are_refused(healthy: RobotLog) -> None:
    """Each joint follows the other's: no replay could be driven by them."""
    log = changed(healthy, with_channel("q_des", lambda x: x[:, [0, 2, 1]]))
    with pytest.raises(LogError, match="j2 follows the target of j3, not its own"):
        one_motion(log, Settings())


@pytest.mark.parametrize("name", ["go2_air", "double_pendulum"])
def test_real_logs_tell_one_motion(name: str) -> None:
    """Robots whose logs were diagnosed."""
    folder = Path(__file__).resolve().parents[4] / "shared" / "robot_logs" / name
    if not folder.is_dir():
        pytest.skip("real logs of robots lie next to the repository where at hand")
    log = load_log(folder)
    assert one_motion(log, Settings()).notes == log.notes
