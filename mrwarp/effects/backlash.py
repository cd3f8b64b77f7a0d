"""Backlash: ``dead zone of half-gap b in series, torque of the device 0 in it``.

The joint at q drives the device's shaft at y through a dead zone: ``|q - y| <= b``, and contact only pushes. The device
has no mass, so its torque ``K*z + B*dy/dt`` is what the contact bears: one side bears a positive torque, the other a
negative one, and between them it is zero. A shaft that nothing holds moves to where its stress is gone,
``B*dy/dt = -K*z``: at once for B = 0, with ``K/B`` per second else. So in each step

``y = clamp(free, q - b, q + b)``, ``free = y - sgn(z)*log(1 + r*|z|*(1 - exp(-K*dt/B)))/r``, ``r = beta - gamma``

with ``K = (K0 + K1*I)/(1 + alpha*|dy/dt|)``: eq. 15 unloads by ``dz/dy = 1 + r*|z|``, so ``dz/dt`` is
``-K/B*z*(1 + r*|z|)``, whose solution that is; for B = 0 it is the path to zero stress. On a reversal the stress
first unloads in contact, down to zero or to where the shaft cannot follow; then the gap opens without torque, and the
other side loads after a path of 2b. Friction, viscosity and inertia of the device act behind the gap. D, C*q_c and I1*I
of eq. 14, zero and mounting of the sensor, act before it. With an elastic element both are solved together
(:func:`mrwarp.effects.path.play_and_spring`). With another hysteresis than eq. 15's the shaft's
speed is found with that law (:func:`mrwarp.effects.path.law_behind_shaft`); other effects act before the gap then.
"""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path
from mrwarp.kernels.bouc_wen import bouc_wen_exact, bouc_wen_release

PARTS = wp.constant(4)
STEP = wp.constant(0.25)
"""Parts of a step, and of its path up to a reversal: the shaft leaves its stop and meets the other within steps."""


@wp.func
def backlash_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """Between encoder and device there is play."""
    half_gap, rate = values[row, at], s.beta - s.gamma
    if half_gap > 0.0:
        gap = float(0.0)
        if s.begins == 0:
            gap = memory[line, slot]
        elif s.z != 0.0:
            gap = wp.sign(s.z) * half_gap
        elif s.qd != 0.0:  # a record that begins under way
            gap = wp.sign(s.qd) * half_gap
        ahead, same = wp.sign(s.path_2) * half_gap, s.begins == 0 and s.path_1 == 0.0 and s.path_2 != 0.0
        if same and s.z * s.path_2 >= 0.0 and wp.abs(gap - ahead) <= 1.0e-5 * half_gap:
            s.engaged = 1.0  # in contact all along, as in most steps
        elif same and s.z == 0.0 and wp.abs(gap + s.path_2) < half_gap:
            gap = gap + s.path_2  # through the gap all along
            s.path_2 = 0.0
            s.engaged = 0.0
        else:
            turn = float(0.0)  # share of the step before a reversal, at one acceleration
            if s.path_1 != 0.0:
                turn = wp.sqrt(wp.abs(s.path_1)) / (wp.sqrt(wp.abs(s.path_1)) + wp.sqrt(wp.abs(s.path_2)))
            z, first, second, pushed, part = float(s.z), float(0.0), float(0.0), float(0.0), float(0.0)
            for i in range(2 * PARTS):
                x = float(i % PARTS) / float(PARTS)
                if i < PARTS:
                    part, share = s.path_1 * (2.0 * (1.0 - x) - STEP) * STEP, turn
                else:
                    part, share = s.path_2 * STEP, 1.0 - turn
                    if turn > 0.0:
                        part = s.path_2 * (2.0 * x + STEP) * STEP
                if share > 0.0:
                    free = bouc_wen_release(z, rate, s.stiffness, s.viscosity, s.alpha, share * STEP * s.dt)
                    low = gap + part - half_gap
                    way = wp.clamp(free, low, low + 2.0 * half_gap)
                    pushed = wp.max(low - free, free - low - 2.0 * half_gap)
                    gap = wp.clamp(gap + part - way, -half_gap, half_gap)
                    z = bouc_wen_exact(way, z, s.beta, s.gamma, 1.0)
                    if i < PARTS:
                        first += way
                    else:
                        second += way
            # at the end of the step: all but within the first of its last part, so that it has a slope
            rounding = 1.0e-5 * half_gap
            s.engaged = wp.clamp((16.0 * pushed + rounding) / (wp.abs(part) + rounding), 0.0, 1.0)
            if s.begins == 1 and gap != 0.0:
                s.engaged = 1.0
            s.path_1 = first
            s.path_2 = second
        s.qd = s.engaged * s.qd
        s.qdd = s.engaged * s.qdd
        memory[line, slot] = gap
    return s


LAW = EffectLaw(
    name="backlash",
    title="backlash",
    sentence="Between encoder and device there is play.",
    equation="dead zone of half-gap b in series, torque of the device 0 in it",
    kind="mechanism",
    stage="shaft",
    parameters=(
        EffectParameter(
            name="half_gap",
            unit="rad",
            scale=(1, 0, 0),
            negative=False,
            low=lambda r: 1e-5 * r.q,
            high=lambda r: 0.45 * r.q,
            # 3 to 5 % too small at 200 Hz, for nobody sees the path between samples (benchmarks.confusion, bench)
            resolution=0.04,
            starts=lambda r: tuple(
                x * r.q for x in (4e-5, 1e-4, 3e-4, 7e-4, 0.0015, 0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2)
            ),
            sudden=True,
            tried_again=(1.0, 1.7, 2.8),
        ),
    ),
    law=backlash_law,
    states=1,
    source="dead zone of a coupling, Nordin and Gutman 2002, here on a device without mass",
    depends_on=("qd", "q", "memory"),
    remedy="preload the coupling",
    yields=True,
)
