"""The whole diagnosis: what is wrong, why, the extended model and what it gains."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

from threadpoolctl import threadpool_limits

from mrwarp.diagnose.baseline import (
    align_clocks,
    begin_under_way,
    decimate,
    fit_baseline,
    judged,
    learn_noise,
    plain_problem,
    quiet_current,
    shift_stands,
    smooth_motion,
    with_error_of_smoothing,
    with_learned_noise,
)
from mrwarp.diagnose.calibration_shift import calibration_shifts
from mrwarp.diagnose.checks.recording_faults import RecordingFault, recording_faults, zeros_about
from mrwarp.diagnose.checks.spikes import Spikes, spikes_of
from mrwarp.diagnose.data_checks import no_verdict_reasons, rejections, without_verdict
from mrwarp.diagnose.findings import Findings, diagnosis_of
from mrwarp.diagnose.first_answer import first_answer
from mrwarp.diagnose.held_out import Account, HeldOut, account_of, not_predicted
from mrwarp.diagnose.joint_evidence import Judged, judged_by_evidence, selected_by_evidence
from mrwarp.diagnose.law_choice import LawChoice, choose_law, misfits
from mrwarp.diagnose.next_experiment import propose, smallest_sizes
from mrwarp.diagnose.problem import Fit, Problem, refit
from mrwarp.diagnose.proof import Rejection, select_proven, through_gate, without_parts, without_unknown
from mrwarp.diagnose.residual_structure import Line, find_line, without_line
from mrwarp.diagnose.result import Diagnosis
from mrwarp.diagnose.screening import Candidate, Models, screen
from mrwarp.diagnose.search import Selection, first_guess, screen_candidates
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.checks.stated import stated_numbers
from mrwarp.identify.fit import fit_holding
from mrwarp.identify.projection import Progress
from mrwarp.model_file import Model, Parameter, completed, parameter_unit, stated
from mrwarp.recording.blocks import in_blocks
from mrwarp.recording.load import Holding, Recording, RecordingError
from mrwarp.sysid.settings import Settings
from mrwarp.sysid.verdict import being_checked

Method = Literal["proof", "evidence"]
"""How causes are searched."""


@threadpool_limits.wrap(limits=1, user_api="blas")  # its threads would wait for those of the replay, at full load
def diagnose(
    recording: Recording,
    *,
    model: Model | None = None,
    holding: Holding | None = None,
    effects: Collection[str] | None = None,
    keep: Sequence[str] = (),
    settings: Settings | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    answered: Callable[[Diagnosis], bool] = lambda answer: True,
    threads: int = 1,
    method: Method = "proof",
) -> Diagnosis:
    """Find what eqs. 14 and 15 get wrong about a recording, and why.

    Args:
        recording: Measured runs.
        model: The device as it should be: its parameters are nominal for shifts of calibration, its effects are part
            of the baseline. None: the paper's joint where the units are its own. Its further knowledge, such as the
            holding law, is kept in the models of the result.
        holding: Break-away torques, for eq. 18 of those models; they count before the model's.
        effects: Effects that may be named, of the catalogue; None: all of it.
        keep: Effects that are part of the baseline, with fitted numbers.
        settings: Numbers by which is decided; None: those of the documentation.
        seed: Seed of every draw (starts, resampling).
        progress: Takes a line on what is being done.
        answered: Takes the first answer, which is not final; the diagnosis ends with it where that returns False.
        threads: CPU threads of the replay.
        method: "evidence" searches causes by their evidence alone; "proof" searches and proves them first.

    Raises:
        RecordingError: an effect is to be kept that such a recording cannot show.
    """
    log = progress or (lambda text: None)
    begun = time.perf_counter()
    settings = settings or Settings()
    if reasons := no_verdict_reasons(recording, settings):
        return without_verdict(recording, reasons, settings, seed, time.perf_counter() - begun)
    recording = in_blocks(recording)
    session = _prepared(recording, effects, keep, settings, model=model, threads=threads, seed=seed, log=log)
    answer = first_answer(
        session.recording,
        session.problem,
        session.base,
        session.screened,
        faults=session.faults,
        begun=begun,
        seed=seed,
    )
    log(being_checked(answer.sentence))
    if not answered(answer):
        return answer
    session, line = _well_read(_with_law(session, log), log)
    session, models, judged, rejected = _searched(session, method, log)
    problem, recording = session.problem, session.recording
    selection, refused, held_out = through_gate(models, judged.selection, seed)
    if refused:
        log(f"refused at the last gate: {', '.join(x.effect for x in refused)}")
    if reasons := rejections(held_out, problem):
        result = without_verdict(recording, reasons, settings, seed, time.perf_counter() - begun)
        return replace(result, recording_faults=session.faults)
    selection, parts, held_out, account = _accounted(session, models, selection, held_out, seed, log)
    law = session.base.parameters.law
    log("smallest sizes that would have shown")
    sizes = smallest_sizes(problem, selection.final, session.candidates, judged.shows)
    log("next experiment")
    found = Findings(
        recording=recording,
        faults=session.faults,
        models=models,
        selection=selection,
        rejected=rejected + refused + parts,
        baseline=models.reported(selection.base),
        extended=models.reported(selection.final),
        held_out=held_out,
        account=account,
        law=session.law,
        line=line,
        sizes=sizes,
        shifts=() if law else calibration_shifts(problem, selection.final, recording, model),
        next_experiment=propose(problem, selection, seed),
        spikes=session.spikes,
        notes=session.notes,
        seed=seed,
    )
    result = diagnosis_of(found, begun)
    known = stated_numbers(recording)
    models = (_completed(x, model, holding, known) if x else None for x in (result.model, result.baseline_model))
    return replace(result, **dict(zip(("model", "baseline_model"), models, strict=True)))


@dataclass(frozen=True, kw_only=True)
class _Session:
    """A recording made ready, its baseline, and what each effect would add to it."""

    recording: Recording
    faults: tuple[RecordingFault, ...]
    notes: tuple[str, ...]
    effects: Collection[str] | None
    """Effects that may be named; None: all of the catalogue."""
    spikes: Spikes | None
    problem: Problem
    base: Fit
    candidates: list[str]
    screened: list[Candidate]
    """Every candidate on top of the baseline, best first."""
    law: LawChoice | None = None
    misfit: bool = False
    """Whether the baseline's mismatch was structured before its noise was judged."""
    as_logged: _Session | None = None
    """This session without a shift of the clocks, where the first guess asks for one: both are searched."""

    def about(self, problem: Problem, base: Fit) -> _Session:
        """Another problem and its baseline, with the candidates of these."""
        candidates = _candidates(problem, base, self.effects)
        return replace(self, candidates=candidates).screened_again(problem, base)

    def screened_again(self, problem: Problem, base: Fit) -> _Session:
        """Another reading or noise of the problem, with the same candidates."""
        return replace(self, problem=problem, base=base, screened=screen_candidates(problem, base, self.candidates))


