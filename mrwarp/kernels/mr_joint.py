"""One MR joint step by step: the laws of the sibling files on a joint's parameters, in the order of the stages."""

import warp as wp

from mrwarp.kernels.bouc_wen import bouc_wen_euler, bouc_wen_exact, bouc_wen_torque
from mrwarp.kernels.brake import holding_need, holding_torque, oppose_velocity, support_current, yield_torque
from mrwarp.kernels.clip import clip
from mrwarp.kernels.gate import dynamic_gate, hold_gate


@wp.struct
class JointParams:
    """Parameters of one MR joint; names, units and sources as in ``mrwarp.params``."""

    q_neutral: wp.float32
    q_offset: wp.float32
    q_center: wp.float32
    D: wp.float32
    B: wp.float32
    C: wp.float32
    I1: wp.float32
    K0: wp.float32
    K1: wp.float32
    alpha: wp.float32
    beta: wp.float32
    gamma: wp.float32
    z_max: wp.float32
    T_max: wp.float32
    K: wp.float32
    n: wp.float32
    safety_factor: wp.float32
    f_th: wp.float32
    eps_e: wp.float32
    eps_v: wp.float32
    eps_hold: wp.float32
    kp_base: wp.float32
    kp_low: wp.float32
    kd: wp.float32
    tau_limit: wp.float32
    coil_time_constant: wp.float32
    coil_resistance: wp.float32
    current_max: wp.float32


FIELDS: tuple[str, ...] = tuple(JointParams.vars)
"""Field names in memory order; an (E, M, len(FIELDS)) float view of a parameter array is indexed by them."""

SUPPORT = wp.constant(0)
"""Holding current: the support current of the needed torque."""
FIXED = wp.constant(1)
"""Holding current: all the current the environment may use (current sweeps)."""
UNGATED = wp.constant(2)
"""In place of the switch of the damping branch: no gates, a plain current-driven device."""


@wp.func
def gates(p: JointParams, f_foot: float, e: float, qd: float, limit: float) -> tuple[float, float]:
    """(m_dyn, m_hold) of eqs. 5 and 8; with no current to hold with, holding stays closed and the motor stiff."""
    m_dyn = dynamic_gate(f_foot, e, qd, p.f_th, p.eps_e, p.eps_v)
    m_hold = float(0.0)
    if limit > 0.0:
        m_hold = hold_gate(f_foot, qd, m_dyn, p.f_th, p.eps_hold)
    return m_dyn, m_hold


@wp.func
def coil_command(p: JointParams, m_dyn: float, m_hold: float, e: float, limit: float, hold_current: int) -> float:
    """Commanded current [A]: ``limit`` while damping, the holding current while holding, else none."""
    if m_hold > 0.0:
        if hold_current == FIXED:
            return limit
        need = holding_need(e, p.kp_base, p.kp_low)
        return support_current(need, p.safety_factor, limit, p.T_max, p.K, p.n)
    return m_dyn * limit


@wp.func
def gated_command(
    p: JointParams,
    f_foot: float,
    e: float,
    qd: float,
    allowed: float,
    damping: int,
    holding: int,
    hold_current: int,
    held: float,
    latch: float,
) -> tuple[float, float, float]:
    """(m_dyn, m_hold, commanded current [A]), up to the allowed current [A]; each branch may be switched off (0).

    With ``damping = UNGATED`` the coil gets the allowed current, and the device counts as damping; a negative current
    acts by its size. With ``latch > 1`` a
    device that was holding (``held`` = 1) goes on, regardless of eq. 5, up to ``latch`` times the speed of eq. 8.
    A negative ``allowed`` is a pulse that demagnetises the core: it flows, and the gates are closed.
    """
    limit = clip(allowed, p.current_max)
    if damping == UNGATED:
        return 1.0, 0.0, limit
    if limit < 0.0:
        return 0.0, 0.0, limit
    may_damp, may_hold = gates(p, f_foot, e, qd, limit)
    if latch > 1.0 and held > 0.0 and limit > 0.0:
        may_hold = hold_gate(f_foot, qd, 0.0, p.f_th, latch * p.eps_hold)
        may_damp = wp.where(may_hold > 0.0, 0.0, may_damp)
    m_dyn, m_hold = float(damping) * may_damp, float(holding) * may_hold
    return m_dyn, m_hold, coil_command(p, m_dyn, m_hold, e, limit, hold_current)


