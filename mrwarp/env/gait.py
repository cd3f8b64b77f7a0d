"""The gait clock, and the feet's place in it."""

from __future__ import annotations

import math

import torch

from mrwarp.robot import TROT_PHASE

THIGH_LENGTH = 0.213
"""Thigh joint to calf joint [m], Go1."""
CALF_LENGTH = 0.213
"""Calf joint to foot centre [m], Go1."""
HIP_OFFSET = 0.08
"""Hip joint to thigh joint along y [m], Go1."""
HIP_Z = 0.0
"""Height of the hip joints in the trunk frame [m], Go1."""
FOOT_RADIUS = 0.023
"""Foot sphere [m], Go1."""


def leg_phase(phase: torch.Tensor) -> torch.Tensor:
    """Phase of each leg in [0, 1) from the clock's phase (E,): stance in the first half, swing in the second.

    Returns:
        Shape (E, 4), legs in the order of ``robot.LEGS``.
    """
    offset = torch.tensor(TROT_PHASE, device=phase.device)
    return torch.remainder(phase.unsqueeze(1) + offset, 1.0)


def clock_stance(legs: torch.Tensor) -> torch.Tensor:
    """Whether the clock wants a leg on the ground; bool, shape of ``legs`` (E, 4)."""
    return legs < 0.5


def swing_clearance(legs: torch.Tensor, height: float) -> torch.Tensor:
    """Wanted clearance of each foot over the ground [m]: a half sine over the swing, 0 in stance; shape (E, 4)."""
    swing = (2.0 * legs - 1.0).clamp(min=0.0)
    return height * torch.sin(math.pi * swing)


def foot_height(q: torch.Tensor, root_z: torch.Tensor, up: torch.Tensor) -> torch.Tensor:
    """Height of each foot's lowest point over z = 0 [m], by forward kinematics of hip, thigh and calf.

    Args:
        q: Joint positions [rad], shape (E, 12), in the order of ``robot.JOINTS``.
        root_z: Trunk height [m], shape (E,).
        up: The world's vertical in the trunk frame, shape (E, 3).

    Returns:
        Shape (E, 4).
    """
    hip, thigh, calf = q[:, 0::3], q[:, 1::3], q[:, 2::3]
    x = -THIGH_LENGTH * torch.sin(thigh) - CALF_LENGTH * torch.sin(thigh + calf)
    down = -THIGH_LENGTH * torch.cos(thigh) - CALF_LENGTH * torch.cos(thigh + calf)
    side = torch.tensor([1.0, -1.0, 1.0, -1.0], device=q.device) * HIP_OFFSET
    y = side * torch.cos(hip) - down * torch.sin(hip)
    z = side * torch.sin(hip) + down * torch.cos(hip)
    hip_x = torch.tensor([0.1881, 0.1881, -0.1881, -0.1881], device=q.device)
    hip_y = torch.tensor([0.04675, -0.04675, 0.04675, -0.04675], device=q.device)
    height = (hip_x + x) * up[:, 0:1] + (hip_y + y) * up[:, 1:2] + (HIP_Z + z) * up[:, 2:3]
    return root_z.unsqueeze(1) + height - FOOT_RADIUS
