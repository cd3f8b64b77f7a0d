"""Single changes of a robot that are tried by the replay alone: sizes that derivatives do not see, the best of many."""

from __future__ import annotations

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.likelihood import Likelihood, left_by_each
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.selection import Hypothesis
from mrwarp.robot_logs.windows import Windows


def sizes_of_their_own(
    hypotheses: list[Hypothesis], model: ReplayModel, groups: list[Windows], parameters: list[Parameter]
) -> dict[int, list[float]]:
    """Sizes, in steps, of hypotheses that derivatives do not see: of what moves feet on the floor, limits; by place."""
    own = {}
    for k, p in ((k, parameters[d.members[0]]) for k, d in enumerate(hypotheses) if len(d.members) == 1):
        if model.free and (tried := p.declared.tried):
            own[k] = [times * p.fault / abs(p.step) for times in tried]
        elif p.declared.limits and p.index in (short := _short_of_torque(model, groups)):
            own[k] = [short[p.index] / abs(p.step)]
    return own


def screened(
    tried: list[tuple[np.ndarray, Hypothesis, float]],
    described: Likelihood,
    model: ReplayModel,
    groups: list[Windows],
    parameters: list[Parameter],
) -> list[tuple[np.ndarray, Hypothesis, float]]:
    """The best of changed robots, (P,), with what changed and how unlikely it is; by some windows."""
    robots, settings = np.array([robot for robot, _, _ in tried]), described.settings.robot_fit
    left = left_by_each(described, model, groups, parameters, robots, every=settings.screened)
    order = np.argsort(left + np.array([unlikely for _, _, unlikely in tried]))
    return [tried[k] for k in order[: settings.kept]]


def _short_of_torque(model: ReplayModel, groups: list[Windows]) -> dict[int, float]:
    """Most that drives gave relative to their commands, as a change [1], of the least, by joint."""
    read = [np.abs(w.measured["tau"]).reshape(-1, len(model.joints)) for w in groups if "tau" in w.measured]
    if not read:
        return {}
    change = np.nanquantile(np.concatenate(read), 0.999, axis=0) / model.asked - 1.0
    return {int(j): float(change[j]) for j in np.argsort(change)[: model.settings.robot_fit.limited] if change[j] < 0.0}