def _prepared(
    recording: Recording,
    effects: Collection[str] | None,
    keep: Sequence[str],
    settings: Settings,
    *,
    model: Model | None,
    threads: int,
    seed: int,
    log: Progress,
) -> _Session:
    """A recording without the faults that can be undone, its baseline, and a first look at every candidate."""
    recording, faults = recording_faults(recording, settings)
    for fault in faults:
        log(fault.sentence)
    recording, decimated = decimate(recording, settings.reading)
    given = {"model": model, "settings": settings, "threads": threads, "seed": seed, "log": log}
    problem, base = fit_baseline(recording, **given)
    spikes = spikes_of(problem, base, recording)
    if spikes is not None:
        log(spikes.sentence)
        problem, base = fit_baseline(recording, **given, known=spikes.known)
    problem, base = _with_kept(problem, base, keep, log)
    candidates = _candidates(problem, base, effects)
    log(f"{len(candidates)} effects as candidates")
    return _Session(
        recording=recording,
        faults=faults,
        notes=(decimated,) if decimated else (),
        effects=effects,
        spikes=spikes,
        problem=problem,
        base=base,
        candidates=candidates,
        screened=screen_candidates(problem, base, candidates),
    )


def _with_kept(problem: Problem, base: Fit, keep: Sequence[str], log: Progress) -> tuple[Problem, Fit]:
    """The baseline with effects that are to be in it, and the noise that it leaves then.

    Raises:
        RecordingError: the recording cannot show one of them.
    """
    for name in keep:
        if name in base.effects:
            continue
        if name not in _candidates(problem, base, None):
            raise RecordingError(f"--keep {name}: a recording such as this cannot show its size; leave it out")
        log(f"with {name}")
        base = Models(problem, base).grown(base, screen(problem, base, [name])[0])
        problem, base = judged(problem, base, log)
    return problem, base


