"""The smallest size of each effect that a data set would have shown."""

from __future__ import annotations

import numpy as np

from mrwarp.diagnose.problem import Fit, Problem, threshold
from mrwarp.effects.law import EffectParameter, Ranges
from mrwarp.identify.least_squares import losses
from mrwarp.identify.parameters import Parameters, simulate, slots_of

_MORE = 1.3
"""Gain that is asked for, over the threshold: the gain that is found scatters about the gain that is there."""
_SLAB = 24
"""Sizes whose signals share one table."""


def smallest_sizes(problem: Problem, fit: Fit, effects: list[str]) -> tuple[dict[str, float], list[str]]:
    """For each effect the size of its first number at which its gain would pass the threshold, in normalised units.

    The effect's torque at several sizes, without what the model's own numbers take up of it, against the noise.

    Returns:
        Sizes, and the effects that stay below the threshold at any size in their range.
    """
    models, points = [(fit.parameters, fit.x)], []
    for effect in effects:
        if effect not in fit.effects:
            for size, model in _at_sizes(problem, fit, effect):
                points.append((effect, size))
                models.append(model)
    tau = simulate(problem.replay, models)
    curves: dict[str, list[tuple[float, float]]] = {}
    for first in range(0, len(points), _SLAB):
        some = points[first : first + _SLAB]
        rows = tau[1 + first : 1 + first + len(some)] - tau[0]
        equations = problem.equations([fit.slopes, rows], fit.torque)
        for target, (effect, size) in enumerate(some, start=len(fit.slopes)):
            _, inside, _ = losses(equations, fit.free, target)
            curves.setdefault(effect, []).append((size, max(float(inside.sum()), 1e-12)))
    ranges, need = problem.motion.ranges, _MORE * threshold(fit)
    sizes = {effect: _crossing(curve, need, slots_of(effect)[0].parameter, ranges) for effect, curve in curves.items()}
    return {e: size for e, size in sizes.items() if size is not None}, [e for e, size in sizes.items() if size is None]


def _at_sizes(problem: Problem, fit: Fit, effect: str) -> list[tuple[float, tuple[Parameters, np.ndarray]]]:
    """Sizes of an effect's first number, and the model with the effect of that size."""
    ranges, slots = problem.motion.ranges, slots_of(effect)
    layout = problem.parameters((*fit.effects, effect), fit.parameters.choices)
    x, own = fit.parameters.grown(fit.x, layout.effects), layout.own(effect)
    for i, slot in zip(own, slots, strict=True):
        if slot.parameter.starts is not None:  # a number that shapes the effect: in the middle of its range
            values = slot.parameter.starts(ranges)
            middle = values[len(values) // 2]
            x[i] = np.log(middle) if slot.logarithmic else middle
    first = slots[0].parameter
    if first.starts is None:
        values = (first.null + layout.steps[own[0]],)
    else:
        values = first.starts(ranges)
    found = []
    for value in values:
        size, coordinate = abs(value - first.null), np.log(value) if slots[0].logarithmic else value
        y = x.copy()
        y[own[0]] = coordinate
        found.append((size, (layout, y)))
    return found


def _crossing(
    curve: list[tuple[float, float]], need: float, parameter: EffectParameter, ranges: Ranges
) -> float | None:
    """Size at which a curve of gains over sizes passes what is needed; None beyond the parameter's range."""
    values, gains = np.log(np.array(sorted(curve, key=lambda point: point[0]))).T
    target = np.log(need)
    above = np.flatnonzero(gains >= target)
    k = int(above[0]) if len(above) else int(np.argmax(gains))
    # in proportion to the square of the size from the nearest point
    size = float(np.exp(values[k] + 0.5 * (target - gains[k])))
    if k > 0 and len(above):
        slope = (gains[k] - gains[k - 1]) / (values[k] - values[k - 1])
        size = float(np.exp(values[k] + (target - gains[k]) / max(slope, 0.5)))
    limit = max(abs(end(ranges) - parameter.null) for end in (parameter.low, parameter.high))
    return None if np.isfinite(limit) and size > limit or gains.max() < -15.0 else size
