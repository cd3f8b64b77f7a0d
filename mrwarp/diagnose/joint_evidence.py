"""A joint as a plant of evidence: its effects with their slopes, its nameless groups, its runs as units of chance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrwarp.diagnose.lag_or_delay import DELAY, LAG, decided_by_steps
from mrwarp.diagnose.problem import Fit
from mrwarp.diagnose.proof import Rejection, impossible_size, interval_rejection, without_effect
from mrwarp.diagnose.residual_structure import Group, Leftover, groups_along, leftovers
from mrwarp.diagnose.screening import Candidate, Models, lacking_together
from mrwarp.diagnose.search import Selection, expected_in
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.effects.law import EffectLaw
from mrwarp.identify.dataset import rms
from mrwarp.identify.parameters import LINEAR
from mrwarp.identify.projection import Progress
from mrwarp.recording.data import NO_INPUT
from mrwarp.sysid.by_evidence import Found, searched_by_evidence
from mrwarp.sysid.evidence import Signals, showing
from mrwarp.sysid.least_squares import ridge_solve

_SPRING = LINEAR.index("C")
"""The number of eq. 14 that has a sign: no spring pushes away from its rest, only a weight does."""
_FITTED = 5
"""Most effects that are fitted in each step."""
_SHIFT = 0.5
"""Standard deviation of the time between two samples at which a law acts [samples]."""
_ROUNDING = 1e-6
"""Relative rounding of products of rows in single precision: with it, no sum of rows has a negative power."""


class JointPlant:
    """Effects and nameless groups of a data set; nameless functions lie along the baseline's hysteresis."""

    def __init__(self, models: Models, screened: Sequence[Candidate]) -> None:
        self.models, self.problem, self.base = models, models.problem, models.base
        self.effects = [candidate.effect for candidate in screened]
        self.without, self.expected = models.without, expected_in(models.problem)
        self.ranges = models.problem.motion.ranges
        self.groups: list[Group] = [group for group in groups_along(self.problem, self.base) if len(group.rows)]
        rows = np.vstack([group.rows for group in self.groups])
        self.rows = (rows / np.sqrt((rows**2).mean(axis=1, keepdims=True))).astype(np.float32)
        self.group = np.repeat(np.arange(len(self.groups)), [len(group.rows) for group in self.groups])

    def causes(self, fit: Fit) -> list[str]:
        """The effects of a model beyond the baseline, but for one that takes the place of a term of eq. 14."""
        return [effect for effect in self.models.added(fit) if effect != self.expected]

    @property
    def least(self) -> float:
        """The learned noise is the least there is; next to a large misfit nothing is known of it."""
        return 1e-6 if self.problem.misfit else 1.0

    def grown(self, fit: Fit) -> Iterator[tuple[str, Fit]]:
        """Models with one effect more, of those that promise most at a first look, and with a body's mechanics."""
        rest = [effect for effect in self.effects if effect not in fit.effects]
        looks = self.models.screened(fit, rest) if rest else []
        near = [
            c for c in looks if fit.total - c.total > self.problem.settings.gain.half * (fit.total - looks[0].total)
        ]
        for candidate in (near or looks)[:_FITTED]:
            more = self.models.grown(fit, candidate)
            if not (impossible_size(candidate.effect, more, self.ranges) or self._unknown(candidate.effect, more)):
                yield candidate.effect, more
        if fit is self.base and len(together := lacking_together(self.problem, fit, rest)) > 1:
            yield " and ".join(candidate.effect for candidate in together), self.models.grown_together(fit, together)

    def _unknown(self, effect: str, fit: Fit) -> bool:
        """Whether the size of an effect is not known: of one that few runs carry, which evidence takes for many."""
        return bool(interval_rejection(effect, fit, self.problem.settings.proof))

    def swapped(self, fit: Fit, effect: str) -> Iterator[tuple[str, Fit]]:
        """Models that the search fitted with another effect in one's place."""
        without, near = self.without(fit, effect), self.problem.settings.gain.half
        for name, other in self.models.swapped(fit, effect).items():
            enough = without.total - other.total > near * (without.total - fit.total)
            if enough and not impossible_size(name, other, self.ranges):
                yield name, other

    def contains(self, effect: str, other: str) -> bool:
        """Whether an effect is another one with one number more."""
        return CATALOGUE[effect].contains == other

    def ordinary(self, effect: str) -> bool:
        """Whether it is a body's weight, inertia or friction, where there is no device but a body."""
        return CATALOGUE[effect].mechanics and self.problem.units["current"] == NO_INPUT

    def distinct(self, effect: str, other: str) -> bool:
        """Whether none of two effects contains the other; single steps distinguish a lag from a delay."""
        return not (self.contains(effect, other) or self.contains(other, effect)) and {effect, other} != {LAG, DELAY}

    def signals(self, fit: Fit) -> Signals:
        """Whitened, with each run's offset and factor let go."""
        problem, (forms, sizes) = self.problem, self._forms(fit)
        mismatch = (problem.motion.torque - fit.torque)[None]
        return self.signals_of(fit, [fit.slopes, self.rows, forms, mismatch], sizes, derivatives=True)

    def signals_of(
        self, fit: Fit, rows: Sequence[np.ndarray], forms: np.ndarray, *, derivatives: bool = False
    ) -> Signals:
        """Signals of a model's rows, the last of which stands for the mismatch."""
        problem = self.problem
        equations = problem.equations(rows, fit.torque, derivatives=derivatives)
        counts = np.add.reduceat(problem.weight, problem.motion.start[:-1])
        counts = np.maximum(counts * equations.count / max(float(counts.sum()), 1.0), 1.0)
        live = [i for i in fit.free if equations.total[i, i] > 1e-9 * equations.count]
        grams = equations.parts * (1.0 + _ROUNDING * np.eye(equations.parts.shape[-1]))
        room = np.array([fit.x[i] if i == _SPRING else np.inf for i in live])
        return Signals(grams=grams, counts=counts, live=live, group=self.group, forms=forms, room=room)

    def title(self, name: str) -> str:
        """A cause, or a nameless group in words."""
        first, _, number = name.partition(" ")
        if first != "nameless":
            return name
        group = self.groups[int(number)]
        return f"{'/'.join(group.variables)} {group.form}"

    def _forms(self, fit: Fit) -> tuple[np.ndarray, np.ndarray]:
        """Errors that the laws of a model's effects may have: size by motion and current, and parts of a sample.

        None changes an effect's size as a whole, so that what does not vary, as a current that is 0, has no error.
        """
        m, r, odds = self.problem.motion, self.problem.motion.ranges, self.problem.settings.odds
        speed = np.clip(m.qd / (1.5 * r.qd), -1.5, 1.5)
        place = 2.0 * (m.q - 0.5 * (m.q.max() + m.q.min())) / r.q
        along = np.stack([speed, np.abs(speed), place, 2.0 * m.current / max(r.current, 1e-9) - 1.0])
        rows, sizes = [np.empty((0, len(m.q)))], list[float]()
        slopes = fit.slopes[fit.free].astype(float)
        gram = slopes @ slopes.T
        for effect in self.causes(fit):
            bears = fit.torque - without_effect(self.problem, fit, effect)
            others = [k for k, i in enumerate(fit.free) if i not in fit.parameters.own(effect)]
            taken_back = ridge_solve(gram[np.ix_(others, others)], slopes[others] @ bears, 1e-9) @ slopes[others]
            bears *= min(1.0, rms(bears - taken_back) / max(rms(bears), 1e-12))
            about = along - (along @ bears**2 / max(float(bears @ bears), 1e-300))[:, None]
            later = np.diff(bears, prepend=bears[:1])
            later[m.start[:-1]] = 0.0
            rows += [about * bears, later[None]]
            sizes += [odds.form**2] * len(along) + [_SHIFT**2]
        return np.vstack(rows).astype(np.float32), np.array(sizes)

    def rest(self, fit: Fit, change: np.ndarray, sizes: np.ndarray) -> list[np.ndarray]:
        """White rest of each run, where it counts."""
        problem = self.problem
        left = problem.motion.torque - fit.torque
        live = self.signals(fit).live
        left = left - change @ fit.slopes[live]
        for part, own in zip(problem.motion.parts, sizes, strict=True):
            left[part] -= own @ self.rows[:, part]
        white = problem.noise.white(left[None])[0]
        return [white[part][problem.weight[part] > 0.0] for part in problem.motion.parts if problem.weight[part].any()]


