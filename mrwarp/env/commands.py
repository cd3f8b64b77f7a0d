"""Velocity commands (v_x, v_y, yaw rate)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
import warp as wp

from mrwarp.env.task_kernels.derived import command_kernel
from mrwarp.kernels.launch import record

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv


class Commands:
    """Draws a new command for every episode, and every ``period`` at the same step of all; never if it is infinite.

    Args:
        env: The environment.
        begins: Environments whose episode begins, bool, shape (E,).

    Attributes:
        launch: What draws them, once per policy step.
    """

    def __init__(self, env: WalkEnv, begins: wp.array) -> None:
        cfg = env.cfg.commands
        ranges = [torch.tensor(side, device=env.device) for side in zip(cfg.v_x, cfg.v_y, cfg.yaw_rate, strict=True)]
        self._keep = ranges
        held = cfg.period == float("inf")
        self.launch = record(
            command_kernel,
            dim=env.num_envs,
            inputs=[
                0 if held else max(round(cfg.period / env.cfg.step_dt), 1),
                *map(wp.from_torch, (*ranges, env.key, env.episode_length_buf)), begins,
            ],
            outputs=[wp.from_torch(env.command)],
            device=str(env.device),
        )  # fmt: skip
