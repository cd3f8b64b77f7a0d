"""Which effects to name: candidates, singles, pairs, and what must be dropped again."""

from __future__ import annotations

from collections.abc import Callable
from operator import attrgetter

from mrwarp.diagnose.choice import Choice, as_good, drifts, leftovers, threshold
from mrwarp.diagnose.confounders import believed
from mrwarp.diagnose.engine import Candidate, Engine, Fitted
from mrwarp.diagnose.features import Group
from mrwarp.diagnose.rivals import find_rivals, timed

_ADDED, _ADDED_SLOWLY = 0.13, 0.06
"""Part of the gain so far that one more effect must add."""
_MOST = 3
"""Most effects that are named together."""


def choose(
    engine: Engine,
    base: Fitted,
    groups_of: Callable[[Fitted], list[Group]],
    look: list[Candidate],
    told: Callable[[str], None] = lambda text: None,
) -> Choice:
    """Search the effects that explain a data set.

    Args:
        engine: The data set.
        base: The baseline, fitted.
        groups_of: Groups of features along a model.
        look: :func:`first_look` at the candidates on top of the baseline.
        told: Told what is being done.
    """
    candidates = [c.effect for c in look]
    choice = Choice(base=base, final=base, first_look=look)
    choice.fits[base.effects] = base
    choice.left_before = leftovers(engine, base, groups_of(base))
    passing = [c for c in look if base.total - c.total > threshold(base)]
    if not passing:
        choice.left_after = choice.left_before
        return choice
    told(f"refining {', '.join(c.effect for c in passing[:4])}")
    best = _grow(engine, choice, base, passing)
    if believed(engine, choice, best, groups_of) is base:
        # smooth functions of other variables explain it better: the search for partners would only fit them piecemeal
        others = [f for f in choice.singles() if f is not best and believed(engine, choice, f, groups_of) is not base]
        if not others:
            choice.left_after = choice.left_before
            return choice
        best = min(others, key=attrgetter("total"))
    seconds = _passing(engine, choice, best, candidates)
    if seconds:
        told(f"pairs: {' + '.join(best.effects)} with {', '.join(c.effect for c in seconds[:3])}")
        best = _pairs(engine, choice, base, passing, candidates, best, seconds)
        thirds = _passing(engine, choice, best, candidates)
        if thirds and len(best.effects) - len(base.effects) < _MOST:
            grown = _grow(engine, choice, best, thirds[:3])
            if _worth(choice, grown):
                best = grown
    best = _pruned(engine, choice, best)
    best = believed(engine, choice, best, groups_of)
    choice.final = best = timed(engine, choice, best, candidates)
    find_rivals(engine, choice, best, candidates)
    choice.left_after = leftovers(engine, best, groups_of(best))
    return choice


def first_look(engine: Engine, base: Fitted, candidates: list[str]) -> list[Candidate]:
    """Every candidate on top of the baseline, best first."""
    return engine.screen(base, candidates, hopeless=0.3 * threshold(base))


def best_single(engine: Engine, base: Fitted, look: list[Candidate]) -> Fitted | None:
    """The best model with one more effect, if any gains enough: a first guess, to learn the noise without it."""
    if not look or base.total - look[0].total < threshold(base):
        return None
    return Choice(base=base, final=base, first_look=look).full(engine, base, look[0])


def _grow(engine: Engine, choice: Choice, on: Fitted, passing: list[Candidate]) -> Fitted:
    """Best of the models with one more effect, among candidates with at least half of the best first look's gain."""
    top = on.total - passing[0].total
    near = [c for c in passing if on.total - c.total > 0.5 * top][:5]
    fits = [choice.full(engine, on, c) for c in near]
    return _simplest(fits, on)


def _simplest(fits: list[Fitted], on: Fitted) -> Fitted:
    """The best model, or a simpler one that foretells as well."""
    best = min(fits, key=attrgetter("total"))
    for fit in sorted(fits, key=lambda f: f.coordinates.size):
        if fit.coordinates.size < best.coordinates.size and as_good(fit, best, on):
            return fit
    return best


def _passing(engine: Engine, choice: Choice, on: Fitted, candidates: list[str]) -> list[Candidate]:
    """Candidates that would add enough to a model."""
    rest = [c for c in candidates if c not in on.effects]
    if not rest:
        return []
    look = engine.screen(on, rest, hopeless=min(_needed(choice, on, c) for c in rest))
    return [c for c in look if on.total - c.total > _needed(choice, on, c.effect)]


def _pairs(
    engine: Engine,
    choice: Choice,
    base: Fitted,
    passing: list[Candidate],
    candidates: list[str],
    best: Fitted,
    seconds: list[Candidate],
) -> Fitted:
    """Best pair: the best single may be neither cause, so the three best singles each look for a partner."""
    pairs = [choice.full(engine, best, c) for c in seconds[:3]]
    others = [f for f in sorted(choice.singles(), key=attrgetter("total")) if f is not best][:2]
    if len(others) < 2:
        others += [
            choice.full(engine, base, c)
            for c in passing
            if c.effect not in {*best.effects, *(e for f in others for e in f.effects)}
        ][: 2 - len(others)]
    for single in others:
        partners = _passing(engine, choice, single, candidates)
        pairs += [choice.full(engine, single, c) for c in partners[:2]]
    pair = _simplest(pairs, best)
    return pair if best.total - pair.total > threshold(best) else best


def _pruned(engine: Engine, choice: Choice, best: Fitted) -> Fitted:
    """The model without effects that add too little to the others."""
    while len(best.effects) > len(choice.base.effects) + 1:
        without = {effect: choice.without(engine, best, effect) for effect in choice.own(best)}
        weakest = min(without, key=lambda e: without[e].total)
        if without[weakest].total - best.total > _needed(choice, best, weakest):
            break
        best = without[weakest]
    return best


def _worth(choice: Choice, fit: Fitted) -> bool:
    """Whether each effect of a model adds enough to the others."""
    for effect in fit.effects:
        rest = tuple(e for e in fit.effects if e != effect)
        if rest in choice.fits and choice.fits[rest].total - fit.total < _needed(choice, fit, effect):
            return False
    return True


def _needed(choice: Choice, fit: Fitted, effect: str) -> float:
    """What an effect must add to others: a law in a wrong form leaves a part of its gain for others to take up.

    The part is measured by the model's gain, or by all that it leaves if that is less. What drifts over the session is
    nobody else's wrong form.
    """
    part = _ADDED_SLOWLY if drifts(effect) else _ADDED
    return max(threshold(fit), part * min(choice.base.total - fit.total, fit.total))
