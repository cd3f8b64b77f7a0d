"""Fitting models with effects to one data set: all of them side by side in one batch of the simulator's kernels."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.dataset import Motion
from mrwarp.identify.least_squares import Quadratic, Rules, minimise
from mrwarp.identify.noise import Noise
from mrwarp.identify.normal_equations import NormalEquations, losses
from mrwarp.identify.parameters import EFFECT_PART, Parameters, Slot, jacobian, simulate, slots_of
from mrwarp.identify.replay import EffectReplay

_SLAB = 12
"""Trials whose signals share one table: bounds its memory and the products that nobody needs."""


@dataclass(frozen=True)
class Fitted:
    """A model at its best numbers. Losses are in units of the noise's variance."""

    coordinates: Parameters
    x: np.ndarray
    torque: np.ndarray
    """Simulated torque, shape (N,)."""
    slopes: np.ndarray
    """Its derivatives, float32, shape (P, N)."""
    loss: np.ndarray
    """Whitened sum of squares of each trajectory, shape (T,)."""
    left_out: np.ndarray
    """The same with the trajectory left out of the fit, shape (T,)."""
    grams: NormalEquations
    """Of [slopes, residual]."""
    free: list[int]
    """Coordinates that are not held at a bound which they push against: linear models may not cross it either."""
    least_variance: np.ndarray | None = None
    """What the coordinates' variances are at least, shape (P,), or None."""

    @property
    def total(self) -> float:
        """Held-out loss of all trajectories."""
        return float(self.left_out.sum())

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that act."""
        return self.coordinates.effects


@dataclass(frozen=True)
class Candidate:
    """What one more effect would give, with the base parameters' derivatives held: a first look."""

    effect: str
    choices: dict[tuple[str, str], float]
    values: np.ndarray
    """Coordinates of the effect's own numbers."""
    loss: float
    left_out: np.ndarray
    """Shape (T,)."""

    @property
    def total(self) -> float:
        """Held-out loss of all trajectories."""
        return float(self.left_out.sum())


