"""Declaration of a robot's cause: sizes at each place, look-alikes, the motion that shows it, files that have it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from mrwarp.robot_logs.causes.edits import MjcfEdit, UsdEdit
from mrwarp.robot_logs.causes.places import Kind, Place
from mrwarp.robot_logs.replay_model import ReplayModel

Number = float | Callable[[Place], float]
"""A number, or how it follows from the place."""

NUISANCE = "nuisance"
"""Name of what a healthy robot has and is never a cause: fitted next to any cause."""


class Shown(NamedTuple):
    """A motion that shows a cause."""

    how: str
    """In words."""
    record: dict[str, float]
    """The motion for ``mrwarp log record``: its motions and how long each lasts [s]."""

    @property
    def seconds(self) -> float:
        """How long it lasts."""
        return sum(self.record.values())

    @property
    def what(self) -> str:
        """In words, with its length."""
        return f"{self.how}, {self.seconds:.0f} s"


@dataclass(frozen=True, kw_only=True)
class Replayed:
    """Robots of a replay before they run; arrays have one row by robot."""

    robot: ReplayModel
    model: Callable[[str], np.ndarray]
    """A field of MuJoCo's model, shape (E, ...): write all of what a cause changes, for rows outlast a replay."""
    state: Callable[[str], np.ndarray]
    """A field of its state, shape (E, ...): what acts from outside is zero before."""


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A number of a robot that may be wrong, at each of its places."""

    name: str
    title: str
    """In words, as a verdict has it."""
    field: str
    """Array of a :class:`~mrwarp.robot_logs.window_replay.ParameterBatch` that its change is added to."""
    place: Kind
    there: Callable[[Place], bool] = lambda _: True
    """Whether a robot and its log can have it at a place."""

    number: str = ""
    """Name of its number in a result; at a place with axes that of the axis."""
    unit: str
    step: Number
    """Change by which the replay's derivative is taken."""
    spread: Number
    """Standard deviation that a healthy robot has about its description; large for ``ordinary`` causes."""
    least: Number = np.inf
    """Smallest size that counts as a fault."""
    fault: Number = 0.0
    """Standard deviation of faults."""
    lowest: Number = -np.inf
    """Least change that a robot can have: friction and inertia do not turn negative."""
    highest: Number = np.inf
    """Largest change: a limit that was never reached may lie anywhere above."""
    possible: Number = np.inf
    """Largest size, either way, that a body there can have."""
    usual: Callable[[Place], tuple[float, float]] = lambda _: (0.0, 0.0)
    """Sizes that healthy robots have, lowest and highest."""
    nominal: Number = 0.0
    """Value that a change adds to."""
    change: Literal["added", "relative", "inverse", "compliance"] = "added"
    """How it makes a value: as it is; times ``nominal``, that and one; ``nominal`` over one and it; or, of how far a
    spring gives, its natural frequency: ``nominal`` over the root of it."""
    least_share: float = 0.05
    """Of a relative change the least share of ``nominal`` that is left."""

    ordinary: bool = False
    """Whether descriptions rarely know it: fitted in every case, and named where the log excludes the description."""
    of_session: Callable[[Place], bool] = lambda _: False
    """Whether every session has its own: then it is fitted next to any cause, though it may be one beyond ``usual``."""
    outside: str = ""
    """Of an effect outside the catalogue of what a verdict names the words before its place: it is tried, for else it
    would be blamed on a cause, and reported as unexplained."""
    mechanical: bool = False
    """Whether it is a mass, an inertia or a friction: of all these and all torques one factor changes no motion."""
    setup: bool = False
    """Whether it is how drives are set up and no fault: a log's commands need not have it."""
    reads: Callable[[np.ndarray, np.ndarray], np.ndarray] | None = None
    """Of a cause that acts on readings of the torque channel alone: what one unit of it adds to them, from the drive's
    torque and that of gravity; all of the same shape."""
    shared: bool = False
    """Whether all joints may have it at once, by one number of a configuration, one supply, one make of drive."""
    made_of: tuple[str, str] | tuple[()] = ()
    """Causes of the same joint that together are it, as a factor on a drive's torque is one on Kp and one on Kd: no
    more than two of the three are named of a drive."""
    nearly: str = ""
    """Cause that does nearly the same at the same place and size: a fit of it begins with that one's size."""
    rivals: tuple[str, ...] = ()
    """Causes that a slow motion does not distinguish from it: those with which the log is nearly as likely in its place
    are its alternatives."""
    looks_like: str = ""
    """Cause that no log distinguishes from it at the same place: it is named, with that as its alternative."""
    payload: tuple[str, ...] = ()
    """Of its numbers those that a weight on the trunk changes."""
    or_payload: bool = False
    """Whether a weight on the trunk may look like it: then that is the likelier reason."""

    of_all: str = ""
    """Of a nuisance the cause that it is at all joints at once."""
    unseen: str = ""
    """Why the log of a robot that has it does not show that one."""
    others: Callable[[Place], tuple[str, ...]] = lambda _: ()
    """Alternatives that a look at the log has found, in a result's words."""
    sought: str = ""
    """Of a motion that the log does not have: where it is looked for."""
    measured_in: str = ""
    """Channel that does show it."""
    own: float = 0.0
    """Part of its number that any robot has, give or take as much: simulated, but no part of a fault's size."""
    unsure: Number = 0.0
    """Part of its number that no log decides, added to the half of its interval."""
    if_negative: tuple[str, str, str] | tuple[()] = ()
    """Cause, place and number that it is where it is negative."""
    limits: bool = False
    """Whether it limits a drive's torque: a log shows it no further than was asked for."""

    central: bool = False
    """Whether its derivative is central: a factor on all torques and masses changes nothing, but their curvature
    would."""
    uneven: bool = False
    """Whether derivatives do not say its size to the end."""
    sudden: bool = False
    """Whether it acts as soon as it is there: no healthy robot has a little of it."""
    tried: tuple[float, ...] = ()
    """Sizes, in those of a fault, that are tried on feet by the replay alone: where derivatives say nothing."""

    through: Literal["", "trunk", "ground", "imu"] = ""
    """Part that a held robot lacks, so that its log cannot show it: a trunk that moves, the ground, or its sensor."""
    needs_current: bool = False
    """Whether it does nothing while no current is asked for: a lag that lets noise die away would seem to."""
    needs_slip: bool = False
    """Whether it does nothing where no foot slips: then the replay says how low it may be."""
    shown: Shown | None = None
    """Motion that shows it; on the ground mostly a walk, for windows of a robot at rest repeat each other."""
    shown_by_arm: Shown | None = None
    """Motion of a robot that cannot walk, where that is another."""
    says: Callable[[float, str], str] | None = None
    """A verdict's words for a value and its number's name, after the place; without it the title and the number."""

    remark: Callable[[float, tuple[float, float]], str] | None = None
    """A remark on a size beyond ``least`` that is no cause, from it and what is ``usual``."""

    acts: Callable[[Replayed, np.ndarray], None] | None = None
    """Applies a change, shape (E, columns), where the replay has no line for its field."""
    mjcf: Callable[[MjcfEdit, int, float], None] | None = None
    """Writes the change of a column into an MJCF."""
    usd: Callable[[UsdEdit, int, float], None] | None = None
    """Writes it into a robot's USD file."""
    rubs: Literal["", "frictionloss", "damping"] = ""
    """Friction of a joint that it adds to, in each of the extended robot's files that has it."""
    read_back: bool = True
    """Whether ``robot.usda`` has it where it is made from the MJCF."""
