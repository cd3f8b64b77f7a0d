"""Torque channels that read wrong, and what drives add by themselves."""

from __future__ import annotations

import numpy as np

from mrwarp.robot_logs.causes.cause import Cause, Shown
from mrwarp.robot_logs.causes.places import Place

WEIGHED = Shown("swing the links slowly through their range", {"slow": 20.0})

SMOOTHED = 0.1
"""Time over which angles and torques are smoothed [s]: accelerations are second derivatives of encoders."""

STANDSTILL = 0.05
"""Speed within which dry friction changes its sign [rad/s]."""

LATE = 0.01
"""Time by which a speed may come after the change that it is of [s]: filters of drives delay by a few milliseconds."""

LEANS = 0.1
"""Angle by which an inertial sensor sits turned on its trunk and is mounted badly [rad]; beyond it axes are others."""

UNLIKE = 3.0
"""Factor by which a channel differs from a torque, either way, that is no gain of a sensor but another unit."""

EXPLAINED = 0.8
"""Share of a channel's variance that follows from a torque where its unit is judged."""

SPEAKS = 0.005
"""Variation of the links' torque, in what the drive can give, from which it says what a channel is: that of the least
friction that counts."""

LEAST_WEIGHT = 0.02
"""Share of a drive's torque below which gravity's torque at its joint does not count."""


def _read(at: Place) -> bool:
    return at.reads_torque


def _weighed(at: Place) -> bool:
    """Whether gravity loads the joint of a robot that is held."""
    return not at.model.free and at.weight > LEAST_WEIGHT * at.torque


def _says_compensation(share: float, _: str) -> str:
    return f"the drive adds {share:.2f} times the links' gravity torque to the log's command by itself"


def _says_gravity(share: float, _: str) -> str:
    return f"the torque channel {'lacks' if share < 0.0 else 'adds'} {abs(share):.2f} times the links' gravity torque"


CAUSES = (
    Cause(
        name="torque_channel_offset",
        title="the torque channel reads",
        field="tau_offset",
        place="joint",
        there=_read,
        number="torque",
        unit="N·m",
        step=lambda at: 0.01 * at.torque,
        spread=lambda at: 0.005 * at.torque,
        least=lambda at: 0.01 * at.torque,
        fault=lambda at: 0.1 * at.torque,
        reads=lambda torque, gravity: np.ones_like(torque),
        shown=WEIGHED,
        says=lambda value, _: f"the torque channel reads {value:+.3g} N·m (an offset)",
    ),
    Cause(
        name="torque_channel_gain",
        title="torque channel's gain",
        field="tau_gain",
        place="joint",
        there=_read,
        number="factor",
        unit="1",
        step=0.05,
        spread=0.02,
        least=0.06,
        fault=0.3,
        nominal=1.0,
        change="relative",
        lowest=-0.95,
        shared=True,
        reads=lambda torque, gravity: torque,
        shown=WEIGHED,
        says=lambda value, _: f"the torque channel reads {value:.2f} times the torque",
    ),
    Cause(
        name="torque_channel_gravity",
        title="torque channel's gravity",
        field="tau_gravity",
        place="joint",
        there=lambda at: _read(at) and _weighed(at),
        number="share",
        unit="1",
        step=0.1,
        spread=0.01,
        least=0.1,
        fault=1.0,
        shared=True,
        reads=lambda torque, gravity: gravity,
        shown=WEIGHED,
        says=_says_gravity,
    ),
    Cause(
        name="gravity_compensation",
        title="gravity compensation",
        field="gravity",
        place="joint",
        there=_weighed,
        number="share",
        unit="1",
        step=0.1,
        spread=0.01,
        least=0.1,
        fault=1.0,
        shared=True,
        setup=True,
        shown=WEIGHED,
        says=_says_compensation,
    ),
)
