"""Fit a robot to windows of its log: which numbers it has to set free, and sizes by the replay itself."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE, DRIVE, ORDINARY
from mrwarp.robot_logs.likelihood import Likelihood, fit, gather, replayed
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.report.stages import within
from mrwarp.robot_logs.robot_proof import cross_validated
from mrwarp.robot_logs.selection import (
    Found,
    Hypothesis,
    bounds_of,
    hypotheses_of,
    prior_of,
    select,
)
from mrwarp.robot_logs.windows import Windows


@dataclass(frozen=True, kw_only=True)
class FirstLook:
    """Where a fit begins."""

    nuisance: np.ndarray
    """The described robot with the nuisances of this session, shape (P,)."""
    described: Likelihood
    """About that robot."""
    guess: np.ndarray
    """A robot with the fault that stands out, shape (P,)."""
    guessed: list[Hypothesis]
    """That fault; empty where none does."""


def fitted(
    model: ReplayModel,
    groups: list[Windows],
    parameters: list[Parameter],
    progress: Callable[[str], None],
    look: FirstLook,
) -> tuple[np.ndarray, list[Hypothesis], Likelihood, dict[Hypothesis, list[Hypothesis]]]:
    """The robot around which the log is judged, shape (P,), what had to be set free for it, the likelihood about it.

    And of causes of drives that were set free, the others with which the replay was nearly as good. ``look`` says
    where the fit begins.
    """
    theta, described, guess, guessed = look.nuisance, look.described, look.guess, look.guessed
    free: list[Hypothesis] = []
    likelihood = described
    fits: dict[frozenset[Hypothesis], tuple[np.ndarray, list[Hypothesis]]] = {}
    rivals: dict[Hypothesis, list[Hypothesis]] = {}

    def left(theta: np.ndarray, hypotheses: list[Hypothesis], likelihood: Likelihood) -> float:
        seen, _ = replayed(likelihood, model, groups, parameters, theta)
        return float(seen / likelihood.scale + theta @ prior_of(parameters, hypotheses) @ theta)

    ordinary = not guessed and bool((guess != theta).any())
    if ordinary:  # single changes that are no fault say the log: far from them, others would stand for them
        theta = guess
    for round_ in range(described.settings.robot_fit.rounds):
        found = guessed
        if round_ or not (guessed or ordinary):
            # what does not predict what it did not see is no cause, and would only lead the fit astray
            seen, _ = cross_validated(select(likelihood, parameters), likelihood, parameters)
            found = [f.hypothesis for f in seen if f.hypothesis.cause not in ORDINARY]
        # common causes go first: those at single places may only stand for them
        common = [d for d in found if len(d.members) > 1]
        wanted = common if common and common != free else found
        if frozenset(wanted) in fits:  # the last fit asks for itself, or two ask for each other
            break
        free = wanted
        log = within(progress, f"round {round_ + 1} of {described.settings.robot_fit.rounds}")
        low, high = bounds_of(parameters)
        idle = [k for k, p in enumerate(parameters) if p.declared.sudden and not any(k in d.members for d in wanted)]
        low[idle] = high[idle] = 0.0

        def refit(
            hypotheses: list[Hypothesis],
            sizes: Mapping[int, float] | None = None,
            twin: np.ndarray | None = None,
            start: np.ndarray = theta,
            likelihood: Likelihood = likelihood,
            bounds: tuple[np.ndarray, np.ndarray] = (low, high),
            log: Callable[[str], None] = log,
        ) -> tuple[np.ndarray, Likelihood, bool]:
            if twin is not None:
                start = np.clip(twin, *bounds)
            elif hypotheses:
                first = np.clip(guess, *bounds)
                first[[k for d in guessed if d not in hypotheses for k in d.members]] = 0.0
                for k, size in (sizes or {}).items():
                    first[k] = size
                start, _, _ = fitted_alone(model, groups, parameters, hypotheses, first, *bounds, described, log=log)
            _, likelihood = replayed(likelihood, model, groups, parameters, start)
            prior = prior_of(parameters, hypotheses)
            return fit(model, groups, parameters, start, likelihood, prior, *bounds, log)

        theta, likelihood, fresh = refit(free)
        theta, free, likelihood, fresh = _one_drive(
            theta, free, likelihood, fresh, parameters, refit, functools.partial(left, likelihood=likelihood), rivals
        )
        fits[frozenset(wanted)] = fits[frozenset(free)] = theta, free
        if not fresh:
            likelihood = gather(model, groups, parameters, theta, log)
    if len(others := {id(x): (x, own) for x, own in fits.values()}) > 1:  # the likeliest one stands
        odds = described.settings.robot.odds
        worth = {key: left(*fit_, likelihood) + odds * len(fit_[1]) for key, fit_ in others.items()}
        if (best := min(worth, key=lambda key: worth[key])) != id(theta):
            theta, free = others[best]
            likelihood = gather(model, groups, parameters, theta, progress)
    return theta, free, likelihood, rivals


def nuisances_of(
    model: ReplayModel,
    groups: list[Windows],
    parameters: list[Parameter],
    log: Callable[[str], None] = lambda _: None,
) -> np.ndarray:
    """Numbers of every session, fitted alone, (P,): the commands' delay by search, the rest fitted again for each.

    Coils read what rows command, step by step: derivatives do not say how far off the right row is.
    """
    low, high = bounds_of(parameters)
    begin = np.zeros(len(parameters))
    theta, likelihood, indices = fitted_alone(model, groups, parameters, [], begin, low, high, log=log)
    own = [parameters[k] for k in indices]
    late = [k for k, p in enumerate(own) if p.declared.uneven]
    moved = theta.copy()
    prior = prior_of(own, [])
    moved[indices] = searched(theta[indices], late, model, groups, own, likelihood, prior, low[indices], high[indices])
    if (np.abs(moved - theta)[indices][late] < [own[k].least for k in late]).all():
        return theta
    _, likelihood = replayed(likelihood, model, groups, own, moved[indices])
    moved[indices], _, _ = fit(model, groups, own, moved[indices], likelihood, prior, low[indices], high[indices], log)
    return moved


def fitted_alone(
    model: ReplayModel,
    groups: list[Windows],
    parameters: list[Parameter],
    free: list[Hypothesis],
    begin: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    described: Likelihood | None = None,
    *,
    log: Callable[[str], None] = lambda _: None,
) -> tuple[np.ndarray, Likelihood, list[int]]:
    """The robot with ``free`` and the session's offsets fitted alone by the replay, from ``begin``, (P,).

    Far from the truth, where derivatives say little, the other numbers would take up what a large fault leaves.
    ``described`` is the likelihood about the robot as described; without it derivatives are taken at ``begin``.

    Returns:
        Parameters, shape (P,); the likelihood about them of those that were fitted; and which these are.
    """
    named = {k for d in free for k in d.members}
    indices = sorted(named | {k for k, p in enumerate(parameters) if p.is_nuisance or begin[k] != 0.0})
    own = [parameters[k] for k in indices]
    prior = prior_of(own, [replace(d, members=tuple(indices.index(k) for k in d.members)) for d in free])
    start, likelihood = (
        np.clip(begin[indices], low[indices], high[indices]),
        described.of(indices) if described else None,
    )
    if likelihood is not None and start.any():
        _, likelihood = replayed(likelihood, model, groups, own, start)
    found = np.zeros(len(parameters))
    found[indices], likelihood, _ = fit(
        model,
        groups,
        own,
        start,
        likelihood,
        prior,
        low[indices],
        high[indices],
        log,
        renew=int(bool(described)),
    )
    if described is None:
        for d in (d for d in free if uneven(d, model, parameters)):
            members = [indices.index(k) for k in d.members]
            found[indices] = searched(
                found[indices], members, model, groups, own, likelihood, prior, low[indices], high[indices]
            )
    return found, likelihood, indices


def uneven(d: Hypothesis, model: ReplayModel, parameters: list[Parameter]) -> bool:
    """Whether derivatives do not say a cause's size to the end: on feet of any, in the air of limits and delays."""
    return model.free or parameters[d.members[0]].declared.uneven


