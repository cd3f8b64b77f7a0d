"""Shared by the tests of channels."""

import pytest

from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import RobotLog, load_log
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from tests.robot_logs.arm_log import heavy_arm


@pytest.fixture(scope="session")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[ReplayModel, RobotLog]:
    """A held arm of three joints, with the noise of its sensors, whose drives measure their torque."""
    folder = tmp_path_factory.mktemp("measured")
    arm = heavy_arm(folder)
    record(LogCfg(robot=str(arm), motions=(("chirp", 5.0), ("slow", 5.0)), tau="measured", seed=5), folder / "log")
    log = load_log(folder / "log")
    return replay_model(arm, log), log
