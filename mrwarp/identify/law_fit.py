"""Identification with a published hysteresis law in place of eq. 15 (:mod:`mrwarp.effects.laws`).

``tau = D + B*qd + C*q_c + I1*I + B1*I*qd + (K0 + K1*f(I))*h``: every coefficient linear in the control input, and
``f`` its saturation where that predicts trajectories better that took no part. Each trajectory may have its own zero of
the torque; where the zeros differ they are separated from D by a straight line over the control input.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import stats

from mrwarp.effects.catalogue import HYSTERESIS, KNOWN, OF_PUBLISHED_LAWS
from mrwarp.effects.replay_kernel import BASE
from mrwarp.identify.checks.limits import Ends, Limits
from mrwarp.identify.checks.refusal_reason import missed
from mrwarp.identify.contradictions import refuse_contradictions, refuse_unexplained
from mrwarp.identify.dataset import Dataset, Motion, Scales
from mrwarp.identify.fit import FitResult, fit_holding, made_motion, misfit, origin
from mrwarp.identify.intervals import Estimate
from mrwarp.identify.parameters import LINEAR, SHAPE, Parameters, Slot, factor_of, jacobian, row_column, simulate
from mrwarp.identify.projection import Progress
from mrwarp.identify.replay import EffectReplay, null_row
from mrwarp.model_file import Effect, Model, Parameter, effect_unit
from mrwarp.params import BoucWenParams
from mrwarp.recording.data import goes_one_way
from mrwarp.recording.load import Holding, Recording
from mrwarp.sysid.jackknife import jackknife, student
from mrwarp.sysid.least_squares import Rules, minimise, ridge_solve
from mrwarp.sysid.left_out import predicted
from mrwarp.sysid.pieces import Pieces, Quadratic
from mrwarp.sysid.settings import Effort, Law

_STARTS_RUNS = 16
"""Trajectories to which these may fall, where there are many short ones."""
_STARTS = 2
_RULES = Rules(iterations=25, gained=lambda gain, loss: gain < 1e-5 * loss)
_ROUGH = Rules(iterations=10, gained=lambda gain, loss: gain < 1e-3 * loss)


@dataclass(frozen=True, eq=False)
class Solution:
    """A model with a law at its best numbers, normalised units."""

    layout: Parameters
    x: np.ndarray
    torque: np.ndarray
    """Simulated torque without the trajectories' own zeros, shape (N,)."""
    parts: np.ndarray
    """Gram matrix of [derivatives, mismatch] of each trajectory, shape (T, P + 1, P + 1)."""
    free: np.ndarray
    """Coordinates that are searched and off their bounds, shape (F,)."""

    @property
    def loss(self) -> np.ndarray:
        """Squared error of each trajectory, shape (T,)."""
        return self.parts[:, -1, -1]

    @cached_property
    def _left_out(self) -> tuple[np.ndarray, np.ndarray]:
        columns = [*self.free, -1]
        return predicted(Pieces.of_grams(self.parts[:, columns][:, :, columns]))

    @property
    def moves(self) -> np.ndarray:
        """Change of the free coordinates by leaving out each trajectory, shape (T, F)."""
        return self._left_out[0]

    @property
    def held_out(self) -> np.ndarray:
        """Squared error of each trajectory by the fit to the others, shape (T,)."""
        return self._left_out[1]


