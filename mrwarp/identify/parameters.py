"""The parameter vector of a fit: eqs. 14 and 15 and the numbers of effects, as named parts of one vector.

The vector's coordinates, in normalised units, are D, B, C, I1, K0, K1 (:data:`LINEAR_PART`), then log(1 + alpha*v),
log(beta + gamma), log(beta - gamma) with v a typical speed (:data:`SHAPE_PART`), then the effects' own numbers
(:data:`EFFECT_PART`), those of one sign by their logarithm. A *row* is what the replay's kernel takes: the parameters
of eqs. 14 and 15 as they are, the angle from which q_c counts, then every number of the catalogue.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mrwarp.effects.catalogue import HYSTERESIS, KNOWN, column_of
from mrwarp.effects.law import EffectParameter, Ranges
from mrwarp.effects.replay_kernel import BASE
from mrwarp.identify.dataset import Scales
from mrwarp.identify.replay import EffectReplay, null_row

LINEAR = ("D", "B", "C", "I1", "K0", "K1")
"""Parameters of eq. 14 in which the torque is linear."""
_K0, _K1 = LINEAR.index("K0"), LINEAR.index("K1")
SHAPE = ("alpha", "beta", "gamma")
"""Parameters that give the hysteresis its shape."""
NON_NEGATIVE = ("B", "K0", "K1")
YIELDING = tuple(name for name, law in KNOWN.items() if law.yields)
"""Effects of a shaft that yields."""

LINEAR_PART = slice(0, len(LINEAR))
SHAPE_PART = slice(len(LINEAR), len(LINEAR) + len(SHAPE))
BASE_PART = slice(0, len(LINEAR) + len(SHAPE))
"""Eqs. 14 and 15: the linear part and the shape."""
EFFECT_PART = slice(len(LINEAR) + len(SHAPE), None)

LEAST_SHAPE = (0.0, -3.0, -3.0)
STEEPEST, DRY = (5.0, 8.0, 9.0), (5.0, 11.0, 12.0)
"""Largest coordinates of the shape: while effects are searched, and of the reported fit.

The latter is a hysteresis that is over after 1e-5 of a unit of path, less than a step of an encoder.
"""
UNIT_LOOP = (0.0, 0.0, 0.0)
"""Coordinates of the shape with a law that takes eq. 15's place: alpha = gamma = 0, beta = 1 inner unit."""
_STEP = 1e-2
"""Step of the central differences in non-linear coordinates."""
_SHARE, _LEAST = 0.05, 1e-3
"""Step in B, K0 and K1 with a shaft that yields: as a share of the value, and at least."""


def row_column(effect: str, parameter: str) -> int:
    """Place of an effect's number in a row."""
    return len(BASE) + column_of(effect, parameter)


def shape_coordinates(alpha: float, beta: float, gamma: float, speed: float) -> np.ndarray:
    """log(1 + alpha*speed), log(beta + gamma), log(beta - gamma); rates below 1e-3 count as that."""
    return np.array([np.log1p(alpha * speed), *np.log(np.maximum([beta + gamma, beta - gamma], 1e-3))])


def shape_parameters(coordinates: np.ndarray, speed: float) -> dict[str, float]:
    """alpha, beta, gamma of :func:`shape_coordinates`; ``beta > |gamma|``, so the hysteresis dissipates on any path."""
    loading, unloading = np.exp(coordinates[1]), np.exp(coordinates[2])
    alpha = np.expm1(coordinates[0]) / speed
    return {"alpha": alpha, "beta": 0.5 * (loading + unloading), "gamma": 0.5 * (loading - unloading)}


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

    @property
    def key(self) -> tuple[str, str]:
        """Effect and name of the number."""
        return self.effect, self.parameter.name

    def value(self, coordinate: float) -> float:
        """The number of a coordinate."""
        return float(np.exp(coordinate)) if self.logarithmic else float(coordinate)

    def neutral(self, ranges: Ranges) -> float:
        """Coordinate where the effect is absent, or, for a number that has none, of its first start."""
        if self.logarithmic:
            assert self.parameter.starts is not None
            return float(np.log(self.parameter.starts(ranges)[0]))
        return self.parameter.null


