"""Figures over training seeds: rollouts of a policy are averaged first, as in section 6.2."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def seeds_of(trials: np.ndarray, policies: int) -> np.ndarray | None:
    """Seed of each trial, of which number i was walked by policy ``i % policies``; None with a single policy.

    A single policy's trials are the only repetitions there are. Of several policies one may be all that arrived: its
    trials are still one seed.
    """
    return np.asarray(trials) % policies if policies > 1 else None


def over_seeds(values: np.ndarray, seeds: np.ndarray | None = None) -> dict[str, Any]:
    """``ours``, ``sd``, ``n`` and ``seeds`` of a :class:`Comparison`; rollouts are averaged within each seed first.

    Section 6.2 does so.

    Args:
        values: One per rollout; NaN where there is no figure, which counts as no rollout.
        seeds: Seed of each rollout, see :func:`seeds_of`; None takes every rollout as its own.
    """
    values = np.asarray(values, dtype=float)
    there = ~np.isnan(values)
    values = values[there]
    if seeds is not None:
        seeds = np.asarray(seeds)[there]
        values = np.array([values[seeds == seed].mean() for seed in np.unique(seeds)])
    if not len(values):
        return {"ours": math.nan, "sd": None, "n": 0, "seeds": ()}
    sd = float(values.std(ddof=1)) if len(values) > 1 else None
    return {"ours": float(values.mean()), "sd": sd, "n": len(values), "seeds": tuple(values.tolist())}
