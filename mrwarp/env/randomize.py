"""Domain randomisation: what differs between environments, and when it is drawn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
import warp as wp

from mrwarp.env.task_kernels.derived import push_kernel
from mrwarp.env.task_kernels.draws import WIDTH
from mrwarp.env.task_kernels.episodes import device_kernel
from mrwarp.kernels.launch import record, record_per_env

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv

SCALED = ("B", "K0", "K1", "T_max")
"""MR parameters that are scaled."""


def at_start(env: WalkEnv) -> None:
    """Draw what stays for the whole run: ground friction, trunk mass, motor gains."""
    cfg = env.cfg.randomize
    if cfg is None:
        return
    generator = torch.Generator(device=env.device).manual_seed(env.cfg.seed)

    def between(low: float, high: float, *shape: int) -> torch.Tensor:
        return low + (high - low) * torch.rand(*shape, generator=generator, device=env.device)

    friction = between(*cfg.friction, env.num_envs)
    added = between(*cfg.added_mass, env.num_envs)
    env.sim.set_friction(friction.cpu().numpy())
    env.sim.rescale_mass("trunk", (env.trunk_mass + added).cpu().numpy())
    for plain, own in ((env.actuator.kp, ("kp_base", "kp_low")), (env.actuator.kd, ("kd",))):
        scale = between(*cfg.gain_scale, *plain.shape)
        env.view(plain).mul_(scale)
        for name in own if env.actuator.mr_joints else ():
            env.view(env.actuator.param(name)).mul_(scale[:, list(env.actuator.mr_joints)])
    env.privileged[:, 0] = friction
    env.privileged[:, 1] = added


class Devices:
    """Draws new devices in masked environments: a factor on each of :data:`SCALED`; none without randomisation.

    Args:
        env: The environment.
        mask: Environments that get them, bool, shape (E,).

    Attributes:
        launches: What draws them, one per parameter.
    """

    def __init__(self, env: WalkEnv, mask: wp.array) -> None:
        cfg, actuator = env.cfg.randomize, env.actuator
        self.launches: list[wp.Launch] = []
        if cfg is None or not actuator.mr_joints:
            return
        assert len(SCALED) * len(actuator.mr_joints) <= WIDTH
        for number, name in enumerate(SCALED):
            nominal = wp.from_torch(env.nominal_mr[name])
            launch = record_per_env(
                device_kernel,
                env.num_envs,
                inputs=[number, *cfg.mr_scale, wp.from_torch(env.key), mask, nominal],
                outputs=[actuator.param(name)],
                device=env.sim.device,
            )
            self.launches.append(launch)


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
        self._launch = record(
            push_kernel,
            dim=env.num_envs,
            inputs=[env.cfg.step_dt / cfg.push_interval, cfg.push_speed, wp.from_torch(env.key)],
            outputs=[env.sim.backend.field("qvel")],
            device=env.sim.device,
        )

    def __call__(self) -> None:
        """Draw for this policy step, and kick."""
        if self._launch is not None:
            self._launch.launch()
