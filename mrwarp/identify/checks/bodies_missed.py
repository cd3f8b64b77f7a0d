"""Inertia and weight that a fit of eqs. 14 and 15 misses: fitted next to it, from where it ended."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mrwarp.identify.dataset import Dataset, Motion
from mrwarp.identify.projection import Point, Projection, Structure
from mrwarp.identify.replay import Replay
from mrwarp.recording.data import with_unit
from mrwarp.sysid.settings import Gain

INERTIA, WEIGHT = ("an inertia", "inertia"), ("a weight", "sine", "cosine")
"""Bodies that may be missed: the name of each, and those of its linear numbers."""


class _NextTo(Structure):
    """A structure with further linear columns."""

    def __init__(self, inner: Structure, columns: Mapping[str, np.ndarray]) -> None:
        self.inner, self.added = inner, columns
        self.shape, self.low, self.high, self.grid = inner.shape, inner.low, inner.high, inner.grid
        self.linear = (*inner.linear, *columns)

    def linear_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Those of the structure; an inertia is positive."""
        low, high = self.inner.linear_bounds()
        own = [0.0 if name in INERTIA else -np.inf for name in self.added]
        return np.append(low, own), np.append(high, np.full(len(own), np.inf))

    def loop(self, theta: np.ndarray) -> dict[str, float]:
        """As of the structure."""
        return self.inner.loop(theta)

    def elements(self, loop: Mapping[str, float]) -> list[dict[str, float]]:
        """As of the structure."""
        return self.inner.elements(loop)

    def columns(self, samples: Dataset, elements: np.ndarray) -> np.ndarray:
        """Those of the structure, and the further ones, shape (N, L)."""
        return np.column_stack([self.inner.columns(samples, elements), *self.added.values()])


def bodies_missed(structure: Structure, replay: Replay, point: Point, motion: Motion, units: Mapping[str, str]) -> str:
    """Text on the error of a fit with an inertia, a weight, or both next to it; empty if that is over half as large.

    Args:
        structure: What was fitted.
        replay: The samples.
        point: Where the fit ended.
        motion: The samples with their acceleration.
        units: Units of the recording.
    """
    samples, scales = replay.samples, replay.samples.scales
    columns = {"inertia": motion.qdd}
    parts = [(INERTIA,)]
    if units["q"] == "rad":
        angle = samples.q * scales.q
        columns |= {"sine": np.sin(angle), "cosine": np.cos(angle)}
        parts += [(WEIGHT,), (INERTIA, WEIGHT)]
    weight = samples.settled(structure.slowest(point.theta))
    before, best = Projection(structure, replay, weight).evaluate(point.theta).sse, np.inf
    found: dict[str, float] = {}
    for part in parts:
        names = [name for _, *own in part for name in own]
        fitted = Projection(_NextTo(structure, {name: columns[name] for name in names}), replay, weight)
        there = fitted.descend(point.theta)
        if there.sse < Gain.half * best:  # two have to be worth it
            best, found = there.sse, dict(zip(names, there.linear[len(structure.linear) :], strict=True))
    if not found or best > Gain.half**2 * before:
        return ""
    share = 100.0 * float(np.sqrt(best / max(float(weight.sum()), 1.0))) / (float(samples.torque.std()) or 1.0)
    unit = "kg·m²" if (units["q"], units["torque"]) == ("rad", "N·m") else f"{units['torque']}·s²/{units['q']}"
    said = []
    if "inertia" in found:
        size = found["inertia"] * scales.torque / scales.q
        said.append(f"{INERTIA[0]} of {with_unit(f'{size:.3g}', unit)}")
    if "sine" in found:
        size = float(np.hypot(found["sine"], found["cosine"])) * scales.torque
        said.append(f"{WEIGHT[0]} of {with_unit(f'{size:.3g}', units['torque'])}")
    return (
        f"with {' and '.join(said)} next to eq. 14 the fit would miss {share:.0f} %; 'mrwarp diagnose joint' looks for "
        "what is missing, and puts it into the model"
    )
