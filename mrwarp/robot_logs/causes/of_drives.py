"""Gains, torque and readings of drives."""

from __future__ import annotations

import functools

import numpy as np

from mrwarp.robot_logs.causes.cause import Cause, Replayed, Shown
from mrwarp.robot_logs.causes.edits import UsdEdit
from mrwarp.robot_logs.causes.of_timing import OWN_DELAY

WALK = Shown("bear the trunk's weight in a walk", {"walk": 20.0})


def _limited(replay: Replayed, change: np.ndarray) -> None:
    """Range of each drive's torque: a lower limit counts from the most that was asked for."""
    described = replay.robot.model.actuator_forcerange
    own = np.where(change < 0.0, replay.robot.asked * (1.0 + change), np.inf)
    limits = np.maximum(described[:, 0], -own), np.minimum(described[:, 1], own)
    replay.model("actuator_forcerange")[:] = np.stack(limits, axis=-1)


def _usd_limit(edit: UsdEdit, j: int, x: float) -> None:
    edit.scale_drive(j, ("maxEffort", "tau_limit"), 1.0 + x, float(edit.robot.asked[j]))


STRENGTH = ("kp", "kp_base", "kp_low", "kd", "maxEffort", "tau_limit")
"""Numbers of a USD file's drive that a stronger motor multiplies."""

_gain = functools.partial(
    Cause,
    place="joint",
    step=0.05,
    spread=0.02,
    lowest=-0.95,
    change="relative",
    shared=True,
    central=True,
)
"""A factor on a drive's torque or on a part of it."""

CAUSES = (
    _gain(
        name="kp",
        title="kp",
        field="kp",
        there=lambda at: at.log.kp[at.index] > 0.0,
        number="gain",
        unit="N·m/rad",
        least=0.04,
        fault=0.3,
        nominal=lambda at: at.log.kp[at.index],
        nearly="motor_strength",
        shown=WALK,
        shown_by_arm=Shown("step the targets by 0.1 rad at uneven times", {"steps": 10.0}),
        usd=lambda edit, j, x: edit.scale_drive(j, ("kp", "kp_base"), 1.0 + x),
    ),
    _gain(
        name="kd",
        title="kd",
        field="kd",
        there=lambda at: at.log.kd[at.index] > 0.0,
        number="gain",
        unit="N·m·s/rad",
        least=0.05,
        fault=0.5,
        nominal=lambda at: at.log.kd[at.index],
        shown=Shown("step the target by 0.1 rad, with the measured torque in the log", {"steps": 10.0}),
        usd=lambda edit, j, x: edit.scale_drive(j, ("kd",), 1.0 + x),
    ),
    Cause(
        name="velocity_lag",
        title="velocity lag",
        field="lag",
        place="joint",
        there=lambda at: at.log.kd[at.index] > 0.0,
        number="time_constant",
        unit="s",
        step=0.002,
        spread=0.001,
        least=0.003,
        fault=0.006,
        lowest=0.0,
        shared=True,
        shown=Shown("move the joint at 3 to 8 Hz and log its velocity", {"chirp": 15.0}),
    ),
    Cause(
        name="torque_lag",
        title="torque lag",
        field="torque_lag",
        place="joint",
        number="time_constant",
        unit="s",
        step=0.003,
        spread=0.001,
        least=0.003,
        fault=0.01,
        lowest=0.0,
        shared=True,
        unsure=lambda at: OWN_DELAY + 0.5 * at.row,
        rivals=("command_lag", "command_delay"),
        shown=Shown("move the joint to and fro at 3 to 8 Hz", {"chirp": 15.0}),
        says=lambda value, _: f"the drive's torque follows with a lag of {1e3 * value:.1f} ms",
    ),
    _gain(
        name="motor_strength",
        title="motor strength",
        field="strength",
        number="factor",
        unit="1",
        least=0.04,
        fault=0.2,
        nominal=1.0,
        made_of=("kp", "kd"),
        nearly="kp",
        shown=WALK,
        shown_by_arm=Shown("swing the links slowly with a known weight at the end", {"slow": 20.0}),
        usd=lambda edit, j, x: edit.scale_drive(j, STRENGTH, 1.0 + x),
    ),
    Cause(
        name="torque_limit",
        title="torque limit",
        field="limit",
        place="joint",
        number="torque",
        unit="N·m",
        step=-0.1,
        spread=0.02,
        least=0.05,
        fault=0.3,
        nominal=lambda at: at.model.asked[at.index],
        highest=0.0,
        change="relative",
        shared=True,
        limits=True,
        uneven=True,
        sudden=True,
        shown=Shown("ask the joint for more torque than it can give, as a walk may", {"walk": 20.0}),
        shown_by_arm=Shown("step the targets so far that the joint cannot give the torque", {"steps": 10.0}),
        acts=_limited,
        usd=_usd_limit,
    ),
)
