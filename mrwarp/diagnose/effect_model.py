"""A torque model under diagnosis: eqs. 14 and 15 with some effects, as a vector that can be searched."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrwarp.diagnose.effect_kernels import BASE
from mrwarp.diagnose.effect_replay import ExtendedReplay, null_row
from mrwarp.effects.catalogue import CATALOGUE, column_of
from mrwarp.effects.law import EffectParameter, Ranges

LINEAR = ("D", "B", "C", "I1", "K0", "K1")
SHAPE = ("alpha", "beta", "gamma")
_STEP = 1e-2
"""Step of the central differences in non-linear coordinates."""
_POSITIVE = ("B", "K0", "K1")

_STEEPEST, _DRY = (5.0, 8.0, 9.0), (5.0, 11.0, 12.0)
"""Largest log(1 + alpha*v), log(beta + gamma), log(beta - gamma): while effects are searched, and of stated numbers.

The latter is a hysteresis that is over after 1e-5 of a unit of way, less than a step of an encoder.
"""


@dataclass(frozen=True)
class Slot:
    """One searched number of an effect."""

    effect: str
    parameter: EffectParameter

    @property
    def logarithmic(self) -> bool:
        """Whether it is searched by its logarithm."""
        return self.parameter.starts is not None and not self.parameter.negative

    @property
    def linear(self) -> bool:
        """Whether the torque is linear in it at its null value, or nearly so."""
        return self.parameter.starts is None


def slots_of(effect: str, *, form: bool = False) -> list[Slot]:
    """The searched numbers of an effect, with those that bend its law or without."""
    return [
        Slot(effect, p)
        for p in CATALOGUE[effect].parameters
        if p.preset is None and not p.choices and (form or not p.form)
    ]


class Coordinates:
    """Vector of searched numbers of a model with given effects, in inner units.

    First D, B, C, I1, K0, K1, then log(1 + alpha*v), log(beta + gamma), log(beta - gamma), then the effects' own.

    Args:
        effects: Names of the effects that act.
        ranges: What the data cover.
        q_zero: Angle from which q_c counts.
        choices: Values of parameters that say how the data were logged, and of known bends, by (effect, name).
        form: Whether numbers that bend a law are searched; else they are as known, or null.
    """

    def __init__(
        self,
        effects: Sequence[str],
        ranges: Ranges,
        q_zero: float,
        choices: Mapping[tuple[str, str], float] | None = None,
        *,
        form: bool = False,
    ) -> None:
        self.effects, self.ranges, self.q_zero = tuple(effects), ranges, q_zero
        self.choices, self.form = dict(choices or {}), form
        self.slots = [slot for effect in self.effects for slot in slots_of(effect, form=form)]
        self.size = len(LINEAR) + len(SHAPE) + len(self.slots)
        low, high = np.full(self.size, -np.inf), np.full(self.size, np.inf)
        for i, name in enumerate(LINEAR):
            if name in _POSITIVE:
                low[i] = 0.0
        low[6:9], high[6:9] = (0.0, -3.0, -3.0), _STEEPEST
        for i, slot in enumerate(self.slots, start=9):
            a, b = slot.parameter.low(ranges), slot.parameter.high(ranges)
            low[i], high[i] = (np.log(a), np.log(b)) if slot.logarithmic else (a, b)
        self.low, self.high = low, high
        self.steps = np.full(self.size, _STEP)
        self.steps[:6] = 0.1  # linear: any step does
        for i, slot in enumerate(self.slots, start=9):
            if slot.effect in ("backlash", "remanence"):
                self.steps[i] = 0.05  # on and off at samples: a small step would meet single ones
            if slot.linear:
                self.steps[i] = _linear_step(slot.parameter, ranges)

    def steeper(self) -> Coordinates:
        """The same with room for a hysteresis that is nearly dry friction.

        Where effects are searched that room is closed: a steep loop foretells each reversal by its sample, and whitened
        differences are then all about that.
        """
        other = copy.copy(self)
        other.high = self.high.copy()
        other.high[6:9] = _DRY
        return other

    def bent(self) -> Coordinates:
        """The same with the numbers that bend the laws."""
        return Coordinates(self.effects, self.ranges, self.q_zero, self.choices, form=True)

    def row(self, x: np.ndarray) -> np.ndarray:
        """The kernel's row for a vector."""
        row = null_row()
        row[: len(LINEAR)] = x[:6]
        loading, unloading = np.exp(x[7]), np.exp(x[8])
        row[6] = np.expm1(x[6]) / self.ranges.qd
        row[7], row[8] = 0.5 * (loading + unloading), 0.5 * (loading - unloading)
        row[9] = self.q_zero
        for value, slot in zip(x[9:], self.slots, strict=True):
            at = len(BASE) + column_of(slot.effect, slot.parameter.name)
            row[at] = np.exp(value) if slot.logarithmic else value
        for effect in self.effects:
            for p in CATALOGUE[effect].parameters:
                at = len(BASE) + column_of(effect, p.name)
                if p.preset is not None:
                    row[at] = p.preset(self.ranges)
                elif p.choices:
                    row[at] = self.choices.get((effect, p.name), p.choices[0])
                elif p.form and not self.form:
                    row[at] = self.choices.get((effect, p.name), p.null)
        return row

    def values(self, x: np.ndarray) -> dict[str, dict[str, float]]:
        """Parameters of each effect in inner units, without those that say how the data were logged or are null."""
        row = self.row(x)
        return {
            effect: {
                p.name: float(row[len(BASE) + column_of(effect, p.name)])
                for p in CATALOGUE[effect].parameters
                if not p.choices and (not p.form or self.form or (effect, p.name) in self.choices)
            }
            for effect in self.effects
        }

    def grown(self, x: np.ndarray, effects: Sequence[str]) -> np.ndarray:
        """Vector of this model's numbers in a model with more effects; theirs are at null, or the first start."""
        return self.moved(x, Coordinates(effects, self.ranges, self.q_zero, self.choices))

    def moved(self, x: np.ndarray, other: Coordinates) -> np.ndarray:
        """Vector of this model's numbers in other coordinates; what they lack here is at null, or the first start."""
        out = np.zeros(other.size)
        out[:9] = x[:9]
        mine = {(s.effect, s.parameter.name): v for s, v in zip(self.slots, x[9:], strict=True)}
        for i, slot in enumerate(other.slots, start=9):
            key = (slot.effect, slot.parameter.name)
            out[i] = mine[key] if key in mine else self.choices.get(key, neutral(slot, self.ranges))
        return out