class LawSearch:
    """A recording on which laws are fitted.

    Args:
        replay: The motion on a device.
        q_zero: Angle from which q_c counts, normalised.
        offsets: Whether each trajectory has a zero of its own.
        limits: Both ends of numbers that are given or bounded, in the units of the recording.
    """

    def __init__(
        self, replay: EffectReplay, q_zero: float, *, offsets: bool, limits: Mapping[str, Ends] | None = None
    ) -> None:
        self.replay, self.motion, self.q_zero, self.offsets = replay, replay.motion, q_zero, offsets
        self.limits = limits or {}
        self.levels = len(np.unique(np.round(self.motion.current, 2)))
        self.weight = self.motion.settled(4.0)
        self.varies = any(np.ptp(self.motion.current[part]) > 0.05 for part in self.motion.parts)
        """Whether the current changes within a trajectory; else only their zeros give I1."""

    def layout(self, effects: Sequence[str]) -> Parameters:
        """The vector of a model with these effects, in the order of the columns."""
        return Parameters(tuple(name for name in KNOWN if name in effects), self.motion.ranges, self.q_zero)

    def bounds(self, layout: Parameters) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds; what a single level of the control input does not show is 0."""
        low, high = layout.low.copy(), layout.high.copy()
        self._limit(layout, low, high)
        if self.levels < 2:
            for i in (LINEAR.index("I1"), LINEAR.index("K1")):
                low[i] = high[i] = 0.0
        if self.offsets:
            low[0] = high[0] = 0.0
            if not self.varies:
                low[LINEAR.index("I1")] = high[LINEAR.index("I1")] = 0.0
        return low, high

    def _limit(self, layout: Parameters, low: np.ndarray, high: np.ndarray) -> None:
        """Narrow bounds of a vector to the limits of its numbers."""
        scales = self.motion.scales
        for i, name in enumerate(LINEAR):
            if name in self.limits:
                least, most = (end / linear_factor(name, scales) for end in self.limits[name])
                low[i], high[i] = max(low[i], least), most
        for i, slot in layout.items():
            if ends := self.limits.get(printed(slot.effect, slot.parameter.name)):
                least, most = (end / factor_of(slot.parameter, scales) for end in ends)
                if slot.logarithmic:
                    least, most = (float(np.log(max(end, 1e-300))) for end in (least, most))
                low[i] = least if least == most else max(low[i], least)
                high[i] = most if least == most else max(min(high[i], most), low[i])

    def evaluate(self, layout: Parameters, x: np.ndarray) -> Quadratic:
        """Squared error about a vector; the content is (torque, Gram matrices of the trajectories).

        A vector whose torque, or that of a step from it, is no number in 32 bits has an infinite error: no search goes
        there.
        """
        torque, slopes = jacobian(self.replay, layout, x)
        rows = np.vstack([slopes, (self.motion.torque - torque)[None]])
        finite = np.isfinite(rows).all()
        parts = self._grams(rows) if finite else np.full((len(self.motion.parts), len(rows), len(rows)), np.inf)
        return Quadratic.of(parts.sum(axis=0), (torque, parts))

    def loss(self, layout: Parameters, x: np.ndarray) -> float:
        """Squared error at a vector; infinite where the torque is no number."""
        rows = self.motion.torque - simulate(self.replay, [(layout, x)])
        return float(self._grams(rows).sum()) if np.isfinite(rows).all() else np.inf

    def _grams(self, rows: np.ndarray) -> np.ndarray:
        """Gram matrices of signals, shape (K, N), in each trajectory, shape (T, K, K)."""
        rows = rows * self.weight
        parts = np.empty((len(self.motion.parts), len(rows), len(rows)))
        for k, part in enumerate(self.motion.parts):
            inside = rows[:, part].astype(float)
            if self.offsets:
                w = self.weight[part]
                inside -= inside.sum(axis=1)[:, None] / max(w.sum(), 1.0) * w
            parts[k] = inside @ inside.T
        return parts

    def descend(self, layout: Parameters, x: np.ndarray, rules: Rules = _RULES) -> Solution:
        """The nearest optimum within the bounds."""
        low, high = self.bounds(layout)
        found = minimise(
            lambda y: self.evaluate(layout, y),
            x,
            low,
            high,
            reach=layout.reach(1.0, 1.0),
            rules=rules,
            seen=lambda y, here: replace(here, loss=self.loss(layout, y)),
        )
        x, (torque, parts) = found.x, found.quadratic.content
        return Solution(layout, x, torque, parts, np.flatnonzero((x > low + 1e-9) & (x < high - 1e-9)))

    def starts(self, layout: Parameters) -> list[np.ndarray]:
        """Best starts of the law's own grid, their linear numbers solved."""
        own = [slot for slot in layout.slots if slot.logarithmic]
        grids = [[np.log(v) for v in slot.parameter.starts(layout.ranges)] for slot in own if slot.parameter.starts]
        base = np.zeros(9)
        base[LINEAR.index("K0")] = 0.5
        found: list[tuple[float, np.ndarray]] = []
        low, high = self.bounds(layout)
        linear = np.array([i for i in range(len(LINEAR)) if low[i] < high[i]])
        for values in itertools.product(*grids):
            x = layout.vector(base, {slot.key: v for slot, v in zip(own, values, strict=True)})
            here = self.evaluate(layout, x)
            step = ridge_solve(here.normal[np.ix_(linear, linear)], here.descent[linear])
            x[linear] += step
            x = np.clip(x, low, high)
            d = np.zeros(len(x))
            d[linear] = x[linear] - np.where(linear == LINEAR.index("K0"), 0.5, 0.0)
            found.append((here.after(d), x))
        return [x for _, x in sorted(found, key=lambda item: item[0])[:_STARTS]]


