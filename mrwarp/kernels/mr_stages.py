"""The MR joint's stages of one torque step, fused into two kernels around the learned residual.

``predict_kernel`` runs gate, coil, history and Bouc-Wen over (env, MR joint); then a residual may be added to its
prediction; ``torque_kernel`` turns the prediction into motor torque and device torque, or brake bound, over
(env, joint). The steps are those of ``mr_joint``; nothing is written here but their order.
"""

import warp as wp

from mrwarp.kernels.coil import coil_current
from mrwarp.kernels.gate import effective_kp
from mrwarp.kernels.joint_params import JointParams
from mrwarp.kernels.mr_joint import (
    brake_bound,
    device_torque,
    displacement,
    gated_command,
    hysteresis,
    sliding_torque,
)
from mrwarp.kernels.pd import pd_torque
from mrwarp.kernels.window import WINDOW


@wp.kernel
def advance_head_kernel(
    # parameters
    length: int,
    # in, shape (1,)
    head_in: wp.array[int],
    # out, shape (1,)
    head_out: wp.array[int],
):
    """Move the ring's head to the row that the next sample takes."""
    head_out[0] = (head_in[0] + 1) % length


@wp.func
def predict(
    env: int,
    slot: int,
    params: wp.array2d[JointParams],
    joint_of: wp.array[int],
    leg_of: wp.array[int],
    dt: float,
    damping: int,
    holding: int,
    hold_current: int,
    exact: int,
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    f_foot_in: wp.array2d[float],
    current_e_in: wp.array[float],
    head_in: wp.array[int],
    z_in: wp.array2d[float],
    current_in: wp.array2d[float],
    m_dyn_out: wp.array2d[float],
    m_hold_out: wp.array2d[float],
    z_out: wp.array2d[float],
    current_out: wp.array2d[float],
    tau_dyn_out: wp.array2d[float],
    ring_out: wp.array4d[float],
) -> float:
    """Gates, coil, history, z and tau_BW of one device; returns m_dyn. Arguments as in ``predict_kernel``."""
    p = params[wp.min(env, params.shape[0] - 1), slot]
    joint = joint_of[slot]
    q, qd = q_in[env, joint], qd_in[env, joint]
    e = q_des_in[env, joint] - q

    f_foot, allowed = f_foot_in[env, leg_of[slot]], current_e_in[env]
    m_dyn, m_hold, command = gated_command(p, f_foot, e, qd, allowed, damping, holding, hold_current)
    current = coil_current(current_in[env, slot], command, p.coil_time_constant, dt)

    q_c = displacement(p, q)
    row = head_in[0]
    ring_out[env, slot, row, 0] = q_c
    ring_out[env, slot, row, 1] = qd
    ring_out[env, slot, row, 2] = current

    z = hysteresis(p, qd, z_in[env, slot], dt, exact)
    tau_dyn_out[env, slot] = sliding_torque(p, qd, q_c, current, z)
    m_dyn_out[env, slot] = m_dyn
    m_hold_out[env, slot] = m_hold
    z_out[env, slot] = z
    current_out[env, slot] = current
    return m_dyn


@wp.kernel
def predict_kernel(
    # parameters: struct, shape (E or 1, M); joint and leg of each device, shape (M,); step [s]; switches:
    # damping and holding branch allowed, holding current, exact step of z
    params: wp.array2d[JointParams],
    joint_of: wp.array[int],
    leg_of: wp.array[int],
    dt: float,
    damping: int,
    holding: int,
    hold_current: int,
    exact: int,
    # in, shape (E, J) [rad, rad, rad/s], (E, 4) [N], (E,) [A], (1,), state of shape (E, M)
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    f_foot_in: wp.array2d[float],
    current_e_in: wp.array[float],
    head_in: wp.array[int],
    z_in: wp.array2d[float],
    current_in: wp.array2d[float],
    # out, shape (E, M); ring of shape (E, M, WINDOW, FEATURES)
    m_dyn_out: wp.array2d[float],
    m_hold_out: wp.array2d[float],
    z_out: wp.array2d[float],
    current_out: wp.array2d[float],
    tau_dyn_out: wp.array2d[float],
    ring_out: wp.array4d[float],
):
    """Gates (5, 8), coil command and current, history, z (15) and tau_BW (14) of every device."""
    env, slot = wp.tid()
    predict(
        env, slot, params, joint_of, leg_of, dt, damping, holding, hold_current, exact, q_des_in, q_in, qd_in,
        f_foot_in, current_e_in, head_in, z_in, current_in, m_dyn_out, m_hold_out, z_out, current_out, tau_dyn_out,
        ring_out,
    )  # fmt: skip


