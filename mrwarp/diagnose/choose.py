"""Which effects to name: candidates, pairs, rivals, and what is left when they are in.

All figures are held-out: a trajectory counts by how well the others foretell it. They are in units of the noise's
variance, after whitening and with offsets and factors of trajectories taken out, so a gain compares with chi-squared.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mrwarp.diagnose.between import drift_p_value, gain_within
from mrwarp.diagnose.edges import DELAY, LAG, find_edges, size_from, told_apart
from mrwarp.diagnose.engine import Candidate, Engine, Fitted
from mrwarp.diagnose.features import Group
from mrwarp.diagnose.grams import losses
from mrwarp.effects.catalogue import CATALOGUE

FLOOR = 0.003
"""Smallest gain that is worth a name, as a share of the noise's energy: the replay's own step errs by about as much."""
CHI2 = 30.0
"""Smallest gain in units of the noise's variance: one chance in a million over a hundred starts."""
KEPT, KEPT_BESIDE_MORE = 0.35, 0.5
"""Part of an effect's gain that must remain beside free functions of what it leaves, the latter if that is more."""
WITHIN = 60.0
"""Gain within trajectories, in units of the noise's variance, below which an effect must show between them."""
DRIFT_P = 1e-3
"""Largest chance at which an effect that only shows between trajectories is believed."""
_NEAR = 0.15
"""Part of an effect's gain by which its like may be behind, and single events still decide between them."""
_ADDED, _ADDED_SLOWLY = 0.13, 0.06
"""Part of the gain so far that one more effect must add."""
_MOST = 3
"""Most effects that are named together."""


@dataclass(frozen=True)
class Leftover:
    """Structure that a model leaves: one group of features and what it would gain, held-out."""

    group: Group
    gain: float
    t: float
    """Gain over its standard error over trajectories."""


@dataclass
class Choice:
    """The outcome of the search for causes."""

    base: Fitted
    final: Fitted
    first_look: list[Candidate]
    """Every candidate on top of the baseline."""
    fits: dict[tuple[str, ...], Fitted] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    own_gain: dict[str, float] = field(default_factory=dict)
    """What each named effect adds to the others."""
    kept: dict[str, float] = field(default_factory=dict)
    """Part of each effect's gain that remains beside free functions of what is left."""
    settled: set[str] = field(default_factory=set)
    """Effects that are no alternative to a similar one, because single events tell."""
    untold: set[str] = field(default_factory=set)
    """Effects that are an alternative to a similar one, whatever the fits say."""
    refined: dict[tuple[str, str], tuple[float, float, float]] = field(default_factory=dict)
    """Parameters, and their intervals, that single events give better than the fit; inner units."""
    left_before: list[Leftover] = field(default_factory=list)
    left_after: list[Leftover] = field(default_factory=list)

    @property
    def gain(self) -> float:
        """Held-out gain of the final model."""
        return _total(self.base) - _total(self.final)


def threshold(fit: Fitted) -> float:
    """Gain below which nothing is named."""
    return max(CHI2, FLOOR * fit.grams.count)


def choose(
    engine: Engine,
    base: Fitted,
    groups_of: Callable[[Fitted], list[Group]],
    candidates: list[str],
    told: Callable[[str], None] = lambda text: None,
) -> Choice:
    """Search the effects that explain a data set."""
    look = engine.screen(base, candidates, hopeless=0.3 * threshold(base))
    choice = Choice(base=base, final=base, first_look=look)
    choice.fits[base.effects] = base
    choice.left_before = leftovers(engine, base, groups_of(base))
    passing = [c for c in look if _total(base) - float(c.left_out.sum()) > threshold(base)]
    if not passing:
        choice.left_after = choice.left_before
        return choice
    told(f"refining {', '.join(c.effect for c in passing[:4])}")
    best = _grow(engine, choice, base, passing)
    if _believed(engine, choice, best, groups_of) is base:
        # smooth functions of other variables explain it better: the search for partners would only fit them piecemeal
        others = [f for f in choice.fits.values() if len(f.effects) == len(base.effects) + 1 and f is not best]
        others = [f for f in others if _believed(engine, choice, f, groups_of) is not base]
        if not others:
            choice.left_after = choice.left_before
            return choice
        best = min(others, key=_total)
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
    best = _believed(engine, choice, best, groups_of)
    choice.final = best = _timed(engine, choice, best, candidates)
    _rivals(engine, choice, best, candidates)
    choice.left_after = leftovers(engine, best, groups_of(best))
    return choice