def law_search(
    motion: Motion,
    q_zero: float,
    name: str,
    *,
    offsets: bool,
    limit: int,
    effects: Sequence[str],
    threads: int = 1,
    limits: Mapping[str, Ends] | None = None,
) -> Solution:
    """The best fit of one law, from starts on a part of the samples.

    Args:
        motion: The reconstructed motion.
        q_zero: Angle from which q_c counts, normalised.
        name: The law.
        offsets: Whether each trajectory has a zero of its own.
        limit: Samples of the starts.
        effects: Further effects.
        threads: CPU threads.
        limits: As of :class:`LawSearch`.
    """
    some = EffectReplay(motion.stretches(limit, _STARTS_RUNS), threads=threads)
    small = LawSearch(some, q_zero, offsets=offsets, limits=limits)
    whole = LawSearch(EffectReplay(motion, threads=threads), q_zero, offsets=offsets, limits=limits)
    layout = whole.layout([name])
    rough = min((small.descend(layout, x, _ROUGH) for x in small.starts(layout)), key=lambda s: float(s.loss.sum()))
    grown = whole.layout([name, *effects])
    return whole.descend(grown, layout.grown(rough.x, grown.effects))


def fit_law(
    recording: Recording,
    name: str,
    *,
    holding: Holding | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    limits: Limits | None = None,
) -> FitResult:
    """Identify a joint with a published law in place of eq. 15.

    Args:
        recording: Measured runs.
        name: The law, a key of :data:`mrwarp.effects.catalogue.HYSTERESIS`.
        holding: Break-away torques, for eq. 18.
        seed: Written to the result; the search draws nothing.
        progress: Called with what is being done.
        limits: Numbers that are given or bounded.

    Raises:
        ValueError: ``limits`` name what such a fit does not have.
        RecordingError: columns that contradict each other, or a model that explains next to nothing.
    """
    log, limits = progress or (lambda text: None), limits or Limits()
    refuse_contradictions(recording)
    at_rest = {} if holding is None else fit_holding(holding.current, holding.torque)
    motion = Motion.of(recording)
    scales, runs, decides = motion.scales, recording.trajectories, Law()
    search, best = _with_own_zeros(motion, name, limits, log)
    centre = best.layout.q_zero * scales.q
    plain = one_zero(best, search.replay, decides.moved, limits.ends)
    offsets: dict[str, float] = {}
    warnings = []
    given = {"D", "I1"} & {*limits.ends}
    if not given and turn_back(motion) and zeros_moved(best, plain, decides.moved):
        best, zeros = _with_zeros(search, best)
        offsets = {run.id: float(zero) * scales.torque for run, zero in zip(runs, zeros, strict=True)}
        warnings.append(_moving_zeros(recording.units["torque"], np.array(list(offsets.values()))))
        simulated = best.torque + np.repeat(zeros, np.diff(motion.start))
    else:
        best, simulated = plain, plain.torque
    std, weight = float(motion.torque.std()) or 1.0, search.weight
    held = float(np.sqrt(best.held_out.sum() / weight.sum())) / std
    nrmse = missed(simulated - motion.torque, motion.torque, weight)
    ratio = float(np.sqrt(best.held_out.sum() / max(best.loss.sum(), 1e-300)))
    refuse_unexplained(recording, motion, nrmse, nrmse * ratio)
    warnings += made_motion(recording)
    estimates, effects = outer_numbers(best, scales, recording.units, (0, 3) if offsets else ())
    return FitResult(
        estimates={name: e for name, e in estimates.items() if name not in limits.given} | at_rest,
        combinations={},
        fixed=dict.fromkeys(("q_offset", "coil_time_constant", "alpha", "gamma"), 0.0)
        | {"q_center": centre, "z_max": BoucWenParams().z_max, "beta": 1.0}
        | {name: value for name, value in limits.given.items() if name in LINEAR},
        given=limits.given,
        condition=1.0,
        seed=seed,
        effects=effects,
        offsets=offsets,
        held_out=held if len(runs) > 1 else None,
        **origin(recording),
        **misfit(recording, simulated, motion, warnings),
    )


