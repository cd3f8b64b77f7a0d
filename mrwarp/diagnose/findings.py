"""Results of a diagnosis' steps: causes, structure left over, what could have shown, the extended model."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from mrwarp.diagnose.baseline import sticks
from mrwarp.diagnose.checks.recording_faults import RecordingFault
from mrwarp.diagnose.checks.spikes import Spikes
from mrwarp.diagnose.data_checks import gaps
from mrwarp.diagnose.formula import find_formula
from mrwarp.diagnose.held_out import Account, HeldOut, Predictor, reduction
from mrwarp.diagnose.law_choice import LawChoice, misfits
from mrwarp.diagnose.problem import Fit, Problem, covariance, interval, threshold
from mrwarp.diagnose.proof import HIDDEN_MOTION, Rejection, impossible_size, without_effect
from mrwarp.diagnose.residual_structure import LAG, Line, drift_of_zero
from mrwarp.diagnose.result import REGIMES, Accounting, Diagnosis, Shift, Traces, Tried
from mrwarp.diagnose.screening import Models
from mrwarp.diagnose.search import Selection
from mrwarp.diagnose.verdict_text import measured, sentence_of
from mrwarp.effects.catalogue import CATALOGUE, parameter_of
from mrwarp.identify.dataset import MOVING, Motion, rms
from mrwarp.identify.parameters import LINEAR, SHAPE, Slot, factor_of
from mrwarp.model_file import Effect, FittedOn, Model, Parameter, effect_unit, parameter_unit
from mrwarp.recording.data import NO_INPUT, quantity, session_clock
from mrwarp.recording.load import Recording
from mrwarp.run_dir import versions
from mrwarp.sysid.settings import Settings
from mrwarp.sysid.verdict import VERDICTS, Cause, Error, Gain, NextExperiment, Suspect, Unexplained, Value

_NEVER = "at no size in its range would it stand out from what eq. 14 takes up and from the noise"
_NO_FIELD = "the control input is a load or a pressure, which makes no magnetic field"
_UNCHANGING = "the control input is the same throughout"
_LACKS = {"temperature": "no temperature that changes was logged", "angle": "it is that of an angle, and this is a way"}
_TAKEN_UP = "re-fitting eq. 14 takes it up without a trace; only nominal parameters (--model) can show it"
_SUSPECT = "it is a suspect: these data leave open whether it is there"
"""Why no size of an effect would have shown for sure."""


@dataclass(frozen=True, kw_only=True)
class Findings:
    """Findings of each step."""

    recording: Recording
    faults: tuple[RecordingFault, ...] = ()
    """Faults of the recording that were taken out of it."""
    models: Models
    """Models that were fitted on the way."""
    selection: Selection
    rejected: tuple[Rejection, ...] = ()
    """Effects that the search found, but that are not proven."""
    baseline: Fit
    """The baseline as it is reported."""
    extended: Fit
    """The final model as it is reported."""
    held_out: HeldOut
    law: LawChoice | None = None
    """Which law the baseline follows; None: none was compared."""
    account: Account | None = None
    line: Line | None
    spikes: Spikes | None = None
    """Samples that were kept out of every fit."""
    sizes: Mapping[str, float | None]
    """Smallest size of each effect that would have shown, normalised units; None: no size would."""
    shifts: tuple[Shift, ...]
    next_experiment: NextExperiment | None
    notes: tuple[str, ...]
    seed: int

    @property
    def problem(self) -> Problem:
        """The data set as it was searched."""
        return self.models.problem


def diagnosis_of(found: Findings, begun: float) -> Diagnosis:
    """The typed result of steps that began at ``begun``, by ``time.perf_counter``."""
    problem, selection, recording = found.problem, found.selection, found.recording
    scale, held = problem.motion.scales.torque, found.held_out
    traces = _traces(found)
    model = outer_model(problem, found.extended, recording, found.seed, selection.refined)
    causes, suspects = causes_of(selection, model), suspects_of(found)
    unexplained = unexplained_of(problem, selection, found.line, found.rejected) or _repeatable(found)
    if unexplained is None and not causes and misfits(problem, selection.final):
        unexplained = Unexplained(depends_on=("memory",), form="no noise, but along none of these alone", share=1.0)
    if unexplained is not None:
        formula = find_formula(traces, unexplained, problem.units, problem.settings.rest.formula)
        unexplained = replace(unexplained, formula=formula)
    verdict = VERDICTS[bool(causes), unexplained is not None]
    detectable, invisible = _detectable(found)
    names = tuple(run.id for run in recording.trajectories)
    counts = problem.weight > 0.0
    errors = (np.stack([held.predicted_baseline, held.predicted_extended]) - problem.measured) * scale
    spread = float(problem.measured[counts].std()) * scale or 1.0
    sizes = _sizes(errors, counts)
    baseline, extended = (Error(rmse=x, nrmse=x / spread, unit=problem.units["torque"]) for x in sizes)
    runs = np.repeat(np.arange(len(names)), np.diff(problem.motion.start))
    per_trajectory = {name: _sizes(errors, counts & (runs == k)) for k, name in enumerate(names)}
    masks = {name: counts & (traces.regime == i) for i, name in enumerate(REGIMES)}
    per_regime = {name: _sizes(errors, at) for name, at in masks.items() if at.any()}
    gain = None
    if causes:
        value, ci95 = reduction(held, found.seed)
        gain = Gain(rmse_reduction=value, ci95=ci95, held_out=names)
    rows = np.stack([found.baseline.row, found.extended.row])
    result = Diagnosis(
        verdict=verdict,
        sentence="",
        recording_faults=found.faults,
        law=found.law,
        causes=causes,
        suspects=suspects,
        parameter_shift=found.shifts,
        unexplained=unexplained,
        detectable=detectable,
        invisible=invisible,
        cannot_know=(*gaps(recording, problem.settings), *_spring_or_weight(found.models, selection)),
        baseline=baseline,
        extended=extended,
        gain=gain,
        next_experiment=found.next_experiment,
        tried=_tried(found, causes, suspects),
        account=found.account,
        spikes=found.spikes,
        accounting=_accounting(found, unexplained is not None),
        per_trajectory=per_trajectory,
        per_regime=per_regime,
        notes=_notes(found, causes),
        model=model,
        baseline_model=outer_model(problem, found.baseline, recording, found.seed),
        recording=recording,
        traces=traces,
        predictor=Predictor(rows=rows, motion=problem.motion, recording=recording),
        seconds=time.perf_counter() - begun,
        seed=found.seed,
    )
    return replace(result, sentence=sentence_of(result))


def _accounting(found: Findings, structure: bool) -> Accounting:
    """Shares of the baseline's loss: what the named effects take, what structure could, and the rest."""
    if found.account is not None:
        named, repeatable = found.account.named.share, found.account.repeatable.share
        return Accounting(named=named, predictable=repeatable, noise=found.account.not_repeatable.share)
    selection, line = found.selection, found.line
    left = max([f.gain for f in selection.leftovers], default=0.0) + (line.gain if line else 0.0)
    named = max(0.0, selection.gain) / selection.base.total
    predictable = max(0.0, left) / selection.base.total if structure else 0.0
    return Accounting(named=named, predictable=predictable, noise=max(0.0, 1.0 - named - predictable))


