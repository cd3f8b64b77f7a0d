"""The whole diagnosis: what is wrong, why, the extended model and what it gains."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

from mrwarp.diagnose.assemble import assembled
from mrwarp.diagnose.choose import best_single, choose, first_look
from mrwarp.diagnose.data_checks import gaps, hindrances, recording_to_make
from mrwarp.diagnose.decimate import thinned
from mrwarp.diagnose.detectable import detectable
from mrwarp.diagnose.findings import causes_of, shifts_of, unexplained_of
from mrwarp.diagnose.heldout import hold_out
from mrwarp.diagnose.next_experiment import propose
from mrwarp.diagnose.prepare import begin_under_way, groups_of, learn_noise, prepare
from mrwarp.diagnose.result import (
    Accounting,
    Diagnosis,
    Error,
)
from mrwarp.diagnose.spectral_lines import find_line
from mrwarp.diagnose.timing import find_timing, timing_note
from mrwarp.diagnose.verdict_text import sentence_of
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.model_file import Model
from mrwarp.recording.load import Recording

Progress = Callable[[str], None]


def diagnose(
    recording: Recording,
    *,
    model: Model | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    threads: int = 1,
) -> Diagnosis:
    """Find what eqs. 14 and 15 get wrong about a recording, and why.

    Args:
        recording: Measured runs.
        model: The device as it should be: its parameters are nominal for shifts of calibration, its effects are part
            of the baseline. None: the paper's joint where the units are its own.
        seed: Seed of every draw (starts, resampling).
        progress: Told what is being done.
        threads: CPU threads of the replay.
    """
    told = progress or (lambda text: None)
    begun = time.perf_counter()
    reasons = hindrances(recording)
    if reasons:
        return _no_verdict(recording, reasons, seed, time.perf_counter() - begun)
    recording, thinning = thinned(recording)
    known = tuple(e.name for e in model.effects if e.name in CATALOGUE) if model else ()
    baseline = prepare(recording, known=known, model=model, threads=threads, seed=seed, told=told)
    engine, base = baseline.engine, baseline.fitted
    lag = engine.motion.kinematics.velocity_lag
    candidates = [
        name for name, law in CATALOGUE.items()
        if law.kind != "calibration" and name not in known and (name != "velocity_lag" or lag > 0.0)
    ]  # fmt: skip
    told(f"{len(candidates)} effects as candidates")
    look = first_look(engine, base, candidates)
    single = best_single(engine, base, look)
    best, changed = single or base, single is not None
    if begin_under_way(engine, best):
        told("trajectories begin under way")
        changed = True
    line = None
    if not engine.misfit:  # beside a large misfit any of its harmonics would pass for a line
        line = find_line(engine.samples.torque - best.torque, best.torque, engine.samples, engine.noise_model)
    if line:
        told(f"a line at {line.frequency:.2f} Hz is set aside")
        engine.set_aside(line.frequency, best.torque)
        best = engine.fit(best.coordinates, best.x)
        changed = True
    if changed:
        told(f"noise without {', '.join(best.effects) or 'line'}")
        engine.noise = learn_noise(engine, best.torque, groups_of(engine, best.coordinates, best.x))
        best = engine.fit(best.coordinates, best.x)
    if find_timing(engine, best):
        told(f"torque is logged {engine.motion.ahead:.2f} samples ahead of the motion")
        best = engine.fit(best.coordinates, best.x)
        engine.noise = learn_noise(engine, best.torque, groups_of(engine, best.coordinates, best.x))
        changed = True
    if changed:
        base = engine.fit(base.coordinates, base.x)
        look = first_look(engine, base, candidates)
    choice = choose(engine, base, lambda f: groups_of(engine, f.coordinates, f.x), look, told)

    told("smallest sizes that would have shown")
    sizes, unseen = detectable(engine, choice.final, candidates)
    held = hold_out(engine, choice)
    unexplained = unexplained_of(choice, line)
    causes = causes_of(engine, choice, candidates)
    shifts = shifts_of(engine, choice, recording, model)
    told("next experiment")
    following = propose(engine, choice, seed)
    result = assembled(
        engine, choice, held, line, unexplained, causes, shifts, sizes, unseen, following, recording, seed, begun
    )
    notes = [*result.notes, *([thinning] if thinning else [])]
    if engine.motion.ahead:
        notes.append(timing_note(engine.motion.ahead, engine.motion.ranges.dt))
    return dataclasses.replace(result, notes=tuple(notes))


def _no_verdict(recording: Recording, reasons: list[str], seed: int, seconds: float) -> Diagnosis:
    unit = recording.units["torque"]
    nothing = Error(rmse=float("nan"), nrmse=float("nan"), unit=unit)
    result = Diagnosis(
        verdict=None, sentence="", causes=(), parameter_shift=(), unexplained=None, detectable={}, invisible={},
        cannot_know=tuple(reasons + gaps(recording)), baseline=nothing, extended=nothing, gain=None,
        next_experiment=recording_to_make(reasons), tried=(),
        accounting=Accounting(named=0.0, predictable=0.0, noise=1.0), per_trajectory={}, per_regime={}, notes=(),
        model=None, recording=recording, traces=None, seconds=seconds, seed=seed,
    )  # fmt: skip
    return dataclasses.replace(result, sentence=sentence_of(result))
