"""A prepared data set and the models fitted to it: the values that every step of a diagnosis takes and returns.

Losses are in units of the noise's variance, after whitening and with offsets and factors of trajectories taken out, so
a gain compares with chi-squared. A model is judged by its leave-one-out loss: a trajectory counts by how well the
others predict it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from mrwarp.effects.catalogue import CATALOGUE, KNOWN
from mrwarp.identify.angle_lines import angle_lines
from mrwarp.identify.dataset import Motion, Scales
from mrwarp.identify.noise import Noise
from mrwarp.identify.normal_equations import NormalEquations, losses
from mrwarp.identify.parameters import (
    BASE_PART,
    EFFECT_PART,
    LINEAR,
    SHAPE,
    SHAPE_PART,
    YIELDING,
    Parameters,
    jacobian,
    row_column,
    shape_coordinates,
    simulate,
)
from mrwarp.identify.replay import EffectReplay
from mrwarp.recording.data import quantity
from mrwarp.sysid.certainty import by_ratio, gain_and_t
from mrwarp.sysid.jackknife import effective_count, jackknife, student
from mrwarp.sysid.least_squares import Rules, minimise
from mrwarp.sysid.left_out import left_out
from mrwarp.sysid.pieces import Pieces, Quadratic
from mrwarp.sysid.settings import Settings

STIFFER = 4.0
"""Ratio of stiffnesses from which a device behind play or a spring is looked at, and fitted again."""


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A data set with the noise that models of it are judged by; normalised units."""

    replay: EffectReplay
    """The motion on a device, with the torque that is to be explained."""
    measured: np.ndarray
    """Torque as it was measured, shape (N,)."""
    weight: np.ndarray
    """1 for samples that count, else 0, shape (N,)."""
    q_zero: float
    """Angle from which q_c counts."""
    units: Mapping[str, str]
    """Units of the recording: of q, current and torque."""
    noise: Noise
    misfit: bool = False
    """Whether the mismatch is so large that its statistics say nothing about noise."""
    settings: Settings = field(default_factory=Settings)
    """The numbers by which everything about it is decided."""

    @property
    def motion(self) -> Motion:
        """The samples."""
        return self.replay.motion

    @property
    def unchanging(self) -> bool:
        """Whether the control input is the same throughout."""
        current = self.motion.current
        return bool(np.ptp(current) <= self.settings.gain.share * np.abs(current).max())

    @property
    def impossible(self) -> tuple[str, ...]:
        """Effects that a control input of this kind cannot have, or that nothing can show where it never changes."""
        needs: tuple[str, ...] = ()
        if self.unchanging:
            needs = ("change", "command", "field")
        elif self.motion.ranges.load:  # neither makes a field; a valve may lag
            needs = ("field",) if quantity("current", self.units) == "pressure" else ("command", "field")
        if not self.motion.ranges.radian:
            needs = (*needs, "angle")
        if self.motion.temperature is None:
            needs = (*needs, "temperature")
        return tuple(name for name, law in CATALOGUE.items() if law.needs in needs)

    def with_motion(self, motion: Motion) -> Problem:
        """The problem with another reading of the motion, or another torque to be explained."""
        return replace(self, replay=EffectReplay(motion, threads=self.replay.threads))

    def parameters(self, effects: Sequence[str], choices: Mapping[tuple[str, str], float] | None = None) -> Parameters:
        """Layout of a model's vector on this data set; effects stand in the catalogue's order."""
        order = tuple(name for name in KNOWN if name in effects)
        return Parameters(order, self.motion.ranges, self.q_zero, dict(choices or {}))

    def equations(
        self, blocks: Sequence[np.ndarray], torque: np.ndarray, *, derivatives: bool = False
    ) -> NormalEquations:
        """Whitened normal equations of signals, in blocks of shape (k, N), about a simulated torque.

        ``derivatives``: of its derivatives, and of the mismatch in the last row.
        """
        threads = self.replay.threads
        return NormalEquations(blocks, torque, self.motion, self.noise, self.weight, threads, derivatives)

    def of_runs(self, rest: np.ndarray, predicted: np.ndarray, at: np.ndarray | None = None) -> np.ndarray:
        """Part of a rest that is a zero and a gain of each run, as the noise has them, all of shape (M,).

        ``at`` are places of the samples, None: all. Blocks of one run are of one set-up, which has one zero and gain.
        """
        motion, out = self.motion, np.zeros(len(rest))
        if motion.cut:
            return out
        at = np.arange(len(motion.q)) if at is None else at
        run = np.searchsorted(motion.start, at, side="right") - 1
        for k in np.unique(run):
            here = run == k
            rows, w = np.stack([np.ones(int(here.sum())), predicted[here]], axis=1), self.weight[at[here]]
            out[here] = rows @ np.linalg.lstsq(w[:, None] * rows, w * rest[here], rcond=None)[0]
        return out

    def loss(self, parameters: Parameters, x: np.ndarray) -> float:
        """Loss of a model, as :meth:`linearised` has it in the last element of the normal equations."""
        torque = simulate(self.replay, [(parameters, x)])[0].astype(float)
        mismatch = (self.motion.torque - torque)[None]
        return float(self.equations([mismatch], torque, derivatives=True).total[-1, -1])

    def linearised(self, parameters: Parameters, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, NormalEquations]:
        """Torque of a model, its derivatives, and the normal equations of [derivatives, mismatch]."""
        torque, slopes = jacobian(self.replay, parameters, x)
        return torque, slopes, self.equations([slopes, (self.motion.torque - torque)[None]], torque, derivatives=True)


