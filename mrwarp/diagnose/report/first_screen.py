"""The first screen of a report: what is missing, how big, how sure, what to do; in at most sixty words."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from mrwarp.diagnose import verdict_text as text
from mrwarp.diagnose.result import Diagnosis
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.recording.data import true_names
from mrwarp.sysid.verdict import Value

MOST_WORDS = 60
"""Words before the first section of a report: what is read at a glance."""

_SHARES = {"What is missing": 13, "How big": 9, "How sure": 10, "What to do": 12}
"""Words of each answer. With the questions (10) and the heading (:data:`_NAME`) they are :data:`MOST_WORDS` at most."""

_NAME = 3
"""Words of a recording's name; three more make the heading."""

MOST_SHOWN = 2
"""Causes whose sizes the first screen gives; the rest are in the sections below."""

NOTHING = "nothing that these data could show"


def heading(source: str) -> str:
    """The page's title: the name of what was diagnosed, shortened."""
    return f"Diagnosis of {_cut(text.short(source, 40), _NAME)}"


def screen(answers: Mapping[str, Iterable[str]]) -> list[tuple[str, str]]:
    """Questions and answers within their shares of words.

    Args:
        answers: By question, phrases in the order of their weight: the first stands always, the rest where they fit.
    """
    return [(question, fitted(list(answers[question]), share)) for question, share in _SHARES.items()]


def fitted(phrases: Sequence[str], most: int) -> str:
    """Phrases, joined by semicolons, of at most ``most`` words; the first is cut if it alone has more."""
    chosen: list[str] = []
    for phrase in filter(None, phrases):
        if not chosen:
            chosen.append(_cut(phrase, most))
        elif len(" ".join([*chosen, phrase]).split()) <= most:
            chosen.append(phrase)
    return "; ".join(chosen)


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
    return [(question, text.capital(true_names(answer, d.recording.units))) for question, answer in found]


def _missing(d: Diagnosis) -> list[str]:
    """Law, causes and structure without a name, after faults of the recording."""
    if d.verdict is None:
        return ["unknown: these data cannot carry a verdict"]
    said = [text.title(d.law.title)] if d.law is not None and d.law.other else []
    names = [text.title(c.name) for c in d.causes]
    shown = text.both(names[:MOST_SHOWN]) + (f" and {len(names) - MOST_SHOWN} more" if names[MOST_SHOWN:] else "")
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
    return text.both(text.variable(v, d.recording.units) for v in d.unexplained.depends_on[:2])


def _size(d: Diagnosis, largest: Mapping[str, float]) -> list[str]:
    """The first number of each cause, and the error before and after."""
    if d.verdict is None:
        return ["unknown"]
    error = f"error {text.percent(d.baseline.nrmse)}"
    if d.causes and d.gain is not None:
        error += f" → {text.percent(d.extended.nrmse)}"
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
        low, high = (text.percent(x, 0) for x in d.gain.ci95)
        said.append(f"error falls by {low} to {high}")
    if suspects := [text.title(s.name) for s in d.suspects if s.possible]:
        said.append(f"suspected, not proven: {text.both(suspects[:MOST_SHOWN])}")
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


def _cut(phrase: str, most: int) -> str:
    words = phrase.split()
    return phrase if len(words) <= most else " ".join(words[:most]) + "…"
