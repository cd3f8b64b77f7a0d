"""The paper's figures against each other: closed forms and a model of one degree of freedom, no simulated robot.

Each check returns its arithmetic in words.

A body of mass m moves on legs whose feet stay below the hips, so that a knee's torque tau carries the
vertical force tau/r with the lever r = dz/dq of :func:`lever`. Two legs stand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mrwarp import paper
from mrwarp.energy import consistency
from mrwarp.params import BoucWenParams, HoldParams
from mrwarp.usd.robot import GAIT_FREQUENCY, STAND_HEIGHT
from paper.reproduce.disturbance import two_knees

SPEED = 3.0
"""Speed of a pressed calf [rad/s] at which device torques are compared; the pushes of table 4 reach 3 to 4."""

BENT = -2.0
"""Angle of such a calf [rad], between -1.5 in stance and -2.2 at the paper's lowest."""

CURRENTS = (0.5, 1.0, 1.5)
"""Currents of table 4 above 0 [A]."""

STRAIGHTEST = -0.888
"""Angle of a calf at the end of its range [rad], public Go1 description."""

OUT_OF_REACH = (0.8, 1.0)
"""Commands that section 7 puts beyond the leg's workspace at 1.5 Hz [m/s]."""


@dataclass(frozen=True, kw_only=True)
class Check:
    """One comparison of the paper with itself."""

    title: str
    arithmetic: str
    figures: dict[str, float]
    """The numbers behind it."""


def lever(high: float, low: float) -> float:
    """Mean lever of a knee [m] between two heights of the hip [m]: way of the hip over the knee's angle."""
    angles = [2.0 * math.acos((height - two_knees.SOLE) / (2.0 * two_knees.LINK)) for height in (high, low)]
    return (high - low) / (angles[1] - angles[0])


def gain(current: float, speed: float = SPEED) -> float:
    """Sliding torque that the current adds in eq. 14 [N·m], with z at its bound.

    ``K1 I z/(1 + alpha |qd|)``; ``speed`` [rad/s].
    """
    law = BoucWenParams()
    return law.K1 * current * law.z_bound / (1.0 + law.alpha * speed)


def plastic_impact() -> float:
    """Speed of robot and mass together after a plastic impact [m/s]."""
    mass = paper.IMPACTOR["mass"]
    return mass * paper.IMPACTOR["speed"] / (mass + paper.MASS["mr_go"])


def undamped_speed(drop: float, *, force: float = paper.PUSH_FORCE, mass: float = paper.MASS["mr_go"]) -> float:
    """Peak speed [m/s] of a mass on a linear spring that a lasting force presses down by ``drop`` [m] without damping.

    With ``drop = 2F/k`` and ``v = F/sqrt(k m)`` it is ``sqrt(F*drop/(2m))``; any damping lowers it at the same drop.
    """
    return math.sqrt(force * drop / (2.0 * mass))


def required_torque() -> dict[float, tuple[float, float]]:
    """Torque per stance calf [N·m] that the simulated rows of table 4 ask of the device beyond 0 A, by current [A].

    The push F on a spring k that it presses down by ``d0 = 2F/k`` at 0 A; a friction f, constant while the body falls,
    leaves ``d = 2(F - f)/k`` and ``v = (F - f)/sqrt(k m)``, so ``f = F(1 - d/d0)`` and ``f = F(1 - v/v0)``: the first
    figure is from the drop, the second from the peak speed. A knee carries f over the legs that stand times
    :func:`lever`.
    """
    rows, start = paper.TABLE_4["simulation"], paper.TABLE_2["D"]["height"].mean
    arm = lever(start, rows[0.0]["min_height"].mean) / two_knees.LEGS
    found = {}
    for amps in CURRENTS:
        drops = [start - rows[a]["min_height"].mean for a in (amps, 0.0)]
        speeds = [rows[a]["peak_down_velocity"].mean for a in (amps, 0.0)]
        found[amps] = tuple(arm * paper.PUSH_FORCE * (1.0 - now / before) for now, before in (drops, speeds))
    return found


