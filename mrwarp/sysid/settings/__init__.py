"""Every number by which the method decides, in one object: ``mrwarp.diagnose(recording, settings=Settings(...))``.

A group belongs to one step; those of the joint are in :mod:`~mrwarp.sysid.settings.joint_settings`. Laws, physical
bounds and units stand in the effects and causes, not here.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

from mrwarp.sysid.settings.joint_settings import Gain, Law, Proof, Rest, Search

__all__ = ["Gain", "Law", "Proof", "Rest", "Search", "Settings"]


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
    """What counts as a gain."""
    search: Search = field(default_factory=Search)
    """Which effects are found together."""
    proof: Proof = field(default_factory=Proof)
    """Which found effects are causes."""
    law: Law = field(default_factory=Law)
    """Whether the hysteresis has another shape."""
    rest: Rest = field(default_factory=Rest)
    """What is reported as unexplained."""

    def __post_init__(self) -> None:
        """Check that each group is one of its kind."""
        for f in fields(self):
            kind, group = f.default_factory, getattr(self, f.name)
            if not (isinstance(kind, type) and isinstance(group, kind)):
                raise ValueError(f"setting {f.name} is {group!r}: give a {getattr(kind, '__name__', kind)}")
