"""The answer of a diagnosis, of any plant: typed data, from which page and ``result.json`` are written."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from mrwarp.run_dir import write_result

Verdict = Literal["none", "named", "unexplained", "named_and_unexplained"]

VERDICTS: dict[tuple[bool, bool], Verdict] = {
    (False, False): "none",
    (True, False): "named",
    (False, True): "unexplained",
    (True, True): "named_and_unexplained",
}
"""By whether there are causes, and something that none explains."""

NOT_CHECKED = "a first look only: nothing was checked"
"""Why no candidate of a first answer is a cause."""


def being_checked(sentence: str) -> str:
    """The line that says so while it is checked."""
    return sentence.replace("Likely", "likely", 1).replace("; not checked.", "; checking")


@dataclass(frozen=True, kw_only=True)
class Value:
    """A number with its 95 % interval and unit."""

    value: float
    ci95: tuple[float, float]
    unit: str


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A named cause: an effect of a joint, or what a robot's description has wrong."""

    name: str
    parameters: Mapping[str, Value]
    p_value: float
    """Chance that noise alone, or a healthy robot, would give as much, after looking at every candidate."""
    alternatives: tuple[str, ...]
    """Causes that these data do not distinguish from it."""
    gain: float
    """Share of the squared mismatch that it alone takes away [1]."""


@dataclass(frozen=True, kw_only=True)
class Suspect:
    """A cause that fits, but is not proven: it is no part of the extended model."""

    name: str
    reason: str
    """The missing part of a proof."""
    parameters: Mapping[str, Value]
    """Its numbers where it was found."""
    gain: float
    """Reduction of the squared mismatch where it was found [1]."""
    possible: bool = True
    """False: no device has it with this sign or size; a report shows it with what was tried only."""


@dataclass(frozen=True, kw_only=True)
class Unexplained:
    """Structure that no cause of the catalogue explains."""

    depends_on: tuple[str, ...]
    """Variables, the clearest first."""
    form: str
    """How it depends on them, in words."""
    share: float
    """Its part of all that could be predicted beyond the baseline [1]."""
    formula: str | None = None


@dataclass(frozen=True, kw_only=True)
class Error:
    """RMS of measured minus predicted, on pieces of the data each predicted by a fit to the others."""

    rmse: float
    nrmse: float
    """rmse over the standard deviation of what was measured; of a robot, over rmse of its description."""
    unit: str


@dataclass(frozen=True, kw_only=True)
class Gain:
    """Gain of the extension on pieces that took no part in fitting it."""

    rmse_reduction: float
    """1 - rmse(extended)/rmse(baseline), of the answer's errors [1]."""
    ci95: tuple[float, float]
    held_out: tuple[str | int, ...]
    """Names of the pieces, or their numbers."""


@dataclass(frozen=True, kw_only=True)
class NextExperiment:
    """A recording that would settle what this one leaves open."""

    what: str
    """The experiment in one sentence."""
    seconds: float
    separates: tuple[str, ...]
    """Causes that it separates, or shows."""
    kind: str
    """Name of the standard experiment, or of the cause that it shows."""
    settings: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Answer:
    """The answer of a diagnosis, be it of a joint or of a robot."""

    verdict: Verdict | None
    """None: the data cannot carry a verdict; ``cannot_know`` says why."""
    sentence: str
    final: bool = True
    """False: a first answer, whose suspects are what looks likeliest; nothing is checked, and there is no model."""
    causes: tuple[Cause, ...] = ()
    suspects: tuple[Suspect, ...] = ()
    unexplained: Unexplained | None = None
    detectable: Mapping[str, Value] = field(default_factory=dict)
    """Smallest size of each effect that these data would have shown; effects missing here are invisible in them."""
    cannot_know: tuple[str, ...] = ()
    """Questions that these data cannot answer, each with the recording to make."""
    baseline: Error
    extended: Error
    gain: Gain | None = None
    next_experiment: NextExperiment | None = None
    notes: tuple[str, ...] = ()
    seconds: float
    seed: int = 0
    """Seed of everything random."""

    def to_dict(self) -> dict[str, Any]:
        """The figures of ``result.json``; an interval that the data do not give holds infinities, written as null."""
        plain = ("verdict", "final", "seconds", "sentence", "cannot_know", "notes")
        gain = {"rmse_reduction": None, "ci95": (None, None), "held_out": ()}
        parts = ("unexplained", "baseline", "extended", "next_experiment")
        return {
            **{name: getattr(self, name) for name in plain},
            **{name: asdict(part) if (part := getattr(self, name)) else None for name in parts},
            **{name: [asdict(row) for row in getattr(self, name)] for name in ("causes", "suspects")},
            "gain": asdict(self.gain) if self.gain else gain,
            "detectable": {name: {"value": v.value, "unit": v.unit} for name, v in self.detectable.items()},
        }

    def write(self, out: Path, command: str, extras: Mapping[str, Any] | None = None, *, model_name: str = "") -> Path:
        """Write ``result.json`` atomically into a folder, which is made if it is not there.

        ``extras`` holds further results, such as those of ``--predict``, ``model_name`` the extended model's file.
        """
        figures = self.to_dict() | dict(extras or {}) | {"model": model_name or None}
        return write_result(out, figures, seed=self.seed, command=command)


def not_checked(what: str, unit: str) -> dict[str, Any]:
    """Fields of a first answer: what looks likeliest after one look at every candidate, and errors of this unit."""
    unknown = Error(rmse=float("nan"), nrmse=float("nan"), unit=unit)
    sentence = f"Likely: {what}; not checked."
    return {"verdict": None, "sentence": sentence, "final": False, "baseline": unknown, "extended": unknown}