def _capacity() -> Check:
    eq18 = HoldParams().yield_torque(1.5)
    return Check(
        title="Holding capacity at 1.5 A.",
        arithmetic=(
            f"Section 2.2 says {paper.HOLDING_CAPACITY} N·m; eq. 18 with its own T_max, K, n gives {eq18:.2f} N·m."
        ),
        figures={"eq18": eq18},
    )


def _momentum() -> Check:
    after, rows = plastic_impact(), paper.TABLE_4["hardware"]
    mass = paper.IMPACTOR["mass"] + paper.MASS["mr_go"]
    still, damped = (-rows[amps]["peak_down_velocity"].mean for amps in (0.0, 1.5))
    force = mass * (after - damped) / paper.IMPACTOR["window"]
    arm = lever(paper.TABLE_2["D"]["height"].mean, rows[1.5]["min_height"].mean)
    wanted, most = force * arm / two_knees.LEGS, gain(1.5, 0.0)
    return Check(
        title="Table 4, hardware: momentum.",
        arithmetic=(
            f"After a plastic impact {paper.IMPACTOR['mass']:g} kg at {paper.IMPACTOR['speed']:g} m/s and "
            f"{paper.MASS['mr_go']:g} kg move at {after:.3f} m/s, which is the row of 0 A ({still:.3f}): there nothing "
            f"brakes. For the {damped:.3f} m/s at 1.5 A the legs have to take {wanted:.1f} N·m per stance calf. Eq. "
            f"14 adds {gain(1.5):.2f} N·m at {SPEED:g} rad/s, and {most:.2f} N·m at most, at standstill."
        ),
        figures={"after": after, "wanted": wanted, "most": most},
    )


def _acceleration() -> Check:
    window, rows = paper.IMPACTOR["window"], paper.TABLE_4["hardware"]
    texts, figures = [], {}
    for name, amps in (("C", 0.0), ("D", 1.5)):
        allowed = paper.TABLE_5[name]["acceleration"].mean * window
        peak = -rows[amps]["peak_down_velocity"].mean
        texts.append(
            f"Row {name}'s {paper.TABLE_5[name]['acceleration'].mean:.3f} m/s² allow {allowed:.3f} m/s, compared with "
            f"table 4's {peak:.3f} m/s at {amps:g} A"
        )
        figures[name] = allowed
    return Check(
        title="Table 5 against table 4.",
        arithmetic=(
            f"A mean |a_z − g| over {window:g} s changes the speed by its product with the time at most. "
            f"{'. '.join(texts)}."
        ),
        figures=figures,
    )


def _spring() -> Check:
    row = paper.TABLE_4["simulation"][0.0]
    drop = paper.TABLE_2["D"]["height"].mean - row["min_height"].mean
    bound = undamped_speed(drop)
    half = two_knees.half_period()
    return Check(
        title="Table 4, simulation: the row of 0 A.",
        arithmetic=(
            f"A lasting {paper.PUSH_FORCE:g} N that presses {paper.MASS['mr_go']:g} kg down by {drop:.3f} m reaches "
            f"{bound:.3f} m/s on an undamped spring; the row has {-row['peak_down_velocity'].mean:.3f} m/s. So motors "
            f"and drag hardly damp, and the push lasts half a period, {half:.2f} s, or longer."
        ),
        figures={"bound": bound, "half_period": half},
    )


