"""A joint's answers on the first screen of its page: what is missing, how big, how sure, what to do."""

from __future__ import annotations

from collections.abc import Mapping

from mrwarp.diagnose import verdict_text as text
from mrwarp.diagnose.result import Diagnosis
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.recording.data import true_names
from mrwarp.sysid.report.page import MOST_SHOWN, NOTHING, screen
from mrwarp.sysid.report.words import both, capital, percent
from mrwarp.sysid.verdict import Value


def answers_of(d: Diagnosis, largest: Mapping[str, float]) -> list[tuple[str, str]]:
    """The four answers on a joint; numbers in the units that the page has by its ``largest`` ones."""
    found = screen(
        {
            "What is missing": _missing(d),
            "How big": _size(d, largest),
            "How sure": _certainty(d, largest),
            "What to do": _advice(d),
        }
    )
    return [(question, capital(true_names(answer, d.recording.units))) for question, answer in found]


def _missing(d: Diagnosis) -> list[str]:
    """Law, causes and structure without a name, after faults of the recording."""
    if d.verdict is None:
        return ["unknown: these data cannot carry a verdict"]
    said = [text.title(d.law.title)] if d.law is not None and d.law.other else []
    names = [text.title(c.name) for c in d.causes]
    shown = both(names[:MOST_SHOWN]) + (f" and {len(names) - MOST_SHOWN} more" if names[MOST_SHOWN:] else "")
    said += [shown] if shown else []
    if d.unexplained is not None:
        said.append(f"structure along {_variables(d)} without a name")
    if not said and d.account is not None and d.account.open:
        said.append("something that repeats and has no name")
    said += [f"calibration: {text.title(d.parameter_shift[0].name)}"] if d.parameter_shift else []
    said += ["the recording has faults, see below"] if d.recording_faults else []
    return said or [NOTHING]


def _variables(d: Diagnosis) -> str:
    assert d.unexplained is not None
    return both(text.variable(v, d.recording.units) for v in d.unexplained.depends_on[:2])


def _size(d: Diagnosis, largest: Mapping[str, float]) -> list[str]:
    """The first number of each cause, and the error before and after."""
    if d.verdict is None:
        return ["unknown"]
    error = f"error {percent(d.baseline.nrmse)}"
    if d.causes and d.gain is not None:
        error += f" → {percent(d.extended.nrmse)}"
    sizes = [_number(next(iter(c.parameters.values())), c.name, largest).value for c in d.causes if c.parameters]
    return [*([", ".join(sizes[:MOST_SHOWN])] if sizes else []), error]


def _certainty(d: Diagnosis, largest: Mapping[str, float]) -> list[str]:
    """Interval of the size, or of the gain; what it cannot be distinguished from; else suspects."""
    if d.verdict is None:
        return ["not at all"]
    said = []
    if len(d.causes) == 1 and (numbers := list(d.causes[0].parameters.values())):
        interval = _number(numbers[0], d.causes[0].name, largest).interval
        said += [f"95 %: {interval}"] if interval else []
    rivals = text.either(dict.fromkeys(name for c in d.causes for name in c.alternatives))
    said += [f"or {rivals}"] if rivals else []
    if d.causes and d.gain is not None:
        low, high = (percent(x, 0) for x in d.gain.ci95)
        said.append(f"error falls by {low} to {high}")
    if suspects := [text.title(s.name) for s in d.suspects if s.possible]:
        said.append(f"suspected, not proven: {both(suspects[:MOST_SHOWN])}")
    return said or ["smaller effects than those listed may be there"]


def _advice(d: Diagnosis) -> list[str]:
    """Remedy of the first cause; the next experiment."""
    seconds = f"{d.next_experiment.seconds:.0f} s" if d.next_experiment is not None else ""
    if d.verdict is None:
        return [f"make the recording below, {seconds}" if seconds else "read below what to record"]
    remedies = [CATALOGUE[c.name].remedy for c in d.causes if c.name in CATALOGUE and CATALOGUE[c.name].remedy]
    remedies += [CATALOGUE[s.name].remedy for s in d.parameter_shift[:1] if s.name in CATALOGUE and not d.causes]
    said = remedies[:1] or (["use the extended model"] if d.causes else [])
    said += [f"record the next experiment, {seconds}"] if seconds else []
    if d.unexplained is not None or (d.account is not None and d.account.open):
        said.append("learn the rest (--learn)")
    return said or ["nothing"]


def _number(value: Value, effect: str, largest: Mapping[str, float]) -> text.Readable:
    parameter = next(iter(CATALOGUE[effect].parameters), None) if effect in CATALOGUE else None
    return text.readable(value, parameter, largest)