@dataclass(frozen=True, kw_only=True)
class Judged:
    """A search with the evidence of its model."""

    selection: Selection
    rejected: tuple[Rejection, ...]
    """Effects that may be a piece of what has no name."""
    shows: Callable[[Fit, np.ndarray], np.ndarray]
    """Chi-squared, in what is needed, by which effects with these torques would show on top of a model, shape (k,)."""


def selected_by_evidence(models: Models, screened: list[Candidate], log: Progress = lambda text: None) -> Judged:
    """Causes and nameless structure of a joint, by nothing but their evidence."""
    plant = JointPlant(models, screened)
    settings = models.problem.settings
    found = searched_by_evidence(plant, settings.odds, settings.gain)
    for step in found.steps:
        log(", ".join(f"{plant.title(name)} {gain:+.0f}" for name, gain in step[:3]))
    selection = Selection(
        base=models.base,
        final=found.model,
        screened=screened,
        fits=models.fits,
        leftovers=[],
        alternatives={effect: tuple(rivals) for effect, rivals in found.rivals.items()},
    )
    steps = decided_by_steps(models, found.model, plant.effects)
    if steps.model is not found.model or steps.excluded or steps.undecided:
        selection = _as_steps_say(selection, steps.model, steps.excluded, steps.undecided)
    selection = replace(selection, refined=steps.refined)
    return _judged(plant, found, selection)


