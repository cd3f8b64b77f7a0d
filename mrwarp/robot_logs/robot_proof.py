"""Which causes of a robot's log are proven: by pieces that took no part, by the replay, and by clear sizes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.robot_causes import ORDINARY
from mrwarp.robot_logs.likelihood import Likelihood, fit, losses, replayed
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.selection import (
    Found,
    Hypothesis,
    Posterior,
    bounds_without,
    common,
    half_width,
    own_members,
    posterior,
    prior_of,
    sizes,
    vector,
    wider_than,
)
from mrwarp.robot_logs.windows import Windows
from mrwarp.sysid.certainty import agreement, clearness
from mrwarp.sysid.jackknife import student, sum_and_error
from mrwarp.sysid.last_gate import Change
from mrwarp.sysid.least_squares import minimum_within
from mrwarp.sysid.left_out import in_a_row, predicted
from mrwarp.sysid.plant import Listed
from mrwarp.sysid.stepwise import eliminated
from mrwarp.sysid.verdict import Gain

JUDGED = ("q", "qd", "tau")
"""Channels that no cause may make worse."""


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """Sizes by the replay, shape (P,)."""

    size: np.ndarray
    """Of the causes, with the session's offsets."""
    lone: np.ndarray
    """Their sizes where nothing else is off."""
    wider: float
    """Factor on intervals."""

    def of(
        self, d: Hypothesis, free: list[Hypothesis], now: Posterior, parameters: list[Parameter]
    ) -> tuple[float, float]:
        """Size of one of the causes ``free``, and half of its interval."""
        members = own_members(d, free)
        size, lone = (float(x[members].mean()) for x in (self.size, self.lone))
        return size, half_width(members, size, now, parameters, wider=self.wider, lone=lone)


def cross_validated(
    found: list[Found], likelihood: Likelihood, parameters: list[Parameter]
) -> tuple[list[Found], list[Found]]:
    """Causes without which pieces of the log that took no part are predicted worse, and the others."""

    def without(found: list[Found], tried: list[Found]) -> list[np.ndarray]:
        loss = _predicted(likelihood, parameters, found, None)
        return [_predicted(likelihood, parameters, found, one) - loss for one in tried]

    return _certain(found, without, likelihood, parameters)


def by_replay(
    found: list[Found],
    model: ReplayModel,
    groups: list[Windows],
    likelihood: Likelihood,
    parameters: list[Parameter],
    fitted: np.ndarray,
    log: Callable[[str], None],
) -> tuple[list[Found], list[Found]]:
    """Causes without which the replay itself, fitted again, is worse, and those that only its derivatives ask for.

    A step of a leg is far from linear: next to a large fault derivatives blame neighbours for what the replay with
    them does not show. ``fitted``, (P,), is the robot that ``likelihood`` is about.
    """

    def without(found: list[Found], tried: list[Found]) -> list[np.ndarray]:
        about, base, least, left = likelihood, fitted, -np.inf, []
        steps = likelihood.settings.robot_fit.proof_steps
        for k, one in enumerate((None, *tried)):
            log(f"{k} of {len(tried)}")
            q, low, high = _without(parameters, found, one)
            a, b = about.normal_equations()
            # where derivatives say, or without the cause alone: the better one, for derivatives may lead far astray
            starts = minimum_within(a + q, b, low, high)[0], np.clip(base, low, high)
            seen = [replayed(likelihood, model, groups, parameters, x) for x in starts]
            worth = [value / likelihood.scale + float(x @ q @ x) for x, (value, _) in zip(starts, seen, strict=True)]
            begin = int(np.argmin(worth))
            theta, here = starts[begin], seen[begin][1]
            if not worth[begin] <= least:  # else it is as good without the cause, and a fit would make it better
                theta, here, _ = fit(
                    model, groups, parameters, theta, here, q, low, high, lambda _: None, steps=steps, renew=0
                )
            # the windows' own steps judge: of long ones a window's error is as large as what a small cause changes
            each = np.tile(theta, (len(likelihood.square), 1))
            each = likelihood.weight * losses(likelihood, model, groups, parameters, each)[0]
            if one is None and np.isfinite(worth[begin]):
                about, base, least = here, theta, float(here.at(theta) / likelihood.scale + theta @ q @ theta)
            left.append(each + likelihood.scale * float(theta @ q @ theta) / len(each))
        broke = ~np.isfinite(left).all(axis=0)
        return [np.where(broke, 0.0, loss - left[0]) for loss in left[1:]]

    return _certain(found, without, likelihood, parameters, {} if model.free else model.limbs)


