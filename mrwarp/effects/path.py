"""The path of one joint at one step: eqs. 14 and 15 with every effect of the catalogue at its place.

The stages are composed from the catalogue when this module is loaded. At null values of all effects the torque is that
of the plain laws. Two effects need more than one step's quantities, so the caller provides them: the command as it was
``command_delay`` ago, and the heat that ``temperature_drift`` has stored.

Warp compiles a kernel anew when its source changes, or that of a function it names. A law that a static loop picks is
not among those, so each stage names the checksum of all laws: an edited law never runs as it was compiled before.
"""

import warp as wp

from mrwarp.effects.catalogue import CATALOGUE, COLUMN, HYSTERESIS, SLOT, SOURCES
from mrwarp.effects.law import Path
from mrwarp.kernels.bouc_wen import bouc_wen_exact
from mrwarp.kernels.mr_joint import JointParams, displacement

_CURRENT = [law for law in CATALOGUE.values() if law.stage == "current"]
_MOTION = [law for law in CATALOGUE.values() if law.stage == "motion"]
_SHAFT = [law for law in CATALOGUE.values() if law.stage == "shaft"]
_TORQUE = [law for law in CATALOGUE.values() if law.stage == "torque"]
_SENSOR = [law for law in CATALOGUE.values() if law.stage == "sensor"]
_HYSTERESIS = list(HYSTERESIS.values())


@wp.func
def current_path(s: Path, values: wp.array2d[float], row: int, memory: wp.array2d[float], line: int) -> Path:
    """From the command to the current that flows and the one that magnetises."""
    s.current = s.command
    s.field = s.command
    wp.static(SOURCES)
    for i in range(wp.static(len(_CURRENT))):
        s = wp.static(_CURRENT[i].law)(
            s, values, row, wp.static(COLUMN[_CURRENT[i].name]), memory, line, wp.static(SLOT[_CURRENT[i].name])
        )
    return s


@wp.func
def motion_path(
    p: JointParams, s: Path, z: float, values: wp.array2d[float], row: int, memory: wp.array2d[float], line: int
) -> Path:
    """From the measured motion to that of the device's shaft, with its path on both sides of a reversal."""
    s.z = z
    s.stiffness = p.K0 + p.K1 * s.field
    s.viscosity = p.B
    s.alpha = p.alpha
    s.beta = p.beta
    s.gamma = p.gamma
    s.engaged = 1.0
    wp.static(SOURCES)
    for i in range(wp.static(len(_MOTION))):
        s = wp.static(_MOTION[i].law)(
            s, values, row, wp.static(COLUMN[_MOTION[i].name]), memory, line, wp.static(SLOT[_MOTION[i].name])
        )
    before, after = s.qd_before, s.qd
    if before * after < 0.0:
        turn = s.dt * before / (before - after)
        s.path_1 = 0.5 * before * turn
        s.path_2 = 0.5 * after * (s.dt - turn)
    else:
        # a cubic with the slopes of both ends: a chord would shorten the path of a sine
        s.path_1 = 0.0
        s.path_2 = s.dt * (0.5 * (before + after) + s.dt / 12.0 * (s.qdd_before - s.qdd))
        if s.path_2 * (before + after) < 0.0:
            s.path_2 = 0.0
    if s.begins == 1:
        s.path_1 = 0.0
        s.path_2 = 0.0
    for i in range(wp.static(len(_SHAFT))):
        s = wp.static(_SHAFT[i].law)(
            s, values, row, wp.static(COLUMN[_SHAFT[i].name]), memory, line, wp.static(SLOT[_SHAFT[i].name])
        )
    return s


@wp.func
def torque_path(s: Path, values: wp.array2d[float], row: int, memory: wp.array2d[float], line: int) -> Path:
    """Factors of eq. 14 and what is added to it (``s.torque``)."""
    s.yield_gain = 1.0
    s.viscous_gain = 1.0
    s.weakening = 1.0
    s.torque = 0.0
    wp.static(SOURCES)
    for i in range(wp.static(len(_TORQUE))):
        s = wp.static(_TORQUE[i].law)(
            s, values, row, wp.static(COLUMN[_TORQUE[i].name]), memory, line, wp.static(SLOT[_TORQUE[i].name])
        )
    return s


@wp.func
def sensor_path(s: Path, values: wp.array2d[float], row: int, memory: wp.array2d[float], line: int) -> Path:
    """From the torque to its reading."""
    wp.static(SOURCES)
    for i in range(wp.static(len(_SENSOR))):
        s = wp.static(_SENSOR[i].law)(
            s, values, row, wp.static(COLUMN[_SENSOR[i].name]), memory, line, wp.static(SLOT[_SENSOR[i].name])
        )
    return s


@wp.func
def path_hysteresis(z: float, path: float, beta: float, gamma: float) -> float:
    """z after a signed path length of the shaft in one direction, eq. 15, which knows no time."""
    if path == 0.0:
        return z
    return bouc_wen_exact(path, z, beta, gamma, 1.0)


@wp.func
def law_in_force(values: wp.array2d[float], row: int) -> int:
    """Which published law takes the place of eq. 15, counted from 1; 0: none."""
    found = int(0)
    wp.static(SOURCES)
    for i in range(wp.static(len(_HYSTERESIS))):
        if values[row, wp.static(COLUMN[_HYSTERESIS[i].name])] > 0.0:
            found = i + 1
    return found


@wp.func
def law_hysteresis(
    law: int,
    p: JointParams,
    s: Path,
    z: float,
    values: wp.array2d[float],
    row: int,
    memory: wp.array2d[float],
    line: int,
) -> float:
    """z after the step by the law in force [rad]: its unit hysteresis times z's bound."""
    bound = 1.0 / wp.max(p.beta + p.gamma, 1.0e-6)
    q_c, h = displacement(p, s.q), float(z / bound)
    wp.static(SOURCES)
    for i in range(wp.static(len(_HYSTERESIS))):
        if law == i + 1:
            h = wp.static(_HYSTERESIS[i].law)(
                s, q_c, h, values, row, wp.static(COLUMN[_HYSTERESIS[i].name]),
                memory, line, wp.static(SLOT[_HYSTERESIS[i].name]),
            )  # fmt: skip
    return h * bound


@wp.func
def path_torque(p: JointParams, s: Path) -> float:
    """tau_BW of eq. 14 with the effects' factors, and what they add [N·m]."""
    weakening = 1.0 + p.alpha * wp.abs(s.qd)
    if s.weakening != 1.0:
        weakening = wp.pow(weakening, s.weakening)
    loop = s.yield_gain * (p.K0 + p.K1 * s.field) / weakening * s.z
    if s.engaged < 1.0:
        loop = s.engaged * loop
    return p.D + s.viscous_gain * p.B * s.qd + p.C * displacement(p, s.q) + p.I1 * s.current + loop + s.torque