def _spring_or_weight(models: Models, selection: Selection) -> list[str]:
    """Whether a body's stiffness may be a weight's torque: next to gravity it is not clear of zero."""
    problem, fit, stiffness = models.problem, selection.final, LINEAR.index("C")
    mechanics = [effect for effect in selection.named if CATALOGUE[effect].mechanics]
    weight = [name for name, law in CATALOGUE.items() if law.needs == "angle"]
    if not mechanics or set(weight) & set(fit.effects) or not problem.motion.ranges.radian:
        return []
    low, _ = interval(fit, stiffness, covariance(fit))
    if low <= 0.0:
        return []
    with_weight = models.grown(fit, models.screened(fit, weight)[0])
    low, _ = interval(with_weight, stiffness, covariance(with_weight))
    if low > 0.0:
        return []
    value = fit.x[stiffness] * problem.motion.scales.factor("C")
    size = f"{value:.3g} {parameter_unit('C', problem.units)}"
    return [
        f"whether the stiffness of {size} is a spring or a weight: in swings as small as these both are the same "
        "torque; let the joint swing by a radian or more to either side"
    ]


def _repeatable(found: Findings) -> Unexplained | None:
    """The part that repeats without a name, where the account says that it is much."""
    account = found.account
    if account is None or not account.open:
        return None
    share = account.repeatable.share / max(account.named.share + account.repeatable.share, 1e-9)
    best = found.selection.leftovers[0] if found.selection.leftovers else None
    if best is not None and best.gain > 0.0:
        return Unexplained(depends_on=best.group.variables, form=best.group.form, share=share)
    return Unexplained(depends_on=("memory",), form="what repeats, but follows no single variable", share=share)


