"""Candidates on top of a model: a first look at what each would give, then the models that are fitted in full.

A first look holds the derivatives of the model below. All starts of all candidates run as environments of one launch,
with their derivative columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from operator import attrgetter

import numpy as np

from mrwarp.diagnose.problem import STIFFER, Fit, Problem, fit_model, reported_fit, stiffer, with_lines
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.angle_lines import angle_lines
from mrwarp.identify.normal_equations import losses
from mrwarp.identify.parameters import YIELDING, Parameters, simulate, slots_of, without_hysteresis

_FEW = (1, 3)
"""Steps from the first look that are tried where a fit to the end leaves more than the model without the effect."""

_SLAB = 12
"""Trials whose signals share one table: bounds its memory and the products that nobody needs."""
_LINES = 2
"""Lines of the mismatch over the angle that are starts."""
_REFINE = 6
"""Steps of improvement."""


@dataclass(frozen=True)
class Candidate:
    """Promise of one more effect."""

    effect: str
    choices: Mapping[tuple[str, str], float]
    """How the data were logged, by (effect, name), as in the candidate's model."""
    values: np.ndarray
    """Coordinates of the effect's own numbers."""
    loss: float
    loo_loss: np.ndarray
    """Leave-one-out loss of each trajectory, shape (T,)."""
    promises: tuple[float, ...] = ()
    """Gains that the linear looks at its best starts promised."""
    stiffer: float = 1.0
    """Stiffness of the device with it, over that in the model below."""

    @property
    def total(self) -> float:
        """Leave-one-out loss of all trajectories."""
        return float(self.loo_loss.sum())


class Models:
    """Every model that a search on top of a baseline fits, by its effects, and as reported: none is fitted twice."""

    def __init__(self, problem: Problem, base: Fit) -> None:
        self.problem, self.base = problem, base
        self.fits = {base.effects: base}
        self._reported: dict[Fit, Fit] = {}
        self._looks: dict[Fit, dict[str, tuple[Candidate, float]]] = {}

    def added(self, fit: Fit) -> list[str]:
        """Effects of a model that the baseline does not have."""
        return [e for e in fit.effects if e not in self.base.effects]

    def singles(self) -> list[Fit]:
        """Models that were fitted with one effect more than the baseline."""
        return [f for f in self.fits.values() if len(f.effects) == len(self.base.effects) + 1]

    def screened(self, on: Fit, effects: Sequence[str], *, hopeless: float = 0.0) -> list[Candidate]:
        """As :func:`screen` on top of a model; effects that were looked at before are not looked at again."""
        looks = self._looks.setdefault(on, {})
        new = [e for e in effects if e not in looks or _left_alone(*looks[e]) != _left_alone(looks[e][0], hopeless)]
        looks |= {c.effect: (c, hopeless) for c in screen(self.problem, on, new, hopeless=hopeless)}
        return sorted((looks[e][0] for e in effects), key=lambda c: c.total)

    def grown(self, on: Fit, candidate: Candidate) -> Fit:
        """A model plus a candidate, everything fitted together."""
        choices = {**on.parameters.choices, **candidate.choices}
        layout = self.problem.parameters((*on.effects, candidate.effect), choices)
        if layout.effects not in self.fits:
            x = stiffer(on.parameters.moved(on.x, layout), candidate.stiffer)
            x[layout.own(candidate.effect)] = candidate.values
            fit = fit_model(self.problem, layout, x)
            if fit.total > on.total:  # led astray, as by contacts that come and go: better stay near the first look
                near = [fit_model(self.problem, layout, x, iterations=n) for n in _FEW]
                fit = min(fit, *near, key=attrgetter("total"))
            self.fits[layout.effects] = with_lines(self.problem, fit)
        return self.fits[layout.effects]

    def grown_together(self, on: Fit, candidates: Sequence[Candidate]) -> Fit:
        """A model plus several candidates, all fitted together from where a regression has them."""
        layout = self.problem.parameters((*on.effects, *(c.effect for c in candidates)), on.parameters.choices)
        if layout.effects not in self.fits:
            x = on.parameters.moved(on.x, layout)
            for c in candidates:
                x[layout.own(c.effect)] = c.values
            self.fits[layout.effects] = fit_model(self.problem, layout, x)
        return self.fits[layout.effects]

    def reported(self, fit: Fit) -> Fit:
        """The model whose numbers are reported, :func:`~mrwarp.diagnose.problem.reported_fit`."""
        if fit not in self._reported:
            self._reported[fit] = reported_fit(self.problem, fit)
        return self._reported[fit]

    def without(self, fit: Fit, effect: str) -> Fit:
        """A model refitted without one of its effects."""
        rest = tuple(e for e in fit.effects if e != effect)
        if rest not in self.fits:
            layout = self.problem.parameters(rest, fit.parameters.choices)
            self.fits[rest] = fit_model(self.problem, layout, fit.parameters.moved(fit.x, layout))
        return self.fits[rest]

    def swapped(self, fit: Fit, effect: str) -> dict[str, Fit]:
        """Models that were fitted with another effect in the place of one of a model's, by that effect."""
        rest = set(fit.effects) - {effect}
        others = [(set(effects) - rest, other) for effects, other in self.fits.items() if rest < set(effects)]
        return {new.pop(): other for new, other in others if len(new) == 1 and new != {effect}}


