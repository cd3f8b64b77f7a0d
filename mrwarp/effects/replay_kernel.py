"""Replay of recorded motion through the joint's own laws, for many parameter sets and trajectories in one launch.

One kernel, generated twice: with the path of :mod:`mrwarp.effects.path`, and without effects. Both advance z over the
path of the shaft, which eq. 15 depends on alone; they differ in how they find it between two samples. The one with
effects takes the cubic that meets velocity and acceleration at both, and stops where the shaft turns. The one without
takes parts of an interpolated velocity, or the simulator's own step, and also has three laws of a real damper:
saturation, softening and creep, each absent at 0.
"""

from typing import Any

import warp as wp

from mrwarp.effects.catalogue import column_of
from mrwarp.effects.law import Path
from mrwarp.effects.path import (
    current_path,
    law_in_force,
    law_path,
    motion_path,
    path_hysteresis,
    path_torque,
    sensor_path,
    torque_path,
)
from mrwarp.kernels.bouc_wen import bouc_wen_exact
from mrwarp.kernels.coil import coil_current, mean_coil_current
from mrwarp.kernels.mr_joint import JointParams, hysteresis

LAWS = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma")
"""Parameters of eqs. 14 and 15."""
BASE = (*LAWS, "q_zero", "z_max", "coil_time_constant", "saturation", "softening", "creep")
"""First columns of a row: eqs. 14 and 15, the angle from which q_c is counted, then what acts without effects only."""

HEAT_TIMES = (10.0, 25.0, 60.0, 150.0, 400.0, 1000.0, 3000.0)
"""Thermal time constants for which the stored heat is prepared [s]; it is interpolated in between."""

_DELAY = wp.constant(column_of("command_delay", "delay"))
_COIL_LAG = wp.constant(column_of("coil_lag", "time_constant"))
_JUMPS = wp.constant(column_of("torque_sensor_lag", "hold"))
_THERMAL = wp.constant(column_of("temperature_drift", "time_constant"))
_TEMPERATURE = wp.constant(column_of("temperature_fade", "temperature"))
_TIMES = wp.constant(wp.types.vector(length=len(HEAT_TIMES), dtype=wp.float32)(*HEAT_TIMES))
_COUNT = wp.constant(len(HEAT_TIMES))
_SATURATION = wp.constant(BASE.index("saturation"))
_SOFTENING = wp.constant(BASE.index("softening"))
_CREEP = wp.constant(BASE.index("creep"))


@wp.func
def laws_of(base: wp.array2d[float], row: int) -> JointParams:
    """Parameters of eqs. 14 and 15 and of the coil from a row."""
    p = JointParams()
    p.D = base[row, 0]
    p.B = base[row, 1]
    p.C = base[row, 2]
    p.I1 = base[row, 3]
    p.K0 = base[row, 4]
    p.K1 = base[row, 5]
    p.alpha = base[row, 6]
    p.beta = base[row, 7]
    p.gamma = base[row, 8]
    p.q_offset = base[row, 9]
    p.z_max = base[row, 10]
    p.coil_time_constant = base[row, 11]
    return p


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


@wp.func
def saturating_current(current: float, saturation: float) -> float:
    """Current map ``u(I) = (1 - exp(-k|I|))/(1 - exp(-k))``, odd, u(1) = 1: linear for k = 0, saturating for k > 0."""
    if saturation == 0.0:
        return current
    return wp.sign(current) * (1.0 - wp.exp(-saturation * wp.abs(current))) / (1.0 - wp.exp(-saturation))


@wp.func
def creeping_hysteresis(
    p: JointParams, softening: float, creep: float, qd: float, u: float, z: float, dt: float
) -> float:
    """z after ``dt`` of ``dz/dt = qd - r*(beta*|qd|*z + gamma*qd*|z|) - creep*z`` with ``r = exp(softening*(1-|u|))``.

    Creep adds ``creep/|qd|`` to the rate of both branches over the path, so eq. 15's closed form holds as it is.
    """
    speed = wp.max(wp.abs(qd), 1.0e-5)  # at rest a crawl, along which the stress decays by exp(-creep*dt)
    soft = wp.exp(softening * (1.0 - wp.abs(u)))
    return bouc_wen_exact(wp.where(qd < 0.0, -speed, speed), z, p.beta * soft + creep / speed, p.gamma * soft, dt)


@wp.func
def velocity_between(before: float, start: float, end: float, after: float, part: float) -> float:
    """Velocity at ``part`` of the time from ``start`` to ``end``: the cubic of Catmull and Rom through four samples.

    A chord would shorten the path of a sine of 2 Hz at 200 Hz by 0.03 %, and beta and gamma would take it up.
    """
    slope, slope_end = 0.5 * (end - before), 0.5 * (after - start)
    rise = end - start
    cubic = slope + slope_end - 2.0 * rise
    return start + part * (slope + part * (3.0 * rise - 2.0 * slope - slope_end + part * cubic))