def _with_own_zeros(motion: Motion, name: str, limits: Limits, log: Progress) -> tuple[LawSearch, Solution]:
    """The best fit of a law where each of several trajectories has a zero of its own, and its search."""
    middles = [0.5 * (motion.q[part].min() + motion.q[part].max()) for part in motion.parts]
    centres = [0.0, float(np.median(middles))]
    levels, offsets = len(np.unique(np.round(motion.current, 2))), len(motion.parts) > 1
    effects = OF_PUBLISHED_LAWS["term"] if levels > 1 else ()
    limits.check([*LINEAR, *printed_numbers([name, *effects])])
    log(f"{HYSTERESIS[name].title}: starts")
    given: dict[str, Any] = {"offsets": offsets, "limits": limits.ends}
    fits = [
        law_search(motion, centre, name, limit=Effort().samples, effects=effects, **given)
        for centre in (centres if "side" in HYSTERESIS[name].depends_on else centres[:1])
    ]
    best = min(fits, key=lambda s: float(s.loss.sum()))
    search = LawSearch(EffectReplay(motion), best.layout.q_zero, **given)
    if levels > 2:
        log("saturation over the control input")
        grown = search.layout([*best.layout.effects, *OF_PUBLISHED_LAWS["saturation"]])
        bent = search.descend(grown, best.layout.grown(best.x, grown.effects))
        if bent.held_out.sum() < (1.0 - Law.simpler) * best.held_out.sum():
            best = bent
    return search, best


def _moving_zeros(unit: str, zeros: np.ndarray) -> str:
    """Warning that zeros of the runs differ, shape (T,) [unit]."""
    return (
        f"the zero of the {unit} reading moves from run to run, from {zeros.min():+.4g} to {zeros.max():+.4g} about D: "
        "each run counts with its own (offsets in result.json)"
    )


def _with_zeros(search: LawSearch, best: Solution) -> tuple[Solution, np.ndarray]:
    """The model with D and I1 of the middle of the trajectories' zeros over the control input, and what is left."""
    motion = search.motion
    mean = [float(np.average((motion.torque - best.torque)[p], weights=search.weight[p])) for p in motion.parts]
    line = zero_line(search, np.array(mean))
    x = best.x.copy()
    x[LINEAR.index("D")] += line[0]
    x[LINEAR.index("I1")] += line[1]
    torque = best.torque + line[0] + line[1] * motion.current
    found = Solution(best.layout, x, torque, best.parts, best.free)
    mean = [float(np.average((motion.torque - torque)[p], weights=search.weight[p])) for p in motion.parts]
    return found, np.array(mean)


def printed(effect: str, number: str) -> str:
    """A number of an effect as a fit prints it."""
    return f"{effect}.{number}"


def printed_numbers(effects: Sequence[str]) -> list[str]:
    """The fitted numbers of effects as a fit prints them."""
    return [printed(e, p.name) for e in effects for p in KNOWN[e].parameters if p.preset is None and not p.choices]


def linear_factor(name: str, scales: Scales) -> float:
    """Factor from an inner number of eq. 14 to the recording's units; K0 and K1 are sliding torque per unit of h."""
    factors = {"K0": scales.torque, "K1": scales.torque / scales.current}
    return factors.get(name, scales.factor(name))


def one_zero(found: Solution, replay: EffectReplay, moved: float, limits: Mapping[str, Ends] | None = None) -> Solution:
    """A law with one zero for all trajectories, and with friction that differs by direction where that is a clear gain.

    Such friction moves the mean of a trajectory as well, the more the faster it runs.
    """
    search = LawSearch(replay, found.layout.q_zero, offsets=False, limits=limits)
    shared = search.descend(found.layout, found.x)
    if not zeros_moved(found, shared, moved):
        return shared
    layout = search.layout([*found.layout.effects, *OF_PUBLISHED_LAWS["direction"]])
    directed = search.descend(layout, found.layout.grown(shared.x, layout.effects))
    return directed if zeros_moved(directed, shared, moved) else shared


