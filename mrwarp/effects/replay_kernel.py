"""The kernel of the diagnosis: the path of :mod:`mrwarp.effects.path` along recorded motion."""

import warp as wp

from mrwarp.effects.catalogue import column_of
from mrwarp.effects.law import Path
from mrwarp.effects.path import current_path, motion_path, path_torque, sensor_path, torque_path, way_hysteresis

BASE = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma", "q_zero")
"""First columns of a row: eqs. 14 and 15, and the angle from which q_c is counted."""

HEAT_TIMES = (10.0, 25.0, 60.0, 150.0, 400.0, 1000.0, 3000.0)
"""Thermal time constants for which the stored heat is prepared [s]; it is interpolated in between."""

_DELAY = wp.constant(column_of("command_delay", "delay"))
_THERMAL = wp.constant(column_of("temperature_drift", "time_constant"))
_TIMES = wp.constant(wp.types.vector(length=len(HEAT_TIMES), dtype=wp.float32)(*HEAT_TIMES))
_COUNT = wp.constant(len(HEAT_TIMES))


@wp.func
def delayed(current: wp.array[float], first: int, k: int, lag: float) -> float:
    """Command ``lag`` samples before sample ``k``, linear in between; before the first one it was the same."""
    whole = int(wp.floor(lag))
    part = lag - float(whole)
    newer, older = wp.max(k - whole, first), wp.max(k - whole - 1, first)
    value = (1.0 - part) * current[newer] + part * current[older]
    return float(value)


@wp.func
def stored_heat(heat: wp.array2d[float], k: int, time_constant: float) -> float:
    """Heat for a thermal time constant between those prepared, linear in its logarithm."""
    i = int(0)
    while i < _COUNT - 2 and _TIMES[i + 1] < time_constant:
        i += 1
    share = wp.clamp(wp.log(time_constant / _TIMES[i]) / wp.log(_TIMES[i + 1] / _TIMES[i]), 0.0, 1.0)
    value = (1.0 - share) * heat[i, k] + share * heat[i + 1, k]
    return float(value)


@wp.kernel(enable_backward=False)
def extended_replay_kernel(
    # parameters, shape (C, len(BASE)), (C, COLUMNS)
    base: wp.array2d[float],
    values: wp.array2d[float],
    # in, samples of all trajectories end to end, shape (N,); (len(HEAT_TIMES), N); (T + 1,); (T,); (T,)
    q_in: wp.array[float],
    qd_in: wp.array[float],
    qdd_in: wp.array[float],
    current_in: wp.array[float],
    time_in: wp.array[float],
    slid_in: wp.array[float],
    heat_in: wp.array2d[float],
    start_in: wp.array[int],
    dt_in: wp.array[float],
    begin_in: wp.array[float],
    # out: states, shape (C*T, SLOTS); torque, shape (C, N)
    memory_out: wp.array2d[float],
    tau_out: wp.array2d[float],
):
    """Torque along every trajectory with every row of parameters; the coil starts at its first command.

    z starts at its steady value in the direction of ``begin_in``, or at 0 where that is 0.
    """
    row, trajectory = wp.tid()
    line = row * dt_in.shape[0] + trajectory
    first, last = start_in[trajectory], start_in[trajectory + 1]
    dt = dt_in[trajectory]
    D, B, C, I1 = base[row, 0], base[row, 1], base[row, 2], base[row, 3]
    K0, K1, alpha = base[row, 4], base[row, 5], base[row, 6]
    beta, gamma, q_zero = base[row, 7], base[row, 8], base[row, 9]
    delay, thermal = values[row, _DELAY], values[row, _THERMAL]
    z = float(0.0)
    if begin_in[trajectory] != 0.0:
        z = begin_in[trajectory] / wp.max(beta + gamma, 1.0e-6)
    for k in range(first, last):
        before = wp.max(k - 1, first)
        s = Path()
        s.dt = dt
        s.time = time_in[k]
        s.slid_time = slid_in[k]
        s.begins = wp.where(k == first, 1, 0)
        s.command = current_in[k]
        s.command_before = current_in[before]
        if delay > 0.0:
            s.command = delayed(current_in, first, k, delay / dt)
            s.command_before = delayed(current_in, first, before, delay / dt)
        s = current_path(s, values, row, memory_out, line)
        s.q = q_in[k]
        s.qd = qd_in[k]
        s.qd_before = qd_in[before]
        s.qdd = qdd_in[k]
        s.qdd_before = qdd_in[before]
        s = motion_path(s, values, row, memory_out, line)
        z = way_hysteresis(way_hysteresis(z, s.way_1, beta, gamma), s.way_2, beta, gamma)
        s.z = z
        if thermal > 0.0:
            s.heat = stored_heat(heat_in, k, thermal)
        s = torque_path(s, values, row, memory_out, line)
        s.torque = path_torque(s, s.q - q_zero, D, B, C, I1, K0, K1, alpha)
        s = sensor_path(s, values, row, memory_out, line)
        tau_out[row, k] = s.torque