def causes_of(selection: Selection, model: Model) -> tuple[Cause, ...]:
    """The named effects, largest gain first, with the numbers of the extended model that were fitted."""
    causes, searches = [], 6 * len(selection.screened)
    for effect in model.effects:
        if effect.name in selection.named:
            fitted = _numbers(effect)
            own = selection.own_gain.get(effect.name, selection.gain)
            cause = Cause(
                name=effect.name,
                parameters=fitted,
                p_value=float(min(1.0, searches * chi2.sf(max(own, 0.0), len(fitted)))),
                alternatives=selection.alternatives.get(effect.name, ()),
                gain=own / selection.base.total,
            )
            causes.append(cause)
    return tuple(sorted(causes, key=lambda c: -c.gain))


def suspects_of(found: Findings) -> tuple[Suspect, ...]:
    """Effects that fit but are not proven, with their numbers where they were found."""
    suspects = []
    for rejection in found.rejected:
        model = outer_model(found.problem, rejection.fit, found.recording, found.seed)
        suspects.append(
            Suspect(
                name=rejection.effect,
                reason=rejection.reason,
                parameters=_numbers(next(e for e in model.effects if e.name == rejection.effect)),
                gain=rejection.gain,
                possible=rejection.reason
                != impossible_size(rejection.effect, rejection.fit, found.problem.motion.ranges),
            )
        )
    return tuple(suspects)


def _numbers(effect: Effect) -> dict[str, Value]:
    """The numbers of an effect that were fitted."""
    fitted = {name: (p, p.ci95) for name, p in effect.parameters.items()}
    return {name: Value(value=p.value, ci95=ci95, unit=p.unit) for name, (p, ci95) in fitted.items() if ci95}


def unexplained_of(
    problem: Problem, selection: Selection, line: Line | None, rejected: Sequence[Rejection] = ()
) -> Unexplained | None:
    """Structure that stays when the named effects are in, or None where it is next to nothing of what is left.

    What a lag would take up that was rejected as the hidden motion of a yielding shaft is that motion, no structure.
    """
    hidden = any(x.reason == HIDDEN_MOTION for x in rejected)
    left = [f for f in selection.nameless if not (hidden and f.group.form == LAG)]
    if line is None and not left:
        return None
    gain, named = sum(f.gain for f in left), 2.0 * sum(max(odds, 0.0) for odds in selection.odds.values())
    both = gain + (line.gain if line else 0.0)
    share = both / max(named + both, 1e-9)
    least = problem.settings.gain
    if both < least.share * selection.final.total or (named > 0.0 and share < least.part):
        return None
    if line is not None and line.gain > gain:
        return Unexplained(depends_on=("frequency",), form=f"a line at {line.frequency:.2f} Hz", share=share)
    clear = [f for f in left[:3] if f.gain >= problem.settings.gain.half * left[0].gain]
    variables = dict.fromkeys(v for f in clear for v in f.group.variables)
    return Unexplained(depends_on=tuple(variables), form=left[0].group.form, share=share)