def _left_alone(candidate: Candidate, hopeless: float) -> list[bool]:
    """Which of a candidate's best starts are left as they are."""
    return [promise < hopeless for promise in candidate.promises]


@dataclass(frozen=True)
class _Trial:
    """Numbers of one effect in a model, on the way to their best."""

    effect: str
    parameters: Parameters
    values: np.ndarray
    stiffer: float = 1.0
    """Stiffness of the device over that of the model below."""
    step: np.ndarray = field(default_factory=lambda: np.empty(0))
    """Where the linear model goes from here."""
    loss: float = np.inf
    """Promise of the linear model there."""
    held_loss: float = np.inf
    """Loss with the effect's numbers as they are."""
    loo_loss: np.ndarray = field(default_factory=lambda: np.empty(0))
    settled: bool = False
    shrink: float = 1.0

    @property
    def own(self) -> list[int]:
        """Places of the effect's numbers in the model's vector."""
        return self.parameters.own(self.effect)

    @property
    def adds(self) -> bool:
        """Whether the effect only adds to the torque."""
        return CATALOGUE[self.effect].adds

    @property
    def _linear(self) -> np.ndarray:
        return np.array([slot.linear for slot in self.parameters.slots if slot.effect == self.effect])

    @property
    def absent(self) -> bool:
        """Whether the effect adds nothing with these numbers."""
        return self.adds and not self.values[self._linear].any()

    @property
    def moving(self) -> list[int]:
        """Places of the numbers that change the torque."""
        return [i for i, linear in zip(self.own, self._linear, strict=True) if linear or not self.absent]

    def moved(self) -> _Trial:
        """The numbers one damped step on."""
        p, own = self.parameters, self.own
        reach = p.reach(np.inf, 0.7)[own]
        values = np.clip(self.values + np.clip(self.step * self.shrink, -reach, reach), p.low[own], p.high[own])
        return _Trial(self.effect, p, values, self.stiffer)

    def better(self, new: _Trial) -> _Trial:
        """A better trial, or this one with a shorter step."""
        if new.held_loss < self.held_loss:
            return replace(new, settled=self.held_loss - new.held_loss < 1e-4 * new.held_loss)
        return replace(self, shrink=0.3 * self.shrink, settled=0.3 * self.shrink < 0.05)


