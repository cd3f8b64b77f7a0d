"""The MR joint's stages of one torque step, fused into two kernels or one.

``predict_kernel`` runs gate, coil, history and Bouc-Wen over (env, MR joint); ``torque_kernel`` turns the prediction
into motor torque and device torque, or brake bound, over (env, joint). ``step_kernel`` is both; where a learned torque
then takes the place of the prediction, ``learned_torque_kernel`` mends what hangs on it. The steps are those of
``mr_joint``; nothing is written here but their order.
"""

import warp as wp

from mrwarp.kernels.coil import coil_current
from mrwarp.kernels.flat import flat, put, put4
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
from mrwarp.kernels.window import FEATURES, WINDOW


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
    p: JointParams,
    q: float,
    qd: float,
    e: float,
    f_foot: float,
    allowed: float,
    z: float,
    current: float,
    dt: float,
    damping: int,
    holding: int,
    hold_current: int,
    exact: int,
) -> tuple[float, float, float, float, float, float]:
    """(m_dyn, m_hold, coil current [A], q_c [rad], z [rad], tau_BW [N·m]) of one device after a step."""
    m_dyn, m_hold, command = gated_command(p, f_foot, e, qd, allowed, damping, holding, hold_current)
    coil = coil_current(current, command, p.coil_time_constant, dt)
    q_c = displacement(p, q)
    z_next = hysteresis(p, qd, z, dt, exact)
    return m_dyn, m_hold, coil, q_c, z_next, sliding_torque(p, qd, q_c, coil, z_next)


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
    p = params[wp.min(env, params.shape[0] - 1), slot]
    joint = joint_of[slot]
    q, qd = q_in[env, joint], float(qd_in[env, joint])
    f_foot, allowed = f_foot_in[env, leg_of[slot]], current_e_in[env]
    m_dyn, m_hold, current, q_c, z, sliding = predict(
        p, q, qd, q_des_in[env, joint] - q, f_foot, allowed, z_in[env, slot], current_in[env, slot], dt, damping,
        holding, hold_current, exact,
    )  # fmt: skip
    row = head_in[0]
    ring_out[env, slot, row, 0] = q_c
    ring_out[env, slot, row, 1] = qd
    ring_out[env, slot, row, 2] = current
    m_dyn_out[env, slot] = m_dyn
    m_hold_out[env, slot] = m_hold
    z_out[env, slot] = z
    current_out[env, slot] = current
    tau_dyn_out[env, slot] = sliding


@wp.func
def device_share(
    p: JointParams, constraint: int, m_hold: float, e: float, qd: float, current: float, sliding: float
) -> tuple[float, float, float]:
    """(known torque, applied torque, bound of the brake constraint) of one device [N·m].

    With the constraint coupling the torque is known only after the step: NaN, and nothing is applied.
    """
    if constraint == 1:
        return wp.nan, 0.0, brake_bound(p, m_hold, current, sliding)
    device = device_torque(p, m_hold, e, qd, current, sliding)
    return device, device, 0.0


@wp.func
def motor_torque(p: JointParams, m_hold: float, e: float, qd: float) -> float:
    """Torque of the motor beside a device [N·m], eqs. 2 and 9."""
    return pd_torque(e, qd, effective_kp(m_hold, p.kp_base, p.kp_low), p.kd, p.tau_limit)


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
    # in, shape (E, J) [rad, rad, rad/s], (E, M) [1, A, N·m]
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
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
    qd = float(qd_in[env, joint])
    e = q_des_in[env, joint] - q_in[env, joint]
    slot = slot_of[joint]
    motor, device, bound = float(0.0), float(0.0), float(0.0)
    if slot >= 0:
        p = params[wp.min(env, params.shape[0] - 1), slot]
        m_hold = m_hold_in[env, slot]
        known, device, bound = device_share(p, constraint, m_hold, e, qd, current_in[env, slot], tau_dyn_in[env, slot])
        tau_mr_out[env, slot] = known
        motor = motor_torque(p, m_hold, e, qd)
    else:
        row = wp.min(env, kp.shape[0] - 1)
        motor = pd_torque(e, qd, kp[row, joint], kd[row, joint], tau_limit[row, joint])
    tau_motor_out[env, joint] = motor
    tau_out[env, joint] = motor + device
    bound_out[env, joint] = bound


