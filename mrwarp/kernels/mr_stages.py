"""Kernels around the step of the MR joints (:mod:`mrwarp.effects.step_kernel`).

Torques, the learned torque, the reset; and the way from the flat arrays of ``newton.actuators`` and back.
"""

import warp as wp

from mrwarp.kernels.clip import clip
from mrwarp.kernels.gate import effective_kp
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.kernels.mr_joint import JointParams, brake_bound, device_torque, displacement, stuck
from mrwarp.kernels.pd import pd_torque


@wp.func_native("return values.data[index];")
def flat(values: wp.array2d[float], index: int) -> float:
    """Element of a contiguous array by its flat index.

    ``values[i, j]`` multiplies by strides that are known only at run time, in every access. Here the caller works out
    the index once for all arrays of a shape, and makes sure that they are contiguous.
    """
    ...


@wp.func_native("values.data[index] = value;")
def put(values: wp.array2d[float], index: int, value: float):
    """Set an element of a contiguous array by its flat index."""
    ...


@wp.func_native("values.data[index] = value;")
def put4(values: wp.array4d[float], index: int, value: float):
    """Set an element of a contiguous array with four axes by its flat index."""
    ...


@wp.func_native("return values.data[index];")
def flat4(values: wp.array4d[float], index: int) -> float:
    """Element of a contiguous array with four axes by its flat index."""
    ...


@wp.func
def holds_without_gates(p: JointParams, qd: float, ring: wp.array4d[float], device: int, row: int) -> float:
    """1 where a device without gates holds, see :func:`mrwarp.kernels.mr_joint.stuck`, by the history's velocities.

    Args:
        p: The joint's parameters.
        qd: Velocity at the step's start [rad/s].
        ring: Histories, shape (E, M, WINDOW, FEATURES), of which velocities are the second feature.
        device: Number of the device among the E*M.
        row: Row of the history that holds, or will hold, this step's sample.
    """
    newer, before, caught = float(qd), float(0.0), float(0.0)
    for age in range(1, WINDOW):
        at = device * WINDOW + (row - age + WINDOW) % WINDOW
        older = flat4(ring, at * FEATURES + 1)
        if age == 1:
            before = older
        if newer * older < 0.0:
            caught = 1.0
        if caught > 0.0 or wp.abs(older) <= wp.abs(newer):
            break
        newer = older
    return stuck(p, qd, before, caught)


@wp.kernel(enable_backward=False)
def advance_head_kernel(
    # parameters
    length: int,
    # in, shape (1,)
    head_in: wp.array[int],
    # out, shape (1,)
    head_out: wp.array[int],
):
    """Move a ring's head to the row that the next sample takes."""
    head_out[0] = (head_in[0] + 1) % length


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
    """Torque of the motor in parallel to a device [N·m], eqs. 2 and 9."""
    return pd_torque(e, qd, effective_kp(m_hold, p.kp_base, p.kp_low), p.kd, p.tau_limit)


@wp.kernel(enable_backward=False)
def learned_torque_kernel(
    # parameters: environments and devices of a thread have this stride; struct, shape (E or 1, M); joint of
    # each device, (M,); 1 = brake constraint, 0 = explicit torque
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
    # out, shape (E, M), (E, J), (E, J) [N·m]
    tau_mr_out: wp.array2d[float],
    tau_out: wp.array2d[float],
    bound_out: wp.array2d[float],
):
    """Outputs of step_kernel with tau_BW, again for the open gates with the learned torque that has taken its place."""
    first, lane = wp.tid()
    for env in range(first, q_in.shape[0], rows):
        for slot in range(lane, m_dyn_in.shape[1], lanes):
            if m_dyn_in[env, slot] > 0.0:
                joint = joint_of[slot]
                p = params[wp.min(env, params.shape[0] - 1), slot]
                known, device, bound = device_share(
                    p,
                    constraint,
                    m_hold_in[env, slot],
                    q_des_in[env, joint] - q_in[env, joint],
                    qd_in[env, joint],
                    current_in[env, slot],
                    tau_dyn_in[env, slot],
                )
                tau_mr_out[env, slot] = known
                tau_out[env, joint] = tau_motor_in[env, joint] + device
                bound_out[env, joint] = bound


@wp.kernel(enable_backward=False)
def learned_hold_kernel(
    # parameters: struct, shape (E or 1, M); joint of each device, (M,); leg of each device or -1, (M,); 1 = gates
    params: wp.array2d[JointParams],
    joint_of: wp.array[int],
    leg_of: wp.array[int],
    gated: int,
    # in, shape (E, J) [rad/s], (E, M) [A, N·m], (E, M, WINDOW, FEATURES), (1,)
    qd_in: wp.array2d[float],
    current_in: wp.array2d[float],
    tau_dyn_in: wp.array2d[float],
    ring_in: wp.array4d[float],
    head_in: wp.array[int],
    # out, shape (E, J) [N·m]
    bound_out: wp.array2d[float],
):
    """The brake's bound of learned_torque_kernel, again for devices without gates, which hold by themselves."""
    env, slot = wp.tid()
    if gated == 0 or leg_of[slot] < 0:
        joint = joint_of[slot]
        p = params[wp.min(env, params.shape[0] - 1), slot]
        device = env * joint_of.shape[0] + slot
        held = holds_without_gates(p, qd_in[env, joint], ring_in, device, head_in[0])
        bound_out[env, joint] = brake_bound(p, held, current_in[env, slot], tau_dyn_in[env, slot])