def _with_law(session: _Session, log: Progress) -> _Session:
    """The session with another law in eq. 15's place where that is better, and plain errors where these must decide."""
    problem, base, recording = session.problem, session.base, session.recording
    choice, other, other_base = choose_law(
        problem, base, session.screened, [run.id for run in recording.trajectories], log
    )
    faults = session.faults
    if choice is not None and choice.offsets:
        faults = (*faults, zeros_about(recording, choice.offsets, choice.moved(problem.settings.law.gap)))
    if choice is not None and choice.other:
        problem, base = plain_problem(other, other_base)
        if not misfits(problem, base):
            problem, base = judged(problem, base, log)
    misfit = problem.misfit
    if misfits(problem, base) and not misfit:  # whitened differences would decide by what is quick
        log("the mismatch is structured: plain simulation error decides")
        problem, base = with_learned_noise(replace(problem, misfit=True), base)
    found = replace(session, faults=faults, law=choice, misfit=misfit)
    return found if problem is session.problem else found.about(problem, base)


def _well_read(session: _Session, log: Progress) -> tuple[_Session, Line | None]:
    """The session with its log read as the best guess so far asks for, and its noise without that guess.

    With it comes a line of the spectrum that was set aside.
    """
    first, base = session.problem, session.base
    best = first_guess(first, base, session.screened) or base
    problem = begin_under_way(first, best)
    if problem is not first:
        log("trajectories begin under way")
    smooth = smooth_motion(problem, session.recording, best)
    if smooth is not problem:
        if smooth.motion is not problem.motion:
            log(f"motion smoothed {smooth.motion.kinematics.smoothing:g} times as much")
        problem, best = smooth, refit(smooth, best)
    # next to a large misfit any of its harmonics would pass for a line
    line = None if problem.misfit else find_line(problem, best)
    if line:
        log(f"line at {line.frequency:.2f} Hz set aside")
        problem = without_line(problem, best, line)
        best = refit(problem, best)
    if problem is not first or best is not base:
        problem, best = _with_noise(session, problem, best, log)
    logged = session if problem is first else session.screened_again(problem, refit(problem, base))
    aligned = align_clocks(problem, best)
    if aligned is problem:
        return logged, line
    log(f"torque taken {aligned.motion.ahead:.2f} samples later")
    problem = replace(aligned, noise=learn_noise(aligned, refit(aligned, best)))
    return replace(logged.screened_again(problem, refit(problem, base)), as_logged=logged), line


def _searched(
    session: _Session, method: Method, log: Progress
) -> tuple[_Session, Models, Judged, tuple[Rejection, ...]]:
    """Causes that are proven, and those that are not, with the session and the models in which they were found.

    Clocks are shifted only where that predicts clearly better than the causes that are found without it.
    """
    found = _searched_as_read(session, method, log)
    if session.as_logged is None:
        return found
    log("search with clocks as logged")
    other = _searched_as_read(session.as_logged, method, log)
    shifted, logged = (read.problem for read, *_ in (found, other))
    if shift_stands(shifted, found[2].selection.final, logged, other[2].selection.final):
        return found
    log(f"clocks as logged: {', '.join(other[2].selection.named) or 'nothing'} predicts as well as the shift")
    return other


def _searched_as_read(
    session: _Session, method: Method, log: Progress
) -> tuple[_Session, Models, Judged, tuple[Rejection, ...]]:
    """Causes of a session as its log is read.

    They are searched again where all together ask for another reading or for another noise: of a motion that was
    smoothed for want of one of them, of a current whose noise hid in what they take, or where they leave clearly less
    spread of the trajectories' factors than the first of them did. Where factors may differ much, a common one costs
    next to nothing, and a model's torque drifts away from what was measured.
    """
    models = Models(session.problem, session.base)
    judged, rejected = _found(models, session, method, log)
    for again in (_smoothed_again, _quiet_again, _noise_again):
        final = judged.selection.final
        most = rejected[0].fit if rejected and not models.added(final) else final
        if (other := again(session, most, log)) is not session:
            session, models = other, Models(other.problem, other.base)
            judged, rejected = _found(models, session, method, log)
    return session, models, judged, rejected


