"""Targets that resting joints contradict are refused with their size; those of healthy and faulty robots are kept."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp.robot_logs.channels.command_channel import check_commands
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import LogError, RobotLog, load_log
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from tests.robot_logs.arm_log import heavy_arm

SHARED = Path(__file__).resolve().parents[4] / "shared"


def arm(folder: Path, *hide: str) -> tuple[ReplayModel, RobotLog]:
    """A held arm of three joints that goes to poses and rests there."""
    path = heavy_arm(folder)
    record(LogCfg(robot=str(path), motions=(("steps", 10.0),), hide=hide, tau="none", seed=5), folder / "log")
    log = load_log(folder / "log")
    return replay_model(path, log), log


@pytest.fixture(scope="module")
def healthy(tmp_path_factory: pytest.TempPathFactory) -> tuple[ReplayModel, RobotLog]:
    """That arm without a fault."""
    return arm(tmp_path_factory.mktemp("healthy"))


def asked(log: RobotLog, change: Callable[[np.ndarray], np.ndarray]) -> RobotLog:
    """The log with other targets, (N, J)."""
    return replace(
        log, runs=tuple(replace(run, joint={**run.joint, "q_des": change(run.joint["q_des"])}) for run in log.runs)
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (np.degrees, "q_des of j3 is 57"),
        (lambda x: x * [1.0, 57.3, 1.0], '"units": {"q_des": "deg"}'),
        (lambda x: x * [1.0, 1.0, -1.0], "q_des of j3 is -1 times"),
        (lambda x: x[:, [1, 2, 0]], "q_des of j2 is what j3 needs"),
        (lambda x: x + [0.0, 0.5, 0.0], "q_des of j2 is +0.5"),
        (lambda x: np.where([False, False, True], x[0], x), "q_des of j3 stands still while it rests from"),
        (lambda x: np.concatenate([x[20:], np.repeat(x[-1:], 20, axis=0)]), "q_des acts 1"),
        (lambda x: np.concatenate([np.repeat(x[:1], 20, axis=0), x[:-20]]), "ms before its row"),
    ],
    ids=["degrees", "one in degrees", "sign", "order", "offset", "frozen", "late", "early"],
)
def test_targets_that_rests_contradict_are_refused(
    change: Callable[[np.ndarray], np.ndarray], said: str, healthy: tuple[ReplayModel, RobotLog]
) -> None:
    """Each with its joint, its size and the remedy; joints whose targets are right are not named."""
    model, log = healthy
    check_commands(model, log)
    with pytest.raises(LogError) as refused:
        check_commands(model, asked(log, change))
    assert said in str(refused.value), str(refused.value)
    right = (change(log.runs[0].joint["q_des"]) == log.runs[0].joint["q_des"]).all(axis=0)
    assert not any(f"of {joint} " in str(refused.value) for joint, same in zip(log.joints, right, strict=True) if same)


@pytest.mark.parametrize(
    "hide",
    [
        "encoder_offset=j2:0.1",
        "link_mass=l3:2",
        "kp=*:0.6",
        "coulomb_friction=j2:4",
        "command_delay=0.02",
        "command_lag=*:0.06",
        "torque_lag=*:0.04",
    ],
)
def test_faults_of_robots_are_none_of_their_targets(hide: str, tmp_path: Path) -> None:
    """They droop and stick, and are for the replay to name."""
    check_commands(*arm(tmp_path, hide))


@pytest.mark.parametrize(
    ("log", "robot"),
    [
        ("robot_logs/go2_air", "robots/go2/go2.xml"),
        ("robot_logs/double_pendulum", "robot_logs/double_pendulum/dfki_double_pendulum_C1.xml"),
        ("cases/gravity_in_drive/log", "cases/torque_channel/xarm7_plain.urdf"),
        ("cases/inertia_log/mjcf", "cases/inertia_log/mjcf/quad.xml"),
    ],
)
def test_real_logs_are_kept(log: str, robot: str) -> None:
    """Robots that were diagnosed, and one whose drives add gravity's torque by themselves."""
    if not ((SHARED / log).is_dir() and (SHARED / robot).is_file()):
        pytest.skip("logs of robots lie next to the repository where at hand")
    read = load_log(SHARED / log)
    check_commands(replay_model(SHARED / robot, read), read)
