"""A device that only resists: the velocity-opposing torque (eq. 6) and the force of the brake constraint."""

import warp as wp


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