class Engine:
    """Fits on one data set.

    Args:
        replay: The motion.
        q_zero: Angle from which q_c counts, inner units.
        weight: 1 for samples that count, shape (N,).
    """

    def __init__(
        self, replay: EffectReplay, q_zero: float, weight: np.ndarray, units: Mapping[str, str] | None = None
    ) -> None:
        self.replay, self.motion, self.samples = replay, replay.motion, replay.motion
        self.q_zero, self.weight = q_zero, weight
        self.units = dict(units or {})
        self.measured = self.samples.torque
        self.noise: Noise | None = None
        self.misfit = False
        """Whether the mismatch is so large that its statistics say nothing about noise."""

    @property
    def noise_model(self) -> Noise:
        """The noise model; it must have been learned."""
        assert self.noise is not None
        return self.noise

    def follow(self, motion: Motion) -> None:
        """Take another reading of the same recording's motion; the measured torque stays as it is."""
        self.motion, self.replay = motion, EffectReplay(motion, threads=self.replay.threads)
        self.samples = dataclasses.replace(self.samples, q=motion.q, qd=motion.qd)

    def set_aside(self, frequency: float, torque: np.ndarray) -> None:
        """Take a line out of the measured torque, with its own phase and size in each trajectory.

        Args:
            frequency: Where it is [Hz].
            torque: Simulated torque, shape (N,).
        """
        cleaned = self.samples.torque.copy()
        for part, dt in zip(self.samples.parts, self.samples.dt, strict=True):
            phase = 2.0 * np.pi * dt * np.arange(part.stop - part.start)
            mismatch = cleaned[part] - torque[part]
            best = np.inf
            taken = np.zeros(len(phase))
            for f in frequency + np.linspace(-0.5, 0.5, 21) / max(dt * len(phase), 1e-9):
                table = np.column_stack([np.sin(f * phase), np.cos(f * phase), np.ones(len(phase))])
                solution = np.linalg.lstsq(table, mismatch, rcond=None)[0]
                rest = float(((mismatch - table @ solution) ** 2).sum())
                if rest < best:
                    best, taken = rest, table[:, :2] @ solution[:2]
            cleaned[part] -= taken
        self.samples = dataclasses.replace(self.samples, torque=cleaned)

    def coordinates(self, effects: Sequence[str], choices: dict[tuple[str, str], float] | None = None) -> Parameters:
        """Coordinates of a model on this data set."""
        order = [name for name in CATALOGUE if name in effects]
        return Parameters(tuple(order), self.motion.ranges, self.q_zero, choices or {})

    def grams(self, rows: np.ndarray | Sequence[np.ndarray], torque: np.ndarray) -> NormalEquations:
        """Whitened Gram matrices of signals, shape (M, N), or of blocks of them."""
        return NormalEquations(rows, torque, self.samples, self.noise_model, self.weight)

    def fit(self, c: Parameters, x: np.ndarray, *, iterations: int = 12, tolerance: float = 1e-5) -> Fitted:
        """Levenberg-Marquardt on the whitened mismatch, within bounds."""

        def evaluate(y: np.ndarray) -> Quadratic:
            torque, slopes = jacobian(self.replay, c, y)
            table = self.grams([slopes, (self.samples.torque - torque)[None]], torque)
            return Quadratic.of(table.total, (torque, slopes, table))

        rules = Rules(
            iterations=iterations, predicted=lambda gain, loss: gain < tolerance * loss and gain < 0.02 * c.size
        )
        x, best = minimise(evaluate, x, c.low, c.high, reach=c.reach(1.0, 0.7), rules=rules)
        torque, slopes, table = best.content
        free = _free(table.total, c, x)
        _, inside, outside = losses(table, free, len(x))
        # what stands is the loss at x; the linear model only says what leaving a trajectory out adds to it
        loss = table.parts[:, -1, -1]
        return Fitted(
            coordinates=c, x=x, torque=torque, slopes=slopes, loss=loss, left_out=loss + outside - inside, grams=table,
            free=free,
        )  # fmt: skip

    def plain_fit(self, fit: Fitted, *, bent: bool = False) -> Fitted:
        """The same model by least squares without whitening; offsets and factors of trajectories are still let go.

        Args:
            fit: The model.
            bent: Whether the numbers that bend its laws are fitted as well.
        """
        noise = self.noise_model
        c = fit.coordinates.bent() if bent else fit.coordinates
        self.noise = dataclasses.replace(noise, whitening=np.ones(1), sigma=noise.rms)
        plain = self.fit(c.steeper(), fit.coordinates.moved(fit.x, c))
        self.noise = noise
        return plain

    # --- a first look at what one more effect would give ---

    def screen(
        self, base: Fitted, effects: Iterable[str], *, refine: int = 6, hopeless: float = 0.0
    ) -> list[Candidate]:
        """Best of each effect's starts, improved with the base's derivatives held; one batch for all.

        Args:
            base: The model without them.
            effects: Candidates.
            refine: Steps of improvement.
            hopeless: Starts whose linear look promises a smaller gain than this are left as they are.
        """
        points: list[_Trial] = []
        for effect in effects:
            points += _trials(effect, base.coordinates)
        if not points:
            return []
        self._evaluate(base, points)
        best: list[_Trial] = []
        for effect in dict.fromkeys(p.effect for p in points):
            mine = sorted((p for p in points if p.effect == effect), key=lambda p: p.loss)
            best += _apart(mine, 2)
        now = float(base.loss.sum())
        for p in best:
            p.settled = now - p.loss < hopeless
        for _ in range(refine):
            moving = [p for p in best if not p.settled]
            if not moving:
                break
            trials = [p.moved() for p in moving]
            self._evaluate(base, trials)
            for old, new in zip(moving, trials, strict=True):
                old.take(new)
        found = []
        for effect in dict.fromkeys(p.effect for p in best):
            p = min((p for p in best if p.effect == effect), key=lambda p: p.loss)
            short = max(0.0, p.held - p.loss)  # at a bound, or not settled: what the linear look promises too much
            found.append(Candidate(effect, p.choices, p.values, p.held, p.left_out + short / len(p.left_out)))
        return sorted(found, key=lambda f: f.total)

    def _evaluate(self, base: Fitted, trials: list[_Trial]) -> None:
        """Losses and next steps of trials: one launch for their torques and their derivative columns."""
        pairs = []
        for t in trials:
            t.coordinates = self.coordinates((*base.effects, t.effect), {**base.coordinates.choices, **t.choices})
            x = base.coordinates.grown(base.x, t.coordinates.effects)
            t.own = t.coordinates.own(t.effect)
            x[t.own] = t.values
            pairs.append((t.coordinates, x))
            for i in t.own:
                y = x.copy()
                y[i] += t.coordinates.steps[i]
                pairs.append((t.coordinates, y))
        tau = simulate(self.replay, pairs)
        size, at = len(base.slopes), 0
        for first in range(0, len(trials), _SLAB):
            some, blocks = trials[first : first + _SLAB], [base.slopes]
            for t in some:
                here, num = tau[at], len(t.own)
                blocks.append((tau[at + 1 : at + 1 + num] - here) / t.coordinates.steps[t.own, None])
                blocks.append((self.samples.torque - here)[None])
                at += 1 + num
            table = self.grams(blocks, base.torque)
            column = size
            for t in some:
                count = len(t.own)
                use = [*base.free, *range(column, column + count)]
                # what eq. 14 alone can take up, with the effect's numbers held: decides between starts
                solution, inside, outside = losses(table, use, column + count)
                t.step, t.loss, t.left_out = solution[len(base.free) :], float(inside.sum()), outside
                held, _, _ = losses(table, base.free, column + count)
                t.held = float(_loss_of(table, base.free, column + count, held))
                column += count + 1


