"""What the steps of a diagnosis amount to: causes, structure left over, what could have shown, the extended model."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from mrwarp.diagnose.data_checks import gaps
from mrwarp.diagnose.formula import find_formula
from mrwarp.diagnose.held_out import HeldOut, Predictor, reduction
from mrwarp.diagnose.preprocess import clock_note
from mrwarp.diagnose.problem import Fit, Problem, covariance, factor_of, interval, threshold
from mrwarp.diagnose.residual_structure import Group, Line
from mrwarp.diagnose.result import (
    REGIMES,
    Accounting,
    Cause,
    Diagnosis,
    Error,
    Gain,
    NextExperiment,
    Shift,
    Traces,
    Tried,
    Unexplained,
    Value,
    Verdict,
)
from mrwarp.diagnose.search import Selection
from mrwarp.diagnose.verdict_text import sentence_of
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.dataset import Motion, rms
from mrwarp.identify.parameters import LINEAR, SHAPE, slots_of
from mrwarp.model_file import Effect, FittedOn, Model, Parameter, effect_unit, parameter_unit
from mrwarp.recording.load import Recording
from mrwarp.run_dir import versions

_UNEXPLAINED_T, _SLOW_T = 2.0, 2.5
"""Structure is only reported when it predicts trajectories with this ratio to its standard error; the latter for
structure that is slow or has a memory."""
_CLEARLY = 2.0
"""Gain, in thresholds, from which it is reported at all."""
_BEYOND_DOUBT = 5.0
"""Gain, in thresholds, above which it is reported although a few trajectories carry it."""
_SHARE = 0.2
"""Part of the predictable mismatch above which what is left beside named effects is reported."""

_UNSEEN = {
    **dict.fromkeys(("coil_lag", "command_delay", "remanence"), "the current hardly changes within a trajectory"),
    **dict.fromkeys(("current_saturation", "current_viscosity"), "too few levels of current"),
}
_NEVER = "at no size in its range would it stand out from what eq. 14 takes up and from the noise"
_TAKEN_UP = "re-fitting eq. 14 takes it up without a trace; only nominal parameters (--model) can show it"
"""Why effects show at no size."""


@dataclass(frozen=True, kw_only=True)
class Findings:
    """What each step found."""

    recording: Recording
    problem: Problem
    selection: Selection
    baseline: Fit
    """The baseline as it is reported."""
    extended: Fit
    """The final model as it is reported."""
    held_out: HeldOut
    line: Line | None
    sizes: Mapping[str, float]
    """Smallest size of each effect that would have shown, normalised units."""
    unseen: list[str]
    """Effects that would have shown at no size."""
    shifts: tuple[Shift, ...]
    next_experiment: NextExperiment | None
    notes: tuple[str, ...]
    seed: int


def diagnosis_of(found: Findings, begun: float) -> Diagnosis:
    """The typed result of steps that began at ``begun``, by ``time.perf_counter``."""
    problem, selection, recording = found.problem, found.selection, found.recording
    measured, scale, unit = problem.measured, problem.motion.scales.torque, problem.units["torque"]
    errors = measured - found.baseline.torque, measured - found.extended.torque
    baseline, extended = (
        Error(rmse=rms(e) * scale, nrmse=rms(e) / (float(measured.std()) or 1.0), unit=unit) for e in errors
    )
    traces = _traces(found)
    causes = causes_of(found)
    unexplained = unexplained_of(selection, found.line)
    if unexplained is not None:
        formula = find_formula(traces, unexplained, problem.units, seed=found.seed)
        unexplained = replace(unexplained, formula=formula)
    verdict: Verdict = "named" if causes else "none"
    if unexplained:
        verdict = "named_and_unexplained" if causes else "unexplained"
    detectable, invisible = _detectable(found)
    held = found.held_out
    squares = zip(held.baseline, held.extended if causes else held.baseline, np.diff(problem.motion.start), strict=True)
    per_trajectory = [(float(np.sqrt(a / n)) * scale, float(np.sqrt(b / n)) * scale) for a, b, n in squares]
    names = tuple(run.id for run in recording.trajectories)
    gain = None
    if causes:
        value, ci95 = reduction(held, found.seed)
        unseen = held.predicted_baseline - measured, held.predicted_extended - measured
        per_regime = _per_regime(*unseen, traces.regime, scale)
        gain = Gain(rmse_reduction=value, ci95=ci95, held_out=names, per_regime=per_regime)
    rows = np.stack([found.baseline.row, found.extended.row])
    result = Diagnosis(
        verdict=verdict,
        sentence="",
        causes=causes,
        parameter_shift=found.shifts,
        unexplained=unexplained,
        detectable=detectable,
        invisible=invisible,
        cannot_know=tuple(gaps(recording)),
        baseline=baseline,
        extended=extended,
        gain=gain,
        next_experiment=found.next_experiment,
        tried=_tried(problem, selection, causes),
        accounting=_accounting(selection, found.line, unexplained is not None),
        per_trajectory=dict(zip(names, per_trajectory, strict=True)),
        per_regime=_per_regime(*errors, traces.regime, scale),
        notes=_notes(found, causes),
        model=outer_model(problem, found.extended, recording, found.seed, selection.refined),
        baseline_model=outer_model(problem, found.baseline, recording, found.seed),
        recording=recording,
        traces=traces,
        predictor=Predictor(rows=rows, motion=problem.motion, recording=recording),
        seconds=time.perf_counter() - begun,
        seed=found.seed,
    )
    return replace(result, sentence=sentence_of(result))


def _accounting(selection: Selection, line: Line | None, structure: bool) -> Accounting:
    """Shares of the baseline's loss: what the named effects take, what structure could, and the rest."""
    left = max([f.gain for f in selection.leftovers], default=0.0) + (line.gain if line else 0.0)
    named = max(0.0, selection.gain) / selection.base.total
    predictable = max(0.0, left) / selection.base.total if structure else 0.0
    return Accounting(named=named, predictable=predictable, noise=max(0.0, 1.0 - named - predictable))


