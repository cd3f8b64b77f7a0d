"""The state of a search for causes: every model that was fitted on the way, and the thresholds it is judged by.

All figures are held-out: a trajectory counts by how well the others foretell it. They are in units of the noise's
variance, after whitening and with offsets and factors of trajectories taken out, so a gain compares with chi-squared.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from mrwarp.diagnose.engine import Candidate, Engine, Fitted
from mrwarp.diagnose.features import Group
from mrwarp.diagnose.uncertainty import covariance
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.normal_equations import losses
from mrwarp.identify.parameters import BASE_PART, EFFECT_PART

FLOOR = 0.003
"""Smallest gain that is worth a name, as a share of the noise's energy: the replay's own step errs by about as much."""
BENT, BENT_T = 0.05, 4.0
"""Least gain, as a share of what a model leaves, and its least ratio to its standard error, for a bent law."""
CHI2 = 30.0
"""Smallest gain in units of the noise's variance: one chance in a million over a hundred starts."""


@dataclass(frozen=True)
class Leftover:
    """Structure that a model leaves: one group of features and what it would gain, held-out."""

    group: Group
    gain: float
    t: float
    """Gain over its standard error over trajectories."""


@dataclass
class Choice:
    """The outcome of the search for causes."""

    base: Fitted
    final: Fitted
    first_look: list[Candidate]
    """Every candidate on top of the baseline."""
    fits: dict[tuple[str, ...], Fitted] = field(default_factory=dict)
    alternatives: dict[str, tuple[str, ...]] = field(default_factory=dict)
    own_gain: dict[str, float] = field(default_factory=dict)
    """What each named effect adds to the others."""
    kept: dict[str, float] = field(default_factory=dict)
    """Part of each effect's gain that remains beside free functions of what is left."""
    plain: dict[tuple[str, ...], Fitted] = field(default_factory=dict)
    """See :meth:`stated`."""
    settled: set[str] = field(default_factory=set)
    """Effects that are no alternative to a similar one, because single events tell."""
    untold: set[str] = field(default_factory=set)
    """Effects that are an alternative to a similar one, whatever the fits say."""
    refined: dict[tuple[str, str], tuple[float, float, float]] = field(default_factory=dict)
    """Parameters, and their intervals, that single events give better than the fit; inner units."""
    left_before: list[Leftover] = field(default_factory=list)
    left_after: list[Leftover] = field(default_factory=list)

    @property
    def gain(self) -> float:
        """Held-out gain of the final model."""
        return self.base.total - self.final.total

    def own(self, fit: Fitted) -> list[str]:
        """Effects of a model that the baseline does not have."""
        return [e for e in fit.effects if e not in self.base.effects]

    def singles(self) -> list[Fitted]:
        """Models that were fitted with one effect more than the baseline."""
        return [f for f in self.fits.values() if len(f.effects) == len(self.base.effects) + 1]

    def full(self, engine: Engine, on: Fitted, candidate: Candidate) -> Fitted:
        """Everything searched together: a model plus a candidate."""
        c = engine.coordinates((*on.effects, candidate.effect), {**on.coordinates.choices, **candidate.choices})
        if c.effects not in self.fits:
            x = on.coordinates.grown(on.x, c.effects)
            x[c.own(candidate.effect)] = candidate.values
            self.fits[c.effects] = engine.fit(c, x)
        return self.fits[c.effects]

    def stated(self, engine: Engine, fit: Fitted) -> Fitted:
        """A model fitted again by plain least squares: the numbers that are stated.

        Whitened differences decide what is there, for chance is reckoned in them. But they weigh what is quick, and
        there a motion that is known to some milliseconds only, or a law in a slightly wrong form, shrinks an effect.
        """
        if fit.effects not in self.plain:
            resolution = np.zeros(fit.coordinates.size)
            resolution[EFFECT_PART] = [slot.parameter.resolution for slot in fit.coordinates.slots]
            least = np.diag(covariance(fit)) + resolution**2
            plain = replace(engine.plain_fit(fit), least_variance=least)
            if any(p.form for effect in fit.effects for p in CATALOGUE[effect].parameters):
                bent = engine.plain_fit(fit, bent=True)
                gain, t = gain_and_t(plain.left_out, bent.left_out)
                if gain > BENT * plain.total and t > BENT_T:
                    slots = bent.coordinates.slots
                    own = iter(least[EFFECT_PART])
                    least = [*least[BASE_PART], *(0.0 if slot.parameter.form else next(own) for slot in slots)]
                    plain = replace(bent, least_variance=np.array(least))
            self.plain[fit.effects] = plain
        return self.plain[fit.effects]

    def without(self, engine: Engine, fit: Fitted, effect: str) -> Fitted:
        """A model refitted without one of its effects."""
        rest = tuple(e for e in fit.effects if e != effect)
        if rest not in self.fits:
            c = engine.coordinates(rest, fit.coordinates.choices)
            self.fits[rest] = engine.fit(c, fit.coordinates.moved(fit.x, c))
        return self.fits[rest]


def threshold(fit: Fitted) -> float:
    """Gain below which nothing is named."""
    return max(CHI2, FLOOR * fit.grams.count)


def drifts(effect: str) -> bool:
    """Whether an effect changes slowly, over the session."""
    return "time" in CATALOGUE[effect].depends_on


def gain_and_t(before: np.ndarray, after: np.ndarray) -> tuple[float, float]:
    """Sum of the differences and its ratio to its standard error."""
    d = before - after
    error = float(np.std(d, ddof=1) * np.sqrt(len(d))) if len(d) > 1 else float("inf")
    return float(d.sum()), float(d.sum()) / max(error, 1e-12)


def as_good(fit: Fitted, best: Fitted, base: Fitted) -> bool:
    """Whether a model cannot be told from a better one, by what both gain on a base."""
    loss, t = gain_and_t(fit.left_out, best.left_out)
    own = base.total - best.total
    if all(drifts(e) for e in set(fit.effects) ^ set(best.effects)):
        return loss < 12.0 or (t < 2.0 and loss < 0.05 * own)  # what drifts is told by trajectories, not by samples
    return loss < 12.0 or (t < 1.5 and loss < 0.01 * own)


def leftovers(engine: Engine, fit: Fitted, groups: list[Group]) -> list[Leftover]:
    """What each group of features would gain on top of a model, best first."""
    rows = [fit.slopes, *(g.rows for g in groups), (engine.samples.torque - fit.torque)[None]]
    table = engine.grams(rows, fit.torque)
    target = sum(len(r) for r in rows) - 1
    _, _, plain = losses(table, fit.free, target, ridge=1e-7)
    at, found = len(fit.slopes), []
    for group in groups:
        use = [*fit.free, *range(at, at + len(group.rows))]
        _, _, outside = losses(table, use, target, ridge=1e-7)
        found.append(Leftover(group, *gain_and_t(plain, outside)))
        at += len(group.rows)
    return sorted(found, key=lambda f: -f.gain)
