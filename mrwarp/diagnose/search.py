"""Which effects to name: candidates, singles, pairs, what must be dropped again, and what would do as well."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from operator import attrgetter

from mrwarp.diagnose.confounders import confirmed
from mrwarp.diagnose.lag_or_delay import LagOrDelay, decided_by_steps
from mrwarp.diagnose.problem import Fit, Problem, as_good, drifts, threshold
from mrwarp.diagnose.residual_structure import Leftover, leftovers
from mrwarp.diagnose.screening import Candidate, Models, screen
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.projection import Progress

_ADDED, _ADDED_SLOWLY = 0.13, 0.06
"""Part of the gain so far that one more effect must add."""
_MOST = 3
"""Most effects that are named together."""


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
    """What each named effect adds to the others."""
    alternatives: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Effects that would do as well in a named one's place."""
    refined: Mapping[tuple[str, str], tuple[float, float, float]] = field(default_factory=dict)
    """Parameters, and their intervals, that single events give better than the fit; normalised units."""

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
    return screen(problem, base, candidates, hopeless=0.3 * threshold(base))


def best_single(problem: Problem, base: Fit, screened: list[Candidate]) -> Fit | None:
    """The best model with one more effect, if any gains enough: a first guess, to learn the noise without it."""
    if not screened or base.total - screened[0].total < threshold(base):
        return None
    return Models(problem, base).grown(base, screened[0])


def select(problem: Problem, base: Fit, screened: list[Candidate], log: Progress = lambda text: None) -> Selection:
    """Search the effects that explain a data set, among those that :func:`screen_candidates` looked at."""
    candidates = [c.effect for c in screened]
    models, before = Models(problem, base), leftovers(problem, base)
    best = _best_model(models, screened, before, log)
    if best is base:
        return Selection(base=base, final=base, screened=screened, fits=models.fits, leftovers=before)
    steps = decided_by_steps(models, best, candidates)
    own_gain, alternatives = _alternatives(models, steps, screened, candidates)
    return Selection(
        base=base,
        final=steps.model,
        screened=screened,
        fits=models.fits,
        leftovers=leftovers(problem, steps.model),
        own_gain=own_gain,
        alternatives=alternatives,
        refined=steps.refined,
    )


def _best_model(models: Models, screened: list[Candidate], before: list[Leftover], log: Progress) -> Fit:
    """The best model whose effects are all worth their place and no confounders; the baseline if there is none."""
    base, candidates = models.base, [c.effect for c in screened]
    passing = [c for c in screened if base.total - c.total > threshold(base)]
    if not passing:
        return base
    log(f"refining {', '.join(c.effect for c in passing[:4])}")
    best = _grow(models, base, passing)
    if confirmed(models, best, before) is base:
        # smooth functions of other variables explain it better: the search for partners would only fit them piecemeal
        others = [f for f in models.singles() if f is not best and confirmed(models, f, before) is not base]
        if not others:
            return base
        best = min(others, key=attrgetter("total"))
    seconds = _passing(models, best, candidates)
    if seconds:
        log(f"pairs: {' + '.join(best.effects)} with {', '.join(c.effect for c in seconds[:3])}")
        best = _best_pair(models, passing, candidates, best, seconds)
        thirds = _passing(models, best, candidates)
        if thirds and len(models.added(best)) < _MOST:
            grown = _grow(models, best, thirds[:3])
            if _worth(models, grown):
                best = grown
    return confirmed(models, _pruned(models, best), before)


def _grow(models: Models, on: Fit, passing: list[Candidate]) -> Fit:
    """Best of the models with one more effect, among candidates with at least half of the best first look's gain."""
    top = on.total - passing[0].total
    near = [c for c in passing if on.total - c.total > 0.5 * top][:5]
    return _simplest([models.grown(on, c) for c in near], on)


def _simplest(fits: list[Fit], on: Fit) -> Fit:
    """The best model, or a simpler one that predicts as well."""
    best = min(fits, key=attrgetter("total"))
    for fit in sorted(fits, key=lambda f: f.parameters.size):
        if fit.parameters.size < best.parameters.size and as_good(fit, best, on):
            return fit
    return best


