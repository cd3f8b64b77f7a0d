"""Velocity commands: ranges, reproducibility, and when the environment draws new ones."""

from dataclasses import replace

import pytest
import torch

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import CommandCfg
from mrwarp.env.vec_env import WalkEnv


def make_env(
    period: float,
    num_envs: int = 4,
    episode_seconds: float = 20.0,
    commands: CommandCfg | None = None,
    seed: int = 5,
) -> WalkEnv:
    """Environments whose only random draws after the start are commands and resets."""
    cfg = TaskCfg(num_envs=num_envs, seed=seed)
    commands = commands or CommandCfg(period=period)
    return WalkEnv(replace(cfg, noise=None, randomize=None, commands=commands, episode_seconds=episode_seconds))


def drawn(commands: CommandCfg, count: int, seed: int = 5) -> torch.Tensor:
    """Commands at the start of ``count`` environments, shape (count, 3)."""
    return make_env(commands.period, count, commands=commands, seed=seed).command


def test_commands_are_uniform_in_their_ranges() -> None:
    """Every draw lies in its range, and mean and spread are those of the uniform distribution."""
    cfg = CommandCfg(v_x=(0.2, 0.6), v_y=(-0.1, 0.3), yaw_rate=(-0.2, 0.2))
    count = 4000
    commands = drawn(cfg, count)
    assert commands.shape == (count, 3) and commands.dtype == torch.float32
    for column, (low, high) in enumerate((cfg.v_x, cfg.v_y, cfg.yaw_rate)):
        values = commands[:, column].double()
        assert low - 1e-7 <= float(values.min()) and float(values.max()) <= high + 1e-7  # float32 bounds
        # the mean of n draws has standard deviation width/sqrt(12 n); five of them
        assert float(values.mean()) == pytest.approx((low + high) / 2, abs=5 * (high - low) / (12 * count) ** 0.5)
        # the spread of n draws is known to about width*sqrt(0.8/n)/4; 5 % is over four of those
        assert float(values.std()) == pytest.approx((high - low) / 12**0.5, rel=0.05)


def test_an_empty_range_is_its_value() -> None:
    """A range of zero width commands exactly that value."""
    commands = drawn(CommandCfg(v_x=(0.5, 0.5), v_y=(0.0, 0.0), yaw_rate=(-0.1, -0.1)), 10)
    assert torch.equal(commands, torch.tensor([0.5, 0.0, -0.1]).expand(10, 3))


def test_commands_repeat_with_the_seed_and_not_with_the_number_of_robots() -> None:
    """The seed decides the draws; a robot's are the same in a larger batch."""
    first, again, other, larger = (
        drawn(CommandCfg(), count, seed) for count, seed in ((8, 1), (8, 1), (8, 2), (20, 1))
    )
    assert torch.equal(first, again) and torch.equal(first, larger[:8])
    assert not torch.equal(first, other)


def test_env_draws_new_commands_every_period_and_only_then() -> None:
    """With a period of 0.1 s commands change at steps 5, 10, 15, in every environment."""
    env = make_env(period=0.1)
    changed = []
    for _ in range(16):
        before = env.command.clone()
        env.step(torch.zeros(4, 12))
        changed.append((env.command[:, 0] != before[:, 0]).tolist())
    due = [step % 5 == 0 for step in range(1, 17)]
    assert changed == [[now] * 4 for now in due]


def test_env_holds_commands_with_an_infinite_period() -> None:
    """Commands that were set stay, bit for bit, and are what the actor sees."""
    env = make_env(period=float("inf"))
    env.set_command(torch.tensor([0.4, 0.0, 0.1]))
    expected = torch.tensor([0.4, 0.0, 0.1]).expand(4, 3)
    for _ in range(10):
        obs, _, _, _ = env.step(torch.zeros(4, 12))
        assert torch.equal(env.command, expected)
        assert torch.equal(obs["actor"][:, 6:9], expected)


def test_env_draws_new_commands_with_a_new_episode() -> None:
    """When an episode ends, all its environments get other commands."""
    env = make_env(period=float("inf"), episode_seconds=0.1)
    before = env.command.clone()
    for _ in range(4):
        env.step(torch.zeros(4, 12))
    assert torch.equal(env.command, before)
    _, _, done, _ = env.step(torch.zeros(4, 12))
    assert bool(done.all())
    assert bool((env.command[:, 0] != before[:, 0]).all())
