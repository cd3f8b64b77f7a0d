"""Which other effects would do as well in a named one's place, and what single events say about them."""

from __future__ import annotations

from mrwarp.diagnose.choice import Choice, as_good
from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.diagnose.step_response import DELAY, LAG, find_edges, size_from, told_apart
from mrwarp.effects.catalogue import CATALOGUE

_NEAR = 0.7
"""Part of an effect's gain by which its like may be behind, and single events still decide between them.

Wide, since each step falls where it likes between two samples: with few steps the fits' difference is their luck.
"""


def timed(engine: Engine, choice: Choice, final: Fitted, candidates: list[str]) -> Fitted:
    """The model with whichever of lag and delay the single steps of the command speak for."""
    named = [e for e in (LAG, DELAY) if e in choice.own(final)]
    if len(named) != 1:
        return final
    other = DELAY if named[0] == LAG else LAG
    without = choice.without(engine, final, named[0])
    look = engine.screen(without, [other]) if other in candidates else []
    if not look:
        return final
    rival = choice.full(engine, without, look[0])
    behind = (rival.total - final.total) / max(without.total - final.total, 1e-9)
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


def find_rivals(engine: Engine, choice: Choice, final: Fitted, candidates: list[str]) -> None:
    """For each named effect: what it adds, and which others would do as well in its place.

    Stribeck friction whose speed lies beyond the recorded ones is Coulomb friction, with one number more: where it
    does not even foretell better it is no alternative.
    """
    for effect in choice.own(final):
        without = choice.without(engine, final, effect)
        add = without.total - final.total
        choice.own_gain[effect] = add
        if without.effects == choice.base.effects:
            look = choice.first_look
        else:
            look = engine.screen(without, [c for c in candidates if c not in final.effects])
        close = [
            c for c in look
            if c.effect != effect and without.total - c.total > 0.6 * add
        ][:4]  # fmt: skip
        fits = {c.effect: choice.full(engine, without, c) for c in close}
        for effects, fit in choice.fits.items():  # what was fitted on the way, whatever its first look
            other = set(effects) - set(without.effects)
            if len(other) == 1 and len(effects) == len(without.effects) + 1 and effect not in other:
                fits.setdefault(other.pop(), fit)
        choice.alternatives[effect] = tuple(
            name
            for name, fit in sorted(fits.items(), key=lambda kv: kv[1].total)
            if name not in choice.settled
            and not _worn(engine, fit, name)
            and not (effect == "coulomb_friction" and name == "stribeck" and fit.total > final.total)
            and (name in choice.untold or as_good(fit, final, without))
        )


def _worn(engine: Engine, fit: Fitted, effect: str) -> bool:
    """Whether a drift with temperature recovers in no rest: then it is wear under another name."""
    if effect != "temperature_drift":
        return False
    slow = next(p for p in CATALOGUE[effect].parameters if p.name == "time_constant")
    return fit.coordinates.values(fit.x)[effect][slow.name] > 0.5 * slow.high(engine.motion.ranges)
