"""Reward terms: velocity tracking, clocked gait, posture, effort and smoothness. Each gives one value per env (E,)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from mrwarp.env import gait

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv


def total(env: WalkEnv) -> torch.Tensor:
    """Weighted sum of all terms over one policy step, shape (E,)."""
    weights, reward = env.cfg.rewards, torch.zeros(env.num_envs, device=env.device)
    for name, term in TERMS.items():
        reward = reward + getattr(weights, name) * term(env)
    return reward * env.cfg.step_dt


def track_velocity(env: WalkEnv) -> torch.Tensor:
    """exp(-|v_xy - command|^2 / width)."""
    error = (env.body_velocity[:, :2] - env.command[:, :2]).square().sum(1)
    return torch.exp(error * (-1.0 / env.cfg.rewards.velocity_width))


def track_yaw(env: WalkEnv) -> torch.Tensor:
    """exp(-(yaw rate - command)^2 / width)."""
    return torch.exp((env.root_ang[:, 2] - env.command[:, 2]).square() * (-1.0 / env.cfg.rewards.yaw_width))


def contact_clock(env: WalkEnv) -> torch.Tensor:
    """Share of feet whose contact is what the gait clock wants, minus a half."""
    return env.clock_match.float().mean(1) - 0.5


def swing_height(env: WalkEnv) -> torch.Tensor:
    """Squared error of the swinging feet's clearance [m^2], summed."""
    height = gait.foot_height(env.q, env.root_pos[:, 2], -env.gravity)
    wanted = gait.swing_clearance(env.leg_phase, env.cfg.rewards.step_height)
    return torch.where(env.leg_phase >= 0.5, (height - wanted).square(), 0.0).sum(1)


def height(env: WalkEnv) -> torch.Tensor:
    """Squared error of the trunk height [m^2]."""
    return (env.root_pos[:, 2] - env.cfg.rewards.target_height).square()


def tilt(env: WalkEnv) -> torch.Tensor:
    """Squared horizontal part of the projected gravity."""
    return env.gravity[:, :2].square().sum(1)


def bounce(env: WalkEnv) -> torch.Tensor:
    """Squared vertical speed [(m/s)^2]."""
    return env.root_vel[:, 2].square()


def roll_pitch_rate(env: WalkEnv) -> torch.Tensor:
    """Squared roll and pitch rates [(rad/s)^2]."""
    return env.root_ang[:, :2].square().sum(1)


def posture(env: WalkEnv) -> torch.Tensor:
    """Squared distance of all joints from the neutral stance [rad^2]."""
    return (env.q - env.default_q).square().sum(1)


def hip_posture(env: WalkEnv) -> torch.Tensor:
    """Squared hip angles [rad^2]: legs stay under the body."""
    return env.q[:, 0::3].square().sum(1)


def effort(env: WalkEnv) -> torch.Tensor:
    """Squared motor torques [(N·m)^2], averaged over the torque steps."""
    return env.effort


def action_rate(env: WalkEnv) -> torch.Tensor:
    """Squared change of the action."""
    return (env.action - env.last_action).square().sum(1)


def joint_acceleration(env: WalkEnv) -> torch.Tensor:
    """Squared joint acceleration over the policy step [(rad/s^2)^2]."""
    return (env.qd - env.last_qd).square().sum(1) * (1.0 / env.cfg.step_dt**2)


TERMS = {
    term.__name__: term
    for term in (
        track_velocity, track_yaw, contact_clock, swing_height, height, tilt, bounce, roll_pitch_rate, posture,
        hip_posture, effort, action_rate, joint_acceleration,
    )
}  # fmt: skip
"""All terms by the name of their weight in ``RewardCfg``."""
