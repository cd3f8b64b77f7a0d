"""Rewards: velocity tracking, clocked gait, posture, effort and smoothness, and their weighted sum."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

from dataclasses import dataclass

import torch
import warp as wp

from mrwarp.env.gait import Legs, foot_height, swing_clearance
from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import Launch, record_per_env

TERMS = {
    "track_velocity": "exp(-|v_xy - command|^2 / width)",
    "track_yaw": "exp(-(yaw rate - command)^2 / width)",
    "contact_clock": "share of feet whose contact is what the gait clock wants, minus a half",
    "swing_height": "squared error of the swinging feet's clearance over the ground [m^2], summed",
    "height": "squared error of the trunk's height over the ground [m^2]",
    "tilt": "squared horizontal part of the projected gravity",
    "bounce": "squared vertical speed [(m/s)^2]",
    "roll_pitch_rate": "squared roll and pitch rates [(rad/s)^2]",
    "posture": "squared distance of all joints from the neutral stance [rad^2]",
    "hip_posture": "squared distance of hips, which turn about x, from the stance [rad^2]: legs stay under the body",
    "effort": "squared motor torques [(N·m)^2], averaged over the torque steps",
    "action_rate": "squared change of the action",
    "joint_acceleration": "squared joint acceleration over the policy step [(rad/s^2)^2]",
    "power": "electrical power of motors and coils [W]: copper loss, mechanical power, coil loss",
}
"""All terms, by the name of their weight in ``RewardCfg``, in the order of the kernel."""


@dataclass(frozen=True, kw_only=True)
class RewardCfg:
    """Weights of the reward terms, per second; see :data:`TERMS`."""

    track_velocity: float = 2.0
    track_yaw: float = 0.5
    contact_clock: float = 1.5
    swing_height: float = -30.0
    height: float = -40.0
    tilt: float = -3.0
    bounce: float = -1.0
    roll_pitch_rate: float = -0.05
    posture: float = -0.15
    hip_posture: float = -1.0
    effort: float = -3e-4
    action_rate: float = -0.02
    joint_acceleration: float = -1e-7
    power: float = 0.0
    """Per watt of electrical power of motors and coils."""
    winding_resistance: float = 0.128
    """Phase resistance that the power is computed with [Ohm]; a public motor of this size has 0.105 to 0.13 (see
    ``ElectricalCfg``). Not the calibrated number: the calibration needs trained policies."""
    target_height: float = 0.32
    """Wanted trunk height [m]; the paper's policies walk at 0.328 to 0.334."""
    velocity_width: float = 0.04
    """Squared velocity error at which tracking falls to 1/e [(m/s)^2]."""
    yaw_width: float = 0.1
    """Squared yaw-rate error at which tracking falls to 1/e [(rad/s)^2]."""
    step_height: float = 0.06
    """Clearance of a swinging foot at mid swing [m]."""


@wp.func
def tracking(squared_error: float, width: float) -> float:
    """exp(-error^2/width): 1 on target, 1/e where the squared error is the width."""
    return wp.exp(-squared_error / width)


@wp.func
def square_to(values: wp.array2d[float], wanted: wp.array2d[float], env: int) -> float:
    """Squared distance of an environment's values from what is wanted of it."""
    total = float(0.0)
    for k in range(values.shape[1]):
        difference = values[env, k] - wanted[env, k]
        total += difference * difference
    return total


@wp.func
def contact_share(clock_match: wp.array2d[wp.bool], env: int) -> float:
    """Share of feet whose contact is what the gait clock wants."""
    total = float(0.0)
    for leg in range(clock_match.shape[1]):
        total += wp.where(clock_match[env, leg], 1.0, 0.0)
    return total / float(clock_match.shape[1])


@wp.func
def clearance_error(
    legs: Legs,
    q: wp.array2d[float],
    leg_phase: wp.array2d[float],
    ground: wp.array2d[float],
    root_z: float,
    up: wp.vec3,
    step_height: float,
    env: int,
) -> float:
    """Squared error of the swinging feet's clearance over the ground [m^2], summed."""
    total = float(0.0)
    for leg in range(leg_phase.shape[1]):
        phase = leg_phase[env, leg]
        if phase >= 0.5:
            height = foot_height(legs, leg, q, env, root_z, up)
            error = height - ground[env, leg] - swing_clearance(phase, step_height)
            total += error * error
    return total