@dataclass(frozen=True, eq=False)
class Fit:
    """A model at its best numbers."""

    parameters: Parameters
    x: np.ndarray
    torque: np.ndarray
    """Simulated torque, shape (N,)."""
    slopes: np.ndarray
    """Its derivatives, float32, shape (P, N)."""
    loss: np.ndarray
    """Whitened sum of squares of each trajectory, shape (T,)."""
    loo_loss: np.ndarray
    """Leave-one-out loss: that of each trajectory by the fit to the others, shape (T,)."""
    equations: NormalEquations
    """Of [derivatives, mismatch]."""
    free: list[int]
    """Coordinates that are not held at a bound which they push against: linear models may not cross it either."""
    least_variance: np.ndarray | None = None
    """Least variances of the coordinates, shape (P,), or None."""

    @property
    def total(self) -> float:
        """Leave-one-out loss of all trajectories."""
        return float(self.loo_loss.sum())

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects that act."""
        return self.parameters.effects

    @property
    def row(self) -> np.ndarray:
        """The kernel's row, shape (WIDTH,)."""
        return self.parameters.row(self.x)


def fit_model(
    problem: Problem, parameters: Parameters, x: np.ndarray, *, iterations: int = 12, tolerance: float = 1e-5
) -> Fit:
    """Least squares of the whitened mismatch, within bounds, from a vector ``x``."""

    def evaluate(x: np.ndarray) -> Quadratic:
        found = problem.linearised(parameters, x)
        return Quadratic.of(found[-1].total, found)

    def loss(x: np.ndarray) -> float:
        return problem.loss(parameters, x)

    rules = Rules(
        iterations=iterations,
        predicted=lambda gain, loss: gain < tolerance * loss and gain < 0.02 * parameters.size,
    )
    reach = parameters.reach(1.0, 0.7)
    if set(YIELDING) & set(parameters.effects) and not parameters.law:
        x, best = _by_sliding_torque(evaluate, loss, x, parameters, reach, rules)
    else:
        x, best = _minimum(evaluate, loss, x, parameters, reach, rules)
    torque, slopes, equations = best.content
    # coordinates of eqs. 14 and 15 that are not at a bound and push against it, and all of the effects
    at_low, at_high = x <= parameters.low + 1e-9, x >= parameters.high - 1e-9
    held = (at_low & (best.descent < 0.0)) | (at_high & (best.descent > 0.0))
    held[EFFECT_PART] = False
    if problem.motion.ranges.turns > 1.0:  # a joint that turns on and on shows little of a loop's shape
        held[SHAPE_PART] = True
    free = [int(i) for i in np.flatnonzero(~held)]
    _, inside, outside = losses(equations, free, len(x))
    # what stands is the loss at x; the linear model only says what leaving a trajectory out adds to it
    squares = equations.parts[:, -1, -1]
    added = np.subtract(outside, inside, out=np.zeros_like(squares), where=np.isfinite(squares))
    return Fit(parameters, x, torque, slopes, squares, squares + added, equations, free)


