"""One step of one device, as the simulator takes it without gates; read by :mod:`mrwarp.export.specialise`.

It is the branch of :mod:`mrwarp.effects.step_kernel` that a device alone goes through, on plain numbers. The names in
capitals stand for what the device has, and are replaced where it is exported.
"""

from typing import Any

import warp as wp

from mrwarp.effects.joint import delayed_command, joint_path, stored_heat
from mrwarp.kernels.brake import yield_torque
from mrwarp.kernels.clip import clip
from mrwarp.kernels.coil import coil_current, mean_coil_current
from mrwarp.kernels.mr_joint import (
    JointParams,
    displacement,
    hysteresis,
    sliding_torque,
    slowed_since_turn,
    stuck,
    unusable,
)

DT = 0.0
EFFECTS = DELAYED = WORN = WARMED = COMMANDS = 0

__all__ = ["step"]


def step(
    p: JointParams,  # pyright: ignore[reportGeneralTypeIssues]
    joint: Any,
    values: Any,
    row: int,
    q: float,
    qd: float,
    current: float,
) -> float:
    """Torque [N*m] over the step that begins in this state, positive against a positive velocity."""
    command = clip(current, p.current_max)
    begin = float(joint.coil)
    logged = mean_coil_current(begin, command, p.coil_time_constant, DT)
    joint.coil = coil_current(begin, command, p.coil_time_constant, DT)
    flowing, sliding, strength = float(logged), float(0.0), float(1.0)
    if EFFECTS == 0:
        joint.z = hysteresis(p, qd, joint.z, DT, 1)
        sliding = sliding_torque(p, qd, displacement(p, q), logged, joint.z)
    else:
        begun, heat, time = float(logged), float(0.0), float(0.0)
        if DELAYED == 1:
            joint.newest = (joint.newest + 1) % COMMANDS
            joint.commands[joint.newest] = logged
            begun = delayed_command(logged, values, row, joint.commands, 0, joint.newest, DT)
        if WORN == 1:
            joint.steps = joint.steps + 1
            time = float(joint.steps) * DT
        if WARMED == 1:
            heat = joint.heat
        s = joint_path(p, values, row, joint.memory, 0, begun, q, qd, joint.z, heat, time, DT, 1)
        joint.z = s.z
        if WARMED == 1:
            joint.heat = stored_heat(s, values, row, p.coil_resistance)
        flowing, sliding, strength = s.current, s.torque, s.yield_gain
    sliding = sliding + unusable(q, qd, current, command)
    bound = wp.abs(sliding)
    joint.caught = slowed_since_turn(qd, joint.speed, joint.caught)
    held = stuck(p, qd, joint.speed, joint.caught)
    joint.speed = qd
    if held > 0.0:
        tau_y = yield_torque(flowing, strength * p.T_max, p.K, p.n)
        bound = wp.where(tau_y > bound, tau_y, bound)
    joint.bound = bound
    return sliding
