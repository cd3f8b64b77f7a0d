"""Shared by tests of the walking environment: its configuration, random actions, and sameness to the bit."""

from dataclasses import replace
from typing import Any

import torch

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv


def make_cfg(num_envs: int = 8, *, seed: int = 0, threads: int = 0, **changes: Any) -> TaskCfg:
    """The training task, with noise and randomisation, and changes to it."""
    return replace(TaskCfg(num_envs=num_envs, seed=seed, threads=threads), **changes)


def random_actions(steps: int, num_envs: int, *, scale: float = 0.5, seed: int = 0) -> list[torch.Tensor]:
    """Uniform actions in [-scale, scale)."""
    generator = torch.Generator().manual_seed(seed)
    return [scale * (2.0 * torch.rand(num_envs, 12, generator=generator) - 1.0) for _ in range(steps)]


def assert_same_step(first: tuple, second: tuple, rows: Any = slice(None)) -> None:
    """Observations, rewards, dones and time-outs of two steps have the same bits in the given environments."""
    for group in ("actor", "critic"):
        assert torch.equal(first[0][group][rows], second[0][group][rows]), group
    assert torch.equal(first[1][rows], second[1][rows])
    assert torch.equal(first[2][rows], second[2][rows])
    assert torch.equal(first[3]["time_outs"][rows], second[3]["time_outs"][rows])


def assert_same_state(first: WalkEnv, second: WalkEnv) -> None:
    """Everything that a resumed run needs has the same bits."""
    ours, theirs = first.state(), second.state()
    assert ours.keys() == theirs.keys()
    for name in ours:
        assert torch.equal(ours[name], theirs[name]), name
