"""The whole diagnosis: what is wrong, why, the extended model and what it gains."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace

from threadpoolctl import threadpool_limits

from mrwarp.diagnose.baseline import (
    align_clocks,
    begin_under_way,
    decimate,
    fit_baseline,
    judged,
    learn_noise,
    plain_problem,
    smooth_motion,
    with_learned_noise,
)
from mrwarp.diagnose.calibration_shift import calibration_shifts
from mrwarp.diagnose.checks.recording_faults import recording_faults, zeros_about
from mrwarp.diagnose.checks.spikes import spikes_of
from mrwarp.diagnose.data_checks import hindrances, rejections, without_verdict
from mrwarp.diagnose.findings import Findings, diagnosis_of
from mrwarp.diagnose.first_answer import being_checked, first_answer
from mrwarp.diagnose.held_out import account_of, hold_out, not_predicted
from mrwarp.diagnose.law_choice import choose_law, misfits
from mrwarp.diagnose.next_experiment import propose, smallest_sizes
from mrwarp.diagnose.problem import Fit, Problem, refit
from mrwarp.diagnose.proof import select_proven, without_parts
from mrwarp.diagnose.residual_structure import find_line, without_line
from mrwarp.diagnose.result import Diagnosis, Shift
from mrwarp.diagnose.screening import Models
from mrwarp.diagnose.search import best_single, screen_candidates
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.checks.stated import stated_numbers
from mrwarp.identify.fit import fit_holding
from mrwarp.identify.projection import Progress
from mrwarp.model_file import Model, Parameter, completed, parameter_unit, stated
from mrwarp.recording.load import Holding, Recording

_TIGHTER = 0.5
"""Ratio of the spreads of the trajectories' factors from which causes are searched again: where factors may differ
much, a common one costs next to nothing, and a model's torque drifts away from what was measured."""