def _minimum(
    about: Callable[[np.ndarray], Quadratic],
    loss: Callable[[np.ndarray], float],
    x: np.ndarray,
    p: Parameters,
    reach: np.ndarray,
    rules: Rules,
) -> tuple[np.ndarray, Quadratic]:
    """Least squares within a model's bounds: derivatives are taken at better points only."""
    found = minimise(
        about, x, p.low, p.high, reach=reach, rules=rules, seen=lambda x, here: replace(here, loss=loss(x))
    )
    return found.x, found.quadratic


def _by_sliding_torque(
    evaluate: Callable[[np.ndarray], Quadratic],
    loss: Callable[[np.ndarray], float],
    x: np.ndarray,
    p: Parameters,
    reach: np.ndarray,
    rules: Rules,
) -> tuple[np.ndarray, Quadratic]:
    """Least squares in K0/(beta + gamma) and K1/(beta + gamma) instead of K0 and K1.

    Behind play or a spring a device may be stiffer than any data show: K and beta then grow together, along a curve
    that a step in K and log(beta + gamma) leaves at once. The torque at which the device slides stays what it is.
    """
    stiff, rate = [LINEAR.index("K0"), LINEAR.index("K1")], SHAPE_PART.start + SHAPE.index("beta")

    def outer(y: np.ndarray) -> np.ndarray:
        x = y.copy()
        x[stiff] *= np.exp(y[rate])
        return x

    def about(y: np.ndarray) -> Quadratic:
        x = outer(y)
        found, turn = evaluate(x), np.eye(len(x))
        turn[stiff, stiff] = np.exp(y[rate])
        turn[stiff, rate] = x[stiff]
        return replace(found, normal=turn.T @ found.normal @ turn, descent=turn.T @ found.descent)

    y = np.clip(x, p.low, p.high)
    y[stiff] *= np.exp(-y[rate])
    y, best = _minimum(about, lambda y: loss(outer(y)), y, p, reach, rules)
    # the derivatives stand in K0 and K1
    back = np.eye(len(y))
    back[stiff, stiff] = np.exp(-y[rate])
    back[stiff, rate] = -y[stiff]
    return outer(y), replace(best, normal=back.T @ best.normal @ back, descent=back.T @ best.descent)


def refit(problem: Problem, fit: Fit, *, tolerance: float = 1e-5) -> Fit:
    """The model fitted to a changed problem."""
    return fit_model(problem, fit.parameters, fit.x, tolerance=tolerance)


def plain_fit(problem: Problem, fit: Fit, *, bent: bool = False) -> Fit:
    """The model, with ``bent`` laws if asked, by least squares without whitening, offsets and factors still let go."""
    plain = replace(problem.noise, whitening=np.ones(1), sigma=problem.noise.rms)
    layout = (fit.parameters.bent() if bent else fit.parameters).reported()
    problem = replace(problem, noise=plain)
    return _as_stiff(problem, fit_model(problem, layout, fit.parameters.moved(fit.x, layout)))


def stiffer(x: np.ndarray, ratio: float) -> np.ndarray:
    """A model's vector with a device that is as many times stiffer and slides at the same torque."""
    y = x.copy()
    y[SHAPE_PART.start + 1 : SHAPE_PART.stop] += np.log(ratio)
    y[[LINEAR.index("K0"), LINEAR.index("K1")]] *= ratio
    return y