@wp.func
def slowed_since_turn(qd: float, before: float, caught: float) -> float:
    """1 where a joint has only slowed down since it turned round, else 0; ``caught`` is that of the step before."""
    if qd * before < 0.0:
        return 1.0
    return wp.where(wp.abs(qd) < wp.abs(before), caught, 0.0)


@wp.func
def stuck(p: JointParams, qd: float, before: float, caught: float) -> float:
    """1 where a device without gates holds with what current it has, as any brake does, else 0.

    It holds a joint that is slow. A joint that turns round is slow for an instant only, which lies between two steps
    where these are long, and a brake catches it there. So it also holds one that turned round within the last step,
    until it stands, and one that will turn round within the coming step if its velocity goes on to change as it did in
    the last. A joint whose load is above the yield torque speeds up, and is let go. With ``eps_hold`` = 0 none is held.

    Args:
        p: The joint's parameters.
        qd: Velocity at the step's start [rad/s].
        before: Velocity at the start of the step before [rad/s].
        caught: :func:`slowed_since_turn`.
    """
    slow = hold_gate(wp.inf, qd, 0.0, p.f_th, p.eps_hold)
    turning = wp.abs(before) > 2.0 * wp.abs(qd)
    return wp.where(p.eps_hold > 0.0 and (turning or caught > 0.0), 1.0, slow)


@wp.func
def own_displacement(p: JointParams, q: float) -> float:
    """Offset-corrected displacement q_c [rad] of eq. 14 at the device's own angle, that of its bench."""
    return q - (p.q_offset + p.q_center)


@wp.func
def displacement(p: JointParams, q: float) -> float:
    """Offset-corrected joint displacement q_c [rad] of eq. 14 at an angle of the joint."""
    return own_displacement(p, q - p.q_neutral)


@wp.func
def hysteresis(p: JointParams, qd: float, z: float, dt: float, exact: int) -> float:
    """z after one step of eq. 15 [rad], in closed form (``exact`` = 1) or by the paper's Euler step."""
    if exact == 1:
        return bouc_wen_exact(qd, z, p.beta, p.gamma, dt)
    return bouc_wen_euler(qd, z, p.beta, p.gamma, p.z_max, dt)


@wp.func
def sliding_torque(p: JointParams, qd: float, q_c: float, current: float, z: float) -> float:
    """tau_BW of eq. 14 [N·m]; a negative current acts by its size."""
    return bouc_wen_torque(qd, q_c, wp.abs(current), z, p.D, p.B, p.C, p.I1, p.K0, p.K1, p.alpha)


@wp.func
def unusable(q: float, qd: float, allowed: float, command: float) -> float:
    """0, and NaN where an input is none or infinite: a law whose numbers take no notice of it would go on [N·m]."""
    return 0.0 * (q + qd) + 0.0 * (allowed + command)


@wp.func
def brake_bound(p: JointParams, held: float, current: float, sliding: float) -> float:
    """Bound of the brake constraint [N·m]: the yield torque where the device is held, the sliding torque elsewhere.

    NaN stays NaN.
    """
    bound = wp.abs(sliding)
    if held > 0.0:
        tau_y = yield_torque(current, p.T_max, p.K, p.n)
        bound = wp.where(tau_y > bound, tau_y, bound)
    return bound


@wp.func
def device_torque(p: JointParams, m_hold: float, e: float, qd: float, current: float, sliding: float) -> float:
    """Explicit torque of the device [N·m]: eq. 19 while holding, else eq. 6, which also serves as off-current drag."""
    if m_hold > 0.0:
        return holding_torque(holding_need(e, p.kp_base, p.kp_low), yield_torque(current, p.T_max, p.K, p.n))
    return oppose_velocity(sliding, qd)