def clear_ones(
    found: list[Found],
    likelihood: Likelihood,
    parameters: list[Parameter],
    alone: Callable[[list[Found]], tuple[Sizes, Likelihood]],
) -> tuple[list[Found], list[Found], Sizes, Likelihood]:
    """Causes of sizes that a body can have and healthy robots have not, and the others; the least clear go first.

    Sizes count by their 95 % intervals.

    ``alone`` fits causes and session's offsets alone; of what is left, its result comes with them.
    """
    fits: dict[int, tuple[Sizes, Likelihood]] = {}

    def certainty(found: list[Found]) -> list[float]:
        size, _ = fits[len(found)] = alone(found)
        free = [f.hypothesis for f in found]
        now, clear = posterior(likelihood, parameters, free), []
        for d in free:
            own, half = size.of(d, free, now, parameters)
            own -= common(d, free, size.size)
            possible = abs(own) <= parameters[d.members[0]].possible
            clear.append(clearness(own, half, parameters[d.members[0]].usual) if possible else 0.0)
        return clear

    found, rejected = eliminated(Listed(), found, certainty)
    return found, rejected, *(fits.get(len(found)) or alone(found))


def _certain(
    found: list[Found],
    without: Callable[[list[Found], list[Found]], list[np.ndarray]],
    likelihood: Likelihood,
    parameters: list[Parameter],
    limbs: Mapping[str, str] = MappingProxyType({}),
) -> tuple[list[Found], list[Found]]:
    """Causes that windows agree on, and the others.

    ``without`` gives what every window, (W,), loses among causes without each of some. The least certain is taken out
    first, and those that were not certain with it are tried again. ``limbs``, by place, do not move each other: of
    each one goes at a time.
    """
    sure: list[Found] = []
    least = likelihood.settings.robot.share

    def certainty(found: list[Found]) -> list[float]:
        tried = [f for f in found if f not in sure]
        certain = dict.fromkeys(map(id, sure), np.inf)
        for f, gain in zip(tried, without(found, tried) if tried else (), strict=True):
            share = float(gain.sum()) / (likelihood.samples * len(f.hypothesis.members))
            certain[id(f)] = min(agreement(gain[_acting(f.hypothesis, likelihood, parameters)]), share / least)
            if certain[id(f)] >= 1.0:
                sure.append(f)
        return [certain[id(f)] for f in found]

    def of_each_limb(weakest: list[Found]) -> list[Found]:
        first_of: dict[str, Found] = {}
        for f in weakest:
            first_of.setdefault(limbs.get(f.hypothesis.where, ""), f)
        first, *others = first_of
        return [first_of[first], *(first_of[limb] for limb in others if first and limb)]

    return eliminated(Listed(), found, certainty, together=of_each_limb)


def _acting(d: Hypothesis, likelihood: Likelihood, parameters: list[Parameter]) -> np.ndarray:
    """Windows that have a say on a hypothesis, shape (N,)."""
    change = vector(d, parameters)[list(d.members)]
    own = likelihood.information[:, list(d.members)][:, :, list(d.members)]
    information = np.einsum("wij,i,j->w", own, change, change)
    settings = likelihood.settings.robot
    enough = np.sort(information)[-min(settings.windows, len(information))]
    return np.flatnonzero(information >= min(settings.acts * information.mean(), enough))


def _predicted(
    likelihood: Likelihood, parameters: list[Parameter], found: list[Found], without: Found | None
) -> np.ndarray:
    """Squared mismatch of each window, by parameters from the other pieces; ``without`` is held at its description.

    With it each window's part of what the parameters are unlikely by: twelve drives that all settle far from their
    commands predict a log of a heavier trunk as well as its mass does.
    """
    q, low, high = _without(parameters, found, without)

    def solve(information: np.ndarray, score: np.ndarray) -> np.ndarray:
        both = zip(information / likelihood.scale, score / likelihood.scale, strict=True)
        return np.stack([minimum_within(a + q, b, low, high)[0] for a, b in both])

    theta, loss = predicted(likelihood, in_a_row(len(likelihood.square), likelihood.settings.robot.parts), solve)
    return loss + likelihood.scale * np.einsum("wp,pq,wq->w", theta, q, theta) / len(loss)