def _required() -> Check:
    found = required_torque()
    by_drop, by_speed = zip(*found.values(), strict=True)
    have = [gain(amps) for amps in CURRENTS]

    def many(values: tuple[float, ...] | list[float]) -> str:
        return ", ".join(f"{value:.2f}" for value in values)

    left = [needed - added for needed, added in zip(by_drop, have, strict=True)]
    whole = [two_knees.torque(amps, BENT, -SPEED, -BoucWenParams().z_bound, raw=True) for amps in CURRENTS]
    knees = two_knees.by_zero_row(raw=True, drag=False)
    best = two_knees.changes(knees, CURRENTS)
    rows = paper.TABLE_4["simulation"]

    def papers(cell: str) -> str:
        return ", ".join(f"{100.0 * (rows[a][cell].mean / rows[0.0][cell].mean - 1.0):+.1f}" for a in CURRENTS)

    def ours(changes: list[tuple[float, float, float]], k: int) -> str:
        return ", ".join(f"{change[k]:+.1f}" for change in changes)

    return Check(
        title="Table 4, simulation: the torque that it requires.",
        arithmetic=(
            "With that spring the rows ask for a friction beyond that of 0 A. Per stance calf it is, at 0.5, 1 and "
            f"1.5 A, {many(by_drop)} N·m by the drops and {many(by_speed)} N·m by the speeds. K1·I of eq. 14 adds "
            f"{many(have)} N·m at {SPEED:g} rad/s. Missing is a constant of {many(left)} N·m, absent at 0 A. Eq. 14 as "
            f"a whole gives {many(whole)} N·m, if its q_c is the calf's angle itself ({BENT:g} rad).\n\n"
            "A model of one degree of freedom has that torque, and none at 0 A: 12.6 kg on two knees with Kp "
            f"{knees.kp:g}. Kd {knees.kd:.2f} and a push of {knees.duration:.2f} s follow from the row of 0 A alone. "
            f"It changes the minimum height by {ours(best, 0)} % (paper {papers('min_height')}), the peak speed by "
            f"{ours(best, 1)} % ({papers('peak_down_velocity')}). But section 4.2 says "
            "that the drag stays at 0 A: either the rows were simulated without it, or the paper contradicts itself."
        ),
        figures={
            "drop": by_drop[2], "speed": by_speed[2], "eq14": have[2], "least_left": min(left), "most_left": max(left),
            "whole": whole[2], "height": best[2][0], "torque": best[2][2],
        },
    )  # fmt: skip


def _figures_6_and_7() -> Check:
    one, many = paper.FIGURE_6_HARDWARE["FR"], paper.FIGURE_7["FR"]
    relief = [many[0.0].mean - many[1.5].mean, paper.FIGURE_7["RL"][0.0].mean - paper.FIGURE_7["RL"][1.5].mean]
    return Check(
        title="Figures 6(c) and 7.",
        arithmetic=(
            f"The same leg under the same impact: {one[0.0]:.2f} N·m (FR, 0 A) in the representative trial, "
            f"{many[0.0].mean:.2f} ± {many[0.0].sd:.2f} N·m over ten. "
            f"In figure 7 the motors lose {relief[0]:.1f} and {relief[1]:.1f} N·m, more than the "
            f"{gain(1.5, 0.0):.1f} N·m that eq. 14 can add at any speed."
        ),
        figures={"FR": relief[0], "RL": relief[1]},
    )


def _bias() -> Check:
    rest = {
        name: math.sqrt(row["v_x_rmse"].mean ** 2 - row["v_x_bias"].mean ** 2) for name, row in paper.TABLE_2.items()
    }
    return Check(
        title="Table 2: bias and oscillation.",
        arithmetic=(
            "RMSE² − bias² leaves the speed's own fluctuation: "
            + ", ".join(f"{name} {value:.3f}" for name, value in rest.items())
            + " m/s. With SAL on (B, D) training takes the bias away and the fluctuation grows: all gain is bias."
        ),
        figures=rest,
    )


def _two_tables() -> Check:
    two, three = paper.TABLE_2["D"]["v_x_rmse"], paper.TABLE_3["pg_rlstm"]["v_x_rmse"]
    distance = abs(two.mean - three.mean) / math.hypot(two.sd or 0.0, three.sd or 0.0)
    return Check(
        title="Tables 2 and 3.",
        arithmetic=(
            f"Row D and the row of PG-RLSTM are the same training, SAL on, at 0.5 m/s, with {two.mean:.4f} ± "
            f"{two.sd:.4f} and {three.mean:.4f} ± {three.sd:.4f} m/s: {distance:.1f} joint SD between them. "
            "So differences of that size in table 3 say nothing."
        ),
        figures={"distance": distance},
    )


