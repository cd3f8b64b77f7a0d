"""Energy ledger: work of motor and device per branch and joint, and the integrals behind the electrical losses."""

import warp as wp

MOTOR = wp.constant(0)
"""Work of the electric motor [J]."""
DYNAMIC = wp.constant(1)
"""Work of the device while the dynamic gate is open [J]."""
HOLD = wp.constant(2)
"""Work of the device while the holding gate is open [J]."""
DRAG = wp.constant(3)
"""Work of the device with both gates closed [J]."""
INJECTED = wp.constant(4)
"""Positive work of the device over single steps [J]: 0 for a passive coupling."""
MOTOR_SQUARE = wp.constant(5)
"""Integral of the motor torque squared [(N·m)^2 s]: times a motor constant, the copper loss."""
COIL = wp.constant(6)
"""Coil loss, integral of R*I^2 [J]."""

ENTRIES = ("motor", "dynamic", "hold", "drag", "injected", "motor_square", "coil")
"""Names of the ledger entries in order."""


@wp.func
def step_work(tau: float, dq: float) -> float:
    """Work of a torque held over one step [J]: tau * dq, with dq the step's joint motion [rad]."""
    return tau * dq


@wp.func
def branch_of(m_dyn: float, m_hold: float) -> int:
    """Ledger entry of the device's work: DYNAMIC, HOLD or DRAG."""
    if m_dyn > 0.0:
        return DYNAMIC
    return wp.where(m_hold > 0.0, HOLD, DRAG)


@wp.kernel(enable_backward=False)
def ledger_kernel(
    # parameters: joints of a thread have this stride (a GPU: J threads, a CPU: one); slot of joint j in the
    # MR arrays or -1, shape (J,); step [s]; 1 = brake constraint, 0 = explicit
    lanes: int,
    slot_of: wp.array[int],
    dt: float,
    constraint: int,
    # in, shape (E, J) [rad/s, N·m, N·m], (E, M) [N·m, 1, 1, A, Ohm]
    qd_next_in: wp.array2d[float],
    tau_motor_in: wp.array2d[float],
    friction_in: wp.array2d[float],
    tau_mr_in: wp.array2d[float],
    m_dyn_in: wp.array2d[float],
    m_hold_in: wp.array2d[float],
    current_in: wp.array2d[float],
    resistance_in: wp.array2d[float],
    # out, shape (E, M) [N·m], (E, J, len(ENTRIES)) accumulated
    tau_mr_out: wp.array2d[float],
    ledger_out: wp.array3d[float],
):
    """Add one step to the ledger. The joint moved by qd_next*dt (semi-implicit Euler).

    With the constraint coupling the device's torque is the friction that the solver found; it is stored in ``tau_mr``.
    """
    env, lane = wp.tid()
    for joint in range(lane, slot_of.shape[0], lanes):
        dq = qd_next_in[env, joint] * dt
        tau = tau_motor_in[env, joint]
        ledger_out[env, joint, MOTOR] = ledger_out[env, joint, MOTOR] + step_work(tau, dq)
        ledger_out[env, joint, MOTOR_SQUARE] = ledger_out[env, joint, MOTOR_SQUARE] + tau * tau * dt
        slot = slot_of[joint]
        if slot >= 0:
            device = float(tau_mr_in[env, slot])
            if constraint == 1:
                device = friction_in[env, joint]
            tau_mr_out[env, slot] = device
            work = step_work(device, dq)
            entry = branch_of(m_dyn_in[env, slot], m_hold_in[env, slot])
            ledger_out[env, joint, entry] = ledger_out[env, joint, entry] + work
            ledger_out[env, joint, INJECTED] = ledger_out[env, joint, INJECTED] + wp.max(work, 0.0)
            current = current_in[env, slot]
            loss = resistance_in[env % resistance_in.shape[0], slot] * current * current * dt
            ledger_out[env, joint, COIL] = ledger_out[env, joint, COIL] + loss