def _as_stiff(problem: Problem, fit: Fit) -> Fit:
    """The model fitted again from a stiffer device behind its play or spring, as long as that is clearly better.

    A little of the spring is as good as a softer device, so fits from there creep, and stop where contacts that come
    and go between samples roughen the loss.
    """
    while set(YIELDING) & set(fit.effects) and not fit.parameters.law:
        x = stiffer(fit.x, STIFFER)
        if (x > fit.parameters.high).any():
            break
        stiff = fit_model(problem, fit.parameters, x)
        if stiff.loss.sum() > (1.0 - problem.settings.gain.share) * fit.loss.sum():
            break
        fit = stiff
    return fit


def reported_fit(problem: Problem, fit: Fit) -> Fit:
    """The model whose numbers are reported: fitted again by plain least squares, bent laws where these predict better.

    Whitened differences decide what is there, for chance is computed in them. But they weigh what is quick, and there a
    motion that is known to some milliseconds only, or a law in a slightly wrong form, shrinks an effect.
    """
    resolution = np.zeros(fit.parameters.size)
    numbers = zip(fit.parameters.slots, fit.x[EFFECT_PART], strict=True)
    resolution[EFFECT_PART] = [s.parameter.resolution * (1.0 if s.logarithmic else abs(x)) for s, x in numbers]
    least = np.diag(covariance(fit)) + resolution**2
    own = dict(zip((slot.key for slot in fit.parameters.slots), least[EFFECT_PART], strict=True))

    def stated(plain: Fit) -> Fit:
        added = [own.get(slot.key, 0.0) for slot in plain.parameters.slots]
        return replace(plain, least_variance=np.array([*least[BASE_PART], *added]))

    fit, plain = _as_logged(problem, fit, plain_fit(problem, fit))
    fit = _with_harmonics(problem, fit, plain := stated(plain))
    bends = [slot.parameter for slot in fit.parameters.bent().slots if slot.parameter.form]
    if bends:
        bent = plain_fit(problem, fit, bent=True)
        gain, t = gain_and_t(plain.loo_loss, bent.loo_loss)
        settings = problem.settings.gain
        # harmonics of a joint that turns all the way round: a line of the spectrum stands in for nothing else
        least_t = settings.likely_t if problem.motion.ranges.turns >= 1.0 else settings.clear_t
        if all(p.carried for p in bends):  # where an inertia is known to be there, some is behind the gear
            least_t = settings.one_error
        clear = t > least_t or by_ratio(plain.loo_loss, bent.loo_loss) > settings.clear_t
        if clear and gain > problem.settings.search.bent * plain.total:
            return stated(bent)
    return plain


def _as_logged(problem: Problem, fit: Fit, plain: Fit) -> tuple[Fit, Fit]:
    """The model and its plain fit by the way of logging that leaves the least plain error, where none is between."""
    logging = [(effect, p) for effect in fit.effects for p in KNOWN[effect].parameters if p.choices and not p.form]
    for key, way in [((effect, p.name), x) for effect, p in logging for x in p.choices]:
        choices = {**fit.parameters.choices, key: way}
        if choices != fit.parameters.choices:
            other = plain_fit(problem, replace(plain, parameters=replace(plain.parameters, choices=choices)))
            if other.loss.sum() < plain.loss.sum():
                fit, plain = replace(fit, parameters=replace(fit.parameters, choices=choices)), other
    return fit, plain


def _with_harmonics(problem: Problem, fit: Fit, plain: Fit) -> Fit:
    """The model with the number of repetitions of further harmonics known.

    Where a joint turns all the way round what the model leaves shows them, one after the other as long as each
    predicts; else twice the first one's number may be one.
    """
    parameters, ranges, choices = fit.parameters, problem.motion.ranges, dict(fit.parameters.choices)
    for effect in fit.effects:
        counts = [p for p in KNOWN[effect].parameters if p.repeats]
        more = [p for p in counts if p.form and (effect, p.name) not in choices]
        if more and ranges.turns < 1.0:
            choices[effect, more[0].name] = 2.0 * parameters.values(fit.x)[effect][counts[0].name]
        elif more:
            choices |= {(effect, name): line for name, line in _lines_that_predict(problem, plain, effect).items()}
    if choices == parameters.choices:
        return fit
    layout = replace(parameters, choices=choices)
    return replace(fit, parameters=layout, x=parameters.moved(fit.x, layout))


