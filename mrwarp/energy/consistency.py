"""The paper's powers against its state of charge, and the most that holding can save: closed forms, no simulation."""

from __future__ import annotations

import math
from typing import Any, Literal

from mrwarp import paper
from mrwarp.energy.power import NAME_PLATE

STANDING = paper.MISSION_POWER["go1"]["standby"] - paper.MISSION_POWER["mr_go"]["standby"]
"""Power that holding saves standing robots in the paper [W], section 6.5: Go1 on its motors, MR_Go on its devices."""

STANDING_MASS = paper.MASS["go1"] + paper.arm_load()
"""Mass that stood on motors there [kg]: Go1 with arm and item."""


def mission_energy(robot: str, speed: float) -> float:
    """Energy at the terminals [W·h] of the paper's mission powers, both ways at ``speed`` [m/s]."""
    times = {"outbound": paper.DISTANCE / speed, "standby": paper.STANDBY, "return": paper.DISTANCE / speed}
    return sum(paper.MISSION_POWER[robot][name] * time for name, time in times.items()) / 3600.0


def walking_speed(robot: str, energy: float) -> float:
    """Speed [m/s] at which the paper's powers use ``energy`` [W·h] over the mission; infinite if it is too little."""
    power = paper.MISSION_POWER[robot]
    walking = 3600.0 * energy - power["standby"] * paper.STANDBY
    return (power["outbound"] + power["return"]) * paper.DISTANCE / walking if walking > 0.0 else math.inf


def hidden_load(first: str, second: str, speed: float) -> float:
    """Constant power [W] not measured that makes the energy ratio the depletion ratio, at equal speed.

    ``(E2 + X T)/(E1 + X T) = r`` gives ``X = (r E1 - E2)/((1 - r) T)``.
    """
    ratio = paper.MISSION_DEPLETION[second][0] / paper.MISSION_DEPLETION[first][0]
    hours = (2.0 * paper.DISTANCE / speed + paper.STANDBY) / 3600.0
    return (ratio * mission_energy(first, speed) - mission_energy(second, speed)) / ((1.0 - ratio) * hours)


def gauge_exponent(first: str, second: str, speed: float) -> float:
    """Exponent p of a gauge ``depletion ~ energy^p`` that agrees with both robots [1]; 1 would be linear."""
    depletions = [paper.MISSION_DEPLETION[robot][0] for robot in (first, second)]
    energies = [mission_energy(robot, speed) for robot in (first, second)]
    return math.log(depletions[1] / depletions[0]) / math.log(energies[1] / energies[0])


def check(speeds: tuple[float, ...] = (0.3, 0.5)) -> dict[str, Any]:
    """The paper's power ratio of MR_Go-SAL and MR_Go against its state-of-charge ratio, by assumed speed [m/s]."""
    before, sd_before = paper.MISSION_DEPLETION["mr_go"]
    after, sd_after = paper.MISSION_DEPLETION["mr_go_sal"]
    walking = {robot: 0.5 * (power["outbound"] + power["return"]) for robot, power in paper.MISSION_POWER.items()}
    rows = []
    for speed in speeds:
        energy = {robot: mission_energy(robot, speed) for robot in paper.ROBOTS}
        ratio = energy["mr_go_sal"] / energy["mr_go"]
        expected = before * ratio
        rows.append(
            {
                "speed": speed,
                "energy": energy,
                "energy_ratio": ratio,
                "expected_depletion": expected,
                "deviation_in_sd": (after - expected) / math.hypot(sd_after, sd_before * ratio),
                "implied_capacity": {r: 100.0 * energy[r] / paper.MISSION_DEPLETION[r][0] for r in paper.ROBOTS},
                "reconciled_by": {
                    "sal_speed": walking_speed("mr_go_sal", energy["mr_go"] * after / before),
                    "hidden_load": hidden_load("mr_go", "mr_go_sal", speed),
                    "gauge_exponent": gauge_exponent("mr_go", "mr_go_sal", speed),
                },
            }
        )
    return {
        "walking_power_ratio": walking["mr_go_sal"] / walking["mr_go"],
        "depletion_ratio": after / before,
        "by_speed": rows,
        "speed_with_name_plate": {
            robot: walking_speed(robot, NAME_PLATE * paper.MISSION_DEPLETION[robot][0] / 100.0)
            for robot in paper.ROBOTS
        },
        "arm_load": paper.arm_load(),
        "proximal_rise": {robot: paper.proximal_rise(robot) for robot in paper.ROBOTS},
        "cot_reduction": {
            paper.condition_name(*cell): 1.0 - paper.TABLE_6["mr_go_sal", *cell].cot / paper.TABLE_6["mr_go", *cell].cot
            for cell in paper.TABLE_7
        },
    }


def holding_bound(share: float, mass: float, *, standing: float = STANDING, reference: float = STANDING_MASS) -> float:
    """Most that holding can save while trotting [W]: ``4 a S (m/m0)^2``.

    Standing, all four calves held save S, so S/4 each. A trot puts the weight on two legs: twice the force and torque,
    four times the copper loss. Held for a share a of the time, each leg saves at most ``a 4 S/4``. Torque grows with
    the mass, loss with its square.

    Args:
        share: Mean share of time a with the holding gate open [1].
        mass: Total mass m [kg].
        standing: Standing saving S [W]; the default is the paper's.
        reference: Mass m0 that stood on its motors [kg]; the default is the paper's.

    Validity: the whole copper loss of a held calf is saved, knee angles are those of the stance, hip and thigh do not
    change, and nothing is lost when the holding ends.
    """
    return 4.0 * share * standing * (mass / reference) ** 2


def paper_bounds(source: Literal["hardware", "simulation"]) -> list[dict[str, Any]]:
    """The bound by the paper's own activation, and its own saving, for each condition of table 7.

    ``source``: whose mean share of time with the holding gate open.
    """
    rows = []
    for (payload, command), shares in paper.TABLE_7.items():
        share = shares[source]
        off, on = (paper.TABLE_6[robot, payload, command] for robot in ("mr_go", "mr_go_sal"))
        bound = holding_bound(share, paper.MASS["mr_go"] + payload)
        rows.append(
            {
                "payload": payload, "command": command, "share": share, "bound": bound,
                "bound_relative": bound / off.power, "paper_saving": off.power - on.power,
                "paper_saving_relative": 1.0 - on.power / off.power,
            }
        )  # fmt: skip
    return rows