def factor_of(parameter: EffectParameter, scales: Scales) -> float:
    """Factor from an effect parameter's normalised value to that in the units of the recording."""
    q, current, torque = parameter.scale
    return scales.q**q * scales.current**current * scales.torque**torque


def slots_of(effect: str, *, form: bool = False) -> list[Slot]:
    """The searched numbers of an effect, with those that only the reported fit has or without."""
    numbers = [p for p in KNOWN[effect].parameters if p.preset is None]
    return [Slot(effect, p) for p in numbers if (form if p.form else not p.choices)]


@dataclass(frozen=True, eq=False)
class Parameters:
    """Layout, bounds and steps of the vector of a model with given effects."""

    effects: tuple[str, ...]
    """Names of the effects that act."""
    ranges: Ranges
    """Ranges that the data cover."""
    q_zero: float
    """Angle from which q_c counts."""
    choices: Mapping[tuple[str, str], float] = field(default_factory=dict)
    """Values of parameters that say how the data were logged, and of known bends, by (effect, name)."""
    form: bool = False
    """Whether numbers that bend a law are searched; else they are as known, or null. Sizes of known lines are."""
    steepest: tuple[float, float, float] = STEEPEST
    """Upper bounds of the shape."""
    logging: bool = False
    """Whether how the data were logged is fitted, where anything between the choices may be."""

    @cached_property
    def slots(self) -> list[Slot]:
        """The effects' numbers in the order of the vector."""
        return [slot for effect in self.effects for slot in slots_of(effect, form=True) if self._searched(slot)]

    def _searched(self, slot: Slot) -> bool:
        """Whether a number is searched: not a known number of repetitions, nor what needs one that is not known.

        What bends a law is searched if asked for; the size of a further line always, for without it the line is none.
        """
        p = slot.parameter
        if p.choices:
            return self.logging and p.form
        if p.form and not p.requires and not self.form:
            return False
        if p.repeats:
            return not p.form and slot.key not in self.choices
        if p.carried:
            return self.ranges.carried and any(KNOWN[effect].inertial for effect in self.effects)
        return not p.requires or (slot.effect, p.requires) in self.choices

    @property
    def law(self) -> str:
        """Name of the law that takes the place of eq. 15; empty: none does."""
        return next((name for name in self.effects if name in HYSTERESIS), "")

    @property
    def size(self) -> int:
        """Length of the vector."""
        return BASE_PART.stop + len(self.slots)

    @cached_property
    def low(self) -> np.ndarray:
        """Lower bounds, shape (P,)."""
        base = [0.0 if name in NON_NEGATIVE or name in absent_from(self.ranges) else -np.inf for name in LINEAR]
        shape = UNIT_LOOP if self.law else LEAST_SHAPE
        return np.array([*base, *shape, *(self._bound(slot, "low") for slot in self.slots)])

    @cached_property
    def high(self) -> np.ndarray:
        """Upper bounds, shape (P,)."""
        shape = UNIT_LOOP if self.law else self.steepest
        linear = [0.0 if name in absent_from(self.ranges) else np.inf for name in LINEAR]
        return np.array([*linear, *shape, *(self._bound(slot, "high") for slot in self.slots)])

    @cached_property
    def steps(self) -> np.ndarray:
        """Steps of the differences, shape (P,)."""
        out = np.full(self.size, _STEP)
        out[LINEAR_PART] = 0.1  # any step does
        for i, slot in self.items():
            if slot.parameter.sudden:
                out[i] = 0.05
            if slot.linear:
                out[i] = _linear_step(slot.parameter, self.ranges)
        return out

    def reach(self, shape: float, logarithmic: float) -> np.ndarray:
        """Longest step of a search, shape (P,): of the shape, of logarithms, and without limit elsewhere."""
        out = np.full(self.size, np.inf)
        out[SHAPE_PART] = shape
        for i, slot in self.items():
            if slot.logarithmic:
                out[i] = logarithmic
        return out

    def items(self) -> Iterator[tuple[int, Slot]]:
        """Place in the vector and slot of every number of the effects."""
        return enumerate(self.slots, start=BASE_PART.stop)

    def own(self, effect: str) -> list[int]:
        """Places of an effect's numbers in the vector."""
        return [i for i, slot in self.items() if slot.effect == effect]

    def reported(self) -> Parameters:
        """With room for a hysteresis that is nearly dry friction, and with where a command stepped between samples.

        Where effects are searched that room is closed: a steep loop predicts each reversal by its sample, and whitened
        differences are then all about that. So they are about the first sample after a step.
        """
        return dataclasses.replace(self, steepest=DRY, logging=True)

    def bent(self) -> Parameters:
        """With the numbers that bend the laws."""
        return Parameters(self.effects, self.ranges, self.q_zero, self.choices, form=True)

    def row(self, x: np.ndarray) -> np.ndarray:
        """The kernel's row for a vector, shape (WIDTH,)."""
        row = null_row()
        row[LINEAR_PART] = x[LINEAR_PART]
        row[SHAPE_PART] = list(shape_parameters(x[SHAPE_PART], self.ranges.qd).values())
        row[BASE.index("q_zero")] = self.q_zero
        for i, slot in self.items():
            row[row_column(*slot.key)] = np.exp(x[i]) if slot.logarithmic else x[i]
        for effect in self.effects:
            for p in KNOWN[effect].parameters:
                at = row_column(effect, p.name)
                if p.preset is not None:
                    row[at] = p.preset(self.ranges)
                elif p.choices:
                    known = self._searched(Slot(effect, p))
                    row[at] = row[at] if known else self.choices.get((effect, p.name), p.choices[0])
                elif p.repeats and (p.form or (effect, p.name) in self.choices):
                    row[at] = self.choices.get((effect, p.name), p.null)
                elif p.form and not self._searched(Slot(effect, p)):
                    row[at] = self.choices.get((effect, p.name), p.null)
        return row

    def values(self, x: np.ndarray) -> dict[str, dict[str, float]]:
        """Parameters of each effect in normalised units, but those of the logging and those that are null."""
        row = self.row(x)
        return {
            effect: {
                p.name: float(row[row_column(effect, p.name)])
                for p in KNOWN[effect].parameters
                if not p.choices and (not p.form or self._shown(effect, p))
            }
            for effect in self.effects
        }

    def _shown(self, effect: str, p: EffectParameter) -> bool:
        """Whether a number that bends a law stands among the values."""
        if p.repeats or p.requires:
            return (effect, p.requires or p.name) in self.choices
        return (effect, p.name) in self.choices or self._searched(Slot(effect, p))

    def vector(self, base: np.ndarray, numbers: Mapping[tuple[str, str], float]) -> np.ndarray:
        """A vector from its base part and the effects' coordinates; those not given are known, neutral or a start."""
        known = {slot.key: self.choices.get(slot.key, slot.neutral(self.ranges)) for slot in self.slots}
        return np.array([*base[BASE_PART], *(numbers.get(key, value) for key, value in known.items())])

    def moved(self, x: np.ndarray, other: Parameters) -> np.ndarray:
        """This model's vector in another layout; what it lacks here is known, at null, or its first start."""
        numbers = {slot.key: x[i] for i, slot in self.items()}
        return other.vector(x, {**self.choices, **other.choices, **numbers})

    def grown(self, x: np.ndarray, effects: Sequence[str]) -> np.ndarray:
        """This model's vector in a model with more effects; theirs are at null, or the first start."""
        return self.moved(x, dataclasses.replace(self, effects=tuple(effects), form=False))

    def _bound(self, slot: Slot, name: str) -> float:
        bound = getattr(slot.parameter, name)(self.ranges)
        return np.log(bound) if slot.logarithmic else bound


