"""Replay of recorded motion through the joint's own laws, for many parameter sets and trajectories at once."""

import warp as wp

from mrwarp.kernels.coil import coil_current
from mrwarp.kernels.joint_params import JointParams
from mrwarp.kernels.mr_joint import displacement, hysteresis, sliding_torque


@wp.kernel
def replay_kernel(
    # parameters: one set per candidate, shape (C,); 1 = closed form, 0 = Euler step of z; parts of each sampling step,
    # through linearly interpolated velocity, or 0 = the simulator's own step, which holds the newest velocity
    params: wp.array[JointParams],
    exact: int,
    substeps: int,
    # in, the samples of all trajectories end to end, shape (N,) [rad, rad/s, A]; first sample of each trajectory and
    # the end of the last one, shape (T + 1,); sampling step, shape (T,) [s]
    q_in: wp.array[float],
    qd_in: wp.array[float],
    current_in: wp.array[float],
    start_in: wp.array[int],
    dt_in: wp.array[float],
    # out, shape (C, N) [N·m]
    tau_out: wp.array2d[float],
):
    """tau_BW (eqs. 14, 15) along every trajectory: z starts at 0, the coil at its first command."""
    candidate, trajectory = wp.tid()
    p = params[candidate]
    dt = dt_in[trajectory]
    first = start_in[trajectory]
    current, qd_before, z = float(current_in[first]), float(qd_in[first]), float(0.0)
    for k in range(first, start_in[trajectory + 1]):
        qd = float(qd_in[k])
        current = coil_current(current, current_in[k], p.coil_time_constant, dt)
        if substeps == 0:
            z = hysteresis(p, qd, z, dt, exact)
        for i in range(substeps):
            part = (float(i) + 0.5) / float(substeps)
            z = hysteresis(p, qd_before + part * (qd - qd_before), z, dt / float(substeps), exact)
        qd_before = qd
        tau_out[candidate, k] = sliding_torque(p, qd, displacement(p, q_in[k]), current, z)