@wp.kernel(enable_backward=False)
def step_kernel(
    # parameters: environments and joints that a thread takes are this far apart; the rest as in predict_kernel and
    # torque_kernel
    rows: int,
    lanes: int,
    params: wp.array2d[JointParams],
    slot_of: wp.array[int],
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
    head_out: wp.array[int],
    tau_motor_out: wp.array2d[float],
    tau_mr_out: wp.array2d[float],
    tau_out: wp.array2d[float],
    bound_out: wp.array2d[float],
):
    """Both kernels in one: a GPU takes a thread per joint, a CPU one for all.

    A CPU runs the threads one after the other, and starting one, which copies all arguments, costs as much as the laws.
    A single thread moves the ring's head itself. Arrays (E, ...) have to be contiguous.
    """
    first, lane = wp.tid()
    joints, devices, legs = q_in.shape[1], z_in.shape[1], f_foot_in.shape[1]
    row = head_in[0]
    if rows == 1 and lanes == 1:
        row = (row + 1) % WINDOW
        head_out[0] = row
    for env in range(first, q_in.shape[0], rows):
        allowed = current_e_in[env]
        for joint in range(lane, joints, lanes):
            at = env * joints + joint
            q, qd = flat(q_in, at), flat(qd_in, at)
            e = flat(q_des_in, at) - q
            slot = slot_of[joint]
            motor, device, bound = float(0.0), float(0.0), float(0.0)
            if slot >= 0:
                k = env * devices + slot
                p = params[wp.min(env, params.shape[0] - 1), slot]
                m_dyn, m_hold, current, q_c, z, sliding = predict(
                    p, q, qd, e, flat(f_foot_in, env * legs + leg_of[slot]), allowed, flat(z_in, k),
                    flat(current_in, k), dt, damping, holding, hold_current, exact,
                )  # fmt: skip
                known, device, bound = device_share(p, constraint, m_hold, e, qd, current, sliding)
                motor = motor_torque(p, m_hold, e, qd)
                sample = (k * WINDOW + row) * FEATURES
                put4(ring_out, sample, q_c)
                put4(ring_out, sample + 1, qd)
                put4(ring_out, sample + 2, current)
                put(m_dyn_out, k, m_dyn)
                put(m_hold_out, k, m_hold)
                put(z_out, k, z)
                put(current_out, k, current)
                put(tau_dyn_out, k, sliding)
                put(tau_mr_out, k, known)
            else:
                own = wp.min(env, kp.shape[0] - 1) * joints + joint
                motor = pd_torque(e, qd, flat(kp, own), flat(kd, own), flat(tau_limit, own))
            put(tau_motor_out, at, motor)
            put(tau_out, at, motor + device)
            put(bound_out, at, bound)


@wp.kernel(enable_backward=False)
def learned_torque_kernel(
    # parameters: environments and devices that a thread takes are this far apart; the rest as in predict_kernel and
    # torque_kernel
    rows: int,
    lanes: int,
    params: wp.array2d[JointParams],
    joint_of: wp.array[int],
    constraint: int,
    # in, shape (E, J) [rad, rad, rad/s], (E, M) [1, 1, A, N·m], (E, J) [N·m]
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    m_dyn_in: wp.array2d[float],
    m_hold_in: wp.array2d[float],
    current_in: wp.array2d[float],
    tau_dyn_in: wp.array2d[float],
    tau_motor_in: wp.array2d[float],
    # out, as of torque_kernel
    tau_mr_out: wp.array2d[float],
    tau_out: wp.array2d[float],
    bound_out: wp.array2d[float],
):
    """What step_kernel gave with tau_BW, again for the open gates with the learned torque that has taken its place."""
    first, lane = wp.tid()
    for env in range(first, q_in.shape[0], rows):
        for slot in range(lane, m_dyn_in.shape[1], lanes):
            if m_dyn_in[env, slot] > 0.0:
                joint = joint_of[slot]
                p = params[wp.min(env, params.shape[0] - 1), slot]
                known, device, bound = device_share(
                    p, constraint, m_hold_in[env, slot], q_des_in[env, joint] - q_in[env, joint], qd_in[env, joint],
                    current_in[env, slot], tau_dyn_in[env, slot],
                )  # fmt: skip
                tau_mr_out[env, slot] = known
                tau_out[env, joint] = tau_motor_in[env, joint] + device
                bound_out[env, joint] = bound


@wp.kernel
def reset_kernel(
    # parameters: environments and joints that a thread takes are this far apart; struct, shape (E or 1, M); slot of
    # joint j or -1, shape (J,)
    rows: int,
    lanes: int,
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
    first, lane = wp.tid()
    for env in range(first, mask_in.shape[0], rows):
        if mask_in[env]:
            for joint in range(lane, slot_of.shape[0], lanes):
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
