"""Semi-active gates: when may the device damp (eq. 5), when may it hold (eq. 8), and the motor gain (eq. 9)."""

import warp as wp


@wp.func
def dynamic_gate(f_foot: float, e: float, qd: float, f_th: float, eps_e: float, eps_v: float) -> float:
    """m_dyn of eq. 5: 1 for a loaded joint that moves away from its target, else 0.

    ``1(f_foot > f_th) 1(|e| > eps_e) 1(|qd| > eps_v) 1(e*qd < 0)``.
    """
    if f_foot > f_th and wp.abs(e) > eps_e and wp.abs(qd) > eps_v and e * qd < 0.0:
        return 1.0
    return 0.0


@wp.func
def hold_gate(f_foot: float, qd: float, m_dyn: float, f_th: float, eps_hold: float) -> float:
    """m_hold of eq. 8: 1 for a loaded joint close to standstill while the dynamic gate is closed, else 0."""
    if f_foot > f_th and wp.abs(qd) < eps_hold and m_dyn == 0.0:
        return 1.0
    return 0.0


@wp.func
def effective_kp(m_hold: float, kp_base: float, kp_low: float) -> float:
    """Kp_eff of eq. 9 [N·m/rad]: the low gain while the holding gate is open."""
    return wp.where(m_hold > 0.0, kp_low, kp_base)