def neutral(slot: Slot, ranges: Ranges) -> float:
    """Coordinate of a number where its effect is absent, or, for one that has none, of its first start."""
    p = slot.parameter
    if slot.logarithmic:
        assert p.starts is not None
        return float(np.log(p.starts(ranges)[0]))
    return p.null


def _linear_step(p: EffectParameter, r: Ranges) -> float:
    """A step of a linear parameter that changes the torque by the order of a percent."""
    q, current, torque = p.scale
    unit = r.qd**q if (q, current, torque) != (1, 0, 0) else r.q
    size = unit * r.current**current * r.torque**torque
    if p.unit == "kg·m²":
        size = r.torque * r.q / max(r.qd**2, 1e-12) * 1.0
    if p.unit == "1/s":
        size = 1.0 / r.session
    if p.unit == "1/J":
        size = 1.0 / (r.torque * r.qd * min(r.session, 100.0))
    return 1e-2 * size if size > 0 else 1e-2


def simulate(replay: ExtendedReplay, pairs: Sequence[tuple[Coordinates, np.ndarray]]) -> np.ndarray:
    """Torque of several models, float32, shape (C, N)."""
    return replay.torque(np.stack([c.row(x) for c, x in pairs]))


def jacobian(replay: ExtendedReplay, c: Coordinates, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque, shape (N,), and its derivatives by every coordinate, float32, shape (P, N), from one launch."""
    pairs, linear = [(c, x)], len(LINEAR)
    for i in range(c.size):
        for sign in (1.0,) if i < linear else (1.0, -1.0):
            y = x.copy()
            y[i] += sign * c.steps[i]
            pairs.append((c, y))
    tau = simulate(replay, pairs)
    steps = c.steps[:, None].astype(np.float32)
    slopes = np.empty((c.size, tau.shape[1]), dtype=np.float32)
    slopes[:linear] = (tau[1 : 1 + linear] - tau[0]) / steps[:linear]
    slopes[linear:] = (tau[1 + linear :: 2] - tau[2 + linear :: 2]) / (2.0 * steps[linear:])
    return tau[0].astype(float), slopes