def _passing(models: Models, on: Fit, candidates: list[str]) -> list[Candidate]:
    """Candidates that would add enough to a model."""
    rest = [c for c in candidates if c not in on.effects]
    if not rest:
        return []
    found = screen(models.problem, on, rest, hopeless=min(_needed(models, on, c) for c in rest))
    return [c for c in found if on.total - c.total > _needed(models, on, c.effect)]


def _best_pair(
    models: Models, passing: list[Candidate], candidates: list[str], best: Fit, seconds: list[Candidate]
) -> Fit:
    """Best pair: the best single may be neither cause, so the three best singles each look for a partner."""
    pairs = [models.grown(best, c) for c in seconds[:3]]
    others = [f for f in sorted(models.singles(), key=attrgetter("total")) if f is not best][:2]
    if len(others) < 2:
        known = {*best.effects, *(e for f in others for e in f.effects)}
        others += [models.grown(models.base, c) for c in passing if c.effect not in known][: 2 - len(others)]
    for single in others:
        pairs += [models.grown(single, c) for c in _passing(models, single, candidates)[:2]]
    pair = _simplest(pairs, best)
    return pair if best.total - pair.total > threshold(best) else best


def _pruned(models: Models, best: Fit) -> Fit:
    """The model without effects that add too little to the others."""
    while len(models.added(best)) > 1:
        without = {effect: models.without(best, effect) for effect in models.added(best)}
        weakest = min(without, key=lambda e: without[e].total)
        if without[weakest].total - best.total > _needed(models, best, weakest):
            break
        best = without[weakest]
    return best


def _worth(models: Models, fit: Fit) -> bool:
    """Whether each effect of a model adds enough to the others, as far as these were fitted alone."""
    for effect in fit.effects:
        rest = models.fits.get(tuple(e for e in fit.effects if e != effect))
        if rest is not None and rest.total - fit.total < _needed(models, fit, effect):
            return False
    return True


def _needed(models: Models, fit: Fit, effect: str) -> float:
    """What an effect must add to others: a law in a wrong form leaves a part of its gain for others to take up.

    The part is measured by the model's gain, or by all that it leaves if that is less. What drifts over the session is
    nobody else's wrong form.
    """
    part = _ADDED_SLOWLY if drifts(effect) else _ADDED
    return max(threshold(fit), part * min(models.base.total - fit.total, fit.total))


def _alternatives(
    models: Models, steps: LagOrDelay, screened: list[Candidate], candidates: list[str]
) -> tuple[dict[str, float], dict[str, tuple[str, ...]]]:
    """For each named effect: what it adds, and which others would do as well in its place.

    Stribeck friction whose speed lies beyond the recorded ones is Coulomb friction, with one number more: where it
    does not even predict better it is no alternative.
    """
    final, gains, alternatives = steps.model, {}, {}
    for effect in models.added(final):
        without = models.without(final, effect)
        gains[effect] = without.total - final.total
        if without.effects != models.base.effects:
            screened = screen(models.problem, without, [c for c in candidates if c not in final.effects])
        near = [c for c in screened if c.effect != effect and without.total - c.total > 0.6 * gains[effect]]
        fits = {c.effect: models.grown(without, c) for c in near[:4]}
        for effects, fit in models.fits.items():  # what was fitted on the way, whatever its first look
            other = set(effects) - set(without.effects)
            if len(other) == 1 and len(effects) == len(without.effects) + 1 and effect not in other:
                fits.setdefault(other.pop(), fit)
        alternatives[effect] = tuple(
            name
            for name, fit in sorted(fits.items(), key=lambda kv: kv[1].total)
            if name != steps.excluded
            and not _worn(fit, name)
            and not (effect == "coulomb_friction" and name == "stribeck" and fit.total > final.total)
            and (name == steps.undecided or as_good(fit, final, without))
        )
    return gains, alternatives


def _worn(fit: Fit, effect: str) -> bool:
    """Whether a drift with temperature recovers in no rest: then it is wear under another name."""
    if effect != "temperature_drift":
        return False
    slow = next(p for p in CATALOGUE[effect].parameters if p.name == "time_constant")
    return fit.parameters.values(fit.x)[effect][slow.name] > 0.5 * slow.high(fit.parameters.ranges)
