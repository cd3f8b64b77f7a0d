"""A device that only resists: sliding (eq. 6), holding (eqs. 18, 19), and the force of the brake constraint."""

import warp as wp

from mrwarp.kernels.clip import clip


@wp.func
def oppose_velocity(tau: float, qd: float) -> float:
    """-sgn(qd)*|tau| [N·m], eq. 6; 0 at standstill. Its power is never positive at an instant (eq. 7)."""
    return -wp.sign(qd) * wp.where(qd == 0.0, 0.0, wp.abs(tau))


@wp.func
def constraint_torque(qd_next: wp.float64, bound: wp.float64, creep: wp.float64) -> wp.float64:
    """Torque of the brake constraint over a step [N·m]: ``clip(-qd_next/creep, +-bound)``.

    MuJoCo's dry-friction row at its solution, ``clip(-(qdd + b*qd)/R, +-bound)``, for the damping ``b = 1/dt`` that
    ``mrwarp.actuator.brake_constraint`` sets: then ``qdd + qd/dt = qd_next/dt`` and ``creep = R*dt`` [rad/s per N·m].
    The work ``tau*qd_next*dt`` is never positive: the coupling is passive in discrete time. In float64 because
    creep is small.
    """
    return wp.clamp(-qd_next / creep, -bound, bound)


@wp.func
def yield_torque(current: float, T_max: float, K: float, n: float) -> float:
    """tau_y of eq. 18 [N·m]: ``T_max*I^n/(K^n + I^n)``; a negative current counts like a positive one."""
    ratio = wp.pow(wp.abs(current) / K, n)
    return T_max * ratio / (1.0 + ratio)


@wp.func
def support_current(tau: float, safety_factor: float, current_max: float, T_max: float, K: float, n: float) -> float:
    """Current [A] at which the device holds ``safety_factor*|tau|``: the inverse of eq. 18, limited to current_max.

    NaN stays NaN.
    """
    wanted = safety_factor * wp.abs(tau)
    if wanted >= T_max:
        return current_max
    return clip(K * wp.pow(wanted / (T_max - wanted), 1.0 / n), current_max)


@wp.func
def holding_need(e: float, kp_base: float, kp_low: float) -> float:
    """Torque that the motor no longer gives while its gain is low: ``(Kp_base - Kp_low)*e`` [N·m], eq. 19."""
    return (kp_base - kp_low) * e


@wp.func
def holding_torque(need: float, tau_y: float) -> float:
    """Explicit holding torque of eq. 19 [N·m]: the need, clipped to the capacity."""
    return clip(need, tau_y)
