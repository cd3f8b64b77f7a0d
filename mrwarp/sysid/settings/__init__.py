"""Every number by which the method decides, in one object: ``mrwarp.diagnose(recording, settings=Settings(...))``.

A group belongs to one step; those of the joint are in :mod:`~mrwarp.sysid.settings.joint_settings`. Laws, physical
bounds and units stand in the effects and causes, not here.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from mrwarp.sysid.settings.joint_settings import Calibration, Experiment, Gain, Law, Odds, Proof, Rest, Search, Steps
from mrwarp.sysid.settings.recording_settings import Data, Effort, Faults, Reading, Spikes
from mrwarp.sysid.settings.robot_settings import Robot, RobotFit

__all__ = [
    "Calibration",
    "Data",
    "Effort",
    "Experiment",
    "Faults",
    "Gain",
    "Law",
    "Odds",
    "Proof",
    "Reading",
    "Rest",
    "Robot",
    "RobotFit",
    "Search",
    "Settings",
    "Spikes",
    "Steps",
]


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Numbers by which a diagnosis decides.

    Example:
        >>> from mrwarp.sysid.settings import Gain, Settings
        >>> Settings(gain=Gain(few=6)).gain.few
        6

    Raises:
        ValueError: a group is of another kind; a group itself refuses numbers outside their ranges.
    """

    gain: Gain = field(default_factory=Gain)
    """Gains that count, in every step."""
    search: Search = field(default_factory=Search)
    """Which effects are found together."""
    odds: Odds = field(default_factory=Odds)
    """The prior of the evidence."""
    proof: Proof = field(default_factory=Proof)
    """Which found effects are causes."""
    law: Law = field(default_factory=Law)
    """Whether the hysteresis has another shape."""
    rest: Rest = field(default_factory=Rest)
    """Structure that is reported as unexplained."""
    data: Data = field(default_factory=Data)
    """Which data carry a verdict."""
    faults: Faults = field(default_factory=Faults)
    """Faults of a recording."""
    spikes: Spikes = field(default_factory=Spikes)
    """Single samples that stand out."""
    reading: Reading = field(default_factory=Reading)
    """How a log is read."""
    steps: Steps = field(default_factory=Steps)
    """Coil lag or command delay."""
    calibration: Calibration = field(default_factory=Calibration)
    """Shifts against nominal parameters."""
    experiment: Experiment = field(default_factory=Experiment)
    """The experiment that is proposed next."""
    effort: Effort = field(default_factory=Effort)
    """Processor time."""
    robot: Robot = field(default_factory=Robot)
    """Which causes of a robot's log are named."""
    robot_fit: RobotFit = field(default_factory=RobotFit)
    """How far a robot is fitted to its log."""

    def __post_init__(self) -> None:
        """Check that each group is one of its kind."""
        for f in fields(self):
            kind, group = f.default_factory, getattr(self, f.name)
            if not (isinstance(kind, type) and isinstance(group, kind)):
                raise ValueError(f"setting {f.name} is {group!r}: give a {getattr(kind, '__name__', kind)}")
