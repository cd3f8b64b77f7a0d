"""An independent model of the push of table 4 in one degree of freedom.

A body stands on two equal knees, each foot below its hip.
A knee bent by theta holds the hip at ``2 L cos(theta/2)`` above the foot, so that its torque tau carries the force
``tau/(L sin(theta/2))``. Motor (eq. 2) and device (eqs. 5, 6, 14, 15) act at the knees; no policy answers. The gain is
that of the public description; damping and duration of the push are those that come nearest to the paper's row of 0 A.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from mrwarp import paper
from mrwarp.params import BoucWenParams, GateParams
from mrwarp.usd.robot import DEFAULT_POSE, PUBLIC_GAINS

LINK, SOLE = 0.213, 0.023
"""Length of thigh and of calf, and radius of the foot [m], public Go1 description."""

LEGS = 2
"""Legs that stand in a trot, section 6.3."""

STEP = 5e-4
"""Time step [s]; half of it changes no change by 0.1 points."""


@dataclass(frozen=True, kw_only=True)
class Knees:
    """A body on its knees under a push, and how the device is read."""

    kp: float = PUBLIC_GAINS[0]
    """[N·m/rad]"""
    kd: float = PUBLIC_GAINS[1]
    """[N·m·s/rad]"""
    duration: float = 0.3
    """Of the push [s]."""
    mass: float = paper.MASS["mr_go"]
    """[kg]"""
    start: float = paper.TABLE_2["D"]["height"].mean
    """Height of the hip at rest [m]."""
    force: float = paper.PUSH_FORCE
    """Downward [N]."""
    raw: bool = False
    """Whether q_c of eq. 14 is the calf's angle itself, or its displacement from the neutral stance."""
    drag: bool = True
    """Whether the device drags at 0 A."""


@dataclass(frozen=True, kw_only=True)
class Fall:
    """Result of a push."""

    height: float
    """Minimum [m]."""
    speed: float
    """Peak downward speed [m/s]."""
    torque: float
    """Peak torque of a motor [N·m]."""


def torque(current: float, q: float, qd: float, z: float, *, raw: bool) -> float:
    """Size of eq. 14 [N·m] at a calf angle [rad], velocity [rad/s] and z [rad]."""
    law = BoucWenParams()
    q_c = q - law.q_offset - law.q_center - (0.0 if raw else DEFAULT_POSE["calf"])
    weak = (law.K0 + law.K1 * current) / (1.0 + law.alpha * abs(qd))
    return abs(law.D + law.B * qd + law.C * q_c + law.I1 * current + weak * z)


def fall(knees: Knees, current: float, *, step: float = STEP, window: float = 0.5) -> Fall:
    """Push the body down and follow it until it rises, or for ``window`` [s].

    The device acts with its gate open (eq. 5), the foot loaded.
    """
    law, gate = BoucWenParams(), GateParams()
    theta = 2.0 * math.acos((knees.start - SOLE) / (2.0 * LINK))
    weight = knees.mass * paper.GRAVITY
    target = -theta + weight / LEGS * LINK * math.sin(0.5 * theta) / knees.kp  # the calf's angle is -theta
    height = knees.start
    speed, z, lowest, fastest, most = 0.0, 0.0, height, 0.0, 0.0
    for k in range(round(window / step)):
        theta = 2.0 * math.acos(min((height - SOLE) / (2.0 * LINK), 1.0))
        arm = LINK * math.sin(0.5 * theta)
        q, qd = -theta, speed / arm  # a falling body bends the knee: both are negative then
        e = target - q
        motor = knees.kp * e - knees.kd * qd
        z += step * (qd - law.beta * abs(qd) * z - law.gamma * qd * abs(z))
        device = 0.0
        if abs(e) > gate.eps_e and abs(qd) > gate.eps_v and e * qd < 0.0 and (knees.drag or current > 0.0):
            device = -math.copysign(torque(current, q, qd, z, raw=knees.raw), qd)
        push = knees.force if k * step < knees.duration else 0.0
        speed += step * (LEGS * (motor + device) / arm - weight - push) / knees.mass
        height += step * speed
        lowest, fastest, most = min(lowest, height), min(fastest, speed), max(most, abs(motor))
        if speed > 0.0 and k * step > 0.05:
            break
    return Fall(height=lowest, speed=-fastest, torque=most)


def half_period() -> float:
    """Half a period [s] of the body on a spring that the push presses down as far as in the paper's row of 0 A.

    A push that presses so deep lasts about that long, or longer.
    """
    drop = Knees().start - paper.TABLE_4["simulation"][0.0]["min_height"].mean
    return math.pi * math.sqrt(paper.MASS["mr_go"] * drop / (2.0 * paper.PUSH_FORCE))


@functools.cache
def by_zero_row(*, raw: bool, drag: bool) -> Knees:
    """The body whose damping and duration give the paper's row of 0 A, nearest in drop and peak speed."""
    row = paper.TABLE_4["simulation"][0.0]
    base = Knees(raw=raw, drag=drag)

    def miss(values: np.ndarray) -> list[float]:
        found = fall(replace(base, kd=float(values[0]), duration=float(values[1])), 0.0)
        drop = (base.start - found.height) / (base.start - row["min_height"].mean)
        return [drop - 1.0, found.speed / -row["peak_down_velocity"].mean - 1.0]

    kd, duration = least_squares(
        miss, (0.3, 0.25), bounds=((0.0, 0.1), (2.0, 0.6)), x_scale=(0.1, 0.1), diff_step=0.02
    ).x
    return replace(base, kd=round(float(kd), 3), duration=round(float(duration), 3))


def changes(knees: Knees, currents: tuple[float, ...]) -> list[tuple[float, float, float]]:
    """Changes of minimum height, peak speed and peak motor torque [%] from 0 A, by current [A]."""
    zero = fall(knees, 0.0)
    found = [fall(knees, amps) for amps in currents]
    return [
        tuple(100.0 * (getattr(now, name) / getattr(zero, name) - 1.0) for name in ("height", "speed", "torque"))
        for now in found
    ]