def searched(
    x: np.ndarray,
    members: list[int],
    model: ReplayModel,
    groups: list[Windows],
    parameters: list[Parameter],
    likelihood: Likelihood,
    prior: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
) -> np.ndarray:
    """Parameters, (P,), with ``members`` of the size that the replay is best with, found without derivatives.

    Derivatives are those of coarse steps, and of feet that touch: a fit by them ends where they vanish.
    """

    def at(times: float) -> tuple[float, np.ndarray]:
        new = x.copy()
        new[members] = np.clip(times * new[members], low[members], high[members])
        return replayed(likelihood, model, groups, parameters, new)[0] / likelihood.scale + float(
            new @ prior @ new
        ), new

    settings = likelihood.settings.robot_fit
    sizes, seen = [1.0 / settings.factor, 1.0, settings.factor], {}
    for _ in range(settings.widened):
        seen |= {s: at(s) for s in sizes if s not in seen}
        best = min(seen, key=lambda size: seen[size][0])
        if min(seen) < best < max(seen):
            break
        sizes = [best / settings.factor, best * settings.factor]
    if not min(seen) < best < max(seen):
        return seen[best][1]
    for _ in range(settings.narrowed):
        near = np.array([max(s for s in seen if s < best), best, min(s for s in seen if s > best)])
        bend, slope, _ = np.polyfit(near, [seen[s][0] for s in near], 2)
        between = at(float(np.clip(-slope / (2.0 * bend), near[0], near[2]))) if bend > 0.0 else seen[best]
        if between[0] < seen[best][0]:
            return between[1]
        # no parabola: next to a step, as where commands that come later are read by other rows
        seen |= {s: at(s) for s in np.sqrt(near[:2] * near[1:]).tolist()}
        best = min(seen, key=lambda size: seen[size][0])
    return seen[best][1]


