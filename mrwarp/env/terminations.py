"""When an episode ends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch
import warp as wp

from mrwarp.env.task_kernels.ends import DONE, ends_kernel
from mrwarp.kernels.launch import record

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv

LEAST_REWARD = -10.0
"""Least reward of a policy step. A trained gait earns 0.06, robots whose actions are noise of 4 standard deviations,
falls included, pay up to 4 (measured over 300 steps of 64). A solver that throws a robot makes accelerations that cost
1e5 in one step, and would shake the critic's values of all states for an update."""

_INPUTS = ("height", "root_pos", "gravity", "root_vel", "root_ang", "q", "qd")


class Terminations:
    """A fall (trunk too low or leaning too far, or a state that is no number), a wrong number, or the time limit.

    Args:
        env: The environment; its tensors stay where they are.
        broken: 1 where a number went wrong in the policy step, int, shape (E,).
        reward: Rewards of the policy step, shape (E,).

    Attributes:
        launch: What computes it, once per policy step: it counts the step.
        rows: Fallen, broken, timed out and done, see ``task_kernels.ends``, bool, shape (4, E).
        done: The last of them: episodes that end now, bool, shape (E,).
    """

    def __init__(self, env: WalkEnv, broken: torch.Tensor, reward: torch.Tensor) -> None:
        device, num_envs = env.height.device, len(env.height)
        self._flags = torch.zeros(4, num_envs, dtype=torch.bool, device=device)
        self._reward = torch.zeros(num_envs, device=device)
        self._keep = [*(getattr(env, name) for name in _INPUTS), broken, reward]
        self.rows, self.done = wp.from_torch(self._flags), wp.from_torch(self._flags[DONE])
        self.launch = record(
            ends_kernel,
            dim=num_envs,
            inputs=[
                env.cfg.fall_height, -math.cos(env.cfg.fall_tilt), env.max_episode_length, LEAST_REWARD,
                *map(wp.from_torch, self._keep),
            ],
            outputs=[*map(wp.from_torch, (env.episode_length_buf, self._flags, self._reward))],
            device=str(device),
        )  # fmt: skip

    def end(self, mask: torch.Tensor) -> None:
        """Let the episodes of the mask, bool (E,), end here, whatever the robots do."""
        self._flags[DONE] = mask

    def flags(self) -> tuple[torch.Tensor, ...]:
        """Who has fallen, who holds a wrong number, whose time is up without a fall, and who is done; bool, (E,) each.

        They are tensors of their own: later steps do not write into them.
        """
        return self._flags.clone().unbind()

    def reward(self) -> torch.Tensor:
        """Rewards, 0 where a number went wrong, else no less than :data:`LEAST_REWARD`, a tensor of its own, (E,)."""
        return self._reward.clone()