def _detectable(found: Findings) -> tuple[dict[str, Value], dict[str, str]]:
    """Smallest size of each effect that would have shown, and why the others would have shown at none."""
    kinematics, scales = found.problem.motion.kinematics, found.problem.motion.scales
    visible, invisible = {}, {}
    for name, size in found.sizes.items():
        if size is None:
            invisible[name] = CATALOGUE[name].unseen or _NEVER
        else:
            p = CATALOGUE[name].parameters[0]
            unit = effect_unit(p, found.problem.units)
            visible[name] = Value(value=size * factor_of(p, scales), ci95=(0.0, 0.0), unit=unit)
    open_questions = {x.effect for x in found.rejected} & set(visible)
    visible = {name: value for name, value in visible.items() if name not in open_questions}
    invisible |= dict.fromkeys(open_questions, _SUSPECT)
    invisible |= {name: _TAKEN_UP for name, law in CATALOGUE.items() if law.kind == "calibration"}
    problem = found.problem
    why = _UNCHANGING if problem.unchanging else _NO_FIELD
    invisible |= {name: _LACKS.get(CATALOGUE[name].needs, why) for name in problem.impossible}
    if kinematics.velocity_lag == 0.0:  # then it is no candidate
        lags = [name for name, law in CATALOGUE.items() if law.measured_in == "qd"]
        if np.isfinite(kinematics.velocity_lag_error):
            size = max(problem.settings.gain.clear_t * kinematics.velocity_lag_error, 1e-4)
            visible |= {name: Value(value=size, ci95=(0.0, 0.0), unit="s") for name in lags}
        else:
            invisible |= dict.fromkeys(lags, "the recording has no velocity channel")
    if problem.units["current"] == NO_INPUT:  # what a device does not have is not missing
        of_input = {*problem.impossible, *(name for name, law in CATALOGUE.items() if law.stage == "current")}
        invisible = {name: why for name, why in invisible.items() if name not in of_input}
    return visible, invisible


def _tried(found: Findings, causes: tuple[Cause, ...], suspects: tuple[Suspect, ...]) -> tuple[Tried, ...]:
    """Every candidate and what came of it."""
    possible = {s.name: s.possible for s in suspects}
    problem, selection, rejected = found.problem, found.selection, {x.effect: x.reason for x in found.rejected}
    named, rivals = {c.name for c in causes}, {a for c in causes for a in c.alternatives}
    base, rows = selection.base, []
    for c in selection.screened:
        d = base.loo_loss - c.loo_loss
        gain, error = float(d.sum()), float(np.std(d, ddof=1) * np.sqrt(len(d)))
        if c.effect in named:
            outcome = "named"
        elif c.effect in rejected:
            outcome = f"{'suspect' if possible[c.effect] else 'rejected'}: {rejected[c.effect]}"
        elif c.effect in rivals:
            outcome = "alternative: these data cannot distinguish it from the cause named"
        elif gain < threshold(problem, base):
            outcome = "rejected: gains no more than noise would"
        elif named:
            outcome = "rejected: adds too little once the named causes are in"
        else:
            outcome = "rejected: free functions of other variables explain the same better"
        values = {
            slot.parameter.name: slot.value(x) * factor_of(slot.parameter, problem.motion.scales)
            for slot, x in zip(problem.parameters([c.effect], c.choices).slots, c.values, strict=True)
        }
        share, its_error = gain / base.total, error / base.total
        rows.append(Tried(name=c.effect, gain=share, error=its_error, values=values, outcome=outcome))
    return tuple(rows)


