"""Which effects to name: candidates, singles, pairs, what must be dropped again, and what would do as well."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from operator import attrgetter

import numpy as np
from scipy import stats

from mrwarp.diagnose.lag_or_delay import DELAY, LAG, LagOrDelay, decided_by_steps
from mrwarp.diagnose.problem import Fit, Problem, as_good, drifts, threshold
from mrwarp.diagnose.residual_structure import Leftover, groups_along, leftovers
from mrwarp.diagnose.screening import Candidate, Models, lacking_together, screen
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.normal_equations import losses
from mrwarp.identify.parameters import absent_from
from mrwarp.identify.projection import Progress
from mrwarp.recording.data import NO_INPUT
from mrwarp.sysid.certainty import gain_and_t
from mrwarp.sysid.stepwise import eliminated, searched


@dataclass(frozen=True, kw_only=True)
class Selection:
    """The outcome of the search for causes."""

    base: Fit
    final: Fit
    screened: list[Candidate]
    """Every candidate on top of the baseline."""
    fits: Mapping[tuple[str, ...], Fit]
    """Every model that was fitted on the way, by its effects."""
    leftovers: list[Leftover]
    """Structure that the final model leaves, best first."""
    own_gain: Mapping[str, float] = field(default_factory=dict)
    """Gain of each named effect on top of the others."""
    alternatives: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Effects that would do as well in a named one's place."""
    refined: Mapping[tuple[str, str], tuple[float, float, float]] = field(default_factory=dict)
    """Parameters, and their intervals, that single events give better than the fit; normalised units."""
    odds: Mapping[str, float] = field(default_factory=dict)
    """Logarithm of the odds of each named effect; empty where no evidence was asked."""
    nameless: tuple[Leftover, ...] = ()
    """Nameless groups that the evidence needs next to the final model, likeliest first; a gain is twice its odds."""

    @property
    def gain(self) -> float:
        """Leave-one-out gain of the final model."""
        return self.base.total - self.final.total

    @property
    def named(self) -> list[str]:
        """Effects of the final model that the baseline does not have."""
        return [e for e in self.final.effects if e not in self.base.effects]


def screen_candidates(problem: Problem, base: Fit, candidates: list[str]) -> list[Candidate]:
    """Every candidate on top of the baseline, best first."""
    return screen(problem, base, candidates, hopeless=0.3 * threshold(problem, base))


def first_guess(problem: Problem, base: Fit, screened: list[Candidate]) -> Fit | None:
    """The best model with one more effect or a body's mechanics, if any gains enough: to learn the noise without it."""
    search = JointSearch(Models(problem, base), screened, [])
    single = search.models.grown(base, screened[0]) if search.passing else None
    return search.with_mechanics(single) or single


def select(
    problem: Problem,
    base: Fit,
    screened: list[Candidate],
    log: Progress = lambda text: None,
    *,
    models: Models | None = None,
) -> Selection:
    """Search the effects that explain a data set, among those that :func:`screen_candidates` looked at.

    ``models`` holds what earlier searches fitted.
    """
    candidates = [c.effect for c in screened]
    models, before = models or Models(problem, base), leftovers(problem, base)
    best = searched(JointSearch(models, screened, before, log))
    found = Selection(base=base, final=best, screened=screened, fits=models.fits, leftovers=before)
    if best is base:
        return found
    steps = decided_by_steps(models, best, candidates)
    own_gain, alternatives = _alternatives(models, steps, screened, candidates)
    left, refined = leftovers(problem, steps.model), steps.refined
    return replace(
        found, final=steps.model, leftovers=left, own_gain=own_gain, alternatives=alternatives, refined=refined
    )