def with_lines(problem: Problem, fit: Fit) -> Fit:
    """The model with the further lines that predict, of a joint that turns all the way round; all fitted together.

    With one line of several a lag seems to add little to what is left, and functions along the angle replace it.
    """
    if problem.motion.ranges.turns < 1.0:
        return fit
    for effect in fit.effects:
        if any(p.repeats for p in KNOWN[effect].parameters):
            found = {(effect, name): line for name, line in _lines_that_predict(problem, fit, effect).items()}
            if found.keys() - fit.parameters.choices.keys():
                layout = replace(fit.parameters, choices={**fit.parameters.choices, **found})
                more = fit_model(problem, layout, fit.parameters.moved(fit.x, layout))
                fit = more if more.total < fit.total else fit
    return fit


def _lines_that_predict(problem: Problem, fit: Fit, effect: str) -> dict[str, float]:
    """Numbers of repetitions along the angle: the known ones, tuned, and further lines, each better on unseen runs.

    What the model leaves shows the next line; its sine and cosine pass through the model's own sensor. Each line's
    number of repetitions is tuned with all else: the error of a strong one would stand as weak lines next to it.
    """
    ranges, mismatch = problem.motion.ranges, problem.motion.torque - fit.torque
    first, *others = (p for p in KNOWN[effect].parameters if p.repeats)
    now = fit.parameters.values(fit.x)[effect]
    lines = {p.name: now[p.name] for p in (first, *others) if (effect, p.name) in fit.parameters.choices}
    columns = [_by_repetitions(problem, fit, effect, {name: line}) for name, line in lines.items()]
    tuning = {name: k for k, name in enumerate(lines)}
    solution, loss = _together(problem, fit, columns)
    for p in others:
        if p.name in lines:
            continue
        # the model's own numbers stay: at one speed each way some of them only stand for each other, at any size
        left = mismatch - solution[len(fit.free) :] @ np.vstack(columns)
        limits, given = (first.low(ranges), first.high(ranges)), (now[first.name], *lines.values())
        if not (found := angle_lines(problem.motion, left, *limits, given=given)):
            break
        parts = [x.name for x in KNOWN[effect].parameters if x.requires == p.name]
        numbers = [{p.name: found[0], **{x: float(x == part) for x in parts}} for part in parts]
        waves = list(_torques(problem, fit, effect, numbers) - fit.torque)
        sizes, after = _together(problem, fit, [*columns, *waves])
        gain, t = gain_and_t(loss, after)
        settings = problem.settings.gain
        if gain < max(settings.chi2, settings.share * float(loss.sum())) or t < settings.likely_t:
            break
        lines[p.name], tuning[p.name] = found[0], len(columns) + len(waves)
        whole = {p.name: found[0], **dict(zip(parts, sizes[-len(parts) :], strict=True))}
        columns += [*waves, _by_repetitions(problem, fit, effect, whole)]
        solution, loss = _together(problem, fit, columns)
    reach = 0.5 * np.pi / ranges.q  # a quarter of the distance of two distinct lines
    steps = {name: float(np.clip(solution[len(fit.free) + k], -reach, reach)) for name, k in tuning.items()}
    return {name: line + steps[name] for name, line in lines.items()}