class _Trial:
    """Numbers of one effect on the way to their best."""

    def __init__(self, effect: str, choices: dict[tuple[str, str], float], values: np.ndarray) -> None:
        self.effect, self.choices, self.values = effect, choices, values
        self.coordinates: Parameters
        self.own: list[int] = []
        self.step = np.zeros(len(values))
        self.loss, self.held, self.left_out = np.inf, np.inf, np.zeros(0)
        self.settled, self.shrink = False, 1.0

    def moved(self) -> _Trial:
        """A trial one damped step on."""
        low, high = self.coordinates.low[self.own], self.coordinates.high[self.own]
        step = self.step * self.shrink
        reach = self.coordinates.reach(np.inf, 0.7)[self.own]
        step = np.clip(step, -reach, reach)
        new = _Trial(self.effect, self.choices, np.clip(self.values + step, low, high))
        return new

    def take(self, new: _Trial) -> None:
        """Go on from a better trial, or try a shorter step."""
        if new.held < self.held:
            gain = self.held - new.held
            self.settled = gain < 1e-4 * new.held
            self.values, self.step, self.loss, self.held, self.left_out = (
                new.values, new.step, new.loss, new.held, new.left_out,
            )  # fmt: skip
            self.shrink = 1.0
        else:
            self.shrink *= 0.3
            self.settled = self.shrink < 0.05


def _trials(effect: str, c: Parameters) -> list[_Trial]:
    """Starts of an effect: every combination of its logging choices with its non-linear number's starts."""
    slots: list[Slot] = slots_of(effect)
    choices = [{}]
    for p in CATALOGUE[effect].parameters:
        if p.choices:
            choices = [{**old, (effect, p.name): value} for old in choices for value in p.choices]
    starts = [[]]
    for slot in slots:
        if slot.parameter.starts is None:
            values: Sequence[float] = (slot.neutral(c.ranges),)
        else:
            values = slot.parameter.starts(c.ranges)
            if slot.logarithmic:
                values = [float(np.log(v)) for v in values]
        starts = [[*old, v] for old in starts for v in values]
    return [_Trial(effect, dict(choice), np.array(start)) for choice in choices for start in starts]


def _apart(trials: list[_Trial], count: int) -> list[_Trial]:
    """The best trials, of different starts."""
    taken: list[_Trial] = []
    for t in trials:
        if all(t.choices != o.choices or np.abs(t.values - o.values).max() > 1e-9 for o in taken):
            taken.append(t)
        if len(taken) == count:
            break
    return taken


def _free(gram: np.ndarray, c: Parameters, x: np.ndarray) -> list[int]:
    """Coordinates of eqs. 14 and 15 that are not at a bound and push against it, and all of the effects."""
    slope, near = gram[:-1, -1], 1e-9
    held = ((x <= c.low + near) & (slope < 0.0)) | ((x >= c.high - near) & (slope > 0.0))
    held[EFFECT_PART] = False
    return [int(i) for i in np.flatnonzero(~held)]


def _loss_of(table: NormalEquations, use: list[int], target: int, solution: np.ndarray) -> float:
    g = table.total
    return float(g[target, target] - 2.0 * solution @ g[use, target] + solution @ g[np.ix_(use, use)] @ solution)