class JointSearch:
    """A joint as a plant: its models are fits, judged by what they predict of trajectories left out."""

    def __init__(
        self,
        models: Models,
        screened: list[Candidate],
        before: list[Leftover],
        log: Progress = lambda text: None,
    ) -> None:
        """``before`` is what the baseline leaves."""
        self.models, self.base, self.log = models, models.base, log
        self.problem, self.settings = models.problem, models.problem.settings
        self.effects = [c.effect for c in screened]
        self.passing = [c for c in screened if self.base.total - c.total > threshold(self.problem, self.base)]
        self.expected = expected_in(self.problem)
        self.gain_before = {f.group.key: f.gain for f in before}
        self.causes, self.without = models.added, models.without
        self.confirming = (self.more_than_chance, self.within_range, self.no_proxy)
        self.tests = (self.adds_enough, *self.confirming)

    def candidates(self, fit: Fit) -> list[Candidate]:
        """Effects that would add enough to a model, alone or, as a body's mechanics do, together."""
        if fit is self.base:
            return self.passing or self.mechanics
        return _passing(self.models, fit, self.effects)

    def grown(self, fit: Fit, candidates: Sequence[Candidate]) -> Fit | None:
        """The model with the best of the effects, or with a better pair in a single one's place."""
        if fit is self.base:
            return self._first()
        if len(self.causes(fit)) == 1 and (pair := self._pair(fit, candidates)) is not fit:
            return pair
        larger = _grow(self.models, fit, candidates[:3])
        return larger if _worth(self.models, larger) else None

    def settled(self, fit: Fit) -> Fit:
        """The model with what an effect contains in its place, where that predicts as well next to all others."""
        for effect in self.causes(fit):
            part = CATALOGUE[effect].contains
            if part in self.effects and part not in fit.effects:
                without = self.without(fit, effect)
                simpler = self.models.grown(without, *self.models.screened(without, [part]))
                fit = simpler if as_good(self.problem, simpler, fit, without) else fit
        return fit

    def _first(self) -> Fit | None:
        """The best single effect that is no confounder, or a body's mechanics together."""
        self.log(f"refining {', '.join(c.effect for c in (self.passing or self.mechanics)[:4])}")
        expected = [c for c in self.passing if c.effect == self.expected]
        best = self.models.grown(self.base, expected[0]) if expected else None
        if best is None and self.passing:
            best = _grow(self.models, self.base, self.passing)
        for fit in (self.with_mechanics(best), best):
            if fit is not None and self._confirmed(fit):
                return fit
        # smooth functions of other variables explain it better: the search for partners would only fit them piecemeal
        others = [f for f in self.models.singles() if f is not best and self._confirmed(f)]
        return min(others, key=attrgetter("total"), default=None)

    @cached_property
    def mechanics(self) -> list[Candidate]:
        """A body's mechanics that the baseline lacks together: two effects or more; else none."""
        found = lacking_together(self.problem, self.base, self.effects)
        return found if len(found) > 1 else []

    def with_mechanics(self, single: Fit | None) -> Fit | None:
        """The baseline with a body's mechanics, those that are needed next to each other, where that beats ``single``.

        Each more than a single effect has to be worth its place.
        """
        best = self.base.total if single is None else single.total
        enough = threshold(self.problem, self.base)
        if not self.mechanics or best - self.mechanics[0].total < enough:
            return None
        self.log(f"together: {', '.join(c.effect for c in self.mechanics)}")
        fit, _ = eliminated(self, self.models.grown_together(self.base, self.mechanics), self.adds_enough)
        more = len(self.causes(fit)) - (single is not None)
        return fit if more > 0 and best - fit.total > enough * more else None

    def _confirmed(self, fit: Fit) -> bool:
        """Whether any effect of a model stands for itself."""
        for certainty in self.confirming:
            fit, _ = eliminated(self, fit, certainty)
        return fit is not self.base

    def _pair(self, best: Fit, seconds: Sequence[Candidate]) -> Fit:
        """Best pair: the best single may be neither cause, so the three best singles each look for a partner."""
        self.log(f"pairs: {' + '.join(best.effects)} with {', '.join(c.effect for c in seconds[:3])}")
        models = self.models
        pairs = [models.grown(best, c) for c in seconds[:3]]
        others = [f for f in sorted(models.singles(), key=attrgetter("total")) if f is not best][:2]
        if self.expected in best.effects:
            others = []
        elif len(others) < 2:
            known = {*best.effects, *(e for f in others for e in f.effects)}
            others += [models.grown(self.base, c) for c in self.passing if c.effect not in known][: 2 - len(others)]
        for single in others:
            pairs += [models.grown(single, c) for c in _passing(models, single, self.effects)[:2]]
        pair = _simplest(self.problem, pairs, best)
        return pair if best.total - pair.total > threshold(self.problem, best) else best

    # --- whether effects are real, or stand in for structure of another kind or for chance ---

    def adds_enough(self, fit: Fit) -> list[float]:
        """Whether the effect that adds least to the others adds enough; one that is alone does."""
        if len(self.causes(fit)) < 2:
            return self._but("", fit)
        rest = {e: self.without(fit, e).total for e in self.causes(fit) if e != self.expected}
        weakest = min(rest, key=lambda e: rest[e])
        enough = rest[weakest] - fit.total > _needed(self.models, fit, weakest)
        return self._but("" if enough else weakest, fit)

    def more_than_chance(self, fit: Fit) -> list[float]:
        """Whether effects may only follow offsets and factors of the trajectories by chance."""
        gain = self.settings.gain
        within = max(2.0 * gain.chi2, 0.5 * threshold(self.problem, fit))
        for effect in self.causes(fit):
            without = self.without(fit, effect)
            if gain_within_runs(self.problem, fit, without) < within:
                if drift_p_value(self.problem, fit, without) > gain.chance:
                    return self._but(effect, fit)
        return self._but("", fit)

    def within_range(self, fit: Fit) -> list[float]:
        """Whether effects end at the edge of their range and show in a few trajectories only.

        An effect that would be more itself beyond what makes sense for it is a proxy of another structure.
        """
        room = np.minimum(fit.x - fit.parameters.low, fit.parameters.high - fit.x)
        at_edge = {slot.effect for i, slot in fit.parameters.items() if slot.logarithmic and room[i] < 1e-3}
        for effect in (e for e in self.causes(fit) if e in at_edge):
            without = self.without(fit, effect)
            if gain_and_t(without.loo_loss, fit.loo_loss)[1] < self.settings.gain.likely_t:
                return self._but(effect, fit)
        return self._but("", fit)

    def no_proxy(self, fit: Fit) -> list[float]:
        """Whether effects only stand in for structure of another kind.

        The structure that a model leaves is offered to it as free functions. An effect that is real still adds what it
        did; one that was a proxy of that structure adds little.
        """
        problem, settings = self.problem, self.settings.search
        left = [f for f in leftovers(problem, fit) if f.gain > threshold(problem, fit)]
        # what the effects have mostly taken up is their own law in another form, not another structure
        left = [f for f in left if f.gain > settings.taken_up * self.gain_before[f.group.key]][:2]
        if not left:
            return self._but("", fit)
        full = _loss_with(problem, fit, np.vstack([f.group.rows for f in left]))
        if full > fit.total:  # together they predict less
            left = left[:1]
            full = _loss_with(problem, fit, left[0].group.rows)
        kept = dict.fromkeys(self.causes(fit), np.inf)
        for effect in kept:
            without = self.without(fit, effect)
            # it explains nearly all, or is a term of eq. 14
            if fit.total < self.settings.rest.unreported * without.total or effect == self.expected:
                continue
            alone = without.total - fit.total
            # along the hysteresis without the effect: along its own they would have its shape
            groups = {group.key: group.rows for group in groups_along(problem, without)}
            gained = _loss_with(problem, without, np.vstack([groups[f.group.key] for f in left])) - full
            more = settings.kept / settings.kept_next_to_more if left[0].gain > 1.5 * alone else 1.0
            kept[effect] = gained / max(alone, 1e-9) * more
            if gained < threshold(problem, fit):
                kept[effect] = min(kept[effect], 0.0)
        return [share / settings.kept for share in kept.values()]

    def _but(self, weakest: str, fit: Fit) -> list[float]:
        """All effects of a model are certain but this one."""
        return [0.0 if effect == weakest else np.inf for effect in self.causes(fit)]


