"""Kernels of a few lines around single laws, for tests of the laws."""
# pyright: reportAttributeAccessIssue=false

from typing import Any

import numpy as np
import warp as wp

from mrwarp.kernels.bouc_wen import bouc_wen_euler, bouc_wen_exact
from mrwarp.kernels.brake import holding_torque, oppose_velocity, support_current, yield_torque
from mrwarp.kernels.coil import coil_current, mean_coil_current
from mrwarp.kernels.gate import dynamic_gate, hold_gate
from mrwarp.kernels.learned_torque import FEATURES, window_row


def f32(values: Any) -> np.ndarray:
    """The values as a float32 array."""
    return np.asarray(values, dtype=np.float32)


@wp.kernel
def bouc_wen_step_kernel(
    # parameters, shape (E or 1, M) [1/rad, 1/rad, rad], time step [s], 1 = closed form, 0 = explicit Euler
    beta: wp.array2d[float],
    gamma: wp.array2d[float],
    z_max: float,
    dt: float,
    exact: int,
    # in, shape (E, M)
    qd_in: wp.array2d[float],
    z_in: wp.array2d[float],
    # out, shape (E, M)
    z_out: wp.array2d[float],
):
    """Advance z by one step of eq. 15."""
    env, joint = wp.tid()
    b, g = beta[env % beta.shape[0], joint], gamma[env % gamma.shape[0], joint]
    qd, z = qd_in[env, joint], z_in[env, joint]
    if exact == 1:
        z_out[env, joint] = bouc_wen_exact(qd, z, b, g, dt)
    else:
        z_out[env, joint] = bouc_wen_euler(qd, z, b, g, z_max, dt)


@wp.kernel
def oppose_velocity_kernel(
    # parameters: none
    # in, shape (E, M) [N·m, rad/s]
    tau_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    # out, shape (E, M) [N·m]
    tau_out: wp.array2d[float],
):
    """Project a predicted torque onto the direction that opposes the motion, eq. 6."""
    env, joint = wp.tid()
    tau_out[env, joint] = oppose_velocity(tau_in[env, joint], qd_in[env, joint])


@wp.kernel
def coil_kernel(
    # parameters, scalars [s, s]
    time_constant: float,
    dt: float,
    # in, shape (E, M) [A]
    command_in: wp.array2d[float],
    current_in: wp.array2d[float],
    # out, shape (E, M) [A]
    current_out: wp.array2d[float],
    mean_out: wp.array2d[float],
):
    """Advance the coil current by one step."""
    env, joint = wp.tid()
    current_out[env, joint] = coil_current(current_in[env, joint], command_in[env, joint], time_constant, dt)
    mean_out[env, joint] = mean_coil_current(current_in[env, joint], command_in[env, joint], time_constant, dt)


@wp.kernel
def gate_kernel(
    # parameters, scalars [N, rad, rad/s, rad/s]
    f_th: float,
    eps_e: float,
    eps_v: float,
    eps_hold: float,
    # in, shape (E, M)
    f_foot_in: wp.array2d[float],
    e_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    # out, shape (E, M)
    m_dyn_out: wp.array2d[float],
    m_hold_out: wp.array2d[float],
):
    """Evaluate both gates, eqs. 5 and 8."""
    env, joint = wp.tid()
    f_foot, qd = f_foot_in[env, joint], qd_in[env, joint]
    m_dyn = dynamic_gate(f_foot, e_in[env, joint], qd, f_th, eps_e, eps_v)
    m_dyn_out[env, joint] = m_dyn
    m_hold_out[env, joint] = hold_gate(f_foot, qd, m_dyn, f_th, eps_hold)


@wp.kernel
def hold_kernel(
    # parameters, scalars [N·m, A, 1, 1, A]
    T_max: float,
    K: float,
    n: float,
    safety_factor: float,
    current_max: float,
    # in, shape (E, M) [N·m, A]
    need_in: wp.array2d[float],
    current_in: wp.array2d[float],
    # out, shape (E, M) [N·m, A, N·m]
    tau_y_out: wp.array2d[float],
    support_current_out: wp.array2d[float],
    tau_hold_out: wp.array2d[float],
):
    """Capacity at the given current, the support current for the need, and the clipped torque (eqs. 18, 19)."""
    env, joint = wp.tid()
    need = need_in[env, joint]
    tau_y = yield_torque(current_in[env, joint], T_max, K, n)
    tau_y_out[env, joint] = tau_y
    support_current_out[env, joint] = support_current(need, safety_factor, current_max, T_max, K, n)
    tau_hold_out[env, joint] = holding_torque(need, tau_y)


@wp.kernel
def window_read_kernel(
    # in, shape (E, M, WINDOW, FEATURES), (1,)
    ring_in: wp.array4d[float],
    head_in: wp.array[int],
    # out, shape (E, M, WINDOW, FEATURES)
    window_out: wp.array4d[float],
):
    """Copy the ring in the order of time, oldest sample first."""
    env, joint, sample = wp.tid()
    length = ring_in.shape[2]
    row = window_row(sample, head_in[0], length)
    for k in range(FEATURES):
        window_out[env, joint, sample, k] = ring_in[env, joint, row, k]