@wp.func
def drive(
    env: int,
    joint: int,
    params: wp.array2d[JointParams],
    slot_of: wp.array[int],
    kp: wp.array2d[float],
    kd: wp.array2d[float],
    tau_limit: wp.array2d[float],
    constraint: int,
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    m_hold_in: wp.array2d[float],
    current_in: wp.array2d[float],
    tau_dyn_in: wp.array2d[float],
    tau_motor_out: wp.array2d[float],
    tau_mr_out: wp.array2d[float],
    tau_out: wp.array2d[float],
    bound_out: wp.array2d[float],
) -> float:
    """Motor and device of one joint; returns the motor's torque [N·m]. Arguments as in ``torque_kernel``."""
    row = wp.min(env, kp.shape[0] - 1)
    q, qd = q_in[env, joint], qd_in[env, joint]
    e = q_des_in[env, joint] - q
    slot = slot_of[joint]
    gain, damping, limit = float(kp[row, joint]), float(kd[row, joint]), float(tau_limit[row, joint])
    device, bound = float(0.0), float(0.0)
    if slot >= 0:
        p = params[wp.min(env, params.shape[0] - 1), slot]
        m_hold = m_hold_in[env, slot]
        gain, damping, limit = effective_kp(m_hold, p.kp_base, p.kp_low), float(p.kd), float(p.tau_limit)
        current, sliding = current_in[env, slot], tau_dyn_in[env, slot]
        if constraint == 1:
            bound = brake_bound(p, m_hold, current, sliding)
            tau_mr_out[env, slot] = wp.nan
        else:
            device = device_torque(p, m_hold, e, qd, current, sliding)
            tau_mr_out[env, slot] = device
    motor = pd_torque(e, qd, gain, damping, limit)
    tau_motor_out[env, joint] = motor
    tau_out[env, joint] = motor + device
    bound_out[env, joint] = bound
    return motor


@wp.kernel
def torque_kernel(
    # parameters: struct, shape (E or 1, M); slot of joint j or -1, shape (J,); motor gains, shape (E or 1, J),
    # of joints without a device (those with one have theirs in the struct); 1 = brake constraint, 0 = explicit torque
    params: wp.array2d[JointParams],
    slot_of: wp.array[int],
    kp: wp.array2d[float],
    kd: wp.array2d[float],
    tau_limit: wp.array2d[float],
    constraint: int,
    # in, shape (E, J) [rad, rad, rad/s], (E, M) [1, 1, A, N·m]
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    m_dyn_in: wp.array2d[float],
    m_hold_in: wp.array2d[float],
    current_in: wp.array2d[float],
    tau_dyn_in: wp.array2d[float],
    # out, shape (E, J) [N·m], (E, M) [N·m], (E, J) [N·m], (E, J) [N·m]
    tau_motor_out: wp.array2d[float],
    tau_mr_out: wp.array2d[float],
    tau_out: wp.array2d[float],
    bound_out: wp.array2d[float],
):
    """Motor torque (2, 9) and, per device, the torque of eqs. 6 and 19 or the bound of the brake constraint.

    ``tau`` is what the simulator applies to the joint and ``bound`` the dry friction it may use. With the constraint
    coupling ``tau_mr`` is known only after the step; it is NaN until then.
    """
    env, joint = wp.tid()
    drive(
        env, joint, params, slot_of, kp, kd, tau_limit, constraint, q_des_in, q_in, qd_in, m_hold_in, current_in,
        tau_dyn_in, tau_motor_out, tau_mr_out, tau_out, bound_out,
    )  # fmt: skip


