"""What rewards, terminations and observations share: once per policy step, before and after its torque steps."""

from typing import Any

import warp as wp

from mrwarp.env.task_kernels.draws import COMMAND, PUSH, STEP, between, draw, place
from mrwarp.env.task_kernels.gait import clock_stance, leg_phase
from mrwarp.kernels.ledger import COIL, MOTOR, MOTOR_SQUARE


@wp.func
def spent(ledger: wp.array3d[float], copper: wp.array[float], env: int) -> wp.vec2:
    """What all joints spent since the reset: integral of the squared motor torques [(N·m)^2 s]; electrical energy [J].

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


@wp.kernel
def begin_kernel(
    # parameters: action scale [rad]; neutral stance [rad], shape (A,); copper loss [W/(N·m)^2], shape (J,)
    action_scale: float,
    default_q: wp.array[float],
    copper: wp.array[float],
    # in, shapes (E, A), (E, J) [rad/s], (E, J, entries)
    actions_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    ledger_in: wp.array3d[float],
    # out, shapes (E, A), (E, A), (E, J) [rad], (E, J) [rad/s], (E,) [(N·m)^2 s, J]
    action_out: wp.array2d[float],
    last_action_out: wp.array2d[float],
    q_des_out: wp.array2d[float],
    last_qd_out: wp.array2d[float],
    spent_out: wp.array[wp.vec2],
):
    """Take the new action, and remember what the coming policy step is compared with."""
    env = wp.tid()
    for k in range(actions_in.shape[1]):
        last_action_out[env, k] = action_out[env, k]
        action_out[env, k] = actions_in[env, k]
        q_des_out[env, k] = default_q[k] + action_scale * actions_in[env, k]
        last_qd_out[env, k] = qd_in[env, k]
    spent_out[env] = spent(ledger_in, copper, env)


@wp.kernel
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


@wp.kernel
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


@wp.kernel
def end_kernel(
    # parameters: clock advance per policy step [1], policy step [s]; copper loss [W/(N·m)^2], shape (J,)
    advance: float,
    step_dt: float,
    copper: wp.array[float],
    # in, shapes (E, J, entries), (E,) [(N·m)^2 s, J], (E,)
    ledger_in: wp.array3d[float],
    spent_in: wp.array[wp.vec2],
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
    mean = (spent(ledger_in, copper, env) - spent_in[env]) / step_dt
    effort_out[env] = mean[0]
    power_out[env] = mean[1]
    phase = phase_in[env] + advance
    phase_out[env] = phase - wp.floor(phase)


@wp.kernel
def derived_kernel(
    # parameters: foot force above which a foot touches the ground [N]
    contact_force: float,
    # in, shapes (E,) where to compute, (E, 3) [m], (E, 4), (E, 3) [m/s], (E,), (E, 4) [N]; height of the ground below
    # the trunk, (E,) [m]
    mask_in: wp.array[wp.bool],
    root_pos_in: wp.array2d[float],
    root_quat_in: wp.array2d[float],
    root_vel_in: wp.array2d[float],
    phase_in: wp.array[float],
    f_foot_in: wp.array2d[float],
    ground_in: wp.array[float],
    # out, shapes (E,) [m], (E, 3), (E, 3) [m/s], (E, 4), (E, 4)
    height_out: wp.array[float],
    gravity_out: wp.array2d[float],
    body_velocity_out: wp.array2d[float],
    leg_phase_out: wp.array2d[float],
    clock_match_out: wp.array2d[wp.bool],
):
    """Height, gravity in the trunk frame, velocity in the heading frame, and the legs on the gait clock."""
    env = wp.tid()
    if not mask_in[env]:
        return
    height_out[env] = root_pos_in[env, 2] - ground_in[env]
    w, x = root_quat_in[env, 0], root_quat_in[env, 1]
    y, z = root_quat_in[env, 2], root_quat_in[env, 3]
    # third row of the rotation matrix: the world's vertical in the trunk frame, negated
    gravity_out[env, 0] = -2.0 * (x * z - w * y)
    gravity_out[env, 1] = -2.0 * (y * z + w * x)
    gravity_out[env, 2] = 2.0 * (x * x + y * y) - 1.0
    yaw = wp.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    c, s = wp.cos(yaw), wp.sin(yaw)
    v_x, v_y = root_vel_in[env, 0], root_vel_in[env, 1]
    body_velocity_out[env, 0] = c * v_x + s * v_y
    body_velocity_out[env, 1] = c * v_y - s * v_x
    body_velocity_out[env, 2] = root_vel_in[env, 2]
    for leg in range(4):
        phase = leg_phase(phase_in[env], leg)
        leg_phase_out[env, leg] = phase
        clock_match_out[env, leg] = (f_foot_in[env, leg] > contact_force) == clock_stance(phase)
