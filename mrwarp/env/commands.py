"""Commands of a robot: velocity, a policy's joint targets, coil currents; and the effort spent on them.

Coils may be commanded at 50 Hz, by a law or by the policy. A device's coil gets its current while one of its gates is
open (200 Hz), else none; the coil's lag follows. Without a command (``fixed``) nothing of this runs, and the gates take
I_e, or the support current at 200 Hz.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import math
from typing import Any

import torch
import warp as wp

from mrwarp.enums import CurrentCommand
from mrwarp.env.config.mdp_cfg import CommandCfg
from mrwarp.env.rng import COMMAND, STEP, between, place
from mrwarp.env.state import WalkState
from mrwarp.kernels.brake import holding_need, support_current
from mrwarp.kernels.launch import Launch, record
from mrwarp.kernels.ledger import COIL, MOTOR, MOTOR_SQUARE
from mrwarp.kernels.mr_joint import JointParams


@wp.kernel(enable_backward=False)
def command_kernel(
    # parameters: policy steps between two commands, 0 = they are held; least and largest command, shape (3,) [m/s, m/s,
    # rad/s]
    period: int,
    low: wp.array[float],
    high: wp.array[float],
    # in, shapes (2,), (E,) [policy steps], (E,)
    key_in: wp.array[wp.int64],
    episode_length_in: wp.array[wp.int64],
    mask_in: wp.array[wp.bool],
    # out, shape (E, 3) [m/s, m/s, rad/s]
    command_out: wp.array2d[float],
):
    """Draw a new command where an episode begins (the mask), and every ``period`` steps of an episode."""
    env = wp.tid()
    due = mask_in[env]
    if period > 0:
        step = int(episode_length_in[env])
        due = due or (step > 0 and step % period == 0)
    if due:
        begin = place(key_in, env, COMMAND)
        for k in range(3):
            command_out[env, k] = between(low[k], high[k], begin, k)


def draw_commands(s: WalkState, cfg: CommandCfg, step_dt: float, begins: wp.array) -> Launch:
    """Launch that draws a command where an episode begins, mask (E,), and every ``period``; ``step_dt`` in s."""
    ranges = zip(cfg.v_x, cfg.v_y, cfg.yaw_rate, strict=True)
    low, high = (torch.tensor(side, device=s.command.device) for side in ranges)
    period = max(round(cfg.period / step_dt), 1) if math.isfinite(cfg.period) else 0
    return record(command_kernel, len(s.command), [period, low, high, s.key, s.episode_length_buf, begins], [s.command])


@wp.func
def spent(ledger: wp.array3d[float], copper: wp.array[float], env: int) -> wp.vec2:
    """Effort of all joints since the reset: integral of the squared motor torques [(N·m)^2 s]; electrical energy [J].

    The energy is the motors' copper loss and mechanical work, given-back work counted in full, and the coils' loss.

    Args:
        ledger: Energy ledger, shape (E, J, entries).
        copper: Copper loss per torque squared, shape (J,) [W/(N·m)^2].
        env: Environment.
    """
    square, energy = float(0.0), float(0.0)
    for joint in range(ledger.shape[1]):
        square += ledger[env, joint, MOTOR_SQUARE]
        energy += (
            copper[joint] * ledger[env, joint, MOTOR_SQUARE] + ledger[env, joint, MOTOR] + ledger[env, joint, COIL]
        )
    return wp.vec2(square, energy)


@wp.kernel(enable_backward=False)
def action_kernel(
    # parameters: action scale [rad]; neutral stance [rad], shape (A,); copper loss [W/(N·m)^2], shape (J,)
    action_scale: float,
    default_q: wp.array[float],
    copper: wp.array[float],
    # in, shapes (E, A), (E, J) [rad/s], (E, J, entries)
    actions_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    ledger_in: wp.array3d[float],
    # out, shapes (E, A), (E, A), (E, J) [rad], (E, J) [rad/s], (E, 2) [(N·m)^2 s, J]
    action_out: wp.array2d[float],
    last_action_out: wp.array2d[float],
    q_des_out: wp.array2d[float],
    last_qd_out: wp.array2d[float],
    spent_out: wp.array2d[float],
):
    """Take the new action, and remember what the coming policy step is compared with."""
    env = wp.tid()
    for k in range(actions_in.shape[1]):
        last_action_out[env, k] = action_out[env, k]
        action_out[env, k] = actions_in[env, k]
    for k in range(q_des_out.shape[1]):  # further actions command currents
        q_des_out[env, k] = default_q[k] + action_scale * actions_in[env, k]
        last_qd_out[env, k] = qd_in[env, k]
    before = spent(ledger_in, copper, env)
    spent_out[env, 0] = before[0]
    spent_out[env, 1] = before[1]


@wp.kernel(enable_backward=False)
def effort_kernel(
    # parameters: clock advance per policy step [1], policy step [s]; copper loss [W/(N·m)^2], shape (J,)
    advance: float,
    step_dt: float,
    copper: wp.array[float],
    # in, shapes (E, J, entries), (E, 2) [(N·m)^2 s, J], (E,)
    ledger_in: wp.array3d[float],
    spent_in: wp.array2d[float],
    phase_in: wp.array[float],
    # out, shapes (E,) [(N·m)^2], (E,) [W], (E,), (2,)
    effort_out: wp.array[float],
    power_out: wp.array[float],
    phase_out: wp.array[float],
    key_out: wp.array[wp.int64],
):
    """Squared motor torques and electrical power, means over the policy step; the gait clock at its end; count it."""
    env = wp.tid()
    if env == 0:
        key_out[STEP] = key_out[STEP] + wp.int64(1)  # nothing is drawn in this launch
    mean = (spent(ledger_in, copper, env) - wp.vec2(spent_in[env, 0], spent_in[env, 1])) / step_dt
    effort_out[env] = mean[0]
    power_out[env] = mean[1]
    phase = phase_in[env] + advance
    phase_out[env] = phase - wp.floor(phase)


def take_actions(s: WalkState, scale: float, copper: wp.array) -> Launch:
    """Launch that writes joint targets from ``s.actions``, ``scale`` [rad] for each.

    ``copper``: loss of each motor per torque squared [W/(N·m)^2], shape (J,).
    """
    return record(
        action_kernel,
        len(s.q),
        [scale, s.default_q, copper, s.actions, s.qd, s.ledger],
        [s.action, s.last_action, s.q_des, s.last_qd, s.spent],
    )


MIDDLE = wp.constant(1.0 / 3.0)
"""Current that a learned action of 0 commands, as a share of I_e: of 1.5 A the best fixed one, 0.5 A
(docs/beyond.md). Actions of -1 and 2 command none and all."""


@wp.func
def scheduled_current(p: JointParams, e: float, qd: float, strength: float, allowed: float) -> float:
    """Current by law [A]: as much as the load needs (eq. 18) of a joint that may soon hold, all for one that moves.

    Args:
        p: The device.
        e: Tracking error [rad], eq. 4, whose share of the low gain is the need (eq. 19).
        qd: Joint velocity [rad/s]. Above eps_v only damping (eq. 5) may open, whose torque is far below the need.
        strength: Yield torque expected of the device, as a share of its nominal one: 1 cold, less when warm.
        allowed: Largest current [A].
    """
    if wp.abs(qd) > p.eps_v:
        return allowed
    need = holding_need(e, p.kp_base, p.kp_low) / wp.max(strength, 0.05)
    return support_current(need, p.safety_factor, allowed, p.T_max, p.K, p.n)


@wp.func
def learned_current(action: float, allowed: float) -> float:
    """Current that the policy commands [A]: linear in its action about :data:`MIDDLE`, clipped to what is allowed."""
    return allowed * wp.clamp(MIDDLE * (1.0 + action), 0.0, 1.0)


BY_NOBODY, BY_LAW, BY_POLICY = wp.constant(0), wp.constant(1), wp.constant(2)
"""Sources of the command of :func:`current_kernel`: all that is allowed, the law, or the policy."""

BY = {
    CurrentCommand.LATCHED: BY_NOBODY,
    CurrentCommand.SCHEDULED: BY_LAW,
    CurrentCommand.LEARNED: BY_POLICY,
}


@wp.kernel(enable_backward=False)
def current_kernel(
    # parameters: what commands, of BY; structs, shape (E or 1, M); joint of each device, shape (M,)
    by: int,
    params: wp.array2d[JointParams],
    joint_of: wp.array[int],
    # in, shapes (E, A), (E, J) [rad, rad, rad/s], (E,) [A], (E, M)
    action_in: wp.array2d[float],
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    current_e_in: wp.array[float],
    strength_in: wp.array2d[float],
    # out, shape (E, M) [A]
    command_out: wp.array2d[float],
):
    """Commanded current of every device over the coming policy step."""
    env = wp.tid()
    for slot in range(joint_of.shape[0]):
        joint = joint_of[slot]
        p = params[wp.min(env, params.shape[0] - 1), slot]
        allowed = wp.min(current_e_in[env], p.current_max)
        if by == BY_NOBODY:
            command_out[env, slot] = allowed
        elif by == BY_POLICY:
            command_out[env, slot] = learned_current(action_in[env, q_in.shape[1] + slot], allowed)
        else:
            e = q_des_in[env, joint] - q_in[env, joint]
            command_out[env, slot] = scheduled_current(p, e, qd_in[env, joint], strength_in[env, slot], allowed)


def command_current(s: WalkState, command: CurrentCommand, params: wp.array, joint_of: wp.array) -> list[Launch]:
    """Launch that writes ``s.current_command`` from the state at a policy step's begin; nothing for fixed currents.

    Args:
        s: The task's arrays.
        command: Who commands.
        params: The devices' parameters, shape (E or 1, M).
        joint_of: Joint of each device, shape (M,).
    """
    if command is CurrentCommand.FIXED or not len(joint_of):
        return []
    inputs: list[Any] = [int(BY[command]), params, joint_of]
    arrays = [s.action, s.q_des, s.q, s.qd, s.current_e, s.strength]
    return [record(current_kernel, len(s.q), [*inputs, *arrays], [s.current_command])]


def account(s: WalkState, copper: wp.array, step_dt: float, gait_frequency: float) -> Launch:
    """Launch that ends a policy step of ``step_dt`` [s]: effort, power, gait clock [Hz] and count of policy steps.

    ``copper``: loss of each motor per torque squared [W/(N·m)^2], shape (J,).
    """
    return record(
        effort_kernel,
        len(s.q),
        [gait_frequency * step_dt, step_dt, copper, s.ledger, s.spent, s.phase],
        [s.effort, s.power, s.phase, s.key],
    )
