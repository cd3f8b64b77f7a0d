"""Rewards of the walking task: the terms and their weighted sum, by one kernel."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
import warp as wp

from mrwarp.env.task_kernels.rewards import terms_kernel
from mrwarp.kernels.launch import record_per_env

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv

TERMS = {
    "track_velocity": "exp(-|v_xy - command|^2 / width)",
    "track_yaw": "exp(-(yaw rate - command)^2 / width)",
    "contact_clock": "share of feet whose contact is what the gait clock wants, minus a half",
    "swing_height": "squared error of the swinging feet's clearance over the ground [m^2], summed",
    "height": "squared error of the trunk's height over the ground [m^2]",
    "tilt": "squared horizontal part of the projected gravity",
    "bounce": "squared vertical speed [(m/s)^2]",
    "roll_pitch_rate": "squared roll and pitch rates [(rad/s)^2]",
    "posture": "squared distance of all joints from the neutral stance [rad^2]",
    "hip_posture": "squared hip angles [rad^2]: legs stay under the body",
    "effort": "squared motor torques [(N·m)^2], averaged over the torque steps",
    "action_rate": "squared change of the action",
    "joint_acceleration": "squared joint acceleration over the policy step [(rad/s^2)^2]",
    "power": "electrical power of motors and coils [W]: copper loss, mechanical power, coil loss",
}
"""All terms, by the name of their weight in ``RewardCfg``, in the order of the kernel."""

_INPUTS = (
    "body_velocity", "command", "height", "root_pos", "root_vel", "root_ang", "gravity", "q", "qd", "last_qd", "action",
    "last_action", "effort", "power", "foot_ground", "leg_phase", "clock_match",
)  # fmt: skip


class Rewards:
    """The rewards of an environment whose tensors stay where they are.

    Args:
        env: The environment; what the terms read of it must be in place.
        total: Where the weighted sum is written, shape (E,); None makes a tensor for it.

    Attributes:
        terms: Terms of the last policy step in the order of :data:`TERMS`, shape (E, T).
        total: Weighted sum over the policy step, shape (E,).
        launch: What computes them.
    """

    def __init__(self, env: WalkEnv, total: torch.Tensor | None = None) -> None:
        cfg, device = env.cfg.rewards, env.device
        self.terms = torch.zeros(env.num_envs, len(TERMS), device=device)
        self.total = torch.zeros(env.num_envs, device=device) if total is None else total
        weights = torch.tensor([getattr(cfg, name) for name in TERMS], device=device)
        self._keep = (weights, *(getattr(env, name) for name in _INPUTS))
        self.launch = record_per_env(
            terms_kernel,
            env.num_envs,
            inputs=[
                cfg.velocity_width, cfg.yaw_width, cfg.step_height, cfg.target_height, env.cfg.step_dt,
                *(wp.from_torch(tensor) for tensor in (env.default_q, *self._keep)),
            ],
            outputs=[wp.from_torch(self.terms), wp.from_torch(self.total)],
            device=str(device),
        )  # fmt: skip
