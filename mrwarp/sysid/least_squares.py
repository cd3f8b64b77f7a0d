"""Damped Gauss-Newton within bounds, for a plant whose replay costs far more than any algebra.

Two kinds of looks at a point are distinguished: ``about`` takes derivatives there, ``seen`` replays once and keeps the
derivatives of where the search stands. Where derivatives are cheap there is ``about`` alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mrwarp.sysid.pieces import Quadratic

RANK = 1e-9
"""Share of the largest eigenvalue of a correlation matrix that counts as zero, and ridge that keeps it regular."""
HELD_ROUNDS = 30
"""Rounds at most in which numbers are held at their bounds and let go again."""


@dataclass(frozen=True, kw_only=True)
class Rules:
    """How a search is damped and when it ends."""

    iterations: int = 12
    """Most points that are looked at."""
    steps: int | None = None
    """Most better points; None: as many as are looked at."""
    damping: float = 1e-4
    """First damping, relative to the normal matrix's diagonal."""
    relief: float = 10.0
    """Divisor of the damping at a better point."""
    least: float = 1e-9
    increase: float = 30.0
    """Factor on the damping at a worse point."""
    most: float = 1e4
    """Damping at which the search gives up."""
    lets_go: bool = False
    """Whether a number that a step has held at a bound may leave it within the same step; else the next one asks again.
    Steps that let go reach farther at once. Searches from rough starts then end in other minima: of the gear with a
    locked output (docs/devices/cyclo_base.md) in zeros of 70 N·m in place of its play."""
    predicted: Callable[[float, float], bool] = lambda gain, loss: gain <= 1e-12 * loss
    """Whether a predicted gain is too small to be tried."""
    gained: Callable[[float, float], bool] = lambda gain, loss: False
    """Whether a gain was so small that the search ends with it."""
    stale: Callable[[float, float], bool] | None = None
    """Whether derivatives are taken again at a better point, by its gain and the predicted one, and the damping starts
    again; None: they are taken at every better point, and the damping goes on."""
    renewals: int = 0
    """How often stale derivatives are taken again."""


@dataclass(frozen=True, kw_only=True)
class Minimum:
    """Where a search ended."""

    x: np.ndarray
    """Shape (P,)."""
    quadratic: Quadratic
    """The sum of squares about it."""
    fresh: bool
    """Whether its derivatives were taken there."""


def minimise(
    about: Callable[[np.ndarray], Quadratic],
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    *,
    reach: np.ndarray | float = np.inf,
    rules: Rules | None = None,
    seen: Callable[[np.ndarray, Quadratic], Quadratic] | None = None,
    start: Quadratic | None = None,
) -> Minimum:
    """Levenberg-Marquardt within bounds.

    Args:
        about: The sum of squares about a point, with derivatives of there.
        x: Where the search starts, shape (P,); moved into the bounds ``low`` and ``high``, of the same shape.
        low: Lower bounds.
        high: Upper bounds.
        reach: Longest step of each coordinate, shape (P,) or one for all.
        rules: Damping, end of the search, and when derivatives are taken again.
        seen: The sum of squares about a point with the derivatives of another one. With it, only better points are
            asked for derivatives, where :attr:`Rules.stale` says so.
        start: The sum of squares about ``x`` where it is known.
    """
    rules = rules or Rules()
    x = np.clip(x, low, high)
    here, fresh, damping = start or about(x), True, rules.damping
    steps, renewals = rules.iterations if rules.steps is None else rules.steps, rules.renewals
    for _ in range(rules.iterations):
        trial, promised, damping = _promising(here, x, low, high, reach, damping, rules)
        if not steps or rules.predicted(promised, here.loss):
            break
        there = about(trial) if seen is None else seen(trial, here)
        gain = here.loss - there.loss
        if there.loss < here.loss:
            x, here, fresh, steps = trial, there, seen is None, steps - 1
            damping = max(damping / rules.relief, rules.least)
            if not fresh and rules.stale is None:
                here, fresh = about(x), True
            elif not fresh and rules.stale is not None and renewals and rules.stale(gain, promised):
                here, fresh, renewals, damping = about(x), True, renewals - 1, rules.damping
            if rules.gained(gain, here.loss):
                break
            continue
        damping *= rules.increase
        if damping > rules.most:
            if fresh or not renewals:
                break
            here, fresh, renewals, damping = about(x), True, renewals - 1, rules.damping
    return Minimum(x=x, quadratic=here, fresh=fresh)


def _promising(
    here: Quadratic,
    x: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    reach: np.ndarray | float,
    damping: float,
    rules: Rules,
) -> tuple[np.ndarray, float, float]:
    """Next point to look at, its predicted gain, and the damping with which bounds do not bend the step uphill."""
    while True:
        room = np.maximum(low - x, -reach), np.minimum(high - x, reach)
        more = damping * np.diag(np.diag(here.normal))
        step, _ = minimum_within(here.normal + more, here.descent, *room, lets_go=rules.lets_go)
        trial = np.clip(x + step, low, high)
        promised = here.gain(trial - x)
        if promised > 0.0 or damping > rules.most:
            return trial, promised, damping
        damping *= rules.increase


def minimum_within(
    normal: np.ndarray, descent: np.ndarray, low: np.ndarray, high: np.ndarray, *, lets_go: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Minimum of ``x@normal@x - 2*descent@x`` within bounds, and whether each number is held at one; shapes (P,).

    An active set: numbers that leave the bounds are held there and the others solved again; one that is held, but
    drawn inwards, is let go, unless ``lets_go`` is False.
    """
    free = np.ones(len(descent), dtype=bool)
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    x = np.zeros(len(descent))
    for _ in range(HELD_ROUNDS):
        if free.any():
            rest = descent[free] - normal[np.ix_(free, ~free)] @ x[~free]
            x[free] = ridge_solve(normal[np.ix_(free, free)], rest)
        out = free & ((x < low) | (x > high))
        x = np.clip(x, low, high)
        if out.any():
            free &= ~out
            continue
        if not lets_go:
            break
        pull = (descent - normal @ x) / size
        inwards = ~free & (low < high) & np.where(x <= low, pull > 1e-9, pull < -1e-9)
        if not inwards.any():
            break
        free |= inwards
    return x, ~free


def ridge_solve(gram: np.ndarray, moment: np.ndarray, ridge: float = RANK) -> np.ndarray:
    """Least squares from (a stack of) normal equations, with a small relative ridge."""
    scale = np.sqrt(np.maximum(np.einsum("...ii->...i", gram), 1e-300))
    normal = gram / (scale[..., :, None] * scale[..., None, :])
    normal = normal + ridge * np.eye(gram.shape[-1])
    return np.linalg.solve(normal, (moment / scale)[..., None])[..., 0] / scale
