"""One torque step of every joint, from gates to torques, in one kernel.

Over (env, joint): gate, coil, history and the laws of the device, then the motor's torque and the device's torque, or
the bound of its brake constraint. The steps are those of :mod:`mrwarp.kernels.mr_joint` and
:mod:`mrwarp.kernels.mr_stages`; nothing is written here but their order. The kernel is generated twice: with the path
of :mod:`mrwarp.effects.joint`, and without effects. Where a learned torque then takes the place of tau_BW,
``learned_torque_kernel`` mends what hangs on it.
"""

from typing import Any

import warp as wp

from mrwarp.effects.joint import delayed_command, joint_path, stored_heat
from mrwarp.kernels import mr_joint
from mrwarp.kernels.coil import coil_current, mean_coil_current
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.kernels.mr_joint import (
    JointParams,
    displacement,
    gated_command,
    hysteresis,
    sliding_torque,
    unusable,
)
from mrwarp.kernels.mr_stages import device_share, flat, holds_without_gates, motor_torque, put, put4
from mrwarp.kernels.pd import pd_torque


@wp.struct
class EffectArrays:
    """Arrays of the effects of E x M devices in a step; all are null without effects."""

    values: wp.array2d[float]
    """Parameters, shape (E*M or M, COLUMNS)."""
    clock: wp.array[int]
    """Steps since the session began, shape (1,)."""
    heat: wp.array2d[float]
    """Stored heat [J], shape (E, M)."""
    newest: wp.array2d[int]
    """Where the newest of the past commands stands, shape (E, M)."""
    memory: wp.array2d[float]
    """States, shape (E*M, SLOTS)."""
    commands: wp.array2d[float]
    """Past commands [A], shape (E*M, DEPTH)."""
    params: wp.array2d[JointParams]
    """The devices' parameters as the effects leave them in this step, shape (E, M)."""


