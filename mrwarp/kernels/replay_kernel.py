"""Replay of recorded motion through the joint's own laws, for many parameter sets and trajectories at once.

A small :class:`Extension` adds what a real damper showed beyond eqs. 14 and 15; at its null values (all 0) the torque
is that of the simulator's laws, bit for bit.
"""

import warp as wp

from mrwarp.kernels.bouc_wen import bouc_wen_exact
from mrwarp.kernels.coil import coil_current
from mrwarp.kernels.joint_params import JointParams
from mrwarp.kernels.mr_joint import displacement, hysteresis, sliding_torque


@wp.struct
class Extension:
    """Laws on top of eqs. 14 and 15; 0 switches each off."""

    saturation: wp.float32
    """Curvature of the current map u(I) [1]."""
    softening: wp.float32
    """Logarithm of how much shorter the yield travel is without current than at I = 1 [1]."""
    creep: wp.float32
    """Rate at which the stress z leaks away [1/s]."""


@wp.func
def saturating_current(current: float, saturation: float) -> float:
    """Current map ``u(I) = (1 - exp(-k|I|))/(1 - exp(-k))``, odd, u(1) = 1: linear for k = 0, saturating for k > 0."""
    if saturation == 0.0:
        return current
    return wp.sign(current) * (1.0 - wp.exp(-saturation * wp.abs(current))) / (1.0 - wp.exp(-saturation))


@wp.func
def creeping_hysteresis(p: JointParams, e: Extension, qd: float, u: float, z: float, dt: float) -> float:
    """z after ``dt`` of ``dz/dt = qd - r*(beta*|qd|*z + gamma*qd*|z|) - creep*z`` with ``r = exp(softening*(1-|u|))``.

    Creep adds ``creep/|qd|`` to the rate of both branches over the path, so eq. 15's closed form holds as it is.
    """
    speed = wp.max(wp.abs(qd), 1.0e-5)  # at rest a crawl, along which the stress decays by exp(-creep*dt)
    soft = wp.exp(e.softening * (1.0 - wp.abs(u)))
    return bouc_wen_exact(wp.where(qd < 0.0, -speed, speed), z, p.beta * soft + e.creep / speed, p.gamma * soft, dt)


@wp.func
def velocity_between(before: float, start: float, end: float, after: float, part: float) -> float:
    """Velocity at ``part`` of the way from ``start`` to ``end``: the cubic of Catmull and Rom through four samples.

    A chord would shorten the path of a sine of 2 Hz at 200 Hz by 0.03 %, and beta and gamma would take it up.
    """
    slope, slope_end = 0.5 * (end - before), 0.5 * (after - start)
    rise = end - start
    cubic = slope + slope_end - 2.0 * rise
    return start + part * (slope + part * (3.0 * rise - 2.0 * slope - slope_end + part * cubic))


@wp.kernel
def replay_kernel(
    # parameters: one set per candidate, shape (C,); 1 = closed form, 0 = Euler step of z; parts of each sampling step,
    # through interpolated velocity, or 0 = the simulator's own step, which holds the newest velocity
    params: wp.array[JointParams],
    extension: wp.array[Extension],
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
    p, e = params[candidate], extension[candidate]
    first = start_in[trajectory]
    parts = wp.max(substeps, 1)
    dt = dt_in[trajectory] / float(parts)
    last = start_in[trajectory + 1] - 1
    current, z = float(current_in[first]), float(0.0)
    for k in range(first, last + 1):
        qd = float(qd_in[k])
        current = coil_current(current, current_in[k], p.coil_time_constant, dt_in[trajectory])
        u = saturating_current(current, e.saturation)
        steps = parts
        if substeps > 0 and k == first:
            steps = 0  # a recorded motion begins at its first sample, the simulator's step ends there
        for i in range(steps):
            speed = float(qd)
            if substeps > 0:
                before, after = qd_in[wp.max(k - 2, first)], qd_in[wp.min(k + 1, last)]
                speed = velocity_between(before, qd_in[k - 1], qd, after, (float(i) + 0.5) / float(parts))
            if e.creep == 0.0 and e.softening == 0.0:
                z = hysteresis(p, speed, z, dt, exact)
            else:
                z = creeping_hysteresis(p, e, speed, u, z, dt)
        tau_out[candidate, k] = sliding_torque(p, qd, displacement(p, q_in[k]), u, z)
