"""The electric motor: PD law with the effective gain (eqs. 2, 10), within its torque limit."""

import warp as wp

from mrwarp.kernels.clip import clip


@wp.func
def pd_torque(e: float, qd: float, kp: float, kd: float, tau_limit: float) -> float:
    """clip(kp*e - kd*qd, +-tau_limit) [N·m]; NaN stays NaN."""
    return clip(kp * e - kd * qd, tau_limit)
