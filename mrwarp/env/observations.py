"""What the policy sees: the actor only what a real robot has, the critic also what the simulator knows."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
import warp as wp

from mrwarp.env.cfg import NoiseCfg
from mrwarp.env.task_kernels.draws import WIDTH
from mrwarp.env.task_kernels.observations import observe_kernel
from mrwarp.kernels.launch import record_per_env

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv

ACTOR_TERMS = {
    "gyro": 3, "gravity": 3, "command": 3, "q": 12, "qd": 12, "action": 12, "clock": 2,
}  # fmt: skip
"""Actor observation terms and their sizes, in order; 47 in total."""

QD_SCALE, F_FOOT_SCALE, TORQUE_SCALE = 0.05, 0.02, 0.05
"""Factors on joint velocities, foot forces and torques, so that all terms are of order one."""


class Observations:
    """The observations of an environment whose tensors stay where they are.

    Args:
        env: The environment.

    Attributes:
        launch: What computes them.
    """

    def __init__(self, env: WalkEnv) -> None:
        device, num_envs, actuator = env.device, env.num_envs, env.actuator
        joints, actions = env.q.shape[1], sum(ACTOR_TERMS.values())
        columns = actions + 3 + 1 + env.f_foot.shape[1] + 1 + joints + 2 + 3 * len(actuator.mr_joints)
        self._actor = torch.zeros(num_envs, actions, device=device)
        self._critic = torch.zeros(num_envs, columns, device=device)
        assert 6 + 2 * joints <= WIDTH
        noise = env.cfg.noise or NoiseCfg(gyro=0.0, gravity=0.0, q=0.0, qd=0.0)
        self.launch = record_per_env(
            observe_kernel,
            num_envs,
            inputs=[
                noise.gyro, noise.gravity, noise.q, noise.qd, QD_SCALE, F_FOOT_SCALE, TORQUE_SCALE,
                *(wp.from_torch(tensor) for tensor in (
                    env.default_q, env.key, env.root_ang, env.gravity, env.command, env.q, env.qd, env.action,
                    env.phase, env.body_velocity, env.height, env.f_foot, env.current_e,
                )),
                actuator.tau_motor, wp.from_torch(env.privileged), actuator.m_dyn, actuator.m_hold, actuator.current,
            ],
            outputs=[wp.from_torch(self._actor), wp.from_torch(self._critic)],
            device=str(device),
        )  # fmt: skip

    def copies(self) -> tuple[torch.Tensor, torch.Tensor]:
        """What actor and critic see, as tensors of their own: later launches do not write into them.

        Returns:
            Actor, shape (E, 47): gyro [rad/s], projected gravity, command, joint positions and velocities, last action,
            gait clock. Critic: the same without noise, and base velocity, height, foot forces, I_e, motor torques,
            friction and added mass, gates and coil currents.
        """
        return self._actor.clone(), self._critic.clone()
