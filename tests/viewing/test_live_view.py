"""Watching a training: one robot per current, and training goes on as without."""

from pathlib import Path

import torch

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.viewing.live_view import LiveTraining
from tests.viewing.conftest import Recorded


def test_recording_holds_one_robot_per_current(tmp_path: Path) -> None:
    """Four of eight robots are recorded, every second step, with the height the environment has."""
    env = WalkEnv(TaskCfg(num_envs=8, seed=2))
    view = LiveTraining(env, rrd=tmp_path / "training.rrd")
    heights = []
    for step in range(20):
        env.step(torch.zeros(8, 12))
        view.update()
        if (step + 1) % LiveTraining.EVERY == 0:
            heights.append(float(env.root_pos[2, 2]))
    view.close()
    recorded = Recorded(tmp_path / "training.rrd")
    for k, current in enumerate(("0", "0.5", "1", "1.5")):
        rows = list(recorded.columns(f"/robots/{k}_{current}A/series/trunk_height", "Scalars:scalars"))
        assert len(rows) == 20 // LiveTraining.EVERY
    found = [value[0] for _, value in sorted(recorded.columns("/robots/1_0.5A/series/trunk_height", "Scalars:scalars"))]
    torch.testing.assert_close(torch.tensor(found), torch.tensor(heights), atol=1e-6, rtol=0.0)


def test_watching_changes_no_bit(tmp_path: Path) -> None:
    """The watched environments do the same as unwatched ones."""
    watched, alone = (WalkEnv(TaskCfg(num_envs=8, seed=2)) for _ in range(2))
    view = LiveTraining(watched, rrd=tmp_path / "training.rrd")
    for _ in range(10):
        watched.step(torch.zeros(8, 12))
        view.update()
        alone.step(torch.zeros(8, 12))
    view.close()
    assert torch.equal(watched.q, alone.q) and torch.equal(watched.qd, alone.qd)
