"""Motions that a log does not have: of links on elastic drives, and of a base that gives way."""

from __future__ import annotations

import functools

from mrwarp.robot_logs.causes.cause import Cause, Shown
from mrwarp.robot_logs.causes.places import Place

SMOOTHED = 0.03
"""Time over which angles and torques are smoothed [s]: faster oscillations do not pass."""

LOWEST, HIGHEST, STEPS = 2.0, 12.0, 24
"""Natural frequencies that are tried [Hz], and how many: of faster oscillators delays are much as they are."""

DAMPING = 0.2
"""Damping ratio of the oscillators: with less, their phase would follow from the frequency more closely than a link's
inertia, which changes with the pose, lets it."""

SHARED = 2
"""Joints of which the most is explained, by which a base is judged: it moves all of them, but few show it."""

RIGHT = (0.4, 1.6)
"""Sizes of an elastic drive's torque, in what follows from its frequency, with which it is one."""


def _frequency(at: Place) -> float:
    return at.model.hidden.frequency if at.model.hidden else 0.0


def _others(at: Place) -> tuple[str, ...]:
    """Other hidden motions that explain much of it, too."""
    rivals = at.model.hidden.rivals if at.model.hidden else ()
    return tuple(f"series_elasticity of {at.model.joints[j]}" if j >= 0 else "base_compliance of robot" for j in rivals)


_oscillator = functools.partial(
    Cause,
    number="frequency",
    unit="Hz",
    step=0.1,
    spread=0.02,
    least=0.4,
    fault=1.0,
    lowest=0.0,
    nominal=_frequency,
    change="compliance",
    others=_others,
    sought="it is looked for in logs of a robot that is held, with targets",
)
"""A size of 1 is an oscillator of the frequency that was found."""

CAUSES = (
    _oscillator(
        name="series_elasticity",
        title="series elasticity",
        field="elastic",
        place="joint",
        there=lambda at: at.model.hidden is not None and at.model.hidden.joint == at.index,
        shown=Shown("move the joint to and fro at 3 to 8 Hz", {"chirp": 15.0}),
        says=lambda value, _: f"an elastic drive: link and motor move against each other at {value:.1f} Hz",
    ),
    _oscillator(
        name="base_compliance",
        title="base compliance",
        field="rocking",
        place="robot",
        there=lambda at: at.model.hidden is not None and at.model.hidden.joint < 0,
        shown=Shown("move the joints to and fro at 3 to 8 Hz", {"chirp": 15.0}),
        says=lambda value, _: f"the base gives way: the robot rocks on it at {value:.1f} Hz",
    ),
)
