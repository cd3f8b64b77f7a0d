"""Events: how episodes begin, kicks, and what differs between environments (domain randomisation)."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

from typing import Any

import torch
import warp as wp

from mrwarp.actuator.mr_actuator import MrActuator
from mrwarp.env.config.mdp_cfg import RandomizeCfg
from mrwarp.env.rng import DEVICE, POSE, PUSH, between, draw, further, place
from mrwarp.env.sim import Sim
from mrwarp.env.state import WalkState, clear_rows
from mrwarp.kernels.launch import Launch, record, record_per_env

SCALED = ("B", "K0", "K1", "T_max")
"""MR parameters that are scaled."""

CLEARANCE = 0.01
"""How far over its stance the trunk begins [m]."""

JOINT_SPREAD = wp.constant(0.1)
"""Largest distance of a joint from the neutral stance at the start [rad]."""
SPEED_SPREAD = wp.constant(0.1)
"""Largest component of the trunk's velocity [m/s] and angular velocity [rad/s] at the start."""


@wp.kernel(enable_backward=False)
def begin_episode_kernel(
    # parameters: environments of a thread have this stride; height of the trunk over the ground [m]; joint
    # addresses, shape (J,); neutral stance [rad], shape (J,); middles of the tiles [m], shape (levels, kinds, 3);
    # what clear_rows zeroes
    rows: int,
    height: float,
    q_adr: wp.array[int],
    default_q: wp.array[float],
    origins: wp.array3d[float],
    cleared: wp.array[wp.uint64],
    words: wp.array[int],
    # in, shapes (2,), (E,), tile of each environment, (E,) twice
    key_in: wp.array[wp.int64],
    mask_in: wp.array[wp.bool],
    level_in: wp.array[wp.int64],
    kind_in: wp.array[wp.int64],
    # out, shapes (E, nq), (E, nv), (E,), (E, J) [rad], (E, J) [N·m]
    qpos_out: wp.array2d[float],
    qvel_out: wp.array2d[float],
    phase_out: wp.array[float],
    q_des_out: wp.array2d[float],
    tau_motor_out: wp.array2d[float],
):
    """Draw pose, velocity and phase near the neutral stance, and clear what belongs to the last episode."""
    first = wp.tid()
    for env in range(first, mask_in.shape[0], rows):
        if mask_in[env]:
            clear_rows(cleared, words, env)
            joints = q_adr.shape[0]
            begin = place(key_in, env, POSE)
            level, kind = int(level_in[env]), int(kind_in[env])
            for k in range(qpos_out.shape[1]):
                qpos_out[env, k] = 0.0
            for k in range(qvel_out.shape[1]):
                qvel_out[env, k] = 0.0
            for k in range(3):
                qpos_out[env, k] = origins[level, kind, k]
            qpos_out[env, 2] = qpos_out[env, 2] + height
            qpos_out[env, 3] = 1.0
            for joint in range(joints):
                spread = between(-JOINT_SPREAD, JOINT_SPREAD, begin, further(joint))
                qpos_out[env, q_adr[joint]] = default_q[joint] + spread
                q_des_out[env, joint] = default_q[joint]
                tau_motor_out[env, joint] = 0.0
            for k in range(6):
                qvel_out[env, k] = between(-SPEED_SPREAD, SPEED_SPREAD, begin, further(joints + k))
            phase_out[env] = between(0.0, 1.0, begin, further(joints + 6))


@wp.kernel(enable_backward=False)
def device_kernel(
    # parameters: environments of a thread have this stride; number of the parameter among the drawn ones;
    # least and largest factor [1]
    rows: int,
    number: int,
    low: float,
    high: float,
    # in, shapes (2,), (E,), (E, M) the asset's values
    key_in: wp.array[wp.int64],
    mask_in: wp.array[wp.bool],
    nominal_in: wp.array2d[float],
    # out, shape (E, M)
    value_out: wp.array2d[float],
):
    """Draw one parameter of the devices around its nominal value."""
    first = wp.tid()
    for env in range(first, mask_in.shape[0], rows):
        if mask_in[env]:
            begin = place(key_in, env, DEVICE)
            devices = value_out.shape[1]
            for slot in range(devices):
                factor = between(low, high, begin, further(number * devices + slot))
                value_out[env, slot] = nominal_in[env, slot] * factor


