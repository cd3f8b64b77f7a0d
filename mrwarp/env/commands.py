"""Velocity commands (v_x, v_y, yaw rate)."""

from __future__ import annotations

import torch

from mrwarp.env.cfg import CommandCfg


def sample(cfg: CommandCfg, count: int, generator: torch.Generator, device: torch.device | str) -> torch.Tensor:
    """Draw commands: forward and lateral speed [m/s] and yaw rate [rad/s], shape (count, 3)."""
    low = torch.tensor([cfg.v_x[0], cfg.v_y[0], cfg.yaw_rate[0]], device=device)
    high = torch.tensor([cfg.v_x[1], cfg.v_y[1], cfg.yaw_rate[1]], device=device)
    return low + (high - low) * torch.rand(count, 3, generator=generator, device=device)
