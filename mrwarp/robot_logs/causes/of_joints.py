"""Friction, inertia and encoders of joints."""

from __future__ import annotations

import numpy as np

from mrwarp.robot_logs.causes.cause import NUISANCE, Cause, Shown
from mrwarp.robot_logs.causes.edits import UsdEdit
from mrwarp.robot_logs.causes.places import Place

LARGEST_ROTOR = 10.0
"""Largest inertia of a rotor, in those that its joint moves: light wrists of arms with high gears come near."""

UNKNOWN_LATENCY = 0.002
"""Time from a drive's reading to its torque that no log distinguishes from a rotor's inertia, Kd times as large [s]."""


def _least_rotor(at: Place) -> float:
    return max(0.05 * at.inertia, UNKNOWN_LATENCY * float(np.nan_to_num(at.log.kd[at.index])))


def _usd_rotor(edit: UsdEdit, j: int, x: float) -> None:
    robot = edit.robot
    armature = max(float(robot.model.dof_armature[robot.v_adr[j]]) + x, 1e-5)
    edit.joint(j).GetAttribute("newton:armature").Set(armature)


CAUSES = (
    Cause(
        name="coulomb_friction",
        title="Coulomb friction",
        field="friction",
        place="joint",
        number="torque",
        unit="N·m",
        mechanical=True,
        step=lambda at: 0.01 * at.torque,
        spread=lambda at: 0.02 * at.torque,
        least=lambda at: 0.005 * at.torque,
        fault=lambda at: 0.05 * at.torque,
        lowest=lambda at: -float(at.model.model.dof_frictionloss[at.dof]),
        possible=lambda at: at.torque,  # with more the motor could not turn it
        ordinary=True,
        looks_like="device_drag",
        shown=Shown("turn the joint slowly through its range and back", {"slow": 10.0}),
        mjcf=lambda edit, j, x: edit.add_to_joint(j, "frictionloss", x),
        rubs="frictionloss",
    ),
    Cause(
        name="viscous_friction",
        title="viscous friction",
        field="damping",
        place="joint",
        number="coefficient",
        unit="N·m·s/rad",
        mechanical=True,
        step=lambda at: 0.002 * at.torque / at.turn,
        spread=lambda at: 0.006 * at.torque / at.turn,
        least=lambda at: 0.002 * at.torque / at.turn,
        fault=lambda at: 0.02 * at.torque / at.turn,
        lowest=lambda at: -float(at.model.model.dof_damping[at.dof]),
        possible=lambda at: at.torque / at.top_speed,
        ordinary=True,
        shown=Shown("turn the joint at several speeds", {"chirp": 15.0}),
        mjcf=lambda edit, j, x: edit.add_to_joint(j, "damping", x),
        rubs="damping",
    ),
    Cause(
        name="rotor_inertia",
        title="rotor inertia",
        field="armature",
        place="joint",
        number="inertia",
        unit="kg·m²",
        mechanical=True,
        step=lambda at: 0.05 * at.inertia,
        spread=lambda at: 0.5 * at.inertia,
        least=_least_rotor,
        fault=lambda at: 2.0 * at.inertia,
        lowest=lambda at: -0.9 * float(at.model.model.dof_armature[at.dof]),
        possible=lambda at: LARGEST_ROTOR * at.inertia,
        ordinary=True,
        central=True,
        shown=Shown("move the joint to and fro at 3 to 8 Hz with the trunk fixed", {"chirp": 15.0}),
        shown_by_arm=Shown("move the joint to and fro at 3 to 8 Hz", {"chirp": 15.0}),
        mjcf=lambda edit, j, x: edit.add_to_joint(j, "armature", x),
        usd=_usd_rotor,
    ),
    Cause(
        name="stribeck",
        title="Stribeck friction",
        field="stribeck",
        place="joint",
        number="torque",
        unit="N·m",
        mechanical=True,
        step=lambda at: 0.01 * at.torque,
        spread=lambda at: 0.004 * at.torque,
        least=lambda at: 0.01 * at.torque,
        fault=lambda at: 0.03 * at.torque,
        lowest=0.0,
        possible=lambda at: at.torque,
        shared=True,
        shown=Shown("turn the joint at 0.02 to 0.5 rad/s", {"slow": 20.0}),
    ),
    Cause(
        name="encoder_offset",
        title="encoder offset",
        field="offset",
        place="joint",
        number="angle",
        unit="rad",
        step=lambda at: 0.005 * at.turn,
        spread=lambda at: 0.004 * at.turn,
        least=lambda at: 0.010 * at.turn,
        fault=lambda at: 0.05 * at.turn,
        tried=(-1.0, -0.4, 0.4, 1.0),  # it lifts an edge of a sole: derivatives end there
        shown=Shown("walk on level ground", {"walk": 20.0}),
        shown_by_arm=Shown("turn the joint slowly to a stop of known angle and back", {"slow": 10.0}),
    ),
    Cause(  # where a joint settles in a session
        name=NUISANCE,
        title="where the joint settles",
        field="shift",
        place="joint",
        there=lambda at: at.log.kp[at.index] > 0.0,
        number="angle",
        unit="rad",
        step=lambda at: 0.004 * at.turn,
        spread=lambda at: 0.005 * at.turn,
    ),
)
