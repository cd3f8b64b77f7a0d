"""When an episode ends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
import warp as wp

from mrwarp.env.task_kernels.rewards import fallen_kernel
from mrwarp.launch import record

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv

_INPUTS = ("height", "root_pos", "gravity", "root_vel", "root_ang", "q", "qd")


class Fallen:
    """Trunk too low or leaning too far, or a state that is no number.

    Args:
        env: The environment; its tensors stay where they are.

    Attributes:
        fallen: The answer, bool, shape (E,).
        launch: What computes it.
    """

    def __init__(self, env: WalkEnv) -> None:
        self._keep = [getattr(env, name) for name in _INPUTS]
        self.fallen = torch.zeros(len(env.height), dtype=torch.bool, device=env.height.device)
        self.launch = record(
            fallen_kernel,
            dim=len(env.height),
            inputs=[env.cfg.fall_height, -math.cos(env.cfg.fall_tilt), *map(wp.from_torch, self._keep)],
            outputs=[wp.from_torch(self.fallen)],
            device=str(env.height.device),
        )


def timed_out(env: WalkEnv) -> torch.Tensor:
    """The episode reached its length; bool, shape (E,)."""
    return env.episode_length_buf >= env.max_episode_length