def _smoothed_again(session: _Session, best: Fit, log: Progress) -> _Session:
    """The session with its motion smoothed as a model asks for, or as it is."""
    smooth = smooth_motion(session.problem, session.recording, best)
    if smooth.motion is session.problem.motion:
        return session
    log(f"motion smoothed {smooth.motion.kinematics.smoothing:g} times as much")
    problem, _ = _with_noise(session, smooth, refit(smooth, best), log)
    return session.screened_again(problem, refit(problem, session.base))


def _quiet_again(session: _Session, best: Fit, log: Progress) -> _Session:
    """The session with a measured current's noise taken off, where a cause may only be named for that, or as it is.

    What follows the current late takes its noise away, so the model is asked without it.
    """
    problem, models, late = session.problem, Models(session.problem, session.base), best
    for effect in models.added(best):
        if CATALOGUE[effect].stage == "current" and "memory" in CATALOGUE[effect].depends_on:
            late = models.without(late, effect)
    if late is best or problem.motion.medians > 1:
        return session
    quiet = quiet_current(problem, late, each=True)
    if quiet is problem:
        return session
    log("the measured current is noisy: it is smoothed")
    quiet, _ = _with_noise(session, quiet, refit(quiet, late), log)
    return session.screened_again(quiet, refit(quiet, session.base))


def _noise_again(session: _Session, best: Fit, log: Progress) -> _Session:
    """The session with the noise that a model leaves, where its runs' factors differ clearly less, or as it is."""
    noise = learn_noise(session.problem, best)
    if noise.gain >= session.problem.settings.gain.half * session.problem.noise.gain:
        return session
    log(f"noise without {', '.join(best.effects)}")
    problem = replace(session.problem, noise=noise)
    return session.screened_again(problem, refit(problem, session.base))


def _with_noise(session: _Session, problem: Problem, best: Fit, log: Progress) -> tuple[Problem, Fit]:
    """Another reading of a session with the noise that a model leaves there, and the model."""
    log(f"noise without {', '.join(best.effects) or 'line'}")
    misfit = session.misfit or (problem.misfit and misfits(problem, best))
    return with_learned_noise(replace(problem, misfit=misfit), best)


def _found(models: Models, session: _Session, method: Method, log: Progress) -> tuple[Judged, tuple[Rejection, ...]]:
    """Causes by a method, judged next to what has no name, and all that is not proven."""
    if method == "evidence":
        judged = selected_by_evidence(models, session.screened, log)
        return judged, judged.rejected
    selection, rejected = select_proven(models, session.screened, log)
    left = {rejection.effect for rejection in rejected}
    log("causes against nameless structure")
    judged = judged_by_evidence(models, selection, [c for c in session.screened if c.effect not in left], log)
    return judged, rejected + judged.rejected


def _accounted(
    session: _Session, models: Models, selection: Selection, held_out: HeldOut, seed: int, log: Progress
) -> tuple[Selection, tuple[Rejection, ...], HeldOut, Account]:
    """Where the mismatch goes, once causes are out whose size is unknown, or that may be a part of what repeats."""
    problem = session.problem
    log("what repeats")
    unpredicted = not_predicted(problem, held_out, models.reported(selection.final), seed)

    def account(held_out: HeldOut) -> Account:
        law = bool(session.base.parameters.law)
        return account_of(problem, held_out, unpredicted, seed, law=law, spikes=session.spikes)

    found = account(held_out)
    selection, parts = without_parts(models, selection, found)
    final = with_error_of_smoothing(problem, session.recording, selection.final)
    selection, unknown = without_unknown(models, selection, final)
    if parts := parts + unknown:
        log(f"not proven: {', '.join(x.effect for x in parts)}")
        selection, refused, held_out = through_gate(models, selection, seed)
        parts, found = parts + refused, account(held_out)
        final = with_error_of_smoothing(problem, session.recording, selection.final)
    return replace(selection, final=final), parts, held_out, found


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
    # another law has no alpha, and what turns on and on no stroke
    lacks = ("alpha",) * bool(base.parameters.law) + ("stroke",) * (problem.motion.ranges.turns > 1.0)
    return [
        name
        for name, law in CATALOGUE.items()
        if law.kind != "calibration"
        and name not in known
        and law.needs not in lacks
        and (effects is None or name in effects)
        and (not law.measured_in or lag > 0.0)
    ]
