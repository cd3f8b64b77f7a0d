"""Candidates on top of a model: a first look at what each would give, then the models that are fitted in full.

A first look holds the derivatives of the model below. All starts of all candidates run as environments of one launch,
with their derivative columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrwarp.diagnose.problem import Fit, Problem, fit_model
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.least_squares import losses
from mrwarp.identify.parameters import Parameters, simulate, slots_of

_SLAB = 12
"""Trials whose signals share one table: bounds its memory and the products that nobody needs."""
_REFINE = 6
"""Steps of improvement."""


@dataclass(frozen=True)
class Candidate:
    """What one more effect would give."""

    effect: str
    choices: Mapping[tuple[str, str], float]
    values: np.ndarray
    """Coordinates of the effect's own numbers."""
    loss: float
    loo_loss: np.ndarray
    """Leave-one-out loss of each trajectory, shape (T,)."""

    @property
    def total(self) -> float:
        """Leave-one-out loss of all trajectories."""
        return float(self.loo_loss.sum())


class Models:
    """Every model that a search on top of a baseline fits, by its effects: none is fitted twice."""

    def __init__(self, problem: Problem, base: Fit) -> None:
        self.problem, self.base = problem, base
        self.fits = {base.effects: base}

    def added(self, fit: Fit) -> list[str]:
        """Effects of a model that the baseline does not have."""
        return [e for e in fit.effects if e not in self.base.effects]

    def singles(self) -> list[Fit]:
        """Models that were fitted with one effect more than the baseline."""
        return [f for f in self.fits.values() if len(f.effects) == len(self.base.effects) + 1]

    def grown(self, on: Fit, candidate: Candidate) -> Fit:
        """A model plus a candidate, everything fitted together."""
        choices = {**on.parameters.choices, **candidate.choices}
        layout = self.problem.parameters((*on.effects, candidate.effect), choices)
        if layout.effects not in self.fits:
            x = on.parameters.grown(on.x, layout.effects)
            x[layout.own(candidate.effect)] = candidate.values
            self.fits[layout.effects] = fit_model(self.problem, layout, x)
        return self.fits[layout.effects]

    def without(self, fit: Fit, effect: str) -> Fit:
        """A model refitted without one of its effects."""
        rest = tuple(e for e in fit.effects if e != effect)
        if rest not in self.fits:
            layout = self.problem.parameters(rest, fit.parameters.choices)
            self.fits[rest] = fit_model(self.problem, layout, fit.parameters.moved(fit.x, layout))
        return self.fits[rest]


@dataclass(frozen=True, kw_only=True)
class _Start:
    """Numbers of one effect in a model, not yet simulated."""

    effect: str
    choices: Mapping[tuple[str, str], float]
    parameters: Parameters
    values: np.ndarray

    @property
    def own(self) -> list[int]:
        """Places of the effect's numbers in the model's vector."""
        return self.parameters.own(self.effect)


@dataclass(frozen=True, kw_only=True)
class _Trial(_Start):
    """Numbers of one effect on the way to their best."""

    step: np.ndarray
    """Where the linear model goes from here."""
    loss: float
    """What the linear model promises there."""
    held_loss: float
    """Loss with the effect's numbers as they are."""
    loo_loss: np.ndarray
    settled: bool = False
    shrink: float = 1.0

    def moved(self) -> _Start:
        """The numbers one damped step on."""
        p, own = self.parameters, self.own
        reach = p.reach(np.inf, 0.7)[own]
        values = np.clip(self.values + np.clip(self.step * self.shrink, -reach, reach), p.low[own], p.high[own])
        return _Start(effect=self.effect, choices=self.choices, parameters=p, values=values)

    def better(self, new: _Trial) -> _Trial:
        """A better trial, or this one with a shorter step."""
        if new.held_loss < self.held_loss:
            return replace(new, settled=self.held_loss - new.held_loss < 1e-4 * new.held_loss)
        return replace(self, shrink=0.3 * self.shrink, settled=0.3 * self.shrink < 0.05)


