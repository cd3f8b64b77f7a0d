"""How episodes begin: a masked reset made of launches, which a graph takes, with the same path on both engines."""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch
import warp as wp

from mrwarp.env import commands, randomize
from mrwarp.env.task_kernels.draws import WIDTH
from mrwarp.env.task_kernels.episodes import begin_episode_kernel
from mrwarp.kernels.launch import Work, record_per_env
from mrwarp.usd.robot import STAND_HEIGHT

if TYPE_CHECKING:
    from mrwarp.env.vec_env import WalkEnv

CLEARANCE = 0.01
"""How far over its stance the trunk begins [m]."""

_HISTORY = ("phase", "episode_length_buf", "action", "last_action", "last_qd", "q_des")


class Episodes:
    """Starts a new episode in masked environments, near the neutral stance, at any gait phase; others stay bit-equal.

    Where no environment is masked, it costs the launches: nothing is drawn and nothing is written.

    Args:
        env: The environment; its tensors stay where they are.
        mask: Environments whose episode begins, bool, shape (E,).

    Attributes:
        works: The launches, in order: state and history, device, derived quantities, command.
    """

    def __init__(self, env: WalkEnv, mask: wp.array) -> None:
        sim, actuator, terrain = env.sim, env.actuator, env.terrain
        model, num_envs, device = sim.scene.model, env.num_envs, sim.device
        assert env.num_actions + 7 <= WIDTH
        qpos = wp.zeros((num_envs, model.nq), dtype=float, device=device)
        qvel = wp.zeros((num_envs, model.nv), dtype=float, device=device)
        q_adr = wp.array(sim.scene.q_adr, dtype=int, device=device)
        flat = torch.zeros(num_envs, dtype=torch.int64, device=env.device)
        tile = (terrain.level, terrain.kind) if terrain else (flat, flat)
        origins = terrain.origins if terrain else torch.zeros(1, 1, 3, device=env.device)
        self._keep = (qpos, qvel, q_adr, flat, origins)
        begin = record_per_env(
            begin_episode_kernel,
            num_envs,
            inputs=[
                STAND_HEIGHT + CLEARANCE, q_adr, *map(wp.from_torch, (env.default_q, origins, env.key)), mask,
                *map(wp.from_torch, tile),
            ],
            outputs=[qpos, qvel, *(wp.from_torch(getattr(env, name)) for name in _HISTORY), actuator.tau_motor],
            device=device,
        )  # fmt: skip
        self._devices = randomize.Devices(env, mask)
        self._commands = commands.Commands(env, mask)
        self.works: list[Work] = [
            begin.launch,
            sim.record_reset(mask, qpos, qvel).launch,
            *(launch.launch for launch in self._devices.launches),
            lambda: actuator.reset(mask),
            *(launch.launch for launch in env.derive(mask)),
            self._commands.launch.launch,
        ]
