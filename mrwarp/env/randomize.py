"""Domain randomisation: what differs between environments, and when it is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
import warp as wp

from mrwarp.env.task_kernels.derived import push_kernel
from mrwarp.launch import record

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


class Pushes:
    """Kicks that move the trunk sideways by up to ``push_speed`` at random times; none without randomisation.

    Args:
        env: The environment.
    """

    def __init__(self, env: WalkEnv) -> None:
        cfg = env.cfg.randomize
        self._launch: wp.Launch | None = None
        if cfg is None or cfg.push_speed <= 0.0:
            return
        self._generator, self._draws = env.generator, torch.zeros(env.num_envs, 3, device=env.device)
        self._launch = record(
            push_kernel,
            dim=env.num_envs,
            inputs=[env.cfg.step_dt / cfg.push_interval, cfg.push_speed, wp.from_torch(self._draws)],
            outputs=[env.sim.backend.field("qvel")],
            device=env.sim.device,
        )

    def __call__(self) -> None:
        """Draw for one policy step, and kick."""
        if self._launch is not None:
            torch.rand(self._draws.shape, generator=self._generator, out=self._draws)
            self._launch.launch()