def screen(problem: Problem, base: Fit, effects: Iterable[str], *, hopeless: float = 0.0) -> list[Candidate]:
    """Best of each effect's starts, improved with the base's derivatives held; best effect first.

    Starts whose linear look promises a smaller gain than ``hopeless`` are left as they are.
    """
    trials = _evaluate(problem, base, [start for effect in effects for start in _starts(problem, base, effect)])
    now, best = float(base.loss.sum()), []
    for mine in _by_effect(trials):
        best += [replace(t, settled=now - t.loss < hopeless) for t in _two_apart(mine)]
    for _ in range(_REFINE):
        new = iter(_evaluate(problem, base, [t.moved() for t in best if not t.settled]))
        best = [t if t.settled else t.better(next(new)) for t in best]
    found = []
    for mine in _by_effect(best):
        t = min(mine, key=lambda t: t.loss)
        short = max(0.0, t.held_loss - t.loss)  # at a bound, or not settled: what the linear look promises too much
        found.append(Candidate(t.effect, t.choices, t.values, t.held_loss, t.loo_loss + short / len(t.loo_loss)))
    return sorted(found, key=lambda c: c.total)


def _starts(problem: Problem, base: Fit, effect: str) -> list[_Start]:
    """Every combination of an effect's logging choices with its non-linear numbers' starts."""
    choices: list[dict[tuple[str, str], float]] = [{}]
    for p in CATALOGUE[effect].parameters:
        if p.choices:
            choices = [{**old, (effect, p.name): value} for old in choices for value in p.choices]
    ranges = problem.motion.ranges
    values: list[list[float]] = [[]]
    for slot in slots_of(effect):
        starts: Sequence[float] = (slot.neutral(ranges),)
        if slot.parameter.starts is not None:
            starts = slot.parameter.starts(ranges)
            starts = [float(np.log(v)) for v in starts] if slot.logarithmic else starts
        values = [[*old, v] for old in values for v in starts]
    found = []
    for choice in choices:
        layout = problem.parameters((*base.effects, effect), {**base.parameters.choices, **choice})
        found += [_Start(effect=effect, choices=choice, parameters=layout, values=np.array(v)) for v in values]
    return found


def _evaluate(problem: Problem, base: Fit, starts: list[_Start]) -> list[_Trial]:
    """Losses and next steps: one launch for the torques of all starts and their derivative columns."""
    if not starts:
        return []
    models = []
    for s in starts:
        x = base.parameters.grown(base.x, s.parameters.effects)
        x[s.own] = s.values
        models.append((s.parameters, x))
        for i in s.own:
            y = x.copy()
            y[i] += s.parameters.steps[i]
            models.append((s.parameters, y))
    tau = iter(simulate(problem.replay, models))
    found = []
    for first in range(0, len(starts), _SLAB):
        some, blocks = starts[first : first + _SLAB], [base.slopes]
        for s in some:
            here = next(tau)
            moved = np.stack([next(tau) for _ in s.own])
            blocks += [(moved - here) / s.parameters.steps[s.own, None], (problem.motion.torque - here)[None]]
        equations = problem.equations(blocks, base.torque)
        column = len(base.slopes)
        for s in some:
            target = column + len(s.own)
            solution, inside, outside = losses(equations, [*base.free, *range(column, target)], target)
            # what eq. 14 alone can take up, with the effect's numbers held: decides between starts
            _, held, _ = losses(equations, base.free, target)
            found.append(
                _Trial(
                    **vars(s),
                    step=solution[len(base.free) :],
                    loss=float(inside.sum()),
                    held_loss=float(held.sum()),
                    loo_loss=outside,
                )
            )
            column = target + 1
    return found


def _by_effect(trials: list[_Trial]) -> list[list[_Trial]]:
    return [[t for t in trials if t.effect == effect] for effect in dict.fromkeys(t.effect for t in trials)]


def _two_apart(trials: list[_Trial]) -> list[_Trial]:
    """The two best trials of different starts."""
    taken: list[_Trial] = []
    for t in sorted(trials, key=lambda t: t.loss):
        if all(t.choices != o.choices or np.abs(t.values - o.values).max() > 1e-9 for o in taken):
            taken.append(t)
    return taken[:2]
