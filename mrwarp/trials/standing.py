"""A robot standing in its neutral pose: what its joints do with the calves held by motors or by devices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
import warp as wp

from mrwarp.energy.power import JointLoad
from mrwarp.env.cfg import EnvCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.trials.power_meter import PowerMeter
from mrwarp.trials.walking import make_env, set_payload
from mrwarp.usd.robot import CALF_COLUMNS, STAND_HEIGHT

SETTLE = 4.0
"""Time in which the targets are moved until the pose is the neutral one [s]."""

RATE = 3.0
"""Rate at which the targets follow the pose error [1/s]."""

STIFFER = 3.0
"""Factor on the gains: the walking gains stand, but under a load the robot sags until it squats."""

HOLD = 1.0
"""Time between switching the devices on and measuring [s]."""


def standing_load(cfg: EnvCfg, *, load: float, hold: bool, seconds: float = 5.0) -> tuple[JointLoad, dict[str, float]]:
    """Stand and measure.

    A standing controller knows the robot's weight: the targets are moved until the joints stand where they should,
    which leaves the motors with the static torques. Then they are fixed and, with ``hold``, the devices switched on.

    Args:
        cfg: The robot; its payload variant must offer the load.
        load: Mass on the back [kg].
        hold: Whether the devices hold.
        seconds: PaperValue time [s].

    Returns:
        The mean joint load, shapes (J,) and (M,), and ``height`` [m], ``hold`` share, ``drift`` of the calves [rad].
    """
    env = make_env(replace(cfg, currents=(cfg.currents[-1],)), 1, 0)
    set_payload(env, np.array([load]))
    _stiffen(env)
    allowed = env.current_e.clone()
    env.current_e.zero_()
    actions = _settle(env)
    if hold:
        env.current_e.copy_(allowed)
    meter = PowerMeter(env)
    calves = list(env.actuator.mr_joints) or list(CALF_COLUMNS)
    for step in range(round((HOLD + seconds) / env.cfg.step_dt)):
        meter.on.fill_(step * env.cfg.step_dt >= HOLD)
        if step == round(HOLD / env.cfg.step_dt):
            start = env.q[:, calves].clone()
        env.step(actions)
    drift = float((env.q[:, calves] - start).abs().max())
    found = {"height": float(env.root_pos[0, 2]), "hold": float(meter.hold.mean()) if meter.hold.size else 0.0}
    return meter.joint_load()[0], {**found, "drift": drift}


def _stiffen(env: WalkEnv) -> None:
    """Motors that stand as stiffly as a standing controller makes them; the low gain while holding stays."""
    actuator = env.actuator
    for array in (actuator.kp, actuator.kd, actuator.param("kp_base"), actuator.param("kd")):
        env.view(array).mul_(STIFFER)


def _settle(env: WalkEnv) -> torch.Tensor:
    """Put the robot down in the neutral pose and return the actions that keep it there."""
    model = env.sim.scene.model
    qpos = torch.zeros(env.num_envs, model.nq, device=env.device)
    qpos[:, 2], qpos[:, 3] = STAND_HEIGHT, 1.0
    qpos[:, torch.from_numpy(env.sim.scene.q_adr).long()] = env.default_q
    everywhere = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
    env.robot.reset(wp.from_torch(everywhere), wp.from_torch(qpos), None)
    env.set_command(torch.zeros(env.num_envs, 3, device=env.device))
    actions = torch.zeros(env.num_envs, env.num_actions, device=env.device)
    for _ in range(round(SETTLE / env.cfg.step_dt)):
        actions += RATE * env.cfg.step_dt / env.cfg.action_scale * (env.default_q - env.q)
        env.step(actions)
    return actions
