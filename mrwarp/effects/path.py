"""The path of one joint at one step: eqs. 14 and 15 with every effect of the catalogue at its place.

The stages are composed from the catalogue when this module is loaded. At null values of all effects the torque is that
of the plain laws. Two effects need more than one step's quantities, so the caller provides them: the command as it was
``command_delay`` ago, and the heat that ``temperature_drift`` has stored.

Warp compiles a kernel again when its source changes, or that of a function it names. A law that a static loop picks is
not among those, so each stage names the checksum of all laws: an edited law never runs as it was compiled before.
"""

import warp as wp

from mrwarp.effects.catalogue import CATALOGUE, COLUMN, HYSTERESIS, SLOT, SLOTS, SOURCES, column_of
from mrwarp.effects.law import Path
from mrwarp.kernels.bouc_wen import bouc_wen_behind_play, bouc_wen_exact, bouc_wen_release
from mrwarp.kernels.mr_joint import JointParams, own_displacement

_CURRENT = [law for law in CATALOGUE.values() if law.stage == "current"]
_MOTION = [law for law in CATALOGUE.values() if law.stage == "motion"]
_SHAFT = [law for law in CATALOGUE.values() if law.stage == "shaft"]
_TORQUE = [law for law in CATALOGUE.values() if law.stage == "torque"]
_SENSOR = [law for law in CATALOGUE.values() if law.stage == "sensor"]
_HYSTERESIS = list(HYSTERESIS.values())

_HALF_GAP = wp.constant(column_of("backlash", "half_gap"))
_COMPLIANCE = wp.constant(column_of("series_compliance", "compliance"))
_DIFFERENCE = wp.constant(column_of("series_compliance", "difference"))
_WOUND = wp.constant(SLOT["series_compliance"])
_RATE = wp.constant(SLOT["backlash"])
_LAST_SLOT = wp.constant(SLOTS - 1)
_RELUCTANT = wp.constant(0.7)
"""Share of what is missing by which w goes at first: as the device's torque falls with w, all of it is too far."""


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
def play_and_spring(s: Path, values: wp.array2d[float], row: int, memory: wp.array2d[float], line: int) -> Path:
    """The shaft's path where play and an elastic element in series stand before it, with eq. 15.

    On a reversal the element unwinds in contact, then the gap opens without torque, then the element is wound the other
    way. Each part of the step on one side of a reversal is solved by itself.
    """
    gap, compliance, difference = values[row, _HALF_GAP], values[row, _COMPLIANCE], values[row, _DIFFERENCE]
    ratio = compliance * s.stiffness / (1.0 + s.alpha * wp.abs(s.qd))
    before, turn = float(memory[line, _WOUND]), float(0.0)
    wound = float(before)
    if s.begins == 1:
        side = wp.sign(s.z)
        if s.z == 0.0:  # a record that begins under way
            side = wp.sign(s.qd) * wp.where(s.qd == 0.0, 0.0, 1.0)
        wound = side * gap + ratio * (1.0 + difference * side) * s.z
    else:
        if s.path_1 != 0.0:  # share of the step before the reversal, at one acceleration
            turn = wp.sqrt(wp.abs(s.path_1)) / (wp.sqrt(wp.abs(s.path_1)) + wp.sqrt(wp.abs(s.path_2)))
        z = float(s.z)
        for i in range(2):
            path, share = wp.where(i == 0, s.path_1, s.path_2), wp.where(i == 0, turn, 1.0 - turn)
            if share > 0.0:
                wound = wound + path
                # where the shaft would stand without stress says on which side the element is wound
                side = wound - bouc_wen_release(z, s.beta - s.gamma, 0.0, 0.0, 0.0, s.dt)
                uneven = 1.0 + difference * wp.sign(side)
                drag = compliance * uneven * s.viscosity / (share * s.dt)
                way = bouc_wen_behind_play(wound, z, ratio * uneven, drag, gap, s.beta, s.gamma)
                wound = wound - way
                z = bouc_wen_exact(way, z, s.beta, s.gamma, 1.0)
                if i == 0:
                    s.path_1 = way
                else:
                    s.path_2 = way
        s.joint_speed = wp.abs(s.qd)
        s.qd = s.qd - (wound - before) / s.dt
    s.engaged = wp.where(wp.abs(wound) > gap or s.begins == 1, 1.0, 0.0)
    s.qd = s.engaged * s.qd
    s.qdd = s.engaged * s.qdd
    memory[line, _WOUND] = wound
    return s


@wp.func
def motion_path(
    p: JointParams,
    s: Path,
    z: float,
    values: wp.array2d[float],
    row: int,
    memory: wp.array2d[float],
    line: int,
    law: int,
) -> Path:
    """From the measured motion to that of the device's shaft, with its path on both sides of a reversal.

    What stands before the shaft takes its share here with eq. 15 (``law`` = 0); with another law it is
    :func:`law_path` that finds it.
    """
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
    if law == 0 and values[row, _HALF_GAP] > 0.0 and values[row, _COMPLIANCE] > 0.0:
        s = play_and_spring(s, values, row, memory, line)
    elif law == 0:
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
    q_c, h = own_displacement(p, s.q), float(z / bound)
    wp.static(SOURCES)
    for i in range(wp.static(len(_HYSTERESIS))):
        if law == i + 1:
            h = wp.static(_HYSTERESIS[i].law)(
                s,
                q_c,
                h,
                values,
                row,
                wp.static(COLUMN[_HYSTERESIS[i].name]),
                memory,
                line,
                wp.static(SLOT[_HYSTERESIS[i].name]),
            )
    return h * bound