def make_step_kernel(effects: bool) -> Any:
    """The kernel with the path of the catalogue's effects, or without."""

    @wp.kernel(enable_backward=False, module="unique")
    def step_kernel(
        # parameters: environments and joints of a thread have this stride; struct, shape (E or 1, M); slot of
        # joint j or -1, (J,), and leg of each device or -1, (M,); motor gains, (E or 1, J), of joints without a device
        # (others have theirs in the struct); step [s]; switches: damping and holding branch allowed, holding current,
        # exact step of z, 1 = brake constraint, 0 = explicit torque; hysteresis of the holding gate, see gated_command
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
        latch: float,
        # in, shape (E, J) [rad, rad, rad/s], (E, 4) [N], (E,) [A], commanded current (E, M) [A] or none, (1,), state
        # of shape (E, M)
        q_des_in: wp.array2d[float],
        q_in: wp.array2d[float],
        qd_in: wp.array2d[float],
        f_foot_in: wp.array2d[float],
        current_e_in: wp.array[float],
        command_in: wp.array2d[float],
        head_in: wp.array[int],
        z_in: wp.array2d[float],
        coil_in: wp.array2d[float],
        # out, shape (E, M); ring of shape (E, M, WINDOW, FEATURES); (1,); (E, J), (E, M), (E, J), (E, J) [N·m]
        effects_out: EffectArrays,
        m_dyn_out: wp.array2d[float],
        m_hold_out: wp.array2d[float],
        z_out: wp.array2d[float],
        coil_out: wp.array2d[float],
        current_out: wp.array2d[float],
        tau_dyn_out: wp.array2d[float],
        ring_out: wp.array4d[float],
        head_out: wp.array[int],
        tau_motor_out: wp.array2d[float],
        tau_mr_out: wp.array2d[float],
        tau_out: wp.array2d[float],
        bound_out: wp.array2d[float],
    ):
        """Gates (5, 8), coil, history, z (15), tau_BW (14), motor (2, 9) and device (6, 19) of every joint.

        ``tau`` is what the simulator applies to the joint and ``bound`` the dry friction it may use. With the
        constraint coupling ``tau_mr`` is known only after the step; it is NaN until then. Of the coil's own current
        ``coil`` is the value at the step's end; laws and history take its mean over the step, for the torque holds so
        long. The history holds what a bench logs, and a residual was trained on: the current before the effects.

        A GPU takes a thread per joint, a CPU one for all: it runs threads one after the other, and starting one, which
        copies all arguments, costs as much as the laws. A single thread moves the ring's head and the session's clock
        itself. Arrays (E, ...) have to be contiguous.
        """
        first, lane = wp.tid()
        joints, devices, legs = q_in.shape[1], z_in.shape[1], f_foot_in.shape[1]
        row = head_in[0]
        alone = rows == 1 and lanes == 1
        if alone:
            row = (row + 1) % WINDOW
            head_out[0] = row
        if wp.static(effects):
            clock = effects_out.clock[0]
            if alone:
                clock = clock + 1
                effects_out.clock[0] = clock
            time = float(clock) * dt
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
                    no_foot = leg_of[slot] < 0
                    branch = wp.where(no_foot, mr_joint.UNGATED, damping)
                    f_foot = flat(f_foot_in, env * legs + wp.max(leg_of[slot], 0))
                    may_use, held_before = float(allowed), float(0.0)
                    if command_in:
                        may_use = flat(command_in, k)
                        may_use = wp.where(may_use > allowed, allowed, may_use)
                        held_before = flat(m_hold_out, k)
                    m_dyn, m_hold, command = gated_command(
                        p, f_foot, e, qd, may_use, branch, holding, hold_current, held_before, latch
                    )
                    q_c = displacement(p, q)
                    begin = flat(coil_in, k)
                    logged = mean_coil_current(begin, command, p.coil_time_constant, dt)
                    put(coil_out, k, coil_current(begin, command, p.coil_time_constant, dt))
                    if wp.static(effects):
                        x = effects_out
                        newest = (x.newest[env, slot] + 1) % x.commands.shape[1]
                        x.commands[k, newest] = logged
                        own = k % x.values.shape[0]
                        begun = delayed_command(logged, x.values, own, x.commands, k, newest, dt)
                        heat = flat(x.heat, k)
                        s = joint_path(
                            p, x.values, own, x.memory, k, begun, q, qd, flat(z_in, k), heat, time, dt, exact
                        )
                        current, z, predicted = s.current, s.z, s.torque
                        put(x.heat, k, stored_heat(s, x.values, own, p.coil_resistance))
                        x.newest[env, slot] = newest
                        x.params[env, slot] = p
                        x.params[env, slot].T_max = s.yield_gain * p.T_max  # what weakens the yield weakens eq. 18 too
                        p = x.params[env, slot]
                    else:
                        z = hysteresis(p, qd, flat(z_in, k), dt, exact)
                        current, predicted = logged, sliding_torque(p, qd, q_c, logged, z)
                    sliding = predicted + unusable(q, qd, allowed, may_use)
                    held = m_hold
                    if branch == mr_joint.UNGATED and constraint == 1:
                        held = holds_without_gates(p, qd, ring_out, k, row)
                    known, device, bound = device_share(p, constraint, held, e, qd, current, sliding)
                    motor = motor_torque(p, m_hold, e, qd)
                    sample = (k * WINDOW + row) * FEATURES
                    put4(ring_out, sample, q_c)
                    put4(ring_out, sample + 1, qd)
                    put4(ring_out, sample + 2, wp.abs(logged))
                    put(m_dyn_out, k, m_dyn)
                    put(m_hold_out, k, m_hold)
                    put(z_out, k, z)
                    put(current_out, k, current)
                    put(tau_dyn_out, k, sliding)
                    put(tau_mr_out, k, known)
                else:
                    gains = wp.min(env, kp.shape[0] - 1) * joints + joint
                    motor = pd_torque(e, qd, flat(kp, gains), flat(kd, gains), flat(tau_limit, gains))
                put(tau_motor_out, at, motor)
                put(tau_out, at, motor + device)
                put(bound_out, at, bound)

    return step_kernel


step_kernel = make_step_kernel(effects=False)
effect_step_kernel = make_step_kernel(effects=True)


@wp.kernel(enable_backward=False)
def reset_effects_kernel(
    # in, shape (E,)
    mask_in: wp.array[wp.bool],
    # out
    effects_out: EffectArrays,
):
    """Masked reset: a cold device without current and field, its coupling in the middle of its play."""
    env, slot = wp.tid()
    if mask_in[env]:
        line = env * effects_out.newest.shape[1] + slot
        effects_out.heat[env, slot] = 0.0
        effects_out.newest[env, slot] = 0
        for k in range(effects_out.memory.shape[1]):
            effects_out.memory[line, k] = 0.0
        for k in range(effects_out.commands.shape[1]):
            effects_out.commands[line, k] = 0.0