def causes_of(found: Findings) -> tuple[Cause, ...]:
    """The named effects, largest gain first, with the intervals of their parameters."""
    selection, fit, problem = found.selection, found.extended, found.problem
    spread, searches = covariance(fit), 6 * len(selection.screened)
    causes = []
    for effect in selection.named:
        parameters = {}
        for i, slot in fit.parameters.items():
            if slot.effect == effect:
                factor = factor_of(slot.parameter, problem.motion.scales)
                value = float(np.exp(fit.x[i])) if slot.logarithmic else float(fit.x[i])
                low, high = (float(np.exp(x)) if slot.logarithmic else x for x in interval(fit, i, spread))
                value, low, high = selection.refined.get(slot.key, (value, low, high))
                unit = effect_unit(slot.parameter, problem.units)
                parameters[slot.parameter.name] = Value(
                    value=value * factor, ci95=(low * factor, high * factor), unit=unit
                )
        own = selection.own_gain.get(effect, selection.gain)
        causes.append(
            Cause(
                name=effect,
                parameters=parameters,
                p_value=float(min(1.0, searches * chi2.sf(max(own, 0.0), len(parameters)))),
                alternatives=selection.alternatives.get(effect, ()),
                gain=own / selection.base.total,
            )
        )
    return tuple(sorted(causes, key=lambda c: -c.gain))


def unexplained_of(selection: Selection, line: Line | None) -> Unexplained | None:
    """Structure that stays when the named effects are in, or None."""
    need = threshold(selection.final)
    left = [
        f
        for f in selection.leftovers
        if f.gain > _BEYOND_DOUBT * need or (f.gain > _CLEARLY * need and f.t > _needed_t(f.group))
    ]
    gain = max([f.gain for f in left], default=0.0)
    if line is None and not left:
        return None
    named = selection.gain
    both = gain + (line.gain if line else 0.0)
    share = both / max(named + both, 1e-9)
    if named > 0.0 and share < _SHARE:
        return None
    if line is not None and line.gain > gain:
        return Unexplained(depends_on=("frequency",), form=f"a line at {line.frequency:.2f} Hz", share=share)
    telling = [f for f in left[:3] if f.gain > 0.5 * left[0].gain]
    variables = dict.fromkeys(v for f in telling for v in f.group.variables)
    return Unexplained(depends_on=tuple(variables), form=left[0].group.form, share=share)