@wp.func
def law_slot(law: int) -> int:
    """First state of the law in force."""
    found = int(0)
    for i in range(wp.static(len(_HYSTERESIS))):
        if law == i + 1:
            found = wp.static(SLOT[_HYSTERESIS[i].name])
    return found


@wp.func
def law_behind_shaft(
    law: int,
    p: JointParams,
    s: Path,
    values: wp.array2d[float],
    row: int,
    memory: wp.array2d[float],
    line: int,
) -> Path:
    """z by the law in force, and the shaft's speed, where play and an elastic element stand before the shaft.

    ``w - clamp(w, -b, b) = c*tau``, w = q - y: the shaft at y has no mass, so the device bears what stops and element
    bear. Its speed is that of the joint less the rate of w. The law is asked again and again, from the states that it
    had before the step, for the w at the step's end at which both agree. What is borne grows with w and the device's
    torque falls with it, so w lies between any guess and where the element bears that guess's torque. The first guess
    is where the last rate leads, without an element that of a shaft that stands still. With an element the rate is the
    step's mean. Without one it is a line over the step within the gap, which keeps the time of contact to a small part
    of a step, and 0 at a stop; a stop gives way by a thousandth of the half-gap at the sliding torque. Factors of
    eq. 14 are those at the joint's speed.
    """
    half_gap, compliance, slot = values[row, _HALF_GAP], values[row, _COMPLIANCE], law_slot(law)
    last, z = wp.min(slot + 1, _LAST_SLOT), float(s.z)
    state_1, state_2 = float(memory[line, slot]), float(memory[line, last])
    loop = s.yield_gain * (p.K0 + p.K1 * s.field)
    size = wp.max(wp.abs(loop), 1.0e-9)
    q, qd, qd_before, way = float(s.q), float(s.qd), float(s.qd_before), float(s.path_1 + s.path_2)
    wound, rate_before, rate = float(memory[line, _WOUND]), float(memory[line, _RATE]), float(0.0)
    w = wp.where(compliance > 0.0, wound + s.dt * rate_before, wound + way)
    low, high, w_before, miss_before, struck = float(0.0), float(0.0), float(w), float(0.0), int(0)
    for i in range(32):
        if s.begins == 0:
            mean = (w - wound) / s.dt
            rate = mean
            if compliance == 0.0:
                rate = wp.where(struck == 1, 0.0, 2.0 * mean - rate_before)
            s.q = q - w
            s.qd = qd - rate
            s.qd_before = qd_before + rate - 2.0 * mean
            s.path_1 = 0.0
            s.path_2 = way - (w - wound)
            memory[line, slot] = state_1
            memory[line, last] = state_2
        s.z = law_hysteresis(law, p, s, z, values, row, memory, line)
        tau = s.viscous_gain * s.viscosity * s.qd + loop * s.z
        give = wp.max(compliance * (1.0 + values[row, _DIFFERENCE] * wp.sign(tau)), 1.0e-3 * half_gap / size)
        side = wp.sign(tau)
        if tau == 0.0:
            side = wp.clamp(w / wp.max(half_gap, 1.0e-9), -1.0, 1.0)
        alone = give * tau + side * half_gap
        if s.begins == 1:
            w = alone
        if s.begins == 1 or struck == 1:
            break
        miss = w - wp.clamp(w, -half_gap, half_gap) - give * tau
        if wp.abs(miss) <= 1.0e-5 * give * size + 1.0e-7 * wp.abs(w) or i == 30:
            if compliance > 0.0 or wp.abs(w) <= half_gap:
                break
            struck = 1  # once more with the joint's own speed, which a shaft at a stop has
            continue
        if i == 0:  # alone, with this w's torque, lies beyond
            low, high = wp.min(alone, w), wp.max(alone, w)
        if miss > 0.0:
            high = w
        else:
            low = w
        ahead = wp.where(compliance > 0.0, w - _RELUCTANT * miss, wound)  # what slides on keeps its element as it is
        if i > 0:
            ahead = w - miss * (w - w_before) / (miss - miss_before + 1.0e-30)
        w_before = w
        miss_before = miss
        w = ahead
        if not (w > low and w < high):
            w = 0.5 * (low + high)
    memory[line, _WOUND] = w
    memory[line, _RATE] = rate
    s.q = q
    return s


@wp.func
def law_path(
    law: int,
    p: JointParams,
    s: Path,
    values: wp.array2d[float],
    row: int,
    memory: wp.array2d[float],
    line: int,
) -> Path:
    """From ``s.z`` before the step to z by the law in force, factors and what is added; behind an element too."""
    if values[row, _HALF_GAP] > 0.0 or values[row, _COMPLIANCE] > 0.0:
        s = torque_path(s, values, row, memory, line)
        return law_behind_shaft(law, p, s, values, row, memory, line)
    s.z = law_hysteresis(law, p, s, s.z, values, row, memory, line)
    return torque_path(s, values, row, memory, line)


@wp.func
def path_torque(p: JointParams, s: Path) -> float:
    """tau_BW of eq. 14 with the effects' factors, and what they add [N·m]."""
    weakening = 1.0 + p.alpha * wp.where(s.joint_speed > 0.0, s.joint_speed, wp.abs(s.qd))
    if s.weakening != 1.0:
        weakening = wp.pow(weakening, s.weakening)
    loop = s.yield_gain * (p.K0 + p.K1 * s.field) / weakening * s.z
    if s.engaged < 1.0:
        loop = s.engaged * loop
    plain = p.D + s.viscous_gain * s.viscosity * s.qd + p.C * own_displacement(p, s.q) + p.I1 * s.current
    return plain + loop + s.torque
