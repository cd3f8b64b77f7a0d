"""Sentences of a diagnosis."""

from __future__ import annotations

from mrwarp.diagnose.result import Diagnosis, NextExperiment
from mrwarp.diagnose.sufficient import STANDARD
from mrwarp.effects.catalogue import CATALOGUE

_ALONG = {
    "q": "the angle", "qd": "the velocity", "qdd": "the acceleration", "current": "the current", "time": "session time",
    "memory": "the past (memory)", "frequency": "frequency",
}  # fmt: skip


def sentence_of(d: Diagnosis) -> str:
    """The verdict in one sentence."""
    if d.verdict is None:
        return "No verdict: " + "; ".join(reason.split(":")[0] for reason in d.cannot_know) + "."
    parts = []
    if d.causes:
        parts.append("the model lacks " + _listed([_cause(c.name, c.alternatives, len(d.causes)) for c in d.causes]))
        if d.gain is not None:
            low, high = d.gain.ci95
            them = "it" if len(d.causes) == 1 else "them"
            parts.append(
                f"with {them} the error on unseen trajectories falls by {100 * d.gain.rmse_reduction:.3g} % "
                f"(95 %: {100 * low:.3g} to {100 * high:.3g})"
            )
    if d.unexplained is not None:
        along = " and ".join(_ALONG.get(v, v) for v in d.unexplained.depends_on[:2])
        beside = "besides, " if d.causes else ""
        parts.append(f"{beside}there is structure along {along} that no effect of the catalogue explains")
    if not parts:
        parts.append("nothing is missing that these data could show")
    for s in d.parameter_shift:
        names = " or ".join(CATALOGUE[n].title for n in (s.name, *s.alternatives))
        parts.append(f"the calibration has shifted: {names}")
    text = "; ".join(parts) + "."
    return text[0].upper() + text[1:]


def _cause(name: str, alternatives: tuple[str, ...], causes: int) -> str:
    first, *others = (CATALOGUE[n].title for n in (name, *alternatives))
    if causes > 1 and others:
        return f"{first} (or {_listed(others, 'or')})"
    return _listed([first, *others], "or")


def _listed(words: list[str], last: str = "and") -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"


def experiment_sentence(reasons: list[str]) -> NextExperiment:
    """The recording to make where no verdict is possible."""
    first = reasons[0].rsplit("; ", 1)[-1] if "; " in reasons[0] else STANDARD
    return NextExperiment(what=first, seconds=60.0, separates=(), kind="recording")