def _needed_t(group: Group) -> float:
    return _SLOW_T if group.slow or "memory" in group.variables else _UNEXPLAINED_T


def _detectable(found: Findings) -> tuple[dict[str, Value], dict[str, str]]:
    """Smallest size of each effect that would have shown, and why the others would have shown at none."""
    visible = {}
    for name, size in found.sizes.items():
        p = CATALOGUE[name].parameters[0]
        value, unit = size * factor_of(p, found.problem.motion.scales), effect_unit(p, found.problem.units)
        visible[name] = Value(value=value, ci95=(0.0, 0.0), unit=unit)
    invisible = {name: _UNSEEN.get(name, _NEVER) for name in found.unseen}
    invisible |= {name: _TAKEN_UP for name, law in CATALOGUE.items() if law.kind == "calibration"}
    kinematics = found.problem.motion.kinematics
    if kinematics.velocity_lag == 0.0:
        for names in (visible, invisible):
            names.pop("velocity_lag", None)
        if np.isfinite(kinematics.velocity_lag_error):
            size = max(5.0 * kinematics.velocity_lag_error, 1e-4)
            visible["velocity_lag"] = Value(value=size, ci95=(0.0, 0.0), unit="s")
        else:
            invisible["velocity_lag"] = "the recording has no velocity channel"
    return visible, invisible


def _tried(problem: Problem, selection: Selection, causes: tuple[Cause, ...]) -> tuple[Tried, ...]:
    """Every candidate and what came of it."""
    named, rivals = {c.name for c in causes}, {a for c in causes for a in c.alternatives}
    base = selection.base
    rows = []
    for c in selection.screened:
        d = base.loo_loss - c.loo_loss
        gain, error = float(d.sum()), float(np.std(d, ddof=1) * np.sqrt(len(d)))
        if c.effect in named:
            outcome = "named"
        elif c.effect in rivals:
            outcome = "alternative: these data cannot tell it from the cause named"
        elif gain < threshold(base):
            outcome = "rejected: gains no more than noise would"
        elif named:
            outcome = "rejected: adds too little once the named causes are in"
        else:
            outcome = "rejected: free functions of other variables explain the same better"
        values = {}
        for slot, x in zip(slots_of(c.effect), c.values, strict=True):
            inner = float(np.exp(x)) if slot.logarithmic else float(x)
            values[slot.parameter.name] = inner * factor_of(slot.parameter, problem.motion.scales)
        share, its_error = gain / base.total, error / base.total
        rows.append(Tried(name=c.effect, gain=share, error=its_error, values=values, outcome=outcome))
    return tuple(rows)


def _notes(found: Findings, causes: tuple[Cause, ...]) -> tuple[str, ...]:
    """What a reader has to know besides."""
    notes, runs = [], found.recording.trajectories
    derived = sum(run.qd_derived for run in runs)
    if derived:
        notes.append(f"velocity derived from the angle without phase: {derived} of {len(runs)} trajectories")
    if found.held_out.agreed < 1.0 and causes:
        others = 100 * (1 - found.held_out.agreed)
        notes.append(f"without one of the trajectories another model would have been chosen in {others:.0f} % of cases")
    notes += found.notes
    motion = found.problem.motion
    if motion.ahead:
        notes.append(clock_note(motion.ahead, motion.ranges.dt))
    return tuple(notes)


def _traces(found: Findings) -> Traces:
    """Arrays for pictures, units of the recording."""
    motion = found.problem.motion
    q, current, torque = motion.scales.q, motion.scales.current, motion.scales.torque
    return Traces(
        torque=found.problem.measured * torque,
        baseline=found.baseline.torque * torque,
        extended=found.extended.torque * torque,
        q=motion.q * q,
        qd=motion.qd * q,
        qdd=motion.qdd * q,
        current=motion.current * current,
        time=motion.time,
        start=motion.start,
        regime=regimes(motion),
        noise_rms=found.problem.noise.rms * torque,
    )


