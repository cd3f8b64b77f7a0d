"""Domain randomisation: what differs between environments, and when it is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv

SCALED = ("B", "K0", "K1", "T_max")
"""MR parameters that are scaled."""


def at_start(env: WalkEnv) -> None:
    """Draw what stays for the whole run: ground friction, trunk mass, motor gains."""
    cfg = env.cfg.randomize
    if cfg is None:
        return
    friction = env.between(*cfg.friction, env.num_envs)
    added = env.between(*cfg.added_mass, env.num_envs)
    env.sim.set_friction(friction.cpu().numpy())
    env.sim.rescale_mass("trunk", (env.trunk_mass + added).cpu().numpy())
    for plain, own in ((env.actuator.kp, ("kp_base", "kp_low")), (env.actuator.kd, ("kd",))):
        scale = env.between(*cfg.gain_scale, *plain.shape)
        env.view(plain).mul_(scale)
        for name in own if env.actuator.mr_joints else ():
            env.view(env.actuator.param(name)).mul_(scale[:, list(env.actuator.mr_joints)])
    env.privileged[:, 0] = friction
    env.privileged[:, 1] = added


def at_reset(env: WalkEnv, mask: torch.Tensor) -> None:
    """Draw a new device for the masked environments, bool, shape (E,)."""
    cfg = env.cfg.randomize
    if cfg is None or not env.actuator.mr_joints:
        return
    for name in SCALED:
        view = env.view(env.actuator.param(name))
        scaled = env.nominal_mr[name] * env.between(*cfg.mr_scale, *view.shape)
        view.copy_(torch.where(mask.unsqueeze(1), scaled, view))


def push(env: WalkEnv) -> None:
    """Kick the trunk sideways by up to ``push_speed`` at random times."""
    cfg = env.cfg.randomize
    if cfg is None or cfg.push_speed <= 0.0:
        return
    due = env.between(0.0, 1.0, env.num_envs) < env.cfg.step_dt / cfg.push_interval
    kick = cfg.push_speed * env.uniform(env.num_envs, 2)
    env.qvel[:, :2] += torch.where(due.unsqueeze(1), kick, 0.0)
