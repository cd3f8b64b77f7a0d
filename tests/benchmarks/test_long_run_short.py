"""Walking for long: the short version of ``benchmarks.long_run``."""

import pytest

from benchmarks.long_run import LongRun, walk_long
from mrwarp.env.cfg import TaskCfg
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy


@pytest.mark.slow
def test_walking_on_needs_no_more_memory() -> None:
    """20 s of wall time: no number goes wrong, memory stays. Step time is left to the quiet machine of the long run."""
    run = walk_long(OnnxPolicy(DEFAULT_POLICY), TaskCfg(num_envs=16, seed=3), seconds=20.0)
    assert (run.broken, run.not_finite) == (0, 0) and run.memory_growth < 0.02
    assert run.robot_hours == pytest.approx(16 * 250 * 0.02 / 3600 * len(run.at))
    assert min(run.memory) > 100.0 and min(run.step_ms) > 0.05


def test_each_fault_is_named() -> None:
    """Growth is that of the last tenth over the tenth after the first."""
    good = LongRun(num_envs=4, robot_hours=9.0, memory=[80.0, *[100.0] * 19], step_ms=[9.0, *[5.0] * 19])
    assert good.faults(hours=8.0) == [] and good.memory_growth == 0.0 == good.step_growth
    leaking = LongRun(num_envs=4, robot_hours=9.0, memory=[100.0 + k for k in range(20)], step_ms=[5.0] * 20)
    assert leaking.faults(hours=8.0) == ["memory grew by 16.7 %"]
    slower = LongRun(num_envs=4, robot_hours=9.0, memory=[100.0] * 20, step_ms=[5.0 + 0.1 * k for k in range(20)])
    assert slower.faults(hours=8.0) == ["a step takes 32.7 % longer than at the start"]
    wrong = LongRun(num_envs=4, robot_hours=7.0, broken=1, not_finite=2)
    assert wrong.faults(hours=8.0) == [
        "7.00 robot hours are fewer than 8",
        "1 broken steps, 2 values that are no numbers",
    ]
