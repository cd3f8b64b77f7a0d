"""Whether named effects are real, or stand in for structure of another kind or for chance.

An effect may only follow offsets and factors of the trajectories: a factor of the torque that drifts over a session
looks like wear and like a sensor whose gain is set anew for each trajectory. Samples do not tell these apart,
trajectories do; so there the evidence is as many numbers as there are trajectories.
"""

from __future__ import annotations

import numpy as np
from scipy import stats

from mrwarp.diagnose.problem import Fit, Problem, gain_and_t, threshold
from mrwarp.diagnose.residual_structure import Leftover, leftovers
from mrwarp.diagnose.screening import Models
from mrwarp.identify.least_squares import losses

KEPT, KEPT_BESIDE_MORE = 0.35, 0.5
"""Part of an effect's gain that must remain beside free functions of what it leaves, the latter if that is more."""
WITHIN = 60.0
"""Gain within trajectories, in units of the noise's variance, below which an effect must show between them."""
DRIFT_P = 1e-3
"""Largest chance at which an effect that only shows between trajectories is confirmed."""
EDGE_T = 2.0
"""Least ratio of a gain to its standard error over trajectories, of an effect at the edge of its range."""


def confirmed(models: Models, fit: Fit, before: list[Leftover]) -> Fit:
    """The model without effects that only stand in for structure of another kind.

    Whatever structure a model leaves is offered to it as free functions. An effect that is real still adds what it
    did; one that was a proxy of that structure adds little. ``before`` is what the baseline leaves.
    """
    fit = _within_range(models, _not_by_chance(models, fit))
    gain_before = {f.group.key: f.gain for f in before}
    while fit is not models.base:
        left = [f for f in leftovers(models.problem, fit) if f.gain > threshold(fit)]
        # what the effects have mostly taken up is their own law in another form, not another structure
        left = [f for f in left if f.gain > 0.3 * gain_before[f.group.key]][:2]
        if not left:
            return fit
        offered = np.vstack([f.group.rows for f in left])
        full = _loss_beside(models.problem, fit, offered)
        kept: dict[str, float] = {}
        for effect in models.added(fit):
            without = models.without(fit, effect)
            alone = without.total - fit.total
            beside = _loss_beside(models.problem, without, offered) - full
            kept[effect] = beside / max(alone, 1e-9)
            if left[0].gain > 1.5 * alone:
                kept[effect] *= KEPT / KEPT_BESIDE_MORE
            if beside < threshold(fit):
                kept[effect] = min(kept[effect], 0.0)
        doubtful = min(kept, key=lambda e: kept[e])
        if kept[doubtful] > KEPT:
            return fit
        fit = models.without(fit, doubtful)
    return fit


def _not_by_chance(models: Models, fit: Fit) -> Fit:
    """The model without effects that may only follow offsets and factors of the trajectories by chance."""
    for effect in models.added(fit):
        without = models.without(fit, effect)
        if gain_within_runs(models.problem, fit, without) < max(WITHIN, 0.5 * threshold(fit)):
            if drift_p_value(models.problem, fit, without) > DRIFT_P:
                return _not_by_chance(models, without)
    return fit


def _within_range(models: Models, fit: Fit) -> Fit:
    """The model without effects that end at the edge of their range and show in a few trajectories only.

    An effect that would be more itself beyond what makes sense for it is a proxy of another structure.
    """
    room = np.minimum(fit.x - fit.parameters.low, fit.parameters.high - fit.x)
    at_edge = {slot.effect for i, slot in fit.parameters.items() if slot.logarithmic and room[i] < 1e-3}
    for effect in models.added(fit):
        if effect in at_edge:
            without = models.without(fit, effect)
            if gain_and_t(without.loo_loss, fit.loo_loss)[1] < EDGE_T:
                return _within_range(models, without)
    return fit


def _loss_beside(problem: Problem, fit: Fit, rows: np.ndarray) -> float:
    """Leave-one-out loss of a model with free functions beside it."""
    equations = problem.equations([fit.slopes, rows, (problem.motion.torque - fit.torque)[None]], fit.torque)
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
    """What an effect gains beside an offset and a factor for each trajectory, in units of the noise's variance."""
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