def _grow(models: Models, on: Fit, passing: Sequence[Candidate]) -> Fit:
    """Best of the models with one more effect, among candidates with at least half of the best first look's gain."""
    top = on.total - passing[0].total
    near = [c for c in passing if on.total - c.total > models.problem.settings.gain.half * top][:5]
    return _simplest(models.problem, [models.grown(on, c) for c in near], on)


def _simplest(problem: Problem, fits: list[Fit], on: Fit) -> Fit:
    """The best model, or a simpler one that predicts as well."""
    best = min(fits, key=attrgetter("total"))
    for fit in sorted(fits, key=lambda f: f.parameters.size):
        if fit.parameters.size < best.parameters.size and as_good(problem, fit, best, on):
            return fit
    return best


def _passing(models: Models, on: Fit, candidates: list[str]) -> list[Candidate]:
    """Candidates that would add enough to a model."""
    rest = [c for c in candidates if c not in on.effects]
    if not rest:
        return []
    found = models.screened(on, rest, hopeless=min(_needed(models, on, c) for c in rest))
    return [c for c in found if on.total - c.total > _needed(models, on, c.effect)]


def _worth(models: Models, fit: Fit) -> bool:
    """Whether each effect of a model adds enough to the others, as far as these were fitted alone."""
    for effect in fit.effects:
        rest = models.fits.get(tuple(e for e in fit.effects if e != effect))
        if rest is not None and rest.total - fit.total < _needed(models, fit, effect):
            return False
    return True


