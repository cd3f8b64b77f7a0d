"""Elastic drives and a base that gives way are found by the torque that rigid bodies leave; in healthy arms none."""

from pathlib import Path

import numpy as np
import pytest

from mrwarp.robot_logs.causes.of_hidden import DAMPING
from mrwarp.robot_logs.channels.hidden_dynamics import behind, with_oscillator
from mrwarp.robot_logs.replay_model import Hidden, replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from tests.robot_logs.arm_log import heavy_arm


def found(folder: Path, *hide: str) -> Hidden | None:
    """The hidden motion of an arm of three joints."""
    arm = heavy_arm(folder)
    motions = (("chirp", 8.0), ("steps", 6.0))
    record(LogCfg(robot=str(arm), motions=motions, hide=hide, seed=3, tau="none"), folder / "log")
    log = load_log(folder / "log")
    return with_oscillator(replay_model(arm, log), log).hidden


def test_an_oscillator_resonates_at_its_frequency() -> None:
    """Gain 1 at rest, 1/(2*damping) at its natural frequency, by the closed form of a forced oscillator."""
    t = np.arange(0.0, 40.0, 0.001)
    for ratio in (0.0, 0.5, 1.0, 2.0):
        x = behind(np.cos(2.0 * np.pi * 5.0 * ratio * t), 0.001, 5.0)[-10000:]
        gain = 1.0 / np.hypot(1.0 - ratio**2, 2.0 * DAMPING * ratio)
        assert np.abs(x).max() == pytest.approx(gain, rel=1e-2)


@pytest.mark.parametrize(
    ("hide", "joint", "frequency"),
    [("series_elasticity=j2:9", 1, 9.0), ("series_elasticity=j3:6", 2, 6.0), ("base_compliance=4", -1, 4.0)],
)
def test_a_hidden_motion_is_found_with_its_frequency(hide: str, joint: int, frequency: float, tmp_path: Path) -> None:
    """Of a virtual robot with one hinge more; within a fifth, for a link's inertia changes with the pose."""
    seen = found(tmp_path, hide)
    assert seen is not None and joint in (seen.joint, *seen.rivals)
    assert seen.frequency == pytest.approx(frequency, rel=0.2)


@pytest.mark.parametrize("hide", ["", "command_delay=0.012", "coulomb_friction=j2:3", "link_mass=l3:0.5"])
def test_rigid_robots_hide_no_motion(hide: str, tmp_path: Path) -> None:
    """Healthy or with another fault, which its own cause explains."""
    assert found(tmp_path, *([hide] if hide else [])) is None
