"""Velocity commands (v_x, v_y, yaw rate)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
import warp as wp

from mrwarp.env.cfg import CommandCfg
from mrwarp.env.task_kernels.derived import command_kernel
from mrwarp.launch import record

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv


def sample(cfg: CommandCfg, count: int, generator: torch.Generator, device: torch.device | str) -> torch.Tensor:
    """Draw commands: forward and lateral speed [m/s] and yaw rate [rad/s], shape (count, 3)."""
    low = torch.tensor([cfg.v_x[0], cfg.v_y[0], cfg.yaw_rate[0]], device=device)
    high = torch.tensor([cfg.v_x[1], cfg.v_y[1], cfg.yaw_rate[1]], device=device)
    return low + (high - low) * torch.rand(count, 3, generator=generator, device=device)


class NewCommands:
    """Draws a new command every ``period``, at the same step of every episode; never where the period is infinite.

    Args:
        env: The environment.
    """

    def __init__(self, env: WalkEnv) -> None:
        cfg, device = env.cfg.commands, env.device
        self._launch: wp.Launch | None = None
        if cfg.period == float("inf"):
            return
        self._env, self._draws = env, torch.zeros(env.num_envs, 3, device=device)
        ranges = [torch.tensor(side, device=device) for side in zip(cfg.v_x, cfg.v_y, cfg.yaw_rate, strict=True)]
        self._keep = ranges
        period = max(round(cfg.period / env.cfg.step_dt), 1)
        self._launch = record(
            command_kernel,
            dim=env.num_envs,
            inputs=[period, *map(wp.from_torch, (*ranges, env.episode_length_buf, self._draws))],
            outputs=[wp.from_torch(env.command)],
            device=str(device),
        )

    def __call__(self) -> None:
        """Draw for one policy step."""
        if self._launch is not None:
            torch.rand(self._draws.shape, generator=self._env.generator, out=self._draws)
            self._launch.launch()