def _notes(found: Findings, causes: tuple[Cause, ...]) -> tuple[str, ...]:
    """Further notes for a reader."""
    notes, runs, motion = [], found.recording.trajectories, found.problem.motion
    derived = sum(run.qd_derived for run in runs)
    if derived:
        notes.append(f"velocity derived from the angle without phase: {derived} of {len(runs)} trajectories")
    if found.held_out.agreed < 1.0 and causes:
        others = 100 * (1 - found.held_out.agreed)
        notes.append(f"without one of the trajectories nothing would have been named in {others:.0f} % of cases")
    if found.spikes is not None:
        notes.append(found.spikes.sentence)
    notes += found.notes
    if len(motion.q) < found.recording.samples:
        notes.append(
            f"{found.recording.samples} samples are more than a diagnosis needs: it used {len(motion.q)}, one stretch "
            "of each trajectory"
        )
    still, reversing = motion.kinematics.still, motion.kinematics.reversing
    if still is not None and sticks(found.problem):
        notes.append(
            f"the joint sticks in {100 * still.mean():.0f} % of the samples while the torque of its drive changes: "
            "static friction balances it, so they do not count"
        )
    if reversing is not None and reversing.any() and not found.problem.weight[reversing].any():
        moving = reversing if still is None else reversing & ~still
        notes.append(
            f"{100 * moving.mean():.0f} % of the samples are so near a start, a stop or a reversal "
            "that the acceleration, which friction makes jump there, is not known; they do not count"
        )
    if motion.kinematics.smoothing > 1.0:
        notes.append(
            f"the motion was smoothed {motion.kinematics.smoothing:g} times as much as the angle asks for: the torque "
            "shows that what was quicker in its acceleration is noise"
        )
    error = found.problem.measured - found.held_out.predicted_extended
    varies = found.problem.of_runs(error, found.held_out.predicted_extended)
    part = float(np.sum(found.problem.weight * varies**2)) / max(float(np.sum(found.problem.weight * error**2)), 1e-300)
    if part > found.problem.settings.gain.half:
        notes.append(
            f"{100 * part:.0f} % of what is missed is a factor and a zero by which trajectories differ. The factor has "
            f"a standard deviation of {100 * found.problem.noise.gain:.2g} %. No law of the device repeats that: look "
            "for what changes from run to run, such as the mounting, the sensor's amplifier or the temperature"
        )
    moved, shares = drift_of_zero(motion, error, found.problem.weight)
    if np.median(shares) > found.problem.settings.gain.half:
        size = measured(float(np.median(np.abs(moved))) * motion.scales.torque, found.problem.units["torque"])
        notes.append(
            f"{100 * np.median(shares):.0f} % of what is missed in a trajectory is a straight line in time, {size} "
            f"from its begin to its end (up in {(moved > 0.0).sum()} of {len(moved)}): the zero of the torque sensor "
            "drifts; let it warm up and set it to zero before each run"
        )
    if motion.medians > 1:
        notes.append(
            f"the measured {quantity('current', found.problem.units)} is noisy: the torque follows its medians over "
            f"{motion.medians} samples more closely"
        )
    if motion.ahead:
        milliseconds = 1e3 * motion.ahead * motion.ranges.dt
        notes.append(
            f"torque is logged {motion.ahead:.2f} samples ({milliseconds:.2g} ms) ahead of the motion, as where a "
            "command is held until the next sample; the motion was taken that much later"
        )
    return tuple(notes)


