"""Delays and clocks."""

from __future__ import annotations

from mrwarp.robot_logs.causes.cause import NUISANCE, Cause, Shown
from mrwarp.robot_logs.causes.places import Place

OWN_DELAY = 0.0005
"""Time after its row at which a command acts on any robot, half a cycle of a bus at 1 kHz, give or take as much [s]: it
is simulated, but is no part of a fault's size."""


def _senses(at: Place) -> bool:
    """Whether an inertial unit moves with the trunk, and was logged."""
    return at.model.free and any("quat" in run.base or "gyro" in run.base for run in at.log.runs)


CAUSES = (
    Cause(
        name="command_delay",
        title="command delay",
        field="delay",
        place="commands",
        number="delay",
        unit="s",
        step=0.0005,  # coils without lag read what a row commands until its last moment
        # when in a row a command began to act no log says: up to the next row it is no delay of the robot
        spread=lambda at: 0.0007 + at.row,
        least=0.0015,
        fault=0.02,
        usual=lambda at: (0.0, at.row + OWN_DELAY),
        ordinary=True,
        of_session=lambda at: at.model.free,  # coils show it; in the air inertias and gains would be traded for it
        own=OWN_DELAY,
        rivals=("command_lag", "torque_lag"),
        # none acts before it was given: then the commands' stamps are late
        if_negative=("clock_shift", "commands", "shift"),
        uneven=True,
        shown=Shown("step the targets by 0.1 rad at uneven times", {"steps": 10.0}),
        says=lambda value, _: f"commands act {1e3 * value:.1f} ms late",
        remark=lambda value, usual: (
            f"commands act {1e3 * abs(value):.1f} ms {'after' if value > 0.0 else 'before'} their row: "
            + ("more than" if abs(value) > usual[1] else "up to")
            + f" {1e3 * usual[1]:.1f} ms, a row and a controller's own delay, "
            + ("is not how a log is written" if abs(value) > usual[1] else "that is how the log was written")
        ),
    ),
    Cause(
        name="command_lag",
        title="command lag",
        field="command_lag",
        place="joint",
        there=lambda at: at.commanded,
        number="time_constant",
        unit="s",
        step=0.003,
        spread=0.001,
        least=0.003,
        fault=0.01,
        lowest=0.0,
        shared=True,
        unsure=lambda at: OWN_DELAY + 0.5 * at.row,  # when in a row its command begins to act
        rivals=("torque_lag", "command_delay"),
        shown=Shown("move the joint to and fro at 3 to 8 Hz", {"chirp": 15.0}),
        says=lambda value, _: f"commands act through a first-order lag of {1e3 * value:.1f} ms",
    ),
    Cause(  # time from a drive's reading to its torque
        name=NUISANCE,
        title="latency",
        field="latency",
        place="commands",
        number="latency",
        unit="s",
        step=0.001,
        spread=0.0015,
        lowest=0.0,
    ),
    Cause(
        name="clock_shift",
        title="clock shift",
        field="clock",
        place="imu",
        there=_senses,
        number="shift",
        unit="s",
        step=0.003,
        spread=0.001,
        least=0.002,
        fault=0.01,
    ),
)