def screen(problem: Problem, base: Fit, effects: Iterable[str], *, hopeless: float = 0.0) -> list[Candidate]:
    """Best of each effect's starts, improved with the base's derivatives held; best effect first.

    Starts whose linear look promises a smaller gain than ``hopeless`` are left as they are.
    """
    trials = _evaluated(problem, base, [start for effect in effects for start in _starts(problem, base, effect)])
    now, best, promises = float(base.loss.sum()), list[_Trial](), dict[str, tuple[float, ...]]()
    for mine in _by_effect(trials):
        two = _two_apart(mine)
        promises[two[0].effect] = tuple(now - t.loss for t in two)
        best += [replace(t, settled=now - t.loss < hopeless) for t in two]
    for _ in range(_REFINE):
        new = iter(_evaluated(problem, base, [t.moved() for t in best if not t.settled]))
        best = [t if t.settled else t.better(next(new)) for t in best]
    found = []
    for mine in _by_effect(best):
        t = min(mine, key=lambda t: t.loss)
        short = max(0.0, t.held_loss - t.loss)  # at a bound, or not settled: what the linear look promises too much
        loo_loss = t.loo_loss + short / len(t.loo_loss)
        found.append(
            Candidate(t.effect, t.parameters.choices, t.values, t.held_loss, loo_loss, promises[t.effect], t.stiffer)
        )
    return sorted(found, key=lambda c: c.total)


def lacking_together(problem: Problem, base: Fit, effects: Iterable[str]) -> list[Candidate]:
    """Mechanics that a model lacks: all in by one regression, then those that are not needed out again.

    Inertia opposes a weight or a spring, so that each alone may gain nothing. What would have a sign that no body has
    goes first, then what adds least to the others, as long as that is not enough to be named.
    """
    trials = [_starts(problem, base, effect)[0] for effect in effects if CATALOGUE[effect].mechanics]
    if len(trials) < 2:
        return []
    columns = _columns(problem, base, trials)
    equations = problem.equations([base.slopes, *columns, (problem.motion.torque - base.torque)[None]], base.torque)
    ends = len(base.slopes) + np.cumsum([len(block) for block in columns])
    own = {t.effect: range(end - len(t.own), end) for t, end in zip(trials, ends, strict=True)}

    def regression(kept: Iterable[str]) -> tuple[np.ndarray, float, np.ndarray]:
        places = [i for effect in kept for i in own[effect]]
        found, inside, outside = losses(equations, [*base.free, *places], int(ends[-1]))
        return found[len(base.free) :], float(inside.sum()), outside

    kept, needed = list(own), max(problem.settings.gain.chi2, problem.settings.gain.floor * base.equations.count)
    while len(kept) > 1:
        solution, _, outside = regression(kept)
        firsts = np.cumsum([0, *(len(own[effect]) for effect in kept[:-1])])
        wrong = [e for e, k in zip(kept, firsts, strict=True) if CATALOGUE[e].positive and solution[k] <= 0.0]
        adds = {e: float(regression([x for x in kept if x != e])[2].sum() - outside.sum()) for e in kept}
        weakest = min(wrong or kept, key=lambda effect: adds[effect])
        if not wrong and adds[weakest] > needed:
            break
        kept.remove(weakest)
    values, inside, outside = regression(kept)
    sizes = dict(zip((i for effect in kept for i in own[effect]), values, strict=True))
    return [
        Candidate(t.effect, t.parameters.choices, np.array([sizes[i] for i in own[t.effect]]), inside, outside)
        for t in trials
        if t.effect in kept
    ]


def _columns(problem: Problem, base: Fit, trials: Sequence[_Trial]) -> list[np.ndarray]:
    """Derivatives of a model's torque by the linear numbers of effects that only add, each of shape (k, N)."""
    models = [(base.parameters, base.x), without_hysteresis(base.parameters, base.x)]
    for t in trials:
        x = base.parameters.moved(base.x, t.parameters)
        for i in t.own:
            y = x.copy()
            y[i] += t.parameters.steps[i]
            models.append(without_hysteresis(t.parameters, y))
    _, alone, *rows = simulate(problem.replay, models)
    tau = iter(rows)
    return [np.stack([(next(tau) - alone) / t.parameters.steps[i] for i in t.own]) for t in trials]


