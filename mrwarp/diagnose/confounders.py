"""Whether named effects are real, or stand in for structure of another kind or for chance."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mrwarp.diagnose.between_run import drift_p_value, gain_within
from mrwarp.diagnose.choice import Choice, gain_and_t, leftovers, threshold
from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.diagnose.features import Group
from mrwarp.identify.normal_equations import losses

KEPT, KEPT_BESIDE_MORE = 0.35, 0.5
"""Part of an effect's gain that must remain beside free functions of what it leaves, the latter if that is more."""
WITHIN = 60.0
"""Gain within trajectories, in units of the noise's variance, below which an effect must show between them."""
DRIFT_P = 1e-3
"""Largest chance at which an effect that only shows between trajectories is believed."""
EDGE_T = 2.0
"""Least ratio of a gain to its standard error over trajectories, of an effect at the edge of its range."""


def believed(engine: Engine, choice: Choice, fit: Fitted, groups_of: Callable[[Fitted], list[Group]]) -> Fitted:
    """The model without effects that only stand in for structure of another kind.

    Whatever structure a model leaves is offered to it as free functions. An effect that is real still adds what it
    did; one that was a poor man's version of that structure adds little.
    """
    fit = _inside(engine, choice, _not_by_chance(engine, choice, fit))
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
        for effect in choice.own(fit):
            without = choice.without(engine, fit, effect)
            alone = without.total - fit.total
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
        fit = choice.without(engine, fit, doubtful)
    return fit


def _not_by_chance(engine: Engine, choice: Choice, fit: Fitted) -> Fitted:
    """The model without effects that may only follow offsets and factors of the trajectories by chance."""
    for effect in choice.own(fit):
        without = choice.without(engine, fit, effect)
        if gain_within(engine, fit, without) < max(WITHIN, 0.5 * threshold(fit)):
            if drift_p_value(engine, fit, without) > DRIFT_P:
                return _not_by_chance(engine, choice, without)
    return fit


def _inside(engine: Engine, choice: Choice, fit: Fitted) -> Fitted:
    """The model without effects that end at the edge of their range and show in a few trajectories only.

    An effect that would be more itself beyond what makes sense for it is another structure's poor man's version.
    """
    for effect in choice.own(fit):
        c = fit.coordinates
        room = np.minimum(fit.x - c.low, c.high - fit.x)
        if any(slot.effect == effect and room[i] < 1e-3 for i, slot in c.items() if slot.logarithmic):
            without = choice.without(engine, fit, effect)
            if gain_and_t(without.left_out, fit.left_out)[1] < EDGE_T:
                return _inside(engine, choice, without)
    return fit


def _with_rows(engine: Engine, fit: Fitted, rows: np.ndarray) -> float:
    """Held-out loss of a model with free functions beside it."""
    table = engine.grams([fit.slopes, rows, (engine.samples.torque - fit.torque)[None]], fit.torque)
    size = len(fit.slopes)
    use = [*fit.free, *range(size, size + len(rows))]
    return float(losses(table, use, size + len(rows), ridge=1e-7)[2].sum())
