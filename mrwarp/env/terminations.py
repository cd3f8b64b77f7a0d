"""When an episode ends."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv


def fallen(env: WalkEnv) -> torch.Tensor:
    """Trunk too low or leaning too far, or a state that is no number; bool, shape (E,)."""
    # written as "not upright", so that NaN counts as fallen
    upright = (env.root_pos[:, 2] > env.cfg.fall_height) & (env.gravity[:, 2] < -math.cos(env.cfg.fall_tilt))
    state = (env.root_pos, env.gravity, env.root_vel, env.root_ang, env.q, env.qd)
    return ~(upright & torch.isfinite(torch.cat(state, dim=1)).all(1))


def timed_out(env: WalkEnv) -> torch.Tensor:
    """The episode reached its length; bool, shape (E,)."""
    return env.episode_length_buf >= env.max_episode_length
