"""The gain of an extended model on trajectories that took no part in fitting or choosing it.

Every trajectory is foretold once by a model that was fitted without it, and chosen without it: among the baseline and
all fits of the search, the one that foretells the *other* trajectories best. So the whole data set counts, and none of
it twice. The fits without a trajectory come from normal equations.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrwarp.diagnose.choice import Choice
from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.identify.least_squares import ridge_solve


@dataclass(frozen=True, kw_only=True)
class HeldOut:
    """Squared mismatch of each trajectory, inner units, shape (T,), and what each sample was foretold, shape (N,)."""

    baseline: np.ndarray
    extended: np.ndarray
    foretold_baseline: np.ndarray
    foretold_extended: np.ndarray
    agreed: float
    """Share of the trajectories without which the same effects would have been chosen."""


def hold_out(engine: Engine, choice: Choice) -> HeldOut:
    """Foretell every trajectory by what the others say."""
    models = list(choice.fits.values())
    final = models.index(choice.final)
    base_index = models.index(choice.base)
    left = np.array([fit.left_out for fit in models])
    others = left.sum(axis=1, keepdims=True) - left
    # the final model stands unless another that was fitted foretells the others clearly better
    picked = np.where(
        others[final] <= others.min(axis=0) + 0.05 * (others[base_index] - others[final]), final, others.argmin(axis=0)
    )
    base, extended = _foretold(engine, choice.stated(engine, choice.base)), np.empty(len(engine.samples.q))
    by_model = {int(k): _foretold(engine, choice.stated(engine, models[int(k)])) for k in np.unique(picked)}
    for k, part in zip(picked, engine.samples.parts, strict=True):
        extended[part] = by_model[int(k)][part]
    measured = engine.samples.torque
    sse = [[float(((x[p] - measured[p]) ** 2).sum()) for p in engine.samples.parts] for x in (base, extended)]
    return HeldOut(
        baseline=np.array(sse[0]), extended=np.array(sse[1]), foretold_baseline=base, foretold_extended=extended,
        agreed=float(np.mean(picked == final)),
    )  # fmt: skip


def _foretold(engine: Engine, fit: Fitted) -> np.ndarray:
    """Torque of each trajectory by the fit without it, shape (N,)."""
    size, free = len(fit.x), fit.free
    parts = fit.grams.parts[:, [*free, size]][:, :, [*free, size]]
    total, moment = parts[:, :-1, :-1].sum(axis=0), parts[:, :-1, -1].sum(axis=0)
    out = fit.torque.copy()
    if len(parts) < 2:
        return out
    left = ridge_solve(total - parts[:, :-1, :-1], moment - parts[:, :-1, -1])
    for delta, part in zip(left, engine.samples.parts, strict=True):
        out[part] += delta @ fit.slopes[free, part]
    return out


def reduction(held: HeldOut, seed: int, count: int = 2000) -> tuple[float, tuple[float, float]]:
    """Reduction of the RMSE and its 95 % interval over trajectories."""
    value = 1.0 - np.sqrt(held.extended.sum() / max(held.baseline.sum(), 1e-300))
    rng = np.random.default_rng(seed)
    pick = rng.integers(0, len(held.baseline), (count, len(held.baseline)))
    draws = 1.0 - np.sqrt(held.extended[pick].sum(1) / np.maximum(held.baseline[pick].sum(1), 1e-300))
    low, high = np.percentile(draws, (2.5, 97.5))
    return float(value), (float(min(low, value)), float(max(high, value)))
