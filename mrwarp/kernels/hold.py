"""Pre-yield holding: capacity (eq. 18), its inverse (the support current) and the explicit holding torque (eq. 19)."""

import warp as wp

from mrwarp.kernels.clip import clip


@wp.func
def yield_torque(current: float, T_max: float, K: float, n: float) -> float:
    """tau_y of eq. 18 [N·m]: ``T_max*I^n/(K^n + I^n)``; a negative current counts like a positive one."""
    ratio = wp.pow(wp.abs(current) / K, n)
    return T_max * ratio / (1.0 + ratio)


@wp.func
def support_current(tau: float, safety_factor: float, current_max: float, T_max: float, K: float, n: float) -> float:
    """Current [A] at which the device holds ``safety_factor*|tau|``: the inverse of eq. 18, limited to current_max."""
    wanted = safety_factor * wp.abs(tau)
    if wanted >= T_max:
        return current_max
    return wp.min(K * wp.pow(wanted / (T_max - wanted), 1.0 / n), current_max)


@wp.func
def holding_need(e: float, kp_base: float, kp_low: float) -> float:
    """Torque that the motor no longer gives while its gain is low: ``(Kp_base - Kp_low)*e`` [N·m], eq. 19."""
    return (kp_base - kp_low) * e


@wp.func
def holding_torque(need: float, tau_y: float) -> float:
    """Explicit holding torque of eq. 19 [N·m]: the need, clipped to the capacity."""
    return clip(need, tau_y)
