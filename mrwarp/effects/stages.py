"""The MR joint's first stage of a torque step with effects: takes the place of ``mr_stages.predict_kernel``.

The second stage is the plain ``torque_kernel``; it reads the device's parameters as the effects leave them.
"""

import warp as wp

from mrwarp.effects.joint import delayed_command, joint_path, stored_heat
from mrwarp.kernels.coil import coil_current
from mrwarp.kernels.joint_params import JointParams
from mrwarp.kernels.mr_joint import displacement, gated_command


@wp.kernel
def advance_effects_kernel(
    # parameters
    length: int,
    # in, shape (1,)
    head_in: wp.array[int],
    clock_in: wp.array[int],
    # out, shape (1,)
    head_out: wp.array[int],
    clock_out: wp.array[int],
):
    """Move the history's head to the row that the next sample takes, and count the session's steps."""
    head_out[0] = (head_in[0] + 1) % length
    clock_out[0] = clock_in[0] + 1


@wp.kernel
def predict_effects_kernel(
    # parameters: struct, shape (E or 1, M); effects, shape (E*M or M, COLUMNS); joint and leg of each device, shape
    # (M,); step [s]; switches as in predict_kernel
    params: wp.array2d[JointParams],
    values: wp.array2d[float],
    joint_of: wp.array[int],
    leg_of: wp.array[int],
    dt: float,
    damping: int,
    holding: int,
    hold_current: int,
    exact: int,
    # in, shape (E, J) [rad, rad, rad/s], (E, 4) [N], (E,) [A], (1,), (1,) [steps], state of shape (E, M)
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    f_foot_in: wp.array2d[float],
    current_e_in: wp.array[float],
    head_in: wp.array[int],
    clock_in: wp.array[int],
    z_in: wp.array2d[float],
    coil_in: wp.array2d[float],
    heat_in: wp.array2d[float],
    newest_in: wp.array2d[int],
    # out, shape (E, M); ring of shape (E, M, WINDOW, FEATURES); states of the effects, shape (E*M, SLOTS), past
    # commands, (E*M, DEPTH), and where the newest stands, (E, M); parameters for the torque stage, (E, M)
    m_dyn_out: wp.array2d[float],
    m_hold_out: wp.array2d[float],
    z_out: wp.array2d[float],
    current_out: wp.array2d[float],
    tau_dyn_out: wp.array2d[float],
    ring_out: wp.array4d[float],
    coil_out: wp.array2d[float],
    heat_out: wp.array2d[float],
    newest_out: wp.array2d[int],
    memory_out: wp.array2d[float],
    commands_out: wp.array2d[float],
    device_out: wp.array2d[JointParams],
):
    """Gates (5, 8), coil command, history, and the path: current, z (15) and tau_BW (14) with the effects' factors.

    The history holds what a bench logs, and a residual was trained on: the current before the effects.
    """
    env, slot = wp.tid()
    devices = joint_of.shape[0]
    p = params[env % params.shape[0], slot]
    line = env * devices + slot
    row = line % values.shape[0]
    joint = joint_of[slot]
    q, qd = q_in[env, joint], qd_in[env, joint]
    e = q_des_in[env, joint] - q

    f_foot, allowed = f_foot_in[env, leg_of[slot]], current_e_in[env]
    m_dyn, m_hold, command = gated_command(p, f_foot, e, qd, allowed, damping, holding, hold_current)
    coil = coil_current(coil_in[env, slot], command, p.coil_time_constant, dt)

    head = head_in[0]
    ring_out[env, slot, head, 0] = displacement(p, q)
    ring_out[env, slot, head, 1] = qd
    ring_out[env, slot, head, 2] = coil

    newest = (newest_in[env, slot] + 1) % commands_out.shape[1]
    commands_out[line, newest] = coil
    begun = delayed_command(coil, values, row, commands_out, line, newest, dt)
    time = float(clock_in[0]) * dt
    s = joint_path(p, values, row, memory_out, line, begun, q, qd, z_in[env, slot], heat_in[env, slot], time, dt, exact)

    tau_dyn_out[env, slot] = s.torque
    m_dyn_out[env, slot] = m_dyn
    m_hold_out[env, slot] = m_hold
    z_out[env, slot] = s.z
    current_out[env, slot] = s.current
    coil_out[env, slot] = coil
    heat_out[env, slot] = stored_heat(s, values, row, p.coil_resistance)
    newest_out[env, slot] = newest
    device_out[env, slot] = p
    device_out[env, slot].T_max = s.yield_gain * p.T_max  # what weakens the yield weakens eq. 18 too


@wp.kernel
def reset_effects_kernel(
    # in, shape (E,)
    mask_in: wp.array[wp.bool],
    # out, shape (E, M), (E*M, SLOTS), (E*M, DEPTH)
    coil_out: wp.array2d[float],
    heat_out: wp.array2d[float],
    newest_out: wp.array2d[int],
    memory_out: wp.array2d[float],
    commands_out: wp.array2d[float],
):
    """Masked reset: a cold device without current and field, its coupling in the middle of its play."""
    env, slot = wp.tid()
    if mask_in[env]:
        line = env * coil_out.shape[1] + slot
        coil_out[env, slot] = 0.0
        heat_out[env, slot] = 0.0
        newest_out[env, slot] = 0
        for k in range(memory_out.shape[1]):
            memory_out[line, k] = 0.0
        for k in range(commands_out.shape[1]):
            commands_out[line, k] = 0.0
