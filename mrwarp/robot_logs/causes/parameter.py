"""Numbers of a robot that a log could speak of: the catalogue's causes at the places of this robot."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mrwarp.robot_logs.causes.cause import NUISANCE, Cause, Number
from mrwarp.robot_logs.causes.places import PLACES, SLIDING, Place
from mrwarp.robot_logs.causes.robot_causes import DECLARED, declared
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import RobotLog


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number of one cause at one place; what :class:`~mrwarp.robot_logs.causes.cause.Cause` declares, there."""

    cause: str
    where: str
    name: str
    """Name of the number in a result."""
    unit: str
    field: str
    index: int
    """Column of the field."""
    step: float
    spread: float
    least: float
    fault: float
    lowest: float = -np.inf
    highest: float = np.inf
    possible: float = np.inf
    usual: tuple[float, float] = (0.0, 0.0)
    unsure: float = 0.0
    others: tuple[str, ...] = ()
    always_free: bool = False
    """Whether it is fitted next to any cause though it may be one."""
    nominal: float = 0.0

    @cached_property
    def declared(self) -> Cause:
        """Its declaration."""
        return declared(self.cause, self.field)

    @property
    def relative(self) -> bool:
        """Whether the change is a share of ``nominal``."""
        return self.declared.change == "relative"

    @property
    def is_nuisance(self) -> bool:
        """Whether it is fitted next to any cause: every session has its own."""
        return self.always_free or self.cause == NUISANCE

    def absolute(self, change: float) -> float:
        """Value in ``unit`` that a change makes."""
        if self.declared.change == "inverse":
            return self.nominal / max(1.0 + change, 1.0 + self.lowest)
        if self.declared.change == "compliance":
            return self.nominal / np.sqrt(change) if change > 0.0 else np.inf
        return self.nominal * (1.0 + change) if self.relative else change


def parameters_of(model: ReplayModel, log: RobotLog) -> list[Parameter]:
    """All numbers that a log of this robot could speak of, place by place."""
    found = []
    for kind, places in PLACES.items():
        causes = [cause for cause in DECLARED if cause.place == kind]
        for where, index, axis in places.of(model):
            at = Place(model=model, log=log, where=where, index=index, axis=axis)
            found += [_parameter(cause, at) for cause in causes if cause.there(at)]
    return found


def _parameter(cause: Cause, at: Place) -> Parameter:
    def here(number: Number) -> float:
        return float(number(at) if callable(number) else number)

    slides = cause.place == "joint" and at.model.slides[at.index]
    return Parameter(
        cause=cause.name,
        where=at.where,
        name=at.axis or cause.number,
        unit=SLIDING.get(cause.unit, cause.unit) if slides else cause.unit,
        field=cause.field,
        index=at.index,
        step=here(cause.step),
        spread=here(cause.spread),
        least=here(cause.least),
        fault=here(cause.fault),
        lowest=here(cause.lowest),
        highest=here(cause.highest),
        possible=here(cause.possible),
        unsure=here(cause.unsure),
        others=cause.others(at),
        usual=cause.usual(at),
        always_free=cause.of_session(at),
        nominal=here(cause.nominal),
    )
