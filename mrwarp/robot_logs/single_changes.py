"""Single changes of a robot that are tried by the replay alone: sizes that derivatives do not see, the best of many."""

from __future__ import annotations

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.likelihood import Likelihood, left_by_each
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.selection import Hypothesis
from mrwarp.robot_logs.windows import Windows

SCREENED, KEPT = 3, 8
"""Every change that is tried is replayed along one window of so many, by long steps; so many of the best along all."""

LIMITED = 2
"""Drives whose limit is tried next to them, at the most that they gave: those that gave least of what was asked of
them. Derivatives see a limit only where it begins to act."""


def sizes_of_their_own(
    hypotheses: list[Hypothesis], model: ReplayModel, groups: list[Windows], parameters: list[Parameter]
) -> dict[int, list[float]]:
    """Sizes, in steps, of hypotheses that derivatives do not see: the floor, single feet, limits; by their place."""
    own = {}
    for k, p in ((k, parameters[d.members[0]]) for k, d in enumerate(hypotheses) if len(d.members) == 1):
        if tried := p.declared.tried:
            own[k] = [times * p.fault / abs(p.step) for times in tried]
        elif p.field == "limit" and p.index in (short := _short_of_torque(model, groups)):
            own[k] = [short[p.index] / abs(p.step)]
    return own


def screened(
    tried: list[tuple[np.ndarray, Hypothesis, float]],
    described: Likelihood,
    model: ReplayModel,
    groups: list[Windows],
    parameters: list[Parameter],
) -> list[tuple[np.ndarray, Hypothesis, float]]:
    """The :data:`KEPT` best of changed robots, (P,), with what changed and how unlikely it is; by some windows."""
    robots = np.array([robot for robot, _, _ in tried])
    left = left_by_each(described, model, groups, parameters, robots, every=SCREENED)
    order = np.argsort(left + np.array([unlikely for _, _, unlikely in tried]))
    return [tried[k] for k in order[:KEPT]]


def _short_of_torque(model: ReplayModel, groups: list[Windows]) -> dict[int, float]:
    """Most that drives gave relative to their commands, as a change [1], of the :data:`LIMITED` least, by joint."""
    read = [np.abs(w.measured["tau"]).reshape(-1, len(model.joints)) for w in groups if "tau" in w.measured]
    if not read:
        return {}
    change = np.nanquantile(np.concatenate(read), 0.999, axis=0) / model.asked - 1.0
    return {int(j): float(change[j]) for j in np.argsort(change)[:LIMITED] if change[j] < 0.0}