def best_single(engine: Engine, base: Fitted, candidates: list[str]) -> Fitted | None:
    """The best model with one more effect, if any gains enough: a first guess, to learn the noise without it."""
    look = engine.screen(base, candidates, hopeless=threshold(base))
    if not look or _total(base) - float(look[0].left_out.sum()) < threshold(base):
        return None
    return _full(engine, Choice(base=base, final=base, first_look=look), base, look[0])


def leftovers(engine: Engine, fit: Fitted, groups: list[Group]) -> list[Leftover]:
    """What each group of features would gain on top of a model, best first."""
    rows = np.vstack([fit.slopes, *(g.rows for g in groups), (engine.samples.torque - fit.torque)[None]])
    table = engine.grams(rows, fit.torque)
    size, at, found = len(fit.slopes), len(fit.slopes), []
    for group in groups:
        use = [*range(size), *range(at, at + len(group.rows))]
        _, _, outside = losses(table, use, len(rows) - 1, ridge=1e-7)
        found.append(Leftover(group, *_gain(fit.left_out, outside)))
        at += len(group.rows)
    return sorted(found, key=lambda f: -f.gain)


def _gain(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Sum of the differences and its ratio to its standard error."""
    d = before - after
    error = float(np.std(d, ddof=1) * np.sqrt(len(d))) if len(d) > 1 else float("inf")
    return float(d.sum()), float(d.sum()) / max(error, 1e-12)


def _total(fit: Fitted) -> float:
    return float(fit.left_out.sum())


def _full(engine: Engine, choice: Choice, on: Fitted, candidate: Candidate) -> Fitted:
    """Everything searched together: a model plus a candidate."""
    c = engine.coordinates((*on.effects, candidate.effect), {**on.coordinates.choices, **candidate.choices})
    if c.effects in choice.fits:
        return choice.fits[c.effects]
    x = on.coordinates.grown(on.x, c.effects)
    own = [i for i, s in enumerate(c.slots, start=9) if s.effect == candidate.effect]
    x[own] = candidate.values
    choice.fits[c.effects] = engine.fit(c, x)
    return choice.fits[c.effects]


def _grow(engine: Engine, choice: Choice, on: Fitted, passing: list[Candidate]) -> Fitted:
    """Best of the models with one more effect, among candidates with at least half of the best first look's gain."""
    top = _total(on) - float(passing[0].left_out.sum())
    near = [c for c in passing if _total(on) - float(c.left_out.sum()) > 0.5 * top][:5]
    fits = [_full(engine, choice, on, c) for c in near]
    return _simplest(fits, on)


def _simplest(fits: list[Fitted], on: Fitted) -> Fitted:
    """The best model, or a simpler one that foretells as well."""
    best = min(fits, key=_total)
    for fit in sorted(fits, key=lambda f: f.coordinates.size):
        if fit.coordinates.size < best.coordinates.size and _as_good(fit, best, on):
            return fit
    return best


def _as_good(fit: Fitted, best: Fitted, base: Fitted) -> bool:
    """Whether a model cannot be told from a better one, by what both gain on a base."""
    loss, t = _gain(fit.left_out, best.left_out)
    own = _total(base) - _total(best)
    if all(_drifts(e) for e in set(fit.effects) ^ set(best.effects)):
        return loss < 12.0 or (t < 2.0 and loss < 0.05 * own)  # what drifts is told by trajectories, not by samples
    return loss < 12.0 or (t < 1.5 and loss < 0.01 * own)


def _passing(engine: Engine, choice: Choice, on: Fitted, candidates: list[str]) -> list[Candidate]:
    """Candidates that would add enough to a model."""
    total = _scale(choice, on)
    rest = [c for c in candidates if c not in on.effects]
    look = engine.screen(on, rest, hopeless=max(threshold(on), min(_part(c) for c in rest) * total)) if rest else []
    return [c for c in look if _total(on) - float(c.left_out.sum()) > max(threshold(on), _part(c.effect) * total)]


def _scale(choice: Choice, fit: Fitted) -> float:
    """What a further effect's gain is measured by: the model's gain, or all that it leaves if that is less."""
    return min(_total(choice.base) - _total(fit), _total(fit))


def _part(effect: str) -> float:
    """Part of the whole gain that an effect must add: a law in a wrong form leaves as much for others to take up.

    What drifts over the session is nobody else's wrong form.
    """
    return _ADDED_SLOWLY if _drifts(effect) else _ADDED


def _drifts(effect: str) -> bool:
    return "time" in CATALOGUE[effect].depends_on


def _worth(choice: Choice, fit: Fitted) -> bool:
    """Whether each effect of a model adds enough to the others."""
    total = _scale(choice, fit)
    for effect in fit.effects:
        rest = tuple(e for e in fit.effects if e != effect)
        if rest in choice.fits and _total(choice.fits[rest]) - _total(fit) < max(threshold(fit), _part(effect) * total):
            return False
    return True


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
    pairs = [_full(engine, choice, best, c) for c in seconds[:3]]
    singles = sorted((f for f in choice.fits.values() if len(f.effects) == len(base.effects) + 1), key=_total)
    others = [f for f in singles if f is not best][:2]
    if len(others) < 2:
        others += [
            _full(engine, choice, base, c)
            for c in passing
            if c.effect not in {*best.effects, *(e for f in others for e in f.effects)}
        ][: 2 - len(others)]
    for single in others:
        partners = _passing(engine, choice, single, candidates)
        pairs += [_full(engine, choice, single, c) for c in partners[:2]]
    pair = _simplest(pairs, best)
    return pair if _total(best) - _total(pair) > threshold(best) else best


def _pruned(engine: Engine, choice: Choice, best: Fitted) -> Fitted:
    """The model without effects that add too little to the others."""
    while len(best.effects) > len(choice.base.effects) + 1:
        without = {}
        for effect in best.effects:
            if effect in choice.base.effects:
                continue
            without[effect] = _without(engine, choice, best, effect)
        total = _scale(choice, best)
        weakest = min(without, key=lambda e: _total(without[e]))
        add = _total(without[weakest]) - _total(best)
        if add > max(threshold(best), _part(weakest) * total):
            break
        best = without[weakest]
    return best


def _believed(engine: Engine, choice: Choice, fit: Fitted, groups_of: Callable[[Fitted], list[Group]]) -> Fitted:
    """The model without effects that only stand in for structure of another kind.

    Whatever structure a model leaves is offered to it as free functions. An effect that is real still adds what it
    did; one that was a poor man's version of that structure adds little.
    """
    fit = _not_by_chance(engine, choice, fit)
    while fit is not choice.base:
        before = {(f.group.variables, f.group.form): f.gain for f in choice.left_before}
        left = [f for f in leftovers(engine, fit, groups_of(fit)) if f.gain > threshold(fit)]
        # what the effects have mostly taken up is their own law in another form, not another structure
        left = [f for f in left if f.gain > 0.3 * before[f.group.variables, f.group.form]][:2]
        if not left:
            return fit
        offered = np.vstack([f.group.rows for f in left])
        full = _with_rows(engine, fit, offered)
        kept: dict[str, float] = {}
        for effect in fit.effects:
            if effect in choice.base.effects:
                continue
            without = _without(engine, choice, fit, effect)
            alone = _total(without) - _total(fit)
            beside = _with_rows(engine, without, offered) - full
            kept[effect] = beside / max(alone, 1e-9)
            if left[0].gain > 1.5 * alone:
                kept[effect] *= KEPT / KEPT_BESIDE_MORE
            if beside < threshold(fit):
                kept[effect] = min(kept[effect], 0.0)
        choice.kept = kept
        doubtful = min(kept, key=lambda e: kept[e])
        if kept[doubtful] > KEPT:
            return fit
        fit = choice.fits[tuple(e for e in fit.effects if e != doubtful)]
    return fit


def _not_by_chance(engine: Engine, choice: Choice, fit: Fitted) -> Fitted:
    """The model without effects that may only follow offsets and factors of the trajectories by chance."""
    for effect in fit.effects:
        if effect in choice.base.effects:
            continue
        without = _without(engine, choice, fit, effect)
        if gain_within(engine, fit, without) < max(WITHIN, 0.5 * threshold(fit)):
            if drift_p_value(engine, fit, without) > DRIFT_P:
                return _not_by_chance(engine, choice, without)
    return fit


def _without(engine: Engine, choice: Choice, fit: Fitted, effect: str) -> Fitted:
    """The model refitted without one of its effects."""
    rest = tuple(e for e in fit.effects if e != effect)
    if rest not in choice.fits:
        choice.fits[rest] = _refit_without(engine, fit, effect)
    return choice.fits[rest]


def _with_rows(engine: Engine, fit: Fitted, rows: np.ndarray) -> float:
    """Held-out loss of a model with free functions beside it."""
    table = engine.grams(np.vstack([fit.slopes, rows, (engine.samples.torque - fit.torque)[None]]), fit.torque)
    size = len(fit.slopes) + len(rows)
    return float(losses(table, list(range(size)), size, ridge=1e-7)[2].sum())


def _refit_without(engine: Engine, fit: Fitted, effect: str) -> Fitted:
    c = engine.coordinates([e for e in fit.effects if e != effect], fit.coordinates.choices)
    values = {(s.effect, s.parameter.name): v for s, v in zip(fit.coordinates.slots, fit.x[9:], strict=True)}
    x = np.array([*fit.x[:9], *(values[s.effect, s.parameter.name] for s in c.slots)])
    return engine.fit(c, x)


def _timed(engine: Engine, choice: Choice, final: Fitted, candidates: list[str]) -> Fitted:
    """The model with whichever of lag and delay the single steps of the command speak for."""
    named = [e for e in (LAG, DELAY) if e in final.effects and e not in choice.base.effects]
    if len(named) != 1:
        return final
    other = DELAY if named[0] == LAG else LAG
    without = _without(engine, choice, final, named[0])
    look = engine.screen(without, [other]) if other in candidates else []
    if not look:
        return final
    rival = _full(engine, choice, without, look[0])
    behind = (_total(rival) - _total(final)) / max(_total(without) - _total(final), 1e-9)
    if behind > _NEAR:
        return final
    edges = find_edges(engine, final if named[0] == LAG else rival)
    told = told_apart(edges) if edges is not None else None
    if edges is None or told is None:  # neither law knows when the command changed: their fits do not decide
        choice.untold.add(other)
        return final
    choice.settled.add(DELAY if told == LAG else LAG)
    if told == DELAY:
        size = size_from(edges, DELAY)
        if size[0] < 2.0 * edges.dt:  # the fit has a delay of parts of a sample as a mean of two samples
            choice.refined[DELAY, CATALOGUE[DELAY].parameters[0].name] = size
    return final if told == named[0] else rival


def _worn(engine: Engine, fit: Fitted, effect: str) -> bool:
    """Whether a drift with temperature recovers in no rest: then it is wear under another name."""
    if effect != "temperature_drift":
        return False
    slow = next(p for p in CATALOGUE[effect].parameters if p.name == "time_constant")
    return fit.coordinates.values(fit.x)[effect][slow.name] > 0.5 * slow.high(engine.motion.ranges)


def _rivals(engine: Engine, choice: Choice, final: Fitted, candidates: list[str]) -> None:
    """For each named effect: what it adds, and which others would do as well in its place.

    Stribeck friction whose speed lies beyond the recorded ones is Coulomb friction, with one number more: where it
    does not even foretell better it is no alternative.
    """
    for effect in final.effects:
        if effect in choice.base.effects:
            continue
        without = _without(engine, choice, final, effect)
        add = _total(without) - _total(final)
        choice.own_gain[effect] = add
        if without.effects == choice.base.effects:
            look = choice.first_look
        else:
            look = engine.screen(without, [c for c in candidates if c not in final.effects])
        close = [
            c for c in look
            if c.effect != effect and _total(without) - float(c.left_out.sum()) > 0.6 * add
        ][:4]  # fmt: skip
        fits = {c.effect: _full(engine, choice, without, c) for c in close}
        for effects, fit in choice.fits.items():  # what was fitted on the way, whatever its first look
            other = set(effects) - set(without.effects)
            if len(other) == 1 and len(effects) == len(without.effects) + 1 and effect not in other:
                fits.setdefault(other.pop(), fit)
        choice.alternatives[effect] = tuple(
            name
            for name, fit in sorted(fits.items(), key=lambda kv: _total(kv[1]))
            if name not in choice.settled
            and not _worn(engine, fit, name)
            and not (effect == "coulomb_friction" and name == "stribeck" and _total(fit) > _total(final))
            and (name in choice.untold or _as_good(fit, final, without))
        )