def make_replay_kernel(effects: bool) -> Any:
    """The kernel with the path of the catalogue's effects, or without."""

    @wp.kernel(enable_backward=False, module="unique")
    def replay_kernel(
        # parameters, shape (C, len(BASE)), (C, COLUMNS) or none; without effects: 1 = closed form, 0 = Euler step of z,
        # and parts of each sampling step, through interpolated velocity, or 0 = the simulator's own step, which holds
        # the newest velocity
        base: wp.array2d[float],
        values: wp.array2d[float],
        exact: int,
        substeps: int,
        # in, samples of all trajectories end to end, shape (N,), those after the current with effects only;
        # (len(HEAT_TIMES), N); (N,) [degC] or none; first sample of each trajectory and the end of the last one,
        # (T + 1,); (T,) [s]; (T,); middle of its angles, (T,), with effects only
        q_in: wp.array[float],
        qd_in: wp.array[float],
        current_in: wp.array[float],
        qdd_in: wp.array[float],
        time_in: wp.array[float],
        slid_in: wp.array[float],
        heat_in: wp.array2d[float],
        temperature_in: wp.array[float],
        start_in: wp.array[int],
        dt_in: wp.array[float],
        begin_in: wp.array[float],
        middle_in: wp.array[float],
        # out: states of the effects, shape (C*T, SLOTS); torque, shape (C, N) [N·m]
        memory_out: wp.array2d[float],
        tau_out: wp.array2d[float],
    ):
        """Torque along every trajectory with every row of parameters; the coil starts at its first command.

        z starts at its steady value in the direction of ``begin_in``, or at 0 where that is 0.
        """
        row, trajectory = wp.tid()
        line = row * dt_in.shape[0] + trajectory
        first, last = start_in[trajectory], start_in[trajectory + 1] - 1
        dt = dt_in[trajectory]
        p = laws_of(base, row)
        coil, z = float(current_in[first]), float(0.0)
        current_before = float(0.0)
        field_before = float(0.0)
        if begin_in[trajectory] != 0.0:
            z = begin_in[trajectory] / wp.max(p.beta + p.gamma, 1.0e-6)
        if wp.static(effects):
            law = law_in_force(values, row)
        for k in range(first, last + 1):
            before = wp.max(k - 1, first)
            s = Path()
            s.dt = dt
            s.begins = wp.where(k == first, 1, 0)
            s.command = current_in[k]
            s.q = q_in[k]
            s.qd = qd_in[k]
            if wp.static(effects):
                s.zero = p.q_offset
                s.middle = middle_in[trajectory]
                s.time = time_in[k]
                s.slid_time = slid_in[k]
                s.command_before = current_in[before]
                delay, thermal = values[row, _DELAY], values[row, _THERMAL]
                if delay > 0.0:
                    s.command = delayed(current_in, first, k, delay / dt)
                    s.command_before = delayed(current_in, first, before, delay / dt)
                s.qd_before = qd_in[before]
                s.qdd = qdd_in[k]
                s.qdd_before = qdd_in[before]
                s = current_path(s, values, row, memory_out, line)
                s = motion_path(p, s, z, values, row, memory_out, line, law)
                if thermal > 0.0:
                    s.heat = stored_heat(heat_in, k, thermal)
                s.temperature = values[row, _TEMPERATURE]
                if temperature_in:
                    s.temperature = temperature_in[k]
                if law > 0:
                    s = law_path(law, p, s, values, row, memory_out, line)
                    z = s.z
                else:
                    if p.K0 != 0.0 or p.K1 != 0.0:  # else nobody asks for the stress
                        z = path_hysteresis(path_hysteresis(z, s.path_1, p.beta, p.gamma), s.path_2, p.beta, p.gamma)
                    s.z = z
                    s = torque_path(s, values, row, memory_out, line)
            else:
                flowing = float(0.0)
                if substeps == 0:  # as in the simulator: the command acts over the step that ends at its sample
                    flowing = mean_coil_current(coil, s.command, p.coil_time_constant, dt)
                    coil = coil_current(coil, s.command, p.coil_time_constant, dt)
                elif p.coil_time_constant > 0.0:  # as on a bench: the command holds from its sample to the next
                    coil = coil_current(coil, current_in[before], p.coil_time_constant, dt)
                    flowing = coil
                else:
                    flowing = s.command
                s.current = saturating_current(flowing, base[row, _SATURATION])
                s.field = s.current
                softening, creep = base[row, _SOFTENING], base[row, _CREEP]
                parts = wp.max(substeps, 1)
                steps = parts
                if substeps > 0 and k == first:
                    steps = 0  # a recorded motion begins at its first sample, the simulator's step ends there
                for i in range(steps):
                    speed = float(s.qd)
                    if substeps > 0:
                        earlier, later = qd_in[wp.max(k - 2, first)], qd_in[wp.min(k + 1, last)]
                        part = (float(i) + 0.5) / float(parts)
                        speed = velocity_between(earlier, qd_in[before], s.qd, later, part)
                    if creep == 0.0 and softening == 0.0:
                        z = hysteresis(p, speed, z, dt / float(parts), exact)
                    else:
                        z = creeping_hysteresis(p, softening, creep, speed, s.current, z, dt / float(parts))
                s.z = z
                s.engaged = 1.0
                s.viscosity = p.B
                s.yield_gain = 1.0
                s.viscous_gain = 1.0
                s.weakening = 1.0
            if wp.static(effects):
                current, field = float(s.current), float(s.field)
                if values[row, _JUMPS] != 0.0:
                    if k > first and values[row, _COIL_LAG] <= 0.0:  # behind a lag the current does not jump
                        s.current = current_before
                        s.field = field_before
                    s.torque_before = path_torque(p, s)
                    s.current = current
                    s.field = field
                current_before = current
                field_before = field
            s.torque = path_torque(p, s)
            if wp.static(effects):
                s = sensor_path(s, values, row, memory_out, line)
            tau_out[row, k] = s.torque

    return replay_kernel


replay_kernel = make_replay_kernel(effects=False)
effect_replay_kernel = make_replay_kernel(effects=True)