def _traces(found: Findings) -> Traces:
    """Arrays for pictures, units of the recording."""
    motion = found.problem.motion
    q, current, torque = motion.scales.q, motion.scales.current, motion.scales.torque
    torques = {"torque": found.problem.measured, "baseline": found.baseline.torque, "extended": found.extended.torque}
    return Traces(
        **{name: x * torque for name, x in torques.items()},
        **{name: getattr(motion, name) * q for name in ("q", "qd", "qdd")},
        current=motion.current * current,
        time=motion.time,
        start=motion.start,
        regime=regimes(motion, found.problem.settings),
        noise_rms=found.problem.noise.rms * torque,
        one_clock=session_clock(found.recording) is not None,
        counts=found.spikes.known if found.spikes is not None else None,
        without={
            name: without_effect(found.problem, found.extended, name) * torque
            for name in found.selection.named
            if len(found.selection.named) > 1
        },
    )


def regimes(motion: Motion, settings: Settings) -> np.ndarray:
    """Index into ``REGIMES`` of each sample, shape (N,)."""
    r = motion.ranges
    out = np.full(len(motion.q), REGIMES.index("slip"), dtype=np.int8)
    out[np.abs(motion.qd) < settings.gain.share * r.qd] = REGIMES.index("hold")
    for part, dt in zip(motion.parts, motion.dt, strict=True):
        reach = max(1, round(settings.spikes.event / dt))
        qd = motion.qd[part]
        turns = np.flatnonzero((qd[1:] * qd[:-1] < 0.0) & (np.abs(qd[1:] - qd[:-1]) > 1e-3 * r.qd))
        jumps = np.flatnonzero(np.abs(np.diff(motion.current[part])) > MOVING * r.current)
        for marks, name in ((turns, "reversal"), (jumps, "current step")):
            for k in marks:
                at = part.start + int(k) + 1
                out[at : min(at + reach, part.stop)] = REGIMES.index(name)
    return out


def _sizes(errors: np.ndarray, at: np.ndarray) -> tuple[float, float]:
    """RMSE of baseline and extension over some samples from their errors, shape (2, N)."""
    return rms(errors[0, at]), rms(errors[1, at])


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
        ci95, factor = interval(fit, i, spread), scales.factor(name)
        if fit.parameters.law and name in ("K0", "K1", "beta"):  # of a unit loop: beta = 1 outside as inside
            factor *= scales.q
        known = (ci95[0] * factor, ci95[1] * factor) if name in LINEAR and ci95[0] <= fit.x[i] <= ci95[1] else None
        parameters[name] = Parameter(value=float(row[i]) * factor, unit=parameter_unit(name, units), ci95=known)
    for name, value in (("q_offset", problem.q_zero * scales.q), ("q_center", 0.0)):
        parameters[name] = Parameter(value=value, unit=parameter_unit(name, units))
    places = {slot.key: i for i, slot in fit.parameters.items()}
    effects = []
    for effect, values in fit.parameters.values(fit.x).items():
        entries = {}
        for name, value in values.items():
            p, key, ci95 = parameter_of(effect, name), (effect, name), None
            factor, unit = factor_of(p, scales), effect_unit(p, units)
            if key in places:
                low, high = interval(fit, places[key], spread)
                slot = Slot(effect, p)
                ci95 = (slot.value(low) * factor, slot.value(min(high, 50.0) if slot.logarithmic else high) * factor)
            elif p.repeats:  # half of the resolution of the spectrum that it is known from
                half = np.pi / problem.motion.ranges.q * factor
                ci95 = (value * factor - half, value * factor + half)
            if refined and key in refined:
                value, low, high = refined[key]
                ci95 = (low * factor, high * factor)
            entries[name] = Parameter(value=value * factor, unit=unit, ci95=ci95)
        effects.append(Effect(name=effect, parameters=entries))
    runs, source = recording.trajectories, str(recording.source or "in memory")
    return Model(
        parameters=parameters,
        effects=tuple(effects),
        units=dict(units),
        seed=seed,
        versions=versions(),
        fitted_on=FittedOn(
            source=source,
            trajectories=len(runs),
            samples=len(fit.torque),
            rate=1.0 / runs[0].dt,
            current=recording.current_range,
        ),
    )
