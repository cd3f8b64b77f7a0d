"""The search for the best parameters: starts on a subset of the samples, refinement on all of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from mrwarp.identify.projection import Point, Projection, Structure
from mrwarp.identify.replay import Replay, Samples

Progress = Callable[[str], None]

_SUBSET = 20_000
"""Samples on which the starts are searched."""
_STARTS = 3
_SPIKE = 0.05
"""Smallest spike that counts, as a share of the torque's 95th percentile."""


def search(
    structure: Structure,
    replay: Replay,
    samples: Samples,
    *,
    starts: tuple[np.ndarray, ...] = (),
    robust: bool = False,
    seed: int = 0,
    told: Progress = lambda text: None,
) -> tuple[Point, list[str]]:
    """Grid of starts on a subset, descent from the best, refinement on all samples.

    Returns:
        The optimum and warnings about the search.
    """
    told("searching starts")
    points = search_starts(structure, replay, samples, starts=starts, seed=seed)
    warnings = []
    rivals = [p for p in points[1:] if p.sse < 1.01 * points[0].sse and np.abs(p.theta - points[0].theta).max() > 0.3]
    if rivals:
        warnings.append("two different parameter sets fit a part of the data equally well: record richer motion")
    told(f"refining on {len(samples.q)} samples")
    rate = float(np.exp(min(points[0].theta[1], points[0].theta[2])))
    projection = Projection(structure, replay, samples.settled(rate))
    projection.samples = samples
    point = projection.descend(points[0].theta)
    for rival in rivals[:1]:
        point = min(point, projection.descend(rival.theta), key=lambda p: p.sse)
    outliers = _spikes(point.simulated - samples.torque)
    base = projection.weight
    for _ in range(4 if robust else 0):
        told("weighing down outliers")
        deviation = 1.4826 * float(np.median(np.abs(point.simulated - samples.torque)))
        far = np.abs(point.simulated - samples.torque) / (1.345 * deviation)
        projection.weight = base / np.maximum(far, 1.0)
        point = projection.descend(point.theta, iterations=8)
    if outliers > 1e-4 and not robust:
        warnings.append(f"{100 * outliers:.2f} % of the samples are single spikes: consider --robust")
    return point, warnings


def search_starts(
    structure: Structure,
    replay: Replay,
    samples: Samples,
    *,
    starts: tuple[np.ndarray, ...] = (),
    limit: int = _SUBSET,
    seed: int = 0,
) -> list[Point]:
    """Optima on about ``limit`` samples, from given starts and from the structure's grid, best first."""
    small = subset(samples, limit, seed)
    rough = Projection(structure, Replay(small, exact=replay.exact, substeps=replay.substeps))
    points = [rough.descend(theta, tolerance=1e-5) for theta in (*starts, *rough.starts(_STARTS))]
    return sorted(points, key=lambda p: p.sse)


def subset(samples: Samples, limit: int, seed: int) -> Samples:
    """At most about ``limit`` samples: a stretch of each of up to 24 trajectories spread over current and speed."""
    if len(samples.q) <= limit:
        return samples
    parts = samples.parts
    order = sorted(
        range(len(parts)), key=lambda k: (np.abs(samples.current[parts[k]]).mean(), samples.qd[parts[k]].std())
    )
    chosen = [order[i] for i in np.unique(np.linspace(0, len(order) - 1, min(24, len(order))).astype(int))]
    length = max(50, limit // len(chosen))
    rng = np.random.default_rng(seed)
    index = []
    for k in chosen:
        spare = max(0, parts[k].stop - parts[k].start - length)
        first = parts[k].start + int(rng.integers(spare + 1))
        index.append(np.arange(first, min(first + length, parts[k].stop)))
    pick = np.concatenate(index)
    start = np.concatenate([[0], np.cumsum([len(i) for i in index])])
    arrays = {name: getattr(samples, name)[pick] for name in ("q", "qd", "current", "torque")}
    return dataclasses.replace(samples, **arrays, start=start, dt=samples.dt[chosen])


def _spikes(mismatch: np.ndarray) -> float:
    """Share of samples that stand out from their four neighbours; a missing mechanism would be smooth."""
    windows = np.lib.stride_tricks.sliding_window_view(mismatch, 5)
    alone = np.abs(windows[:, 2] - np.median(windows, axis=1))
    deviation = float(np.median(alone[alone > 0])) if (alone > 0).any() else 0.0
    return float(np.mean(alone > max(15.0 * deviation, _SPIKE)))
