"""Spikes of a recording: found on top of everything smooth, kept out of every fit, and counted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrwarp.diagnose.problem import Fit, Problem
from mrwarp.diagnose.residual_structure import groups_along
from mrwarp.identify.checks.lone_samples import ROUNDS, beside_spikes, far_off, find_spikes
from mrwarp.recording.data import Recording
from mrwarp.sysid.least_squares import ridge_solve


@dataclass(frozen=True, kw_only=True)
class Spikes:
    """Samples that stand out of all that is smooth and come again nowhere."""

    samples: int
    share: float
    """Of all samples that count [1]."""
    of_squared_mismatch: float
    """Share of what smooth functions of the motion leave that they carry [1]."""
    per_trajectory: Mapping[str, int]
    """How many each trajectory has, where it has some."""
    at: np.ndarray
    """The samples themselves, bool, shape (N,)."""
    known: np.ndarray
    """Samples whose torque may be fitted: neither a spike nor reached by one, bool, shape (N,)."""

    @property
    def sentence(self) -> str:
        """The findings, for people."""
        worst = max(self.per_trajectory, key=lambda name: self.per_trajectory[name])
        return (
            f"{self.samples} samples ({100.0 * self.share:.2g} %) are spikes, most of them in {worst} "
            f"({self.per_trajectory[worst]}): they stand out of all that is smooth, carry "
            f"{100.0 * self.of_squared_mismatch:.0f} % of what it leaves, and come again nowhere. They are kept out of "
            "every fit and figure of error, and count as not repeatable"
        )


def spikes_of(problem: Problem, fit: Fit, recording: Recording) -> Spikes | None:
    """The spikes of a data set on top of a model of it, or None.

    What the model leaves is fitted by smooth functions of all that was measured, again and again without what stands
    far out, so that neither a missing effect passes for spikes, nor do spikes bend what they are judged by.
    """
    motion, counts = problem.motion, problem.weight > 0.0
    mismatch = motion.torque - fit.torque
    rows = [np.ones((1, len(mismatch))), fit.torque[None], *(group.rows for group in groups_along(problem, fit))]
    table = np.vstack(rows).astype(np.float32)
    table /= np.maximum(np.sqrt(np.mean(table**2, axis=1, keepdims=True)), 1e-9)
    near, left = counts, mismatch
    for _ in range(ROUNDS):
        known, goal = table[:, near], mismatch[near].astype(np.float32)
        left = mismatch - ridge_solve((known @ known.T).astype(float), (known @ goal).astype(float), 1e-5) @ table
        before, near = near, counts & ~far_off(left, motion, counts, problem.settings.spikes.far)
        if (near == before).all():
            break
    found = find_spikes(left, motion.torque - left, motion, counts, problem.settings)
    if not found.any():
        return None
    names = [run.id for run in recording.trajectories]
    numbers = np.add.reduceat(found.astype(int), motion.start[:-1])
    return Spikes(
        samples=int(found.sum()),
        share=float(found.sum() / counts.sum()),
        of_squared_mismatch=float(np.sum(left[found] ** 2) / np.sum(left[counts] ** 2)),
        per_trajectory={name: int(n) for name, n in zip(names, numbers, strict=True) if n},
        at=found,
        known=~beside_spikes(found, motion) & (motion.counts > 0.0),
    )
