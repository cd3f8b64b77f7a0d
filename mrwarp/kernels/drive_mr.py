"""The MR joint over the flat arrays of ``newton.actuators``: the steps of ``mr_joint`` for actuator i of N.

As in ``mr_stages``, two kernels around the learned torque: gate, coil, history and Bouc-Wen; motor and device torque.
"""

import warp as wp

from mrwarp.kernels.clip import clip
from mrwarp.kernels.coil import coil_current
from mrwarp.kernels.gate import effective_kp, hold_gate
from mrwarp.kernels.learned_torque import WINDOW
from mrwarp.kernels.mr_joint import (
    JointParams,
    brake_bound,
    device_torque,
    displacement,
    gated_command,
    hysteresis,
    sliding_torque,
)
from mrwarp.kernels.pd import pd_torque


@wp.kernel
def drive_predict_kernel(
    # parameters, shape (N,): struct and the addresses in Newton's flat arrays; step [s]; switches
    params: wp.array[JointParams],
    q_adr: wp.array[wp.uint32],
    v_adr: wp.array[wp.uint32],
    q_des_adr: wp.array[wp.uint32],
    dt: float,
    hold_current: int,
    exact: int,
    # in, Newton's flat arrays [rad, rad/s, rad, A, N or none]; state of shape (N,) [rad, A], fresh = just reset; (1,)
    q_in: wp.array[float],
    qd_in: wp.array[float],
    q_des_in: wp.array[float],
    mr_current_in: wp.array[float],
    foot_load_in: wp.array[float],
    z_in: wp.array[float],
    current_in: wp.array[float],
    fresh_in: wp.array[int],
    head_in: wp.array[int],
    # out, shape (N,) [rad, A, 1]; (N, 1) [1, N·m]; ring of shape (N, 1, WINDOW, FEATURES) or none
    z_out: wp.array[float],
    current_out: wp.array[float],
    m_hold_out: wp.array[float],
    m_dyn_out: wp.array2d[float],
    sliding_out: wp.array2d[float],
    ring_out: wp.array4d[float],
):
    """Gates (5, 8), coil current, history, z (15) and tau_BW (14). Without a foot load the dynamic gate is open."""
    i = wp.tid()
    p = params[i]
    dof = v_adr[i]
    q, qd = q_in[q_adr[i]], qd_in[dof]
    e = q_des_in[q_des_adr[i]] - q

    # without a foot load the device is plainly current-driven
    m_dyn, m_hold, command = float(1.0), float(0.0), wp.min(mr_current_in[dof], p.current_max)
    if foot_load_in:
        m_dyn, m_hold, command = gated_command(p, foot_load_in[dof], e, qd, mr_current_in[dof], 1, 1, hold_current)
    current = coil_current(current_in[i], command, p.coil_time_constant, dt)

    q_c = displacement(p, q)
    if ring_out:
        if fresh_in[i] == 1:  # a joint that has rested where it is
            for row in range(WINDOW):
                ring_out[i, 0, row, 0] = q_c
                ring_out[i, 0, row, 1] = 0.0
                ring_out[i, 0, row, 2] = 0.0
        newest = head_in[0]
        ring_out[i, 0, newest, 0] = q_c
        ring_out[i, 0, newest, 1] = qd
        ring_out[i, 0, newest, 2] = current

    z = hysteresis(p, qd, z_in[i], dt, exact)
    z_out[i] = z
    current_out[i] = current
    m_hold_out[i] = m_hold
    m_dyn_out[i, 0] = m_dyn
    sliding_out[i, 0] = sliding_torque(p, qd, q_c, current, z)


@wp.kernel
def drive_torque_kernel(
    # parameters, shape (N,): struct and the addresses in Newton's flat arrays; 1 = brake constraint
    params: wp.array[JointParams],
    q_adr: wp.array[wp.uint32],
    v_adr: wp.array[wp.uint32],
    q_des_adr: wp.array[wp.uint32],
    v_des_adr: wp.array[wp.uint32],
    constraint: int,
    # in, Newton's flat arrays [rad, rad/s, rad, rad/s, N·m or none, N or none]; shape (N,) [A, 1]; (N, 1) [N·m]
    q_in: wp.array[float],
    qd_in: wp.array[float],
    q_des_in: wp.array[float],
    qd_des_in: wp.array[float],
    feedforward_in: wp.array[float],
    foot_load_in: wp.array[float],
    current_in: wp.array[float],
    m_hold_in: wp.array[float],
    sliding_in: wp.array2d[float],
    # out, shape (N,) [N·m]
    bound_out: wp.array[float],
    tau_out: wp.array[float],
):
    """Motor torque (2, 9), and the device's torque (6, 19) or the bound of its brake constraint."""
    i = wp.tid()
    p = params[i]
    dof, dof_des = v_adr[i], v_des_adr[i]
    q, qd = q_in[q_adr[i]], qd_in[dof]
    e = q_des_in[q_des_adr[i]] - q
    current, m_hold, sliding = current_in[i], m_hold_in[i], sliding_in[i, 0]
    held = float(m_hold)
    if not foot_load_in:  # plainly current-driven: it holds whenever it is slow
        held = hold_gate(wp.inf, qd, 0.0, p.f_th, p.eps_hold)
    device, bound = float(0.0), float(0.0)
    if constraint == 1:
        bound = brake_bound(p, held, current, sliding)
    else:
        device = device_torque(p, m_hold, e, qd, current, sliding)

    # motor: the feed-forward is part of what its torque limit bounds
    gain = effective_kp(m_hold, p.kp_base, p.kp_low)
    motor = pd_torque(e, qd - qd_des_in[dof_des], gain, p.kd, wp.inf)
    if feedforward_in:
        motor = motor + feedforward_in[dof_des]
    motor = clip(motor, p.tau_limit)

    bound_out[i] = bound
    tau_out[i] = motor + device


@wp.kernel
def drive_reset_kernel(
    # in, shape (N,)
    mask_in: wp.array[wp.bool],
    # out, shape (N,)
    z_out: wp.array[float],
    current_out: wp.array[float],
    fresh_out: wp.array[int],
):
    """Masked reset: no stress, no current, and a history that the next step starts anew."""
    i = wp.tid()
    if mask_in[i]:
        fresh_out[i] = 1
        z_out[i] = 0.0
        current_out[i] = 0.0


@wp.kernel
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