def _claims_of_table6() -> Check:
    cells = list(paper.TABLE_7)
    held = {cell: paper.TABLE_7[cell]["hardware"] for cell in cells}
    saved = {cell: 1.0 - paper.TABLE_6["mr_go_sal", *cell].cot / paper.TABLE_6["mr_go", *cell].cot for cell in cells}
    order = sorted(cells, key=lambda cell: -held[cell])
    pairs = ", ".join(f"{100.0 * held[c]:.1f} % held saves {100.0 * saved[c]:.1f} %" for c in order)
    bounds = [row["bound_relative"] for row in consistency.paper_bounds("hardware")]
    return Check(
        title="Table 6: its two claims.",
        arithmetic=(
            f"'Longer activation gives a larger reduction' (section 6.4) does not order the four: {pairs}. What "
            "holding [can save at most](energy.md#what-the-numbers-of-holding-change), by the paper's standing saving "
            f"of {consistency.STANDING:.1f} W, is {', '.join(f'{100.0 * bound:.0f}' for bound in bounds)} % in the "
            "table's order."
        ),
        figures={"least": min(bounds), "most": max(bounds)},
    )


def _charge() -> Check:
    found = consistency.check()
    first = found["by_speed"][0]
    by = first["reconciled_by"]
    return Check(
        title="Figure 10: power and charge.",
        arithmetic=(
            f"MR_Go-SAL walks on {found['walking_power_ratio']:.3f} of MR_Go's power but depletes "
            f"{found['depletion_ratio']:.3f} of its charge. At equal speeds of {first['speed']:g} m/s "
            f"{first['expected_depletion']:.1f} points were to be expected instead of "
            f"{paper.MISSION_DEPLETION['mr_go_sal'][0]} ± {paper.MISSION_DEPLETION['mr_go_sal'][1]} "
            f"({first['deviation_in_sd']:.1f} SD). A walk of MR_Go-SAL at {by['sal_speed']:.2f} m/s would reconcile "
            f"them, or {by['hidden_load']:.0f} W past the meter."
        ),
        figures={"energy_ratio": first["energy_ratio"], "expected": first["expected_depletion"]},
    )


def _proximal() -> Check:
    rise = {robot: paper.proximal_rise(robot) for robot in paper.ROBOTS}
    return Check(
        title="Figure 11: hips and thighs.",
        arithmetic=(
            f"The means over calves and over all motors leave {', '.join(f'{value:.1f}' for value in rise.values())} K "
            "for hips and thighs of Go1, MR_Go and MR_Go-SAL: with SAL they warm more, which figure 8 does not say."
        ),
        figures=rise,
    )


def _stride() -> Check:
    hip = STAND_HEIGHT - two_knees.SOLE
    longest = 2.0 * two_knees.LINK * math.cos(0.5 * STRAIGHTEST)
    reach = 2.0 * math.sqrt(longest**2 - hip**2)
    asked = [0.5 * speed / GAIT_FREQUENCY for speed in OUT_OF_REACH]
    return Check(
        title="Section 7: stride lengths.",
        arithmetic=(
            f"Section 7 puts {OUT_OF_REACH[0]:g} and {OUT_OF_REACH[1]:g} m/s beyond the workspace: {asked[0]:.2f} and "
            f"{asked[1]:.2f} m in half a stride of {GAIT_FREQUENCY:g} Hz. A leg of the public description whose hip "
            f"stays {hip:.2f} m above its foot reaches {reach:.2f} m, so geometry alone does not end the gait."
        ),
        figures={"reach": reach, "slow": asked[0], "fast": asked[1]},
    )


def all_checks() -> list[Check]:
    """Every check, in the paper's order."""
    checks = (
        *(_capacity, _bias, _two_tables, _momentum, _spring, _required, _figures_6_and_7),
        *(_acceleration, _claims_of_table6, _charge, _proximal, _stride),
    )
    return [check() for check in checks]
