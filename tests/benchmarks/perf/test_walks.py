"""The timed robots walk, and plain physics repeats the walk's own steps; robots that do not walk are refused."""

import pytest
import torch

from benchmarks.perf.walks import NotWalkingError, Walk
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy


def test_a_walk_is_timed_and_checked() -> None:
    """Parts nest: physics within robot within environment; a plain turn repeats the bits, and the walk goes on."""
    walk = Walk("bouc_wen", OnnxPolicy(DEFAULT_POLICY), num_envs=2, steps=3, seconds=1.0)
    turns = [walk.turn() for _ in range(100)]
    assert all(0.0 < times["physics"] < times["robot"] for times in turns)
    # the environment is timed in other steps than its parts, and takes little more than the robot: the least count
    robot, env = (min(times[part] for times in turns) for part in ("robot", "env"))
    assert robot < 1.1 * env
    qpos = walk.env.view(walk.env.sim.backend.field("qpos")).clone()
    assert walk.plain_turn()["plain"] > 0.0
    assert not torch.equal(walk.env.view(walk.env.sim.backend.field("qpos")), qpos)  # it walked on
    figures = walk.check()
    assert figures["falls_per_second"] == 0.0


def test_robots_that_stand_still_are_refused() -> None:
    """The zero policy holds the stance: fast, but not what the figures are about."""
    walk = Walk("bouc_wen", lambda obs: torch.zeros(2, 12), num_envs=2, steps=2, seconds=0.5)
    walk.turn()
    with pytest.raises(NotWalkingError, match="not walking"):
        walk.check()


def test_a_repeated_step_with_other_bits_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plain physics that computes something else would be no comparison."""
    walk = Walk("bouc_wen", OnnxPolicy(DEFAULT_POLICY), num_envs=2, steps=1, seconds=0.1)
    monkeypatch.setattr("benchmarks.perf.walks.INPUTS", ("qpos", "qacc_warmstart", "qfrc_applied", "xfrc_applied"))
    with pytest.raises(NotWalkingError, match="other bits"):
        walk.plain_turn()
