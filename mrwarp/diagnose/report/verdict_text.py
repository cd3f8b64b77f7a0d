"""Sentences of a diagnosis."""

from __future__ import annotations

from mrwarp.diagnose.report.report_text import both, either, percent, variable
from mrwarp.diagnose.result import Diagnosis, NextExperiment
from mrwarp.diagnose.sufficient import STANDARD


def sentence_of(d: Diagnosis) -> str:
    """The verdict in one sentence."""
    if d.verdict is None:
        return "No verdict: " + "; ".join(reason.split(":")[0] for reason in d.cannot_know) + "."
    parts = []
    if d.causes:
        parts.append("the model lacks " + both(_cause(c.name, c.alternatives, len(d.causes)) for c in d.causes))
        if d.gain is not None:
            low, high = d.gain.ci95
            them = "it" if len(d.causes) == 1 else "them"
            gains = d.gain.rmse_reduction > 0.0
            parts.append(
                f"with {them} the error on unseen trajectories "
                + (f"falls by {percent(d.gain.rmse_reduction)}" if gains else "does not fall")
                + f" (95 %: {percent(low)} to {percent(high)})"
            )
    if d.unexplained is not None:
        beside = "besides, " if d.causes else ""
        what = f"structure along {both(variable(v, d.recording.units) for v in d.unexplained.depends_on[:2])}"
        if d.unexplained.depends_on[0] == "frequency":
            what = d.unexplained.form
        parts.append(f"{beside}there is {what} that no effect of the catalogue explains")
    if not parts:
        parts.append("nothing is missing that these data could show")
    for s in d.parameter_shift:
        parts.append(f"the calibration has shifted: {either((s.name, *s.alternatives))}")
    text = "; ".join(parts) + "."
    return text[0].upper() + text[1:]


def _cause(name: str, alternatives: tuple[str, ...], causes: int) -> str:
    if causes > 1 and alternatives:
        return f"{either([name])} (or {either(alternatives)})"
    return either((name, *alternatives))


def experiment_sentence(reasons: list[str]) -> NextExperiment | None:
    """The recording to make where no verdict is possible; None where these data only need a change."""
    first = reasons[0].rsplit("; ", 1)[-1] if "; " in reasons[0] else STANDARD
    if first.endswith("diagnose again"):
        return None
    return NextExperiment(what=first, seconds=60.0, separates=(), kind="recording")