def zeros_moved(separate: Solution, together: Solution, moved: float) -> bool:
    """Whether zeros of the trajectories' own leave clearly less than one zero for all does."""
    return bool(separate.loss.sum() < moved * together.loss.sum())


def turn_back(motion: Dataset) -> bool:
    """Whether half of the trajectories go both ways, so that zeros of their own can be seen.

    Of one that never turns back, dry friction and a zero are one number.
    """
    return 2 * sum(not goes_one_way(motion.qd[part]) for part in motion.parts) >= len(motion.parts)


def zero_line(search: LawSearch, zeros: np.ndarray) -> tuple[float, float]:
    """D and I1 among zeros of the trajectories, shape (T,): their straight line over the current, or their median."""
    current = np.array([search.motion.current[part].mean() for part in search.motion.parts])
    if search.varies or len(np.unique(np.round(current, 2))) < 3:
        return float(np.median(zeros)), 0.0
    line: Any = stats.siegelslopes(zeros, current)  # as long as most zeros lie on it
    return float(line.intercept), float(line.slope)


def outer_numbers(
    best: Solution,
    scales: Scales,
    units: Mapping[str, str],
    between: Sequence[int] = (),
    error: np.ndarray | float = 0.0,
) -> tuple[dict[str, Estimate], tuple[Effect, ...]]:
    """Numbers with intervals in the units of the recording: of eq. 14, and of the law and further effects.

    ``between`` are coordinates that follow from the zeros of the trajectories, without an interval. ``error`` is what
    trajectories do not show of the coordinates' errors, shape (P,).

    With alpha = gamma = 0 and beta = 1 outside as inside, K0 and K1 are the sliding torque per unit of h.
    """
    count = len(best.parts)
    half = np.full(len(best.x), np.inf)
    if count > 2:
        half[best.free] = student(0.95, count - 1) * np.sqrt(np.diag(jackknife(best.moves)))
        half = np.hypot(half, error)
    wide = student(1.0 - 0.05 / len(best.x), max(count - 1, 1)) / student(0.95, max(count - 1, 1))
    estimates = {}
    for i, name in enumerate(LINEAR):
        if i in between:
            half[i] = np.inf
        factor = linear_factor(name, scales)
        value, by = float(best.x[i]) * factor, float(half[i]) * factor
        estimates[name] = Estimate(value=value, half=by, half_joint=by * wide)
    slots = {slot.key: i for i, slot in best.layout.items()}
    row = best.layout.row(best.x)
    effects = []
    order = sorted(best.layout.effects, key=lambda name: name not in HYSTERESIS)
    for effect in order:
        parameters = {}
        for spec in KNOWN[effect].parameters:
            value = float(row[row_column(effect, spec.name)]) * factor_of(spec, scales)
            i = slots.get((effect, spec.name))
            by = np.inf if i is None else half[i]
            if i is not None:
                by *= abs(value) if Slot(effect, spec).logarithmic else factor_of(spec, scales)
            ci95 = (value - float(by), value + float(by)) if np.isfinite(by) else None
            parameters[spec.name] = Parameter(value=value, unit=effect_unit(spec, units), ci95=ci95)
        effects.append(Effect(name=effect, parameters=parameters))
    return estimates, tuple(effects)


def model_row(model: Model, scales: Scales) -> np.ndarray:
    """The replay's row of a model with all its effects and its law, shape (WIDTH,)."""
    row, values = null_row(), model.values
    for name in (*LINEAR, *SHAPE):
        row[BASE.index(name)] = values[name] / scales.factor(name)
    row[BASE.index("q_zero")] = (values.get("q_offset", 0.0) + values.get("q_center", 0.0)) / scales.q
    for effect in model.effects:
        for spec in KNOWN[effect.name].parameters if effect.name in KNOWN else ():
            if spec.name in effect.parameters:
                row[row_column(effect.name, spec.name)] = effect.values[spec.name] / factor_of(spec, scales)
    return row


def model_torque(model: Model, recording: Recording) -> list[np.ndarray]:
    """Torque of a model with all its effects and its law along each trajectory [unit of the recording]."""
    motion = Motion.of(recording)
    scales = motion.scales
    tau = EffectReplay(motion).torque(model_row(model, scales)[None])[0].astype(float) * scales.torque
    return [tau[part] for part in motion.parts]