def absent_from(ranges: Ranges) -> tuple[str, ...]:
    """Parameters of eq. 14 that data of such ranges exclude.

    What turns more than once has no stiffness about an angle: C would follow what differs from run to run. A load or a
    pressure makes no field.
    """
    return ("C",) * (ranges.turns > 1.0) + ("K1",) * ranges.load


def _linear_step(p: EffectParameter, r: Ranges) -> float:
    """A step of a linear parameter that changes the torque by the order of a percent."""
    q, current, torque = p.scale
    unit = r.qd**q if (q, current, torque) != (1, 0, 0) else r.q
    size = unit * r.current**current * r.torque**torque
    if p.unit == "kg·m²":
        size = r.torque * r.q / max(r.qd**2, 1e-12)
    if p.unit == "1/s":
        size = 1.0 / r.session
    if p.unit == "1/J":
        size = 1.0 / (r.torque * r.qd * min(r.session, 100.0))
    return 1e-2 * size if size > 0 else 1e-2


def simulate(replay: EffectReplay, models: Sequence[tuple[Parameters, np.ndarray]]) -> np.ndarray:
    """Torque of several models, float32, shape (C, N)."""
    return replay.torque(np.stack([p.row(x) for p, x in models]))


def without_hysteresis(p: Parameters, x: np.ndarray) -> tuple[Parameters, np.ndarray]:
    """A model of the terms that add to a law's torque: they act as in the whole model, for less time.

    Behind play or an elastic element nothing only adds, and eq. 15 costs little: then it is the model itself.
    """
    if not p.law or set(YIELDING) & set(p.effects):
        return p, x
    layout = dataclasses.replace(p, effects=tuple(name for name in p.effects if name != p.law))
    y = np.array([*x[BASE_PART], *(x[i] for i, slot in p.items() if slot.effect != p.law)])
    y[[_K0, _K1]] = 0.0
    return layout, y


