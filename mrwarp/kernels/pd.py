"""The electric motor: PD law with the effective gain (eqs. 2, 10), within its torque limit."""

import warp as wp

from mrwarp.kernels.clip import clip


@wp.func
def pd_torque(e: float, qd: float, kp: float, kd: float, tau_limit: float) -> float:
    """clip(kp*e - kd*qd, +-tau_limit) [N·m]; NaN stays NaN."""
    return clip(kp * e - kd * qd, tau_limit)


@wp.kernel
def pd_kernel(
    # parameters, shape (E or 1, J) [N·m/rad, N·m·s/rad, N·m]
    kp: wp.array2d[float],
    kd: wp.array2d[float],
    tau_limit: wp.array2d[float],
    # in, shape (E, J) [rad, rad, rad/s]
    q_des_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    # out, shape (E, J) [N·m]
    tau_out: wp.array2d[float],
):
    """PD torque of joints that carry no MR device."""
    env, joint = wp.tid()
    row = env % kp.shape[0]
    e = q_des_in[env, joint] - q_in[env, joint]
    tau_out[env, joint] = pd_torque(e, qd_in[env, joint], kp[row, joint], kd[row, joint], tau_limit[row, joint])