@wp.kernel(enable_backward=False)
def push_kernel(
    # parameters: chance of a kick in a policy step [1], largest kick along x and y [m/s]
    chance: float,
    push_speed: float,
    # in, shape (2,)
    key_in: wp.array[wp.int64],
    # out, shape (E, nv)
    qvel_out: wp.array2d[Any],
):
    """Kick the trunk sideways at random times."""
    env = wp.tid()
    begin = place(key_in, env, PUSH)
    if draw(begin, 0) < chance:
        for k in range(2):
            kick = between(-push_speed, push_speed, begin, 1 + k)
            qvel_out[env, k] = qvel_out[env, k] + qvel_out.dtype(kick)


def begin_episodes(s: WalkState, sim: Sim, mask: wp.array, origins: torch.Tensor | None) -> list[Launch]:
    """Launch that starts a new episode in masked environments, near the neutral stance, at any gait phase.

    The others stay bit-equal.

    Args:
        s: The task's arrays.
        sim: The physics, which is put into the new pose.
        mask: Environments whose episode begins, bool, shape (E,).
        origins: Middles of the terrain's tiles [m], shape (levels, kinds, 3); None begins at the world's origin.
    """
    num_envs, model, device = len(s.q), sim.scene.model, sim.device
    origins = torch.zeros(1, 1, 3) if origins is None else origins
    qpos = wp.zeros((num_envs, model.nq), dtype=float, device=device)
    qvel = wp.zeros((num_envs, model.nv), dtype=float, device=device)
    q_adr = wp.array(sim.scene.q_adr, dtype=int, device=device)
    pose = record_per_env(
        begin_episode_kernel,
        num_envs,
        [
            *(sim.scene.stand_height + CLEARANCE, q_adr, s.default_q, origins.to(s.q.device), *s.cleared()),
            *(s.key, mask, s.level, s.kind),
        ],
        [qpos, qvel, s.phase, s.q_des, s.tau_motor],
    )
    return [pose, sim.record_reset(mask, qpos, qvel)]


def draw_devices(s: WalkState, cfg: RandomizeCfg | None, actuator: MrActuator, mask: wp.array) -> list[Launch]:
    """Launch that draws new devices where the mask (E,) is set: a factor on each of :data:`SCALED`.

    Nothing without ``cfg``.
    """
    if cfg is None or not actuator.mr_joints:
        return []
    return [
        record_per_env(
            device_kernel,
            len(s.q),
            [number, *cfg.mr_scale, s.key, mask, wp.to_torch(actuator.param(name)).clone()],
            [actuator.param(name)],
        )
        for number, name in enumerate(SCALED)
    ]


def push(s: WalkState, cfg: RandomizeCfg | None, step_dt: float) -> list[Launch]:
    """Launch that kicks the trunk sideways at random times, by policy steps of ``step_dt`` [s].

    Nothing without ``cfg``.
    """
    if cfg is None or cfg.push_speed <= 0.0:
        return []
    return [record(push_kernel, len(s.q), [step_dt / cfg.push_interval, cfg.push_speed, s.key], [s.qvel])]


def randomize_robots(s: WalkState, cfg: RandomizeCfg, seed: int, sim: Sim, actuator: MrActuator) -> None:
    """Draw what stays for the whole run: ground friction, trunk mass, motor gains; the critic sees the first two."""
    device = s.q.device
    generator = torch.Generator(device=device).manual_seed(seed)

    def uniform(low: float, high: float, *shape: int) -> torch.Tensor:
        return low + (high - low) * torch.rand(*shape, generator=generator, device=device)

    friction, added = uniform(*cfg.friction, len(s.q)), uniform(*cfg.added_mass, len(s.q))
    sim.set_friction(friction.cpu().numpy())
    trunk = sim.scene.layout.trunk
    sim.rescale_mass(trunk, (sim.body_mass(trunk) + added).cpu().numpy())
    for plain, own in ((actuator.kp, ("kp_base", "kp_low")), (actuator.kd, ("kd",))):
        scale = uniform(*cfg.gain_scale, *plain.shape)
        wp.to_torch(plain).mul_(scale)
        for name in own if actuator.mr_joints else ():
            wp.to_torch(actuator.param(name)).mul_(scale[:, list(actuator.mr_joints)])
    s.privileged[:, 0] = friction
    s.privileged[:, 1] = added