@np.errstate(over="ignore", invalid="ignore")
def jacobian(replay: EffectReplay, p: Parameters, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque, shape (N,), and its derivatives by every coordinate, float32, shape (P, N), from one launch.

    A shaft that yields moves by the ratio of B and K: its derivatives by each of them jump where a stop is left or met
    between other samples. By all in proportion they do not, so the largest one's is what that leaves to the others.

    A model that runs away has infinite torque and no slopes: its loss is not finite, and no search takes it.
    """
    linear, steps = len(LINEAR), p.steps.copy()
    yielding = [LINEAR.index(name) for name in NON_NEGATIVE] if set(YIELDING) & set(p.effects) else []
    largest = max(yielding, key=lambda i: x[i], default=0)
    if yielding and x[largest] > _LEAST:
        steps[yielding] = np.maximum(_SHARE * x[yielding], _LEAST)
    else:
        yielding = []
    first = SHAPE_PART.stop if p.law else linear  # with a law the shape stands
    alone = without_hysteresis(p, x)
    models = [(p, x)] if alone[0] is p else [(p, x), alone]
    begin, rows = np.zeros(linear, dtype=int), len(models)
    adds = {i for i in range(linear) if i not in (_K0, _K1)} | {i for i, slot in p.items() if KNOWN[slot.effect].adds}
    for i in (*range(linear), *range(first, p.size)):
        cheap = alone[0] is not p and i in adds
        if cheap and i < linear:
            begin[i] = 1
        for sign in (1.0,) if i < linear else (1.0, -1.0):
            y = x.copy()
            y[i] += sign * steps[i]
            if yielding and i == largest:
                y[yielding] = (1.0 + _SHARE) * x[yielding]
            models.append(without_hysteresis(p, y) if cheap else (p, y))
    tau = simulate(replay, models)
    steps = steps[:, None].astype(np.float32)
    slopes = np.empty((p.size, tau.shape[1]), dtype=np.float32)
    slopes[:linear] = (tau[rows : rows + linear] - tau[begin]) / steps[:linear]
    if yielding:
        others = [i for i in yielding if i != largest]
        together = (tau[rows + largest] - tau[0]) / np.float32(_SHARE)
        slopes[largest] = (together - x[others].astype(np.float32) @ slopes[others]) / np.float32(x[largest])
    slopes[linear:first] = 0.0
    if p.ranges.load:
        slopes[_K1] = 0.0  # stays at 0
    slopes[first:] = (tau[rows + linear :: 2] - tau[rows + linear + 1 :: 2]) / (2.0 * steps[first:])
    return tau[0].astype(float), slopes