@wp.kernel(enable_backward=False)
def reset_kernel(
    # parameters: environments and joints of a thread have this stride; struct, shape (E or 1, M); slot of
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
    coil_out: wp.array2d[float],
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
                    coil_out[env, slot] = 0.0
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


@wp.kernel(enable_backward=False)
def drive_gather_kernel(
    # parameters, shape (N,): addresses in Newton's flat arrays
    q_adr: wp.array[wp.uint32],
    v_adr: wp.array[wp.uint32],
    q_des_adr: wp.array[wp.uint32],
    input_adr: wp.array[wp.uint32],
    # in, Newton's flat arrays [rad, rad/s, rad, A, N or none]
    q_in: wp.array[float],
    qd_in: wp.array[float],
    q_des_in: wp.array[float],
    mr_current_in: wp.array[float],
    foot_load_in: wp.array[float],
    # out, shape (N, 1) [rad, rad/s, rad], (N,) [A], (N, 1) [N]
    q_out: wp.array2d[float],
    qd_out: wp.array2d[float],
    q_des_out: wp.array2d[float],
    current_e_out: wp.array[float],
    f_foot_out: wp.array2d[float],
):
    """Inputs of a step from Newton's flat arrays: actuator i of N is the one joint of environment i."""
    i = wp.tid()
    q_out[i, 0] = q_in[q_adr[i]]
    qd_out[i, 0] = qd_in[v_adr[i]]
    q_des_out[i, 0] = q_des_in[q_des_adr[i]]
    current_e_out[i] = mr_current_in[input_adr[i]]
    if foot_load_in:
        f_foot_out[i, 0] = foot_load_in[input_adr[i]]


@wp.kernel(enable_backward=False)
def drive_torque_kernel(
    # parameters: struct, shape (N, 1); addresses in Newton's flat arrays, shape (N,); 1 = gates, 1 = brake constraint
    params: wp.array2d[JointParams],
    v_des_adr: wp.array[wp.uint32],
    gated: int,
    constraint: int,
    # in, shape (N, 1) [rad, rad/s, rad]; Newton's flat arrays [rad/s, N·m or none]; shape (N, 1) [A, 1, N·m]; histories
    # (N, 1, WINDOW, FEATURES) and the row of their newest sample, (1,)
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    q_des_in: wp.array2d[float],
    qd_des_in: wp.array[float],
    feedforward_in: wp.array[float],
    current_in: wp.array2d[float],
    m_hold_in: wp.array2d[float],
    sliding_in: wp.array2d[float],
    ring_in: wp.array4d[float],
    head_in: wp.array[int],
    # out, shape (N,) [N·m]
    bound_out: wp.array[float],
    tau_out: wp.array[float],
):
    """Motor torque (2, 9) with a wanted velocity and a feed-forward, and the device's share (6, 19)."""
    i = wp.tid()
    p = params[i, 0]
    qd, e = qd_in[i, 0], q_des_in[i, 0] - q_in[i, 0]
    current, m_hold, sliding = current_in[i, 0], m_hold_in[i, 0], sliding_in[i, 0]
    held = float(m_hold)
    if gated == 0:
        held = holds_without_gates(p, qd, ring_in, i, head_in[0])
    device, bound = float(0.0), float(0.0)
    if constraint == 1:
        bound = brake_bound(p, held, current, sliding)
    else:
        device = device_torque(p, m_hold, e, qd, current, sliding)

    # motor: the feed-forward is part of what its torque limit bounds
    gain = effective_kp(m_hold, p.kp_base, p.kp_low)
    dof_des = v_des_adr[i]
    motor = pd_torque(e, qd - qd_des_in[dof_des], gain, p.kd, wp.inf)
    if feedforward_in:
        motor = motor + feedforward_in[dof_des]
    motor = clip(motor, p.tau_limit)

    bound_out[i] = bound
    tau_out[i] = motor + device


@wp.kernel(enable_backward=False)
def drive_reset_kernel(
    # in, shape (N,)
    mask_in: wp.array[wp.bool],
    # out, shape (N,)
    z_out: wp.array[float],
    current_out: wp.array[float],
    fresh_out: wp.array[wp.bool],
):
    """Masked reset: no stress, no current, and a history that the next step starts again."""
    i = wp.tid()
    if mask_in[i]:
        fresh_out[i] = True
        z_out[i] = 0.0
        current_out[i] = 0.0


@wp.kernel(enable_backward=False)
def brake_bounds_kernel(
    # parameters, shape (N,): MuJoCo world and DOF, Newton DOF
    world_of: wp.array[int],
    mjc_dof_of: wp.array[int],
    dof_of: wp.array[wp.uint32],
    # in, shape (N,), (joint_dof_count,) [N·m]
    bound_in: wp.array[float],
    joint_friction_in: wp.array[float],
    # out, shape (worlds, nv) [N·m]
    frictionloss_out: wp.array2d[float],
):
    """Dry friction of each driven joint: its own plus what the device may use."""
    i = wp.tid()
    frictionloss_out[world_of[i], mjc_dof_of[i]] = joint_friction_in[dof_of[i]] + bound_in[i]
