"""The smallest size of each effect that a data set would have shown."""

from __future__ import annotations

import numpy as np

from mrwarp.diagnose.choice import threshold
from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.identify.normal_equations import losses
from mrwarp.identify.parameters import simulate, slots_of


def detectable(engine: Engine, fit: Fitted, effects: list[str]) -> tuple[dict[str, float], list[str]]:
    """For each effect the size of its first number at which its gain would pass the threshold, in inner units.

    The effect's torque at several sizes, without what the model's own numbers take up of it, against the noise.

    Returns:
        Sizes, and the effects that stay below the threshold at any size in their range.
    """
    pairs, points = [(fit.coordinates, fit.x)], []
    for effect in effects:
        if effect in fit.effects:
            continue
        c = engine.coordinates((*fit.effects, effect), fit.coordinates.choices)
        x = fit.coordinates.grown(fit.x, c.effects)
        own = c.own(effect)
        for i, slot in zip(own, slots_of(effect), strict=True):
            starts = slot.parameter.starts
            if starts is not None:  # a number that shapes the effect: in the middle of its range
                middle = starts(engine.motion.ranges)[len(starts(engine.motion.ranges)) // 2]
                x[i] = np.log(middle) if slot.logarithmic else middle
        first = slots_of(effect)[0]
        if first.parameter.starts is None:
            sizes = [c.steps[own[0]]]
            coordinates = [first.parameter.null + sizes[0]]
        else:
            values = first.parameter.starts(engine.motion.ranges)
            sizes = [abs(v - first.parameter.null) for v in values]
            coordinates = [float(np.log(v)) if first.logarithmic else v for v in values]
        for size, coordinate in zip(sizes, coordinates, strict=True):
            y = x.copy()
            y[own[0]] = coordinate
            pairs.append((c, y))
            points.append((effect, size))
    tau = simulate(engine.replay, pairs)
    need = 1.3 * threshold(fit)  # the gain that is found scatters about the gain that is there
    found: dict[str, float] = {}
    curves: dict[str, list[tuple[float, float]]] = {}
    for first in range(0, len(points), 24):
        some = points[first : first + 24]
        rows = tau[1 + first : 1 + first + len(some)] - tau[0]
        table = engine.grams([fit.slopes, rows], fit.torque)
        size = len(fit.slopes)
        for k, (effect, value) in enumerate(some):
            _, inside, _ = losses(table, fit.free, size + k)
            curves.setdefault(effect, []).append((value, max(float(inside.sum()), 1e-12)))
    for effect, curve in curves.items():
        values, gains = np.log([v for v, _ in curve]), np.log([g for _, g in curve])
        order = np.argsort(values)
        values, gains = values[order], gains[order]
        target = np.log(need)
        above = np.flatnonzero(gains >= target)
        k = int(above[0]) if len(above) else int(np.argmax(gains))
        # in proportion to the square of the size from the nearest point
        size = float(np.exp(values[k] + 0.5 * (target - gains[k])))
        if k > 0 and len(above):
            slope = (gains[k] - gains[k - 1]) / (values[k] - values[k - 1])
            size = float(np.exp(values[k] + (target - gains[k]) / max(slope, 0.5)))
        parameter = slots_of(effect)[0].parameter
        low, high = parameter.low(engine.motion.ranges), parameter.high(engine.motion.ranges)
        limit = max(abs(low - parameter.null), abs(high - parameter.null))
        if np.isfinite(limit) and size > limit or gains.max() < -15.0:
            continue
        found[effect] = size
    return found, [e for e in curves if e not in found]