def _starts(problem: Problem, base: Fit, effect: str) -> list[_Trial]:
    """Every combination of an effect's logging choices with its non-linear numbers' starts."""
    ranges, logging = problem.motion.ranges, [p for p in CATALOGUE[effect].parameters if p.choices]
    starts = []
    for slot in slots_of(effect):
        given = slot.parameter.starts
        values = (slot.neutral(ranges),) if given is None else given(ranges)
        starts.append([float(np.log(v)) for v in values] if given and slot.logarithmic else values)
    # without play or a spring the device is softer, in their place
    found, ratios = [], [STIFFER**k for k in range(3 if _gives_way(base, effect) else 1)]
    if lines := _lines(problem, base, effect):
        return lines
    for choice in product(*(p.choices for p in logging)):
        own = {(effect, p.name): value for p, value in zip(logging, choice, strict=True)}
        layout = problem.parameters((*base.effects, effect), {**base.parameters.choices, **own})
        found += [_Trial(effect, layout, np.array(values), ratio) for values in product(*starts) for ratio in ratios]
    return found


def _gives_way(base: Fit, effect: str) -> bool:
    """Whether an effect is the first play or spring before a device with eq. 15."""
    return effect in YIELDING and not base.parameters.law and not set(YIELDING) & set(base.effects)


def _lines(problem: Problem, base: Fit, effect: str) -> list[_Trial]:
    """Starts of an effect that repeats along the angle where a joint turns all the way round: lines of the mismatch."""
    ranges, found = problem.motion.ranges, []
    for p in CATALOGUE[effect].parameters:
        if p.repeats and not p.form and ranges.turns >= 1.0:
            left = problem.motion.torque - base.torque
            for line in angle_lines(problem.motion, left, p.low(ranges), p.high(ranges), count=_LINES):
                known = {**base.parameters.choices, (effect, p.name): line}
                layout = problem.parameters((*base.effects, effect), known)
                found.append(_Trial(effect, layout, np.zeros(len(layout.own(effect)))))
    return found


def _evaluated(problem: Problem, base: Fit, trials: list[_Trial]) -> list[_Trial]:
    """Trials with losses and next steps: one launch for the torques of all and their derivative columns."""
    if not trials:
        return []
    models = [(base.parameters, base.x), without_hysteresis(base.parameters, base.x)]
    for t in trials:
        x = stiffer(base.parameters.moved(base.x, t.parameters), t.stiffer)
        x[t.own] = t.values
        tried = [] if t.absent else [x]
        for i in t.moving:
            tried.append(x.copy())
            tried[-1][i] += t.parameters.steps[i]
        models += [without_hysteresis(t.parameters, y) if t.adds else (t.parameters, y) for y in tried]
    torque, alone, *rows = simulate(problem.replay, models)
    bears = torque - alone  # what a model without the hysteresis lacks
    tau = iter(rows)
    found = []
    for first in range(0, len(trials), _SLAB):
        some, blocks = trials[first : first + _SLAB], [base.slopes]
        for t in some:
            added = bears if t.adds else 0.0
            here = torque if t.absent else next(tau) + added
            moved = np.stack([next(tau) + added if i in t.moving else here for i in t.own])
            if not (np.isfinite(here).all() and np.isfinite(moved).all()):  # no start: with this law it runs away
                here, moved = base.torque, np.repeat(base.torque[None], len(t.own), axis=0)
            blocks += [(moved - here) / t.parameters.steps[t.own, None], (problem.motion.torque - here)[None]]
        equations = problem.equations(blocks, base.torque)
        column = len(base.slopes)
        for t in some:
            target = column + len(t.own)
            solution, inside, outside = losses(equations, [*base.free, *range(column, target)], target)
            # what eq. 14 alone can take up, with the effect's numbers held: decides between starts
            held = float(losses(equations, base.free, target)[1].sum())
            step = solution[len(base.free) :]
            found.append(replace(t, step=step, loss=float(inside.sum()), held_loss=held, loo_loss=outside))
            column = target + 1
    return found


def _by_effect(trials: list[_Trial]) -> list[list[_Trial]]:
    return [[t for t in trials if t.effect == effect] for effect in dict.fromkeys(t.effect for t in trials)]


def _two_apart(trials: list[_Trial]) -> list[_Trial]:
    """The two best trials of different starts."""
    taken: list[_Trial] = []
    for t in sorted(trials, key=lambda t: t.loss):
        here = (t.parameters.choices, t.stiffer)
        if all(here != (o.parameters.choices, o.stiffer) or np.abs(t.values - o.values).max() > 1e-9 for o in taken):
            taken.append(t)
    return taken[:2]