@wp.kernel
def step_kernel(
    # parameters: environments and joints that a thread takes are this far apart; the rest as in predict_kernel and
    # torque_kernel
    rows: int,
    lanes: int,
    params: wp.array2d[JointParams],
    slot_of: wp.array[int],
    joint_of: wp.array[int],
    leg_of: wp.array[int],
    kp: wp.array2d[float],
    kd: wp.array2d[float],
    tau_limit: wp.array2d[float],
    dt: float,
    damping: int,
    holding: int,
    hold_current: int,
    exact: int,
    constraint: int,
    # in, shape (E, J) [rad, rad, rad/s], (E, 4) [N], (E,) [A], (1,), state of shape (E, M)
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    f_foot_in: wp.array2d[float],
    current_e_in: wp.array[float],
    head_in: wp.array[int],
    z_in: wp.array2d[float],
    current_in: wp.array2d[float],
    # out, those of predict_kernel and of torque_kernel
    m_dyn_out: wp.array2d[float],
    m_hold_out: wp.array2d[float],
    z_out: wp.array2d[float],
    current_out: wp.array2d[float],
    tau_dyn_out: wp.array2d[float],
    ring_out: wp.array4d[float],
    tau_motor_out: wp.array2d[float],
    tau_mr_out: wp.array2d[float],
    tau_out: wp.array2d[float],
    bound_out: wp.array2d[float],
):
    """Both kernels in one, where no residual comes between them: a GPU takes a thread per joint, a CPU one for all.

    A CPU runs the threads one after the other, and starting one, which copies all arguments, costs as much as the laws.
    """
    first, lane = wp.tid()
    for env in range(first, q_in.shape[0], rows):
        for joint in range(lane, slot_of.shape[0], lanes):
            slot = slot_of[joint]
            if slot >= 0:
                predict(
                    env, slot, params, joint_of, leg_of, dt, damping, holding, hold_current, exact, q_des_in, q_in,
                    qd_in, f_foot_in, current_e_in, head_in, z_in, current_in, m_dyn_out, m_hold_out, z_out,
                    current_out, tau_dyn_out, ring_out,
                )  # fmt: skip
            drive(
                env, joint, params, slot_of, kp, kd, tau_limit, constraint, q_des_in, q_in, qd_in, m_hold_out,
                current_out, tau_dyn_out, tau_motor_out, tau_mr_out, tau_out, bound_out,
            )  # fmt: skip


@wp.kernel
def reset_kernel(
    # parameters: struct, shape (E or 1, M); slot of joint j or -1, shape (J,)
    params: wp.array2d[JointParams],
    slot_of: wp.array[int],
    # in, shape (E,), (E, J) [rad]
    mask_in: wp.array[wp.bool],
    q_in: wp.array2d[float],
    # out, shape (E, M); ring (E, M, WINDOW, FEATURES); ledger (E, J, entries)
    z_out: wp.array2d[float],
    current_out: wp.array2d[float],
    m_dyn_out: wp.array2d[float],
    m_hold_out: wp.array2d[float],
    tau_dyn_out: wp.array2d[float],
    tau_mr_out: wp.array2d[float],
    ring_out: wp.array4d[float],
    ledger_out: wp.array3d[float],
):
    """Masked reset: a device without current and stress whose joint has rested where it is."""
    env, joint = wp.tid()
    if mask_in[env]:
        for entry in range(ledger_out.shape[2]):
            ledger_out[env, joint, entry] = 0.0
        slot = slot_of[joint]
        if slot >= 0:
            z_out[env, slot] = 0.0
            current_out[env, slot] = 0.0
            m_dyn_out[env, slot] = 0.0
            m_hold_out[env, slot] = 0.0
            tau_dyn_out[env, slot] = 0.0
            tau_mr_out[env, slot] = 0.0
            p = params[wp.min(env, params.shape[0] - 1), slot]
            q_c = displacement(p, q_in[env, joint])
            for row in range(WINDOW):
                ring_out[env, slot, row, 0] = q_c
                ring_out[env, slot, row, 1] = 0.0
                ring_out[env, slot, row, 2] = 0.0