def _together(problem: Problem, fit: Fit, columns: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Solution of a model's free derivatives and ``columns`` for its mismatch, and the leave-one-out losses, (T,)."""
    size = len(fit.x)
    rows = np.array(columns).reshape(-1, len(fit.torque))
    blocks = [fit.slopes, rows, (problem.motion.torque - fit.torque)[None]]
    equations = problem.equations(blocks, fit.torque, derivatives=True)
    solution, _, outside = losses(equations, [*fit.free, *range(size, size + len(rows))], size + len(rows))
    return solution, outside


def _torques(problem: Problem, fit: Fit, effect: str, numbers: Sequence[Mapping[str, float]]) -> np.ndarray:
    """Torque of a model with some numbers of an effect changed, shape (C, N)."""
    rows = np.repeat(fit.row[None], len(numbers), axis=0)
    for row, changed in zip(rows, numbers, strict=True):
        for name, value in changed.items():
            row[row_column(effect, name)] = value
    return problem.replay.torque(rows).astype(float)


def _by_repetitions(problem: Problem, fit: Fit, effect: str, line: Mapping[str, float]) -> np.ndarray:
    """Derivative of a model's torque by the number of repetitions of a line, which ``line`` holds first, shape (N,)."""
    name, value = next(iter(line.items()))
    step = 0.02 / problem.motion.ranges.q
    ahead, behind = _torques(problem, fit, effect, [{**line, name: value + step}, {**line, name: value - step}])
    return (ahead - behind) / (2.0 * step)


def threshold(problem: Problem, fit: Fit) -> float:
    """Gain on top of a model below which nothing is named."""
    return max(problem.settings.gain.chi2, problem.settings.gain.floor * fit.equations.count)


def drifts(effect: str) -> bool:
    """Whether an effect changes slowly, over the session."""
    return "time" in KNOWN[effect].depends_on


def as_good(problem: Problem, fit: Fit, best: Fit, base: Fit) -> bool:
    """Whether a model cannot be distinguished from a better one, by what both gain on a base."""
    loss, t = gain_and_t(fit.loo_loss, best.loo_loss)
    gain, search = problem.settings.gain, problem.settings.search
    slowly = all(drifts(e) for e in set(fit.effects) ^ set(best.effects))
    least_t, part = (gain.likely_t, search.same_slowly) if slowly else (search.same_t, search.same)
    return loss < gain.distinct or (t < least_t and loss < part * (base.total - best.total))


def covariance(fit: Fit) -> np.ndarray:
    """Covariance of the coordinates, shape (P, P): the larger of the noise's and of the jackknife over trajectories."""
    parts, size = fit.equations.parts, len(fit.x)
    total = fit.equations.total[:size, :size]
    scale = np.sqrt(np.where(np.diag(total) > 0.0, np.diag(total), 1.0))
    inverse = np.linalg.pinv(total / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
    noise = inverse * max(1.0, float(fit.equations.total[size, size]) / fit.equations.count)
    count = len(parts)
    least = np.zeros(size) if fit.least_variance is None else fit.least_variance
    if count >= 3:
        least = np.maximum(least, np.diag(jackknife(left_out(Pieces.of_grams(parts)))))
    ratio = np.sqrt(np.maximum(1.0, least / np.maximum(np.diag(noise), 1e-300)))
    return noise * np.outer(ratio, ratio)


def interval(fit: Fit, index: int, spread: np.ndarray, level: float = 0.95) -> tuple[float, float]:
    """Interval of one coordinate that holds it with this chance, by the :func:`covariance` ``spread``."""
    parts, size = fit.equations.parts, len(fit.x)
    information = parts[:, index, index] if index < size else np.ones(len(parts))
    half = student(level, max(effective_count(information) - 1.0, 2.0)) * float(np.sqrt(spread[index, index]))
    return float(fit.x[index] - half), float(fit.x[index] + half)


def normalised(values: Mapping[str, float], scales: Scales) -> dict[str, float]:
    """Parameters of eqs. 14 and 15 from the units of the recording."""
    return {name: values[name] / scales.factor(name) for name in (*LINEAR, *SHAPE)}


def unit_loop(values: Mapping[str, float]) -> dict[str, float]:
    """Parameters of equal sliding torque with beta = 1, gamma = 0 and alpha = 0, as with a law in eq. 15's place."""
    rate = values["beta"] + values["gamma"]
    gains = {name: values[name] / rate for name in ("K0", "K1")}
    return {**values, **gains, "alpha": 0.0, "beta": 1.0, "gamma": 0.0}


def base_vector(values: Mapping[str, float], speed: float) -> np.ndarray:
    """Coordinates of eqs. 14 and 15, shape (9,), from their parameters and a typical speed, in normalised units."""
    shape = shape_coordinates(values["alpha"], values["beta"], values["gamma"], speed)
    return np.array([*(values[name] for name in LINEAR), *shape])