def _same_drive(own: Hypothesis, theta: np.ndarray, parameters: list[Parameter]) -> np.ndarray:
    """An equal robot, (P,), with the motors, Kp and Kd of ``own``'s joints such that the other two are the healthiest.

    A drive gives its strength times what its gains ask for: only products of it and a gain follow from a replay.
    """
    found = theta.copy()
    for joint in (parameters[k].index for k in own.members):
        at = {p.cause: k for k, p in enumerate(parameters) if p.index == joint and p.cause in DRIVE}
        if len(at) < 3:
            continue
        (names,) = ((name, *CATALOGUE[name].made_of) for name in at if CATALOGUE[name].made_of)
        motor, kp, kd = (1.0 + found[at[name]] for name in names)
        times = dict(zip(names, (np.sqrt(kp * kd), np.sqrt(kd / motor), np.sqrt(kp / motor)), strict=True))
        share = times[own.cause]
        found[[at[name] for name in names]] = motor * share - 1.0, kp / share - 1.0, kd / share - 1.0
    return found


def _twin(own: Hypothesis, other: Hypothesis, theta: np.ndarray, parameters: list[Parameter]) -> np.ndarray | None:
    """Of a robot whose Kp is another at all joints, that whose Kd is, with another torque scale, and back; (P,).

    No log of a robot that is held distinguishes the two except by that scale. None where the session has no scale.
    """
    scale = next((k for k, p in enumerate(parameters) if p.declared.of_all), None)
    if scale is None or own.where != "robot":
        return None
    whole = CATALOGUE[parameters[scale].declared.of_all]
    if {own.cause, other.cause} != set(whole.made_of):
        return None
    found, members = theta.copy(), list(own.members)
    times = 1.0 + theta[members].mean()
    found[members] = (1.0 + theta[members]) / times - 1.0
    found[list(other.members)] = (1.0 + theta[list(other.members)]) / times - 1.0
    found[[k for k, p in enumerate(parameters) if p.cause == whole.name]] *= times
    found[scale] = (1.0 + theta[scale]) * times - 1.0
    return found