def judged_by_evidence(
    models: Models, selection: Selection, screened: Sequence[Candidate], log: Progress = lambda text: None
) -> Judged:
    """A finished search next to what has no name: causes that may be a piece of it are taken out, likely ones enter.

    No lag, delay or spring enters: what any law is off by in time looks like one.
    """
    plant = JointPlant(models, [c for c in screened if not _later(CATALOGUE[c.effect])])
    settings = models.problem.settings
    found = searched_by_evidence(plant, settings.odds, settings.gain, begin=selection.final)
    if found.suspects:
        log(f"causes dropped: {', '.join(found.suspects)}")
    if found.model is not selection.final:
        selection = replace(selection, final=found.model, leftovers=[])
    return _judged(plant, found, selection)


def _later(law: EffectLaw) -> bool:
    """Whether an effect is that something happens later."""
    return law.rounds_corners or law.yields or law.needs == "command"


def _as_steps_say(selection: Selection, model: Fit, excluded: str | None, undecided: str | None) -> Selection:
    """The selection with a lag in a delay's place, or the other way round, where single steps speak for it."""
    alternatives = dict(selection.alternatives)
    for effect in (LAG, DELAY):
        if effect not in alternatives:
            continue
        kept = [name for name in alternatives.pop(effect) if name != excluded]
        if undecided and undecided not in kept:
            kept.append(undecided)
        alternatives[effect if effect in model.effects else ({LAG, DELAY} - {effect}).pop()] = tuple(kept)
    return replace(selection, final=model, alternatives=alternatives)


def _judged(plant: JointPlant, found: Found[Fit, str], selection: Selection) -> Judged:
    """A selection with what the evidence found."""

    def shows(fit: Fit, torques: np.ndarray) -> np.ndarray:
        rows = [fit.slopes, plant.rows, torques]
        signals = plant.signals_of(fit, rows, np.ones(len(torques) - 1))
        grams, counts = signals.grams / found.correlation, signals.counts / found.correlation
        signals = replace(signals, grams=grams, counts=counts)
        needed = 2.0 * plant.problem.settings.odds.enters + np.log(counts.sum())
        return showing(signals, found.discrepancy, found.nameless) / needed

    return Judged(selection=_with_evidence(plant, found, selection), rejected=_rejections(plant, found), shows=shows)


def _with_evidence(plant: JointPlant, found: Found[Fit, str], selection: Selection) -> Selection:
    """A selection with the evidence of its model: gains, odds, nameless groups, and intervals next to them."""
    models, final = plant.models, selection.final
    if found.nameless and final is found.model:
        least = np.zeros(final.parameters.size) if final.least_variance is None else final.least_variance.copy()
        numbers = list(found.numbers)
        least[numbers] = np.maximum(least[numbers], found.variance)
        final = replace(final, least_variance=least)
        models.fits[final.effects] = final
    gains = {e: models.without(final, e).total - final.total for e in models.added(final)}
    order = sorted(found.nameless, key=lambda g: -found.nameless[g])
    return replace(
        selection,
        final=final,
        own_gain=gains,
        alternatives={
            e: tuple(dict.fromkeys((*selection.alternatives.get(e, ()), *found.rivals.get(e, ())))) for e in gains
        },
        leftovers=selection.leftovers or leftovers(plant.problem, final),
        odds={e: found.odds.get(e, 0.0) for e in gains},
        nameless=tuple(Leftover(plant.groups[g], 2.0 * max(found.nameless[g], 0.0), np.inf) for g in order),
    )


def _rejections(plant: JointPlant, found: Found[Fit, str]) -> tuple[Rejection, ...]:
    """Effects that may be a piece of what has no name; of those that only the evidence let in, the largest."""
    out = []
    for effect, model in found.suspects.items():
        gain = (plant.models.without(model, effect).total - model.total) / plant.base.total
        reason = "a mismatch without a name is likelier in its place: it may be a part of that"
        out.append(Rejection(effect=effect, reason=reason, gain=max(gain, 0.0), fit=plant.models.reported(model)))
    entered = sorted((x for x in out if x.effect in found.entered), key=lambda x: -x.gain)
    return tuple(x for x in out if x not in entered[1:])