def regimes(motion: Motion) -> np.ndarray:
    """Index into ``REGIMES`` of each sample, shape (N,)."""
    r = motion.ranges
    out = np.full(len(motion.q), REGIMES.index("slip"), dtype=np.int8)
    out[np.abs(motion.qd) < 0.02 * r.qd] = REGIMES.index("hold")
    for part, dt in zip(motion.parts, motion.dt, strict=True):
        reach = max(1, round(0.1 / dt))
        qd = motion.qd[part]
        turns = np.flatnonzero((qd[1:] * qd[:-1] < 0.0) & (np.abs(qd[1:] - qd[:-1]) > 1e-3 * r.qd))
        jumps = np.flatnonzero(np.abs(np.diff(motion.current[part])) > 0.05 * r.current)
        for marks, name in ((turns, "reversal"), (jumps, "current step")):
            for k in marks:
                at = part.start + int(k) + 1
                out[at : min(at + reach, part.stop)] = REGIMES.index(name)
    return out


def _per_regime(
    before: np.ndarray, after: np.ndarray, regime: np.ndarray, scale: float
) -> dict[str, tuple[float, float]]:
    masks = {name: regime == i for i, name in enumerate(REGIMES)}
    return {name: (rms(before[at]) * scale, rms(after[at]) * scale) for name, at in masks.items() if at.any()}


def outer_model(
    problem: Problem,
    fit: Fit,
    recording: Recording,
    seed: int,
    refined: Mapping[tuple[str, str], tuple[float, float, float]] | None = None,
) -> Model:
    """The fitted model in the units of the recording, for ``model.json``.

    ``refined`` gives value and interval of parameters that are known better than by the fit, in normalised units.
    """
    scales, units, spread, row = problem.motion.scales, recording.units, covariance(fit), fit.row
    parameters = {}
    for i, name in enumerate((*LINEAR, *SHAPE)):
        factor, ci95 = scales.factor(name), None
        low, high = interval(fit, i, spread)
        if name in LINEAR and low <= fit.x[i] <= high:
            ci95 = (low * factor, high * factor)
        parameters[name] = Parameter(value=float(row[i]) * factor, unit=parameter_unit(name, units), ci95=ci95)
    for name, value in (("q_offset", problem.q_zero * scales.q), ("q_center", 0.0)):
        parameters[name] = Parameter(value=value, unit=parameter_unit(name, units))
    places = {slot.key: i for i, slot in fit.parameters.items()}
    effects = []
    for effect, values in fit.parameters.values(fit.x).items():
        entries = {}
        for p in CATALOGUE[effect].parameters:
            if p.name not in values:
                continue
            factor, value, ci95 = factor_of(p, scales), values[p.name], None
            if (effect, p.name) in places:
                i = places[effect, p.name]
                ci95 = outer_interval(fit, i, spread, p.starts is not None and not p.negative, factor)
            if refined and (effect, p.name) in refined:
                value, low, high = refined[effect, p.name]
                ci95 = (low * factor, high * factor)
            entries[p.name] = Parameter(value=value * factor, unit=effect_unit(p, units), ci95=ci95)
        effects.append(Effect(name=effect, parameters=entries))
    runs = recording.trajectories
    source = str(recording.source or "in memory")
    return Model(
        parameters=parameters,
        effects=tuple(effects),
        units=dict(units),
        seed=seed,
        versions=versions(),
        fitted_on=FittedOn(source=source, trajectories=len(runs), samples=recording.samples, rate=1.0 / runs[0].dt),
    )


def outer_interval(fit: Fit, index: int, spread: np.ndarray, logarithmic: bool, factor: float) -> tuple[float, float]:
    """Interval of a coordinate as that of its parameter, in the units of the recording."""
    low, high = interval(fit, index, spread)
    if logarithmic:
        low, high = float(np.exp(low)), float(np.exp(min(high, 50.0)))
    return low * factor, high * factor
