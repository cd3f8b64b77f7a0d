"""One MR joint with effects in a step of the simulator: the path of :mod:`mrwarp.effects.path` on a joint's parameters.

What the simulator's step fixes: command and torque hold over the step (``held``), so the torque follows the mean of the
coil's current over it; a semi-implicit step moves the joint by ``dt*qd`` with the newest velocity, so that velocity is
the whole step's (``qd_before = qd``, no acceleration) and the shaft's path is the joint's true one; z takes the Euler
or exact step that it takes without effects, with the shaft's velocity. So with every effect at null each number is that
of the plain laws, bit for bit.

Backlash: only the shaft's path drives z, and in the gap the device bears nothing: the sliding torque, and so the bound
of the brake while damping, is what acts before the gap (D, C*q_c, I1*I). A joint that is *held* is held in the gap too,
for a brake that acts as a constraint on the joint knows no shaft of its own.
"""

import warp as wp

from mrwarp.effects.catalogue import column_of
from mrwarp.effects.law import Path
from mrwarp.effects.path import current_path, law_in_force, law_path, motion_path, path_torque, torque_path
from mrwarp.kernels.mr_joint import JointParams, hysteresis, own_displacement

_DELAY = wp.constant(column_of("command_delay", "delay"))
_THERMAL = wp.constant(column_of("temperature_drift", "time_constant"))
_TEMPERATURE = wp.constant(column_of("temperature_fade", "temperature"))


@wp.func
def delayed_command(
    command: float, values: wp.array2d[float], row: int, ring: wp.array2d[float], line: int, newest: int, dt: float
) -> float:
    """Command as it was ``command_delay`` ago [A], linear between steps; as it is without a delay.

    Args:
        command: The newest one, which stands in the ring too.
        values: Parameters of the effects, shape (rows, COLUMNS).
        row: The joint's row of them.
        ring: Past commands, shape (lines, DEPTH), of which DEPTH - 1 steps can be reached.
        line: The joint's line of it.
        newest: Where the newest command stands.
        dt: Step [s].
    """
    delay = values[row, _DELAY]
    if delay <= 0.0:
        return command
    depth = ring.shape[1]
    lag = wp.min(delay / dt, float(depth - 2))
    whole = int(wp.floor(lag))
    part = lag - float(whole)
    newer, older = (newest - whole + depth) % depth, (newest - whole - 1 + depth) % depth
    return (1.0 - part) * ring[line, newer] + part * ring[line, older]


@wp.func
def joint_path(
    p: JointParams,
    values: wp.array2d[float],
    row: int,
    memory: wp.array2d[float],
    line: int,
    command: float,
    q: float,
    qd: float,
    z: float,
    heat: float,
    time: float,
    dt: float,
    exact: int,
) -> Path:
    """The step of one joint: current, field, z (15) and, as ``torque``, tau_BW (14) with what the effects add.

    Args:
        p: The joint's parameters.
        values: Parameters of the effects, shape (rows, COLUMNS).
        row: The joint's row of them.
        memory: States of the effects, shape (lines, SLOTS); written.
        line: The joint's line of it.
        command: Current that the path begins with [A].
        q: Joint angle [rad].
        qd: Joint velocity [rad/s].
        z: Hysteresis state before the step [rad].
        heat: Heat stored before the step [J].
        time: Time in the session [s].
        dt: Step [s].
        exact: 1 = exact step of z, 0 = Euler.
    """
    s = Path()
    s.dt = dt
    s.time = time
    s.slid_time = time
    s.command = command
    s.command_before = command
    s.held = 1
    s.qd = qd
    s.qd_before = qd
    s = current_path(s, values, row, memory, line)
    s.current = wp.abs(s.current)  # a coil and a core know signs, the fluid does not
    s.field = wp.abs(s.field)
    # the device's own angle, about which a bench fitted its effects: where it stands in a robot is no part of it
    s.q = q - p.q_neutral
    s.zero = s.q - own_displacement(p, s.q)
    s.middle = s.zero
    law = law_in_force(values, row)
    s = motion_path(p, s, z, values, row, memory, line, law)
    speed = float(qd)
    if s.path_2 != dt * qd:  # a gap has shortened the path of the shaft
        speed = s.path_2 / dt
    s.heat = heat
    s.temperature = values[row, _TEMPERATURE]
    if law > 0:
        s = law_path(law, p, s, values, row, memory, line)
    else:
        s.z = hysteresis(p, speed, z, dt, exact)
        s = torque_path(s, values, row, memory, line)
    s.yield_gain = wp.max(s.yield_gain, 0.0)  # a device that has worn out does not push
    s.torque = path_torque(p, s)
    return s


@wp.func
def stored_heat(s: Path, values: wp.array2d[float], row: int, resistance: float) -> float:
    """Heat after the step [J]: ``ds/dt = |tau*qd| + R*I^2 - s/T``; 0 for a joint that does not drift with it."""
    time_constant = values[row, _THERMAL]
    if time_constant <= 0.0:
        return 0.0
    power = wp.abs(s.torque * s.qd) + resistance * s.current * s.current
    return s.heat * wp.exp(-s.dt / time_constant) + s.dt * power
