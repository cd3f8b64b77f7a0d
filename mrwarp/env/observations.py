"""What the policy sees: the actor only what a real robot has, the critic also what the simulator knows."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv

ACTOR_TERMS = {
    "gyro": 3, "gravity": 3, "command": 3, "q": 12, "qd": 12, "action": 12, "clock": 2,
}  # fmt: skip
"""Actor observation terms and their sizes, in order; 47 in total."""

QD_SCALE = 0.05
"""Factor on joint velocities, so that all terms are of order one."""


def actor(env: WalkEnv) -> torch.Tensor:
    """Gyro [rad/s], projected gravity, command, joint positions, velocities, last action, gait clock; (E, 47)."""
    gyro, gravity, q, qd = env.root_ang, env.gravity, env.q - env.default_q, env.qd
    noise = env.cfg.noise
    if noise is not None:
        u = env.uniform(env.num_envs, 30)
        gyro = gyro + noise.gyro * u[:, 0:3]
        gravity = gravity + noise.gravity * u[:, 3:6]
        q = q + noise.q * u[:, 6:18]
        qd = qd + noise.qd * u[:, 18:30]
    return torch.cat([gyro, gravity, env.command, q, QD_SCALE * qd, env.action, _clock(env)], dim=1)


def critic(env: WalkEnv) -> torch.Tensor:
    """The actor's terms without noise, and base velocity, height, foot forces, gates, currents and torques."""
    device = env.actuator
    own = [
        env.root_ang, env.gravity, env.command, env.q - env.default_q, QD_SCALE * env.qd, env.action, _clock(env),
        env.body_velocity, env.root_pos[:, 2:3], 0.02 * env.f_foot, env.current_e.unsqueeze(1),
        0.05 * env.view(device.tau_motor), env.privileged,
    ]  # fmt: skip
    if device.mr_joints:
        own += [env.view(device.m_dyn), env.view(device.m_hold), env.view(device.current)]
    return torch.cat(own, dim=1)


def _clock(env: WalkEnv) -> torch.Tensor:
    angle = (2.0 * math.pi) * env.phase.unsqueeze(1)
    return torch.cat([torch.sin(angle), torch.cos(angle)], dim=1)
