"""The MR joint over the flat arrays of ``newton.actuators``: the steps of ``mr_joint`` for actuator i of N."""

import warp as wp

from mrwarp.kernels.coil import coil_current
from mrwarp.kernels.gate import effective_kp, hold_gate
from mrwarp.kernels.joint_params import JointParams
from mrwarp.kernels.mr_joint import (
    brake_bound,
    coil_command,
    device_torque,
    displacement,
    gates,
    hysteresis,
    sliding_torque,
)
from mrwarp.kernels.pd import pd_torque


@wp.kernel
def drive_kernel(
    # parameters, shape (N,): struct and the addresses in Newton's flat arrays; step [s]; switches
    params: wp.array[JointParams],
    q_adr: wp.array[wp.uint32],
    v_adr: wp.array[wp.uint32],
    q_des_adr: wp.array[wp.uint32],
    v_des_adr: wp.array[wp.uint32],
    dt: float,
    constraint: int,
    hold_current: int,
    exact: int,
    # in, Newton's flat arrays [rad, rad/s, rad, rad/s, N·m or none, A, N or none]; state of shape (N,) [rad, A]
    q_in: wp.array[float],
    qd_in: wp.array[float],
    q_des_in: wp.array[float],
    qd_des_in: wp.array[float],
    feedforward_in: wp.array[float],
    mr_current_in: wp.array[float],
    foot_load_in: wp.array[float],
    z_in: wp.array[float],
    current_in: wp.array[float],
    # out, shape (N,) [rad, A, N·m, N·m]
    z_out: wp.array[float],
    current_out: wp.array[float],
    bound_out: wp.array[float],
    tau_out: wp.array[float],
):
    """One step of the MR joint, in the order of ``mr_stages``: gate, coil, Bouc-Wen, torque or brake bound."""
    i = wp.tid()
    p = params[i]
    dof, dof_des = v_adr[i], v_des_adr[i]
    q, qd = q_in[q_adr[i]], qd_in[dof]
    e = q_des_in[q_des_adr[i]] - q

    # without a foot load the device is plainly current-driven
    limit = wp.min(mr_current_in[dof], p.current_max)
    command, m_hold = float(limit), float(0.0)
    held = hold_gate(wp.inf, qd, 0.0, p.f_th, p.eps_hold)
    if foot_load_in:
        open_gates = gates(p, foot_load_in[dof], e, qd, limit)
        m_hold = open_gates[1]
        held = m_hold
        command = coil_command(p, open_gates[0], m_hold, e, limit, hold_current)
    current = coil_current(current_in[i], command, p.coil_time_constant, dt)

    z = hysteresis(p, qd, z_in[i], dt, exact)
    sliding = sliding_torque(p, qd, displacement(p, q), current, z)
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
    motor = wp.clamp(motor, -p.tau_limit, p.tau_limit)

    z_out[i] = z
    current_out[i] = current
    bound_out[i] = bound
    tau_out[i] = motor + device


@wp.kernel
def drive_reset_kernel(
    # in, shape (N,)
    mask_in: wp.array[wp.bool],
    # out, shape (N,)
    z_out: wp.array[float],
    current_out: wp.array[float],
):
    """Masked reset: no stress, no current."""
    i = wp.tid()
    if mask_in[i]:
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