@threadpool_limits.wrap(limits=1, user_api="blas")  # its threads would wait for those of the replay, at full load
def diagnose(
    recording: Recording,
    *,
    model: Model | None = None,
    holding: Holding | None = None,
    effects: Collection[str] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    answered: Callable[[Diagnosis], bool] = lambda answer: True,
    threads: int = 1,
) -> Diagnosis:
    """Find what eqs. 14 and 15 get wrong about a recording, and why.

    Args:
        recording: Measured runs.
        model: The device as it should be: its parameters are nominal for shifts of calibration, its effects are part
            of the baseline. None: the paper's joint where the units are its own. Its further knowledge, such as the
            holding law, is kept in the models of the result.
        holding: Break-away torques, for eq. 18 of those models; they count before the model's.
        effects: Effects that may be named, of the catalogue; None: all of it.
        seed: Seed of every draw (starts, resampling).
        progress: Takes a line on what is being done.
        answered: Takes the first answer, which is not final; the diagnosis ends with it where that returns False.
        threads: CPU threads of the replay.
    """
    log = progress or (lambda text: None)
    begun = time.perf_counter()
    reasons = hindrances(recording)
    if reasons:
        return without_verdict(recording, reasons, seed, time.perf_counter() - begun)
    recording, faults = recording_faults(recording)
    for fault in faults:
        log(fault.sentence)
    recording, decimated = decimate(recording)
    given = {"model": model, "threads": threads, "seed": seed, "log": log}
    first, base = fit_baseline(recording, **given)
    spikes = spikes_of(first, base, recording)
    if spikes is not None:
        log(spikes.sentence)
        first, base = fit_baseline(recording, **given, known=spikes.known)
    candidates = _candidates(first, base, effects)
    log(f"{len(candidates)} effects as candidates")
    screened = screen_candidates(first, base, candidates)
    answer = first_answer(recording, first, base, screened, faults=faults, begun=begun, seed=seed)
    log(being_checked(answer.sentence))
    if not answered(answer):
        return answer
    choice, other, other_base = choose_law(first, base, screened, [run.id for run in recording.trajectories], log)
    if choice is not None and choice.offsets:
        faults = (*faults, zeros_about(recording, choice.offsets, choice.moved))
    as_whitened = first
    if choice is not None and choice.other:
        first, base = plain_problem(other, other_base)
        if not misfits(first, base):
            first, base = judged(first, base, log)
    misfit_first = first.misfit
    if misfits(first, base) and not misfit_first:  # whitened differences would decide by what is quick
        log("the mismatch is structured: plain simulation error decides")
        first, base = with_learned_noise(replace(first, misfit=True), base)
    if first is not as_whitened:
        candidates = _candidates(first, base, effects)
        screened = screen_candidates(first, base, candidates)

    # the best guess so far says how the log is to be read, and what is noise
    best = best_single(first, base, screened) or base
    problem = begin_under_way(first, best)
    if problem is not first:
        log("trajectories begin under way")
    smooth = smooth_motion(problem, recording, best)
    if smooth is not problem:
        if smooth.motion is not problem.motion:
            log(f"the motion is smoothed {smooth.motion.kinematics.smoothing:g} times as much")
        problem, best = smooth, refit(smooth, best)
    # next to a large misfit any of its harmonics would pass for a line
    line = None if problem.misfit else find_line(problem, best)
    if line:
        log(f"a line at {line.frequency:.2f} Hz is set aside")
        problem = without_line(problem, best, line)
        best = refit(problem, best)
    if problem is not first or best is not base:
        log(f"noise without {', '.join(best.effects) or 'line'}")
        misfit = misfit_first or (problem.misfit and misfits(problem, best))
        problem, best = with_learned_noise(replace(problem, misfit=misfit), best)
    aligned = align_clocks(problem, best)
    if aligned is not problem:
        log(f"torque is logged {aligned.motion.ahead:.2f} samples ahead of the motion")
        problem = replace(aligned, noise=learn_noise(aligned, refit(aligned, best)))
    if problem is not first:
        base = refit(problem, base)
        screened = screen_candidates(problem, base, candidates)

    models = Models(problem, base)
    selection, rejected = select_proven(models, screened, log)
    most = rejected[0].fit if rejected else selection.final
    noise = learn_noise(problem, most)
    if noise.gain < _TIGHTER * problem.noise.gain:  # the causes together leave less than the first of them did
        log(f"noise without {', '.join(most.effects)}")
        problem = replace(problem, noise=noise)
        base = refit(problem, base)
        screened = screen_candidates(problem, base, candidates)
        models = Models(problem, base)
        selection, rejected = select_proven(models, screened, log)
    baseline, extended = models.reported(selection.base), models.reported(selection.final)
    held_out = hold_out(problem, selection, baseline, extended)
    reasons = rejections(held_out, selection, problem)
    if reasons:
        return replace(without_verdict(recording, reasons, seed, time.perf_counter() - begun), recording_faults=faults)
    log("what repeats")
    unpredicted = not_predicted(problem, held_out, extended, seed)
    account = account_of(problem, held_out, unpredicted, seed, law=bool(base.parameters.law), spikes=spikes)
    selection, parts = without_parts(models, selection, account)
    if parts:
        log(f"not proven: {', '.join(x.effect for x in parts)}")
        rejected += parts
        extended = models.reported(selection.final)
        held_out = hold_out(problem, selection, baseline, extended)
        account = account_of(problem, held_out, unpredicted, seed, law=bool(base.parameters.law), spikes=spikes)
    shifts: tuple[Shift, ...] = ()
    if not base.parameters.law:
        shifts = calibration_shifts(selection.final, problem.motion, recording, model)
    log("smallest sizes that would have shown")
    sizes = smallest_sizes(problem, selection.final, candidates)
    log("next experiment")
    next_experiment = propose(problem, selection, seed)
    found = Findings(
        recording=recording,
        faults=faults,
        problem=problem,
        selection=selection,
        rejected=rejected,
        baseline=baseline,
        extended=extended,
        held_out=held_out,
        account=account,
        law=choice,
        line=line,
        sizes=sizes,
        shifts=shifts,
        next_experiment=next_experiment,
        spikes=spikes,
        notes=(decimated,) if decimated else (),
        seed=seed,
    )
    result = diagnosis_of(found, begun)
    known = stated_numbers(recording)
    models = (_completed(x, model, holding, known) if x else None for x in (result.model, result.baseline_model))
    return replace(result, **dict(zip(("model", "baseline_model"), models, strict=True)))


def _completed(fitted: Model, nominal: Model | None, holding: Holding | None, known: Mapping[str, Parameter]) -> Model:
    """A model with its holding law, further knowledge of the nominal one, and further statements on the device."""
    estimates = fit_holding(holding.current, holding.torque) if holding else {}
    law = {
        name: Parameter(value=e.value, unit=parameter_unit(name, fitted.units), ci95=e.ci95)
        for name, e in estimates.items()
    }
    fitted = replace(fitted, parameters={**fitted.parameters, **law})
    model = completed(fitted, nominal) if nominal else fitted
    held = {**model.parameters, **({"device_mass": model.device_mass} if model.device_mass else {})}
    return stated(model, {name: number for name, number in known.items() if name not in held})


def _candidates(problem: Problem, base: Fit, effects: Collection[str] | None) -> list[str]:
    """Effects that may be missing: what re-fitting takes up is none, nor what the baseline has."""
    known, lag = {*base.effects, *problem.impossible}, problem.motion.kinematics.velocity_lag
    if base.parameters.law:
        known.add("speed_weakening")  # of eq. 14's own form
    if problem.motion.ranges.turns > 1.0:
        known.add("position_friction")  # what turns on and on has no place along its way
    return [
        name
        for name, law in CATALOGUE.items()
        if law.kind != "calibration"
        and name not in known
        and (effects is None or name in effects)
        and (name != "velocity_lag" or lag > 0.0)
    ]
