"""The first answer of a diagnosis: what looks likeliest after one look at every candidate, before anything is checked.

It is no verdict: a candidate may stand for another, be a piece of another law, or be refuted by a later step.
"""

from __future__ import annotations

import time
from collections.abc import Sequence

from mrwarp.diagnose.checks.recording_faults import RecordingFault
from mrwarp.diagnose.data_checks import gaps
from mrwarp.diagnose.law_choice import may_follow_another_law
from mrwarp.diagnose.problem import Fit, Problem, threshold
from mrwarp.diagnose.proof import would_be_negative
from mrwarp.diagnose.result import Accounting, Diagnosis
from mrwarp.diagnose.screening import Candidate
from mrwarp.diagnose.verdict_text import either, measured, title
from mrwarp.effects.catalogue import KNOWN
from mrwarp.identify.parameters import factor_of
from mrwarp.model_file import effect_unit
from mrwarp.recording.load import Recording
from mrwarp.sysid.verdict import NOT_CHECKED, Suspect, Value, not_checked


def first_answer(
    recording: Recording,
    problem: Problem,
    base: Fit,
    screened: Sequence[Candidate],
    *,
    faults: Sequence[RecordingFault],
    begun: float,
    seed: int,
) -> Diagnosis:
    """A diagnosis that is not final: the best candidates as suspects, without a verdict and without a model.

    Args:
        recording: What is diagnosed.
        problem: The data set.
        base: The baseline fitted to it.
        screened: What the effects would gain on it, best first.
        faults: What was wrong with the recording.
        begun: When the diagnosis began, by ``time.perf_counter``.
        seed: Seed of everything random.
    """
    found = [_suspect(problem, base, c) for c in screened if base.total - c.total > threshold(problem, base)]
    found = [s for s in found if not would_be_negative(s.name, next(iter(s.parameters.values())).value)]
    near, most = problem.settings.gain.half, problem.settings.law.rivals
    suspects = tuple(s for s in found if s.gain > near * found[0].gain)[:most]
    unknown = float("nan")
    return Diagnosis(
        **not_checked(_likeliest(problem, base, suspects), recording.units["torque"]),
        recording_faults=tuple(faults),
        suspects=suspects,
        cannot_know=tuple(gaps(recording, problem.settings)),
        accounting=Accounting(named=unknown, predictable=unknown, noise=unknown),
        recording=recording,
        seconds=time.perf_counter() - begun,
        seed=seed,
    )


def _suspect(problem: Problem, base: Fit, candidate: Candidate) -> Suspect:
    """A candidate with its numbers as of the first look; they have no interval yet."""
    slots = problem.parameters([candidate.effect], candidate.choices).slots
    numbers = {
        slot.parameter.name: Value(
            value=slot.value(x) * factor_of(slot.parameter, problem.motion.scales),
            ci95=(float("nan"), float("nan")),
            unit=effect_unit(slot.parameter, problem.units),
        )
        for slot, x in zip(slots, candidate.values, strict=True)
    }
    gain = (base.total - candidate.total) / base.total
    return Suspect(name=candidate.effect, reason=NOT_CHECKED, parameters=numbers, gain=gain)


def _likeliest(problem: Problem, base: Fit, suspects: Sequence[Suspect]) -> str:
    """The likeliest answer in words: an effect with its size, with the others that gain nearly as much."""
    law = "a hysteresis of another shape" if may_follow_another_law(problem, base) else ""
    if not suspects:
        return law or "nothing is missing that these data could show"
    best, *others = suspects
    first = KNOWN[best.name].parameters[0].name
    text = title(best.name)
    if first in best.parameters:
        size = best.parameters[first]
        text += f" about {measured(size.value, size.unit)}"
    if others:
        text += f" (or {either(s.name for s in others)})"
    return f"{law}, or {text}" if law and best.gain < 1.0 - problem.settings.gain.half else text