@wp.kernel(enable_backward=False)
def rewards_kernel(
    # parameters: environments that a thread takes are this far apart; squared widths of the tracking rewards, swing
    # clearance [m], trunk height [m], policy step [s]; legs; neutral stance [rad], shape (J,); weights in the order of
    # TERMS, shape (T,)
    rows: int,
    velocity_width: float,
    yaw_width: float,
    step_height: float,
    target_height: float,
    step_dt: float,
    legs: Legs,
    default_q: wp.array[float],
    weights: wp.array[float],
    # in, shapes (E, 3) twice, (E,) over the ground, (E, 3) four times, (E, J) three times, (E, A) twice, (E,) twice,
    # (E, L) three times: height of the ground below each foot [m], phases, contacts
    body_velocity_in: wp.array2d[float],
    command_in: wp.array2d[float],
    height_in: wp.array[float],
    root_pos_in: wp.array2d[float],
    root_vel_in: wp.array2d[float],
    root_ang_in: wp.array2d[float],
    gravity_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    last_qd_in: wp.array2d[float],
    action_in: wp.array2d[float],
    last_action_in: wp.array2d[float],
    effort_in: wp.array[float],
    power_in: wp.array[float],
    foot_ground_in: wp.array2d[float],
    leg_phase_in: wp.array2d[float],
    clock_match_in: wp.array2d[wp.bool],
    # out, shapes (E, T), (E,)
    terms_out: wp.array2d[float],
    total_out: wp.array[float],
):
    """All terms, and their weighted sum over one policy step."""
    first = wp.tid()
    for env in range(first, q_in.shape[0], rows):
        roll_rate, pitch_rate = root_ang_in[env, 0], root_ang_in[env, 1]
        gravity = wp.vec3(gravity_in[env, 0], gravity_in[env, 1], gravity_in[env, 2])
        z, v_z = height_in[env], root_vel_in[env, 2]

        error_x = body_velocity_in[env, 0] - command_in[env, 0]
        error_y = body_velocity_in[env, 1] - command_in[env, 1]
        terms_out[env, 0] = tracking(error_x * error_x + error_y * error_y, velocity_width)
        error_yaw = root_ang_in[env, 2] - command_in[env, 2]
        terms_out[env, 1] = tracking(error_yaw * error_yaw, yaw_width)
        terms_out[env, 2] = contact_share(clock_match_in, env) - 0.5
        terms_out[env, 3] = clearance_error(
            legs, q_in, leg_phase_in, foot_ground_in, root_pos_in[env, 2], -gravity, step_height, env
        )
        terms_out[env, 4] = (z - target_height) * (z - target_height)
        terms_out[env, 5] = gravity[0] * gravity[0] + gravity[1] * gravity[1]
        terms_out[env, 6] = v_z * v_z
        terms_out[env, 7] = roll_rate * roll_rate + pitch_rate * pitch_rate
        posture, hips = float(0.0), float(0.0)
        for joint in range(q_in.shape[1]):
            q = q_in[env, joint]
            posture += (q - default_q[joint]) * (q - default_q[joint])
            if legs.hips[joint] == 1.0:
                hips += (q - default_q[joint]) * (q - default_q[joint])
        terms_out[env, 8] = posture
        terms_out[env, 9] = hips
        terms_out[env, 10] = effort_in[env]
        terms_out[env, 11] = square_to(action_in, last_action_in, env)
        terms_out[env, 12] = square_to(qd_in, last_qd_in, env) / (step_dt * step_dt)
        terms_out[env, 13] = power_in[env]

        total = float(0.0)
        for term in range(weights.shape[0]):
            total += weights[term] * terms_out[env, term]
        total_out[env] = total * step_dt


def reward(s: WalkState, cfg: RewardCfg, step_dt: float, legs: Legs) -> Launch:
    """What writes all terms, ``s.terms``, and their weighted sum over a policy step of ``step_dt`` [s], ``s.total``."""
    weights = torch.tensor([getattr(cfg, name) for name in TERMS], device=s.q.device)
    return record_per_env(
        rewards_kernel,
        len(s.q),
        [
            *(cfg.velocity_width, cfg.yaw_width, cfg.step_height, cfg.target_height, step_dt, legs),
            *(s.default_q, weights),
            *(s.body_velocity, s.command, s.height, s.root_pos, s.root_vel, s.root_ang, s.gravity),
            *(s.q, s.qd, s.last_qd, s.action, s.last_action, s.effort, s.power),
            *(s.foot_ground, s.leg_phase, s.clock_match),
        ],
        [s.terms, s.total],
    )
