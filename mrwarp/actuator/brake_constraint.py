"""A brake as MuJoCo's dry-friction constraint: parameters that make it passive in discrete time and let it stick.

MuJoCo pulls a dry-friction row towards the acceleration ``-b*qd`` with regularisation R, by at most its bound. With
``b = 1/dt`` the row sees the velocity after the step: ``tau = clip(-qd_next/(R*dt), +-bound)``, which cannot do
positive work, and a held joint creeps by ``R*dt`` per torque. (MuJoCo's defaults creep at 0.2 rad/s under 30 % of the
yield torque.)
"""

from __future__ import annotations

IMPEDANCE = 0.9999
"""Constraint impedance: MuJoCo's cap (mjMAXIMP)."""

CREEP = 1.0e-5
"""Creep of a held joint per torque, R*dt [rad/s per N·m]: 25 N·m creep 2.5e-4 rad/s, for any inertia of the joint."""

SOLIMP = (IMPEDANCE, IMPEDANCE, 0.001, 0.5, 2.0)
"""``solimpfriction`` of a braked joint."""

MIN_LS_ITERATIONS = 30
"""Line-search iterations below which this stiff constraint fails silently: with 20, held joints drift by a radian."""


def solref(dt: float) -> tuple[float, float]:
    """``solreffriction`` for the step dt [s]: the damping ``b = 2/(impedance*timeconst)`` is 1/dt."""
    return 2.0 * dt / IMPEDANCE, 1.0


def invweight(dt: float) -> float:
    """``dof_invweight0`` that gives R = CREEP/dt: R = (1 - impedance)/impedance * invweight.

    MuJoCo would derive it from the joint's inertia, so that light joints creep more. Joint limits use it too: those of
    a braked joint become about as stiff as for an inertia of 0.05 kg m^2 at 5 ms.
    """
    return CREEP / dt * IMPEDANCE / (1.0 - IMPEDANCE)