def _needed(models: Models, fit: Fit, effect: str) -> float:
    """Least gain of an effect on top of others: a law in a wrong form leaves a part of its gain for others to take up.

    The part is measured by the model's gain, or by all that it leaves if that is less; of a body without a device, by
    what it leaves above the noise (what a device's law has wrong may have been taken for noise). What drifts over the
    session is nobody else's wrong form.
    """
    problem, settings = models.problem, models.problem.settings.search
    part = settings.added_slowly if drifts(effect) else settings.added
    noise = fit.equations.count if problem.units["current"] == NO_INPUT and not problem.misfit else 0.0
    left = max(fit.total - noise, 0.0)
    return max(threshold(models.problem, fit), part * min(models.base.total - fit.total, left))


def _alternatives(
    models: Models, steps: LagOrDelay, screened: list[Candidate], candidates: list[str]
) -> tuple[dict[str, float], dict[str, tuple[str, ...]]]:
    """For each named effect: what it adds, and which others would do as well in its place."""
    final, gains, alternatives = steps.model, {}, {}
    for effect in models.added(final):
        without = models.without(final, effect)
        gains[effect] = without.total - final.total
        if without.effects != models.base.effects:
            screened = models.screened(without, [c for c in candidates if c not in final.effects])
        near = [c for c in screened if c.effect != effect and without.total - c.total > 0.6 * gains[effect]]
        fits = {c.effect: models.grown(without, c) for c in near[:4]}
        fits = models.swapped(final, effect) | fits  # all fits on the way, for any first look
        alternatives[effect] = tuple(
            name
            for name, fit in sorted(fits.items(), key=lambda kv: kv[1].total)
            if name != steps.excluded
            and not _never_recovers(fit, name)
            and not (CATALOGUE[name].contains == effect and fit.total > final.total)
            and ((name == steps.undecided and effect in (LAG, DELAY)) or as_good(models.problem, fit, final, without))
        )
    return gains, alternatives


def _never_recovers(fit: Fit, effect: str) -> bool:
    """Whether what recovers in a rest, as a drift with temperature does, would in none that the session could show."""
    ranges, values = fit.parameters.ranges, fit.parameters.values(fit.x)[effect]
    return any(values[p.name] > 0.5 * p.high(ranges) for p in CATALOGUE[effect].parameters if p.recovers)


def expected_in(problem: Problem) -> str:
    """The effect that takes the place of a term of eq. 14 which these data exclude; else empty."""
    absent = absent_from(problem.motion.ranges)
    return next((name for name, law in CATALOGUE.items() if law.in_place_of in absent), "")


def _loss_with(problem: Problem, fit: Fit, rows: np.ndarray) -> float:
    """Leave-one-out loss of a model with free functions next to it."""
    equations = problem.equations(
        [fit.slopes, rows, (problem.motion.torque - fit.torque)[None]], fit.torque, derivatives=True
    )
    size = len(fit.slopes)
    use = [*fit.free, *range(size, size + len(rows))]
    return float(losses(equations, use, size + len(rows), ridge=1e-7)[2].sum())


def drift_p_value(problem: Problem, fit: Fit, without: Fit) -> float:
    """Chance that factors of trajectories in random order would follow what an effect predicts as closely.

    ``fit`` is the model with the effect, ``without`` the model refitted without it.
    """
    needed, predicted, weight = [], [], []
    for part in problem.motion.parts:
        tau = without.torque[part] - without.torque[part].mean()
        size = float(tau @ tau)
        if size <= 0.0:
            continue
        needed.append(float(tau @ (problem.motion.torque[part] - without.torque[part])) / size)
        predicted.append(float(tau @ (fit.torque[part] - without.torque[part])) / size)
        weight.append(np.sqrt(size))
    y, x = np.array(needed) * weight, np.array(predicted) * weight
    free = len(x) - 1 - sum(slot.effect not in without.effects for slot in fit.parameters.slots)
    power = float(x @ x)
    if free < 1 or power <= 0.0:
        return 1.0
    slope = float(x @ y) / power
    error = np.sqrt(float(((y - slope * x) ** 2).sum()) / free / power)
    return float(stats.t.sf(slope / max(error, 1e-300), free))


def gain_within_runs(problem: Problem, fit: Fit, without: Fit) -> float:
    """Gain of an effect on top of an offset and a factor for each trajectory, in units of the noise's variance."""
    torque = problem.motion.torque
    rows = np.stack([torque - without.torque, torque - fit.torque, without.torque, np.ones(len(torque))])
    rows = problem.noise.white(rows) * problem.weight
    gain = 0.0
    for part in problem.motion.parts:
        here = rows[:, part]
        basis = np.linalg.qr(here[2:].T)[0]
        left = here[:2] - (here[:2] @ basis) @ basis.T
        gain += float(left[0] @ left[0] - left[1] @ left[1])
    return gain