def _without(
    parameters: list[Parameter], found: list[Found], one: Found | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A robot without one of its causes: precision of its numbers, (P, P), and bounds, (P,), of what is then allowed.

    Deviations of a healthy robot in addition to causes stay allowed. A joint's gain relative to that of all joints is
    then theirs, and not as described.
    """
    wider = one is not None and bool(wider_than(one.hypothesis, [f.hypothesis for f in found]))
    if wider:
        found = [f for f in found if f is not one]
    low, high = bounds_without(parameters, [] if one is None or wider else [one.hypothesis])
    named = {k for f in found for k in f.hypothesis.members}
    for k, p in enumerate(parameters):
        if k not in named and p.cause not in ORDINARY and not p.is_nuisance:
            most = 0.0 if p.declared.sudden else 2.0 * p.spread
            low[k], high[k] = max(low[k], -most), min(high[k], most)
    return prior_of(parameters, [f.hypothesis for f in found]), low, high


def held_out(
    model: ReplayModel,
    groups: list[Windows],
    likelihood: Likelihood,
    parameters: list[Parameter],
    *fits: tuple[list[Hypothesis], Likelihood, tuple[np.ndarray, np.ndarray]],
) -> tuple[Gain, dict[str, tuple[float, float]], dict[str, Change]]:
    """Error of the replay on parts of the log that took no part, before and after, both with their session's offsets.

    ``fits`` are the causes of each, the likelihood about its fit, and its bounds.

    Returns:
        Reduction of the weighted error from each window's best start, with its interval over parts; and errors before
        and after: ``all`` is that one by reading [1], a channel's and ``q.JOINT`` are RMSE from the logged start. And
        the changes of :data:`JUDGED` channels over parts.
    """
    count = likelihood.settings.robot.parts
    parts, both = in_a_row(len(likelihood.square), count), []
    for free, near, bounds in fits:

        def solve(a: np.ndarray, b: np.ndarray, free=free, near=near, bounds=bounds) -> np.ndarray:  # noqa: ANN001
            each = zip(a / near.scale, b / near.scale, strict=True)
            return np.stack([sizes(x, parameters, free, *bounds) for x in each])

        theta, _ = predicted(near, parts, solve)
        both.append(losses(likelihood, model, groups, parameters, theta))
    whole = np.isfinite(both[0][0]) & np.isfinite(both[1][0])  # a replay that broke has no error to compare
    channels = sum(len(x) for x in likelihood.sigma.values())
    samples = channels * np.mean([w.t.shape[1] for w in groups])
    by_part = np.array([[loss[part[whole[part]]].sum() for loss, _ in both] for part in parts if whole[part].any()])
    each = 1.0 - np.sqrt(by_part[:, 1] / np.maximum(by_part[:, 0], 1e-12))
    half = student(0.95, max(len(each) - 1, 1)) * sum_and_error(each)[1] / len(each)
    total = np.sqrt(by_part.sum(axis=0) / (whole.sum() * samples))
    value = float(1.0 - total[1] / max(total[0], 1e-12))
    errors, changes = {"all": (float(total[0]), float(total[1]))}, {}
    for name in both[0][1]:
        before, after = (np.sqrt(squares[name][whole].mean(axis=0)) for _, squares in both)
        errors[name] = (float(np.sqrt((before**2).mean())), float(np.sqrt((after**2).mean())))
        if name in JUDGED:
            own = [part[whole[part]] for part in parts if whole[part].any()]
            changes[name] = Change.of(*(np.array([x[name][k].mean() for k in own]) for _, x in both))
        if name == "q":
            errors |= {f"q.{j}": (float(before[k]), float(after[k])) for k, j in enumerate(model.joints)}
    return Gain(rmse_reduction=value, ci95=(value - half, value + half), held_out=tuple(range(count))), errors, changes