def likelier(
    found: list[Found], theta: np.ndarray, parameters: list[Parameter], rival_odds: float
) -> tuple[list[Found], np.ndarray]:
    """Causes and sizes, (P,), with that of Kp and Kd of all joints whose torque scale and size are the likelier.

    They are one robot: which of them a fit came nearer to decides nothing. The other is its alternative, within
    ``rival_odds``.
    """
    found = list(found)
    for k, f in enumerate(found):
        for other in (d for d in hypotheses_of(parameters) if d.where == "robot" and d != f.hypothesis):
            twin = _twin(f.hypothesis, other, theta, parameters)
            if twin is None:
                continue
            less = _unlikely(f.hypothesis, theta, parameters) - _unlikely(other, twin, parameters)
            if less > -2.0 * rival_odds:
                likely, rival = (other, f.hypothesis) if less > 0.0 else (f.hypothesis, other)
                alternatives = dict.fromkeys([rival, *(d for d in f.alternatives if d != likely)])
                found[k] = replace(f, hypothesis=likely, alternatives=tuple(alternatives))
                theta = twin if less > 0.0 else theta
                break
    return found, theta


def _unlikely(own: Hypothesis, theta: np.ndarray, parameters: list[Parameter]) -> float:
    """How unlikely a cause at all joints is with its torque scale: twice a negative logarithm of the prior."""
    (scale,) = (p for p in parameters if p.declared.of_all)
    at = theta[parameters.index(scale)]
    if not scale.lowest <= at <= scale.highest:
        return np.inf
    size = float(theta[list(own.members)].mean()) / parameters[own.members[0]].fault
    return float(size**2 + (at / scale.spread) ** 2)


def _one_drive(
    theta: np.ndarray,
    free: list[Hypothesis],
    likelihood: Likelihood,
    fresh: bool,
    parameters: list[Parameter],
    refit: Callable[
        [list[Hypothesis], Mapping[int, float] | None, np.ndarray | None], tuple[np.ndarray, Likelihood, bool]
    ],
    left: Callable[[np.ndarray, list[Hypothesis]], float],
    rivals: dict[Hypothesis, list[Hypothesis]],
) -> tuple[np.ndarray, list[Hypothesis], Likelihood, bool]:
    """Of each drive one cause, where the replay is as good with it alone: Kp is much as a stronger motor's.

    Those with which it is nearly as good are added to ``rivals``.
    """
    settings = likelihood.settings.robot
    for place in dict.fromkeys(d.where for d in free if d.cause in DRIVE):
        own = [d for d in free if d.cause in DRIVE and d.where == place]
        rest = [d for d in free if d not in own]
        both = left(theta, free)
        best, least = (theta, free, likelihood, fresh), both - 2.0 * settings.odds * (len(own) > 1)
        alone = {own[0]: both} if len(own) == 1 else {}
        for other in hypotheses_of(parameters):
            if other.cause not in DRIVE or other.where != place or len(other.members) != len(own[0].members):
                continue
            if own == [other]:
                continue
            sizes = twin = None
            if len(own) == 1 and CATALOGUE[other.cause].nearly == own[0].cause:
                sizes = dict(zip(other.members, theta[list(own[0].members)], strict=True))
            elif len(own) == 1:
                twin = _twin(own[0], other, theta, parameters)
            new, seen, near = refit([*rest, other], sizes, twin)
            alone[other] = left(new, [*rest, other])
            if alone[other] < least:
                best, least = (new, [*rest, other], seen, near), alone[other]
        for d in alone if len(own) == 1 == len(own[0].members) else ():
            if d not in best[1]:  # one fit came further than the other: that goes on from there
                new, seen, near = refit([*rest, d], None, _same_drive(d, best[0], parameters))
                alone[d] = min(alone[d], now := left(new, [*rest, d]))
                if now < least:
                    best, least = (new, [*rest, d], seen, near), now
        theta, free, likelihood, fresh = best
        for d in (d for d in free if d in alone):
            rivals[d] = [
                x for x, value in alone.items() if x != d and value < alone[d] + 2.0 * likelihood.settings.odds.rival
            ]
    return theta, free, likelihood, fresh
