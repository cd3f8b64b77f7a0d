"""What a log cannot tell, and the motion that would."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from mrwarp.diagnose.result import NextExperiment
from mrwarp.robot_logs.causes import TORQUE_SCALE, Parameter
from mrwarp.robot_logs.evidence import Evidence
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import RobotLog
from mrwarp.robot_logs.robot_verdict import NamedCause
from mrwarp.robot_logs.selection import Posterior

GROUND = ("trunk_mass", "trunk_com", "ground_friction", "ground_slope", "ground_stiffness", "imu_tilt", "gyro_bias")
"""Causes that speak through feet, ground or a moving trunk."""

ALIKE = f"up to some {200 * TORQUE_SCALE:.0f} % it would have looked like other masses of all links"
"""Why a robot in the air does not tell the torque of all its drives."""

MOTIONS = {
    "trunk_mass": "stand and squat on level ground, 20 s, with torque or enough droop of the joints to see the weight",
    "trunk_com": "stand and lean to all sides on level ground, 20 s",
    "link_mass": "swing the link slowly through its range with the trunk fixed, 20 s",
    "link_length": "stand on level ground in several heights, 20 s",
    "rotor_inertia": "move the joint to and fro at 3 to 8 Hz with the trunk fixed, 10 s",
    "coulomb_friction": "turn the joint slowly through its range and back, 10 s",
    "viscous_friction": "turn the joint at several speeds, 10 s",
    "stribeck": "turn the joint at 0.02 to 0.5 rad/s, 20 s",
    "motor_strength": "hold a known weight at a known arm, 5 s",
    "torque_limit": "ask the joint for more torque than it can give, 2 s",
    "kp": "hold a known weight at a known arm, then step the target by 0.1 rad, 10 s",
    "kd": "step the target by 0.1 rad, 10 s; a log of the measured torque tells it from friction",
    "command_delay": "step the targets by 0.1 rad at uneven times, 10 s",
    "velocity_lag": "move the joint at 3 to 8 Hz and log its velocity, 10 s",
    "encoder_offset": "stand on level ground in several heights, 20 s",
    "imu_tilt": "stand on a level floor, turn by half and stand again, 20 s",
    "gyro_bias": "stand still for 10 s",
    "ground_friction": "walk or push off so hard that a foot slips, 10 s",
    "ground_slope": "stand on the ground, turn by half and stand again, 20 s",
    "ground_stiffness": "land from small jumps, 10 s",
    "coil_dead": "walk with the devices switched on, 3 s",
    "coil_lag": "walk with the devices switched on, 10 s, coil current logged",
    "device_strength": "walk with the devices switched on, 10 s",
    "device_drag": "turn the joint slowly with the device and then without it, 10 s",
}
"""Motion that shows a cause."""

NOT_LOOKED_FOR = {
    "backlash": "a motor's encoder hardly shows play; reverse the joint on a bench under a load that changes sign",
    "hysteresis_law": "a walk hardly shows a device's memory; record the joint on a bench, where laws are compared",
}
"""Causes that no replay of a log tries, why, and what shows them."""


def cannot_know(
    evidence: Evidence, parameters: list[Parameter], model: ReplayModel, log: RobotLog, now: Posterior
) -> tuple[str, ...]:
    """Causes that no size of interest would have shown in this log, each with the motion to record."""
    unseen: dict[str, list[str]] = {}
    known: dict[str, int] = {}
    for k, p in enumerate(parameters):
        if p.cause not in MOTIONS or p.field == "limit":
            continue
        information = 1.0 / now.covariance[k, k] - now.precision[k, k]
        sure = information > 0.0 and 1.0 / np.sqrt(max(information, 1e-30)) < max(2.0 * p.fault, 2.0 * p.least)
        known[p.cause] = known.get(p.cause, 0) + int(sure)
        if not sure:
            unseen.setdefault(p.cause, []).append(p.where)
    found = []
    if not model.free:
        found += [f"{cause}: the robot's base was fixed; {MOTIONS[cause]}" for cause in GROUND]
        if "tau" not in evidence.sigma:
            found.append(f"motor_strength of robot: {ALIKE}; {MOTIONS['motor_strength']}")
    for cause, places in unseen.items():
        where = "" if not known[cause] or places == ["robot"] else f" of {', '.join(places)}"
        found.append(f"{cause}{where}: no size would have shown in this log; {MOTIONS[cause]}")
    for cause, why in NOT_LOOKED_FOR.items():
        if cause == "backlash" or model.devices:
            found.append(f"{cause}: not looked for in robot logs; {why}")
    limits = [p for p in parameters if p.field == "limit"]
    if above := [
        f"{p.where} beyond {model.asked[p.index]:.3g} N·m" for p in limits
        if model.asked[p.index] < (1.0 - p.fault) * _limit(model, p.index)
    ]:  # fmt: skip
        found.append(f"torque_limit of {', '.join(above)}: no more was asked for; {MOTIONS['torque_limit']}")
    if log.tau_is == "command":
        found.append("tau is the command: it says nothing of what the motors gave; log a measured torque or current")
    return tuple(found)


def _limit(model: ReplayModel, joint: int) -> float:
    """Largest torque that the description gives a joint [N·m]."""
    return float(model.model.actuator_forcerange[joint, 1]) if model.limited[joint] else np.inf


def next_experiment(causes: Sequence[NamedCause], unknown: Sequence[str]) -> NextExperiment | None:
    """The motion that tells the first cause from its alternatives, or shows the first of what cannot be known."""
    for cause in causes:
        rivals = [x.partition(" of ")[0] for x in cause.alternatives]
        if rivals:
            return _experiment(rivals[0], (cause.name, *rivals))
    for text in unknown:
        name = text.partition(":")[0].partition(" of ")[0]
        if name in MOTIONS:
            same = [x.partition(":")[0] for x in unknown if x.endswith(MOTIONS[name])]
            return _experiment(name, tuple(x.partition(" of ")[0] for x in same))
    return None


def _experiment(cause: str, separates: tuple[str, ...]) -> NextExperiment:
    what = MOTIONS[cause]
    seconds = re.findall(r"(\d+) s\b", what)
    return NextExperiment(what=what, seconds=float(seconds[0]) if seconds else 20.0, separates=separates, kind=cause)
