"""Momentum in flight: internal torques of motors and MR devices move no centre of mass."""

from dataclasses import replace

import mujoco
import numpy as np
import torch

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv

LINEAR, ANGULAR = 0.05, 0.02
"""Largest drift of the momentum [N·s] and of the angular momentum [kg·m²/s]: the semi-implicit Euler step takes the
mass matrix at its start, an error of dt*m*l*qd^2 per swing (0.005 s * 2 kg * 0.2 m * (3 rad/s)^2 = 0.02 N·s). Twelve
sets of starting poses give 0.006 to 0.016 kg·m²/s, and half a step half of that."""


def momentum(model: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """Linear and angular momentum about the centre of mass, shape (6,), by MuJoCo in float64."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, data)
    mujoco.mj_subtreeVel(model, data)
    return np.concatenate([model.body_subtreemass[0] * data.subtree_linvel[0], data.subtree_angmom[0]])


def test_momentum_in_flight_follows_gravity_alone() -> None:
    """0.4 s in the air with moving legs: momentum changes by m*g*t (49 N·s), angular momentum not at all."""
    env = WalkEnv(replace(TaskCfg(num_envs=4, threads=1), noise=None, randomize=None))
    model = env.sim.scene.model
    qpos, qvel = (env.view(env.sim.backend.field(name)) for name in ("qpos", "qvel"))
    qpos[:, 2] += 5.0
    qvel.zero_()
    env.sim.refresh()
    before = [momentum(model, q, v) for q, v in zip(qpos.numpy(), qvel.numpy(), strict=True)]
    targets = 2.0 * torch.rand(4, 12, generator=torch.Generator().manual_seed(0)) - 1.0
    env.q_des.copy_(env.default_q + 0.5 * targets)
    env.robot.step(80)
    gravity = np.array([0.0, 0.0, -9.81 * float(model.body_subtreemass[0]) * 0.4])
    for q, v, start in zip(qpos.numpy(), qvel.numpy(), before, strict=True):
        drift = momentum(model, q, v) - start
        assert np.abs(drift[:3] - gravity).max() < LINEAR
        assert np.abs(drift[3:]).max() < ANGULAR
