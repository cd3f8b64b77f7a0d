"""Observations: the actor sees what a real robot measures, the critic also what only the simulator knows."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import torch
import warp as wp

from mrwarp.env.config.mdp_cfg import NoiseCfg
from mrwarp.env.rng import NOISE, between, place
from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import Launch, record_per_env


def actor_terms(joints: int, currents: int = 0) -> dict[str, int]:
    """The actor's observation terms and their sizes, in order; 47 in total with 12 joints.

    ``currents``: coils that the policy commands, whose last command is part of the last action.
    """
    return {"gyro": 3, "gravity": 3, "command": 3, "q": joints, "qd": joints, "action": joints + currents, "clock": 2}


QD_SCALE, F_FOOT_SCALE, TORQUE_SCALE = 0.05, 0.02, 0.05
"""Factors on joint velocities, foot forces and torques, so that all terms are of order one."""


def critic_columns(joints: int, legs: int, devices: int, currents: int = 0) -> int:
    """Columns of the critic's observation: those of the actor, and what :func:`observe_kernel` adds."""
    return sum(actor_terms(joints, currents).values()) + 3 + 1 + legs + 1 + joints + 2 + 3 * devices


_COPY = """
const float* from = (const float*)((const char*)values.data + size_t(env) * values.strides[0]);
float* to = &wp::index(out, env, column);
for (int i = 0; i < values.shape[1]; ++i) to[i] = scale * from[i];
"""


@wp.func_native(_COPY)
def copy_row(values: wp.array2d[float], env: int, scale: float, column: int, out: wp.array2d[float]) -> None:
    """Write an environment's values, contiguous, scaled, from a column on."""
    ...


@wp.func
def put(values: wp.array2d[float], env: int, scale: float, column: int, out: wp.array2d[float]) -> int:
    """Write an environment's values, contiguous, scaled, from a column on; returns the next column."""
    copy_row(values, env, scale, column, out)
    return column + values.shape[1]


@wp.func
def noisy(value: float, width: float, begin: wp.uint64, k: int) -> float:
    """A value with uniform noise of a half-width, the k-th draw; a width of 0 draws nothing."""
    if width > 0.0:
        return value + between(-width, width, begin, k)
    return value


@wp.kernel(enable_backward=False)
def observe_kernel(
    # parameters: environments of a thread have this stride; noise half-widths of gyro [rad/s], gravity, joint
    # position [rad] and velocity [rad/s]; factors on joint velocities, foot forces and torques; neutral stance [rad],
    # shape (J,)
    rows: int,
    gyro_noise: float,
    gravity_noise: float,
    q_noise: float,
    qd_noise: float,
    qd_scale: float,
    f_foot_scale: float,
    torque_scale: float,
    default_q: wp.array[float],
    # in, shape (2,); sensors, shapes (E, 3) three times, (E, J) twice, (E, A), (E,); what the critic also sees,
    # shapes (E, 3) [m/s], (E,) [m], (E, L) [N], (E,) [A], (E, J) [N·m], (E, 2), (E, M) three times
    key_in: wp.array[wp.int64],
    root_ang_in: wp.array2d[float],
    gravity_in: wp.array2d[float],
    command_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    action_in: wp.array2d[float],
    phase_in: wp.array[float],
    body_velocity_in: wp.array2d[float],
    height_in: wp.array[float],
    f_foot_in: wp.array2d[float],
    current_e_in: wp.array[float],
    tau_motor_in: wp.array2d[float],
    privileged_in: wp.array2d[float],
    m_dyn_in: wp.array2d[float],
    m_hold_in: wp.array2d[float],
    current_in: wp.array2d[float],
    # out, shapes (E, 9 + 2*J + A + 2), (E, those + 7 + J + L + 3*M)
    actor_out: wp.array2d[float],
    critic_out: wp.array2d[float],
):
    """Actor: noisy sensors. Critic: the same without noise, and what only the simulator knows."""
    first = wp.tid()
    for env in range(first, q_in.shape[0], rows):
        joints = q_in.shape[1]
        begin = place(key_in, env, NOISE)
        for k in range(3):
            gyro, gravity = float(root_ang_in[env, k]), float(gravity_in[env, k])
            actor_out[env, k] = noisy(gyro, gyro_noise, begin, k)
            critic_out[env, k] = gyro
            actor_out[env, 3 + k] = noisy(gravity, gravity_noise, begin, 3 + k)
            critic_out[env, 3 + k] = gravity
            actor_out[env, 6 + k] = command_in[env, k]
            critic_out[env, 6 + k] = command_in[env, k]
        for k in range(joints):
            q, qd = q_in[env, k] - default_q[k], float(qd_in[env, k])
            actor_out[env, 9 + k] = noisy(q, q_noise, begin, 6 + k)
            critic_out[env, 9 + k] = q
            actor_out[env, 9 + joints + k] = qd_scale * noisy(qd, qd_noise, begin, 6 + joints + k)
            critic_out[env, 9 + joints + k] = qd_scale * qd
        column = put(action_in, env, 1.0, 9 + 2 * joints, actor_out)
        put(action_in, env, 1.0, 9 + 2 * joints, critic_out)
        angle = 2.0 * wp.pi * phase_in[env]
        s, c = wp.sin(angle), wp.cos(angle)
        actor_out[env, column] = s
        actor_out[env, column + 1] = c
        critic_out[env, column] = s
        critic_out[env, column + 1] = c

        column = put(body_velocity_in, env, 1.0, column + 2, critic_out)
        critic_out[env, column] = height_in[env]
        column = put(f_foot_in, env, f_foot_scale, column + 1, critic_out)
        critic_out[env, column] = current_e_in[env]
        column = put(tau_motor_in, env, torque_scale, column + 1, critic_out)
        column = put(privileged_in, env, 1.0, column, critic_out)
        column = put(m_dyn_in, env, 1.0, column, critic_out)
        column = put(m_hold_in, env, 1.0, column, critic_out)
        column = put(current_in, env, 1.0, column, critic_out)


def observe(s: WalkState, cfg: NoiseCfg | None, out: tuple[torch.Tensor, torch.Tensor] | None = None) -> Launch:
    """Launch that writes ``s.actor`` and ``s.critic``, or ``out`` in their place.

    Actor, shape (E, O): gyro [rad/s], projected gravity, command, joint positions and velocities, last action, gait
    clock, with noise. Critic: the same without noise, and base velocity, height, foot forces, I_e, motor torques,
    friction and added mass, gates and coil currents.
    """
    noise = cfg or NoiseCfg(gyro=0.0, gravity=0.0, q=0.0, qd=0.0)
    return record_per_env(
        observe_kernel,
        len(s.q),
        [
            *(noise.gyro, noise.gravity, noise.q, noise.qd, QD_SCALE, F_FOOT_SCALE, TORQUE_SCALE),
            *(s.default_q, s.key, s.root_ang, s.gravity, s.command, s.q, s.qd, s.action, s.phase),
            *(s.body_velocity, s.height, s.f_foot, s.current_e, s.tau_motor, s.privileged),
            *(s.m_dyn, s.m_hold, s.current),
        ],
        out or (s.actor, s.critic),
    )
