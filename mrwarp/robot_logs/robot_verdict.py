"""The verdict over a robot's log: typed data, from which report and ``result.json`` are written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.diagnose.result import Error, NextExperiment, Suspect, Unexplained, Value
from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import RobotLog
from mrwarp.robot_logs.windows import Windows
from mrwarp.run_dir import write_result
from mrwarp.runtime import text_table
from mrwarp.sysid.verdict import Verdict


@dataclass(frozen=True, kw_only=True)
class NamedCause:
    """A cause at a place, with its numbers."""

    name: str
    where: str
    """A joint, a leg, a body, or ``robot``."""
    parameters: Mapping[str, Value]
    p_value: float
    """Chance that a healthy robot would give as much, after looking at every cause and place."""
    alternatives: tuple[str, ...]
    """Causes that this log does not distinguish from it; with `` of PLACE`` where that is another place."""
    gain: float
    """Share of the squared mismatch that returns without it [1]."""
    change: Mapping[int, float]
    """Change of each of its parameters."""


@dataclass(frozen=True, kw_only=True)
class RobotDiagnosis:
    """A verdict over a robot's log."""

    verdict: Verdict | None
    sentence: str
    final: bool = True
    """False: a first answer, whose suspects are what looks likeliest; nothing is checked."""
    causes: tuple[NamedCause, ...]
    suspects: tuple[Suspect, ...] = ()
    unexplained: Unexplained | None = None
    cannot_know: tuple[str, ...]
    next_experiment: NextExperiment | None = None
    baseline: Error
    """RMS of what is left of windows that took no part, each channel in units of its healthy error."""
    extended: Error
    gain: Mapping[str, Any]
    """Reduction of that error on pieces of the log that took no part: rmse_reduction, ci95, held_out."""
    per_joint: Mapping[str, Mapping[str, float]]
    """RMSE of the angle over windows that took no part, before and after, by joint [rad]."""
    per_channel: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Errors by channel, in the channel's unit."""
    session: Mapping[str, float]
    """Where each joint settled relative to its command in this session [rad]."""
    detectable: Mapping[str, Value] = field(default_factory=dict)
    """Smallest size of each cause that this log would have shown, at the place where it shows best."""
    notes: tuple[str, ...] = ()
    parameters: tuple[Parameter, ...]
    theta: np.ndarray
    """Changes of the named causes, shape (P,)."""
    model: ReplayModel
    log: RobotLog
    windows: tuple[Windows, ...]
    seconds: float

    def to_dict(self) -> dict[str, Any]:
        """The figures of ``result.json``: the keys of a joint's verdict, and ``where`` of each cause."""
        causes = []
        for c in self.causes:
            row = {name: getattr(c, name) for name in ("name", "where", "p_value", "alternatives", "gain")}
            causes.append(row | {"parameters": {name: vars(v) for name, v in c.parameters.items()}})
        plain = (
            "verdict",
            "final",
            "seconds",
            "sentence",
            "cannot_know",
            "notes",
            "gain",
            "per_joint",
            "per_channel",
            "session",
        )
        parts = ("unexplained", "baseline", "extended", "next_experiment")
        return {
            **{name: getattr(self, name) for name in plain},
            **{name: vars(part) if (part := getattr(self, name)) else None for name in parts},
            "causes": causes,
            "suspects": [
                vars(s) | {"parameters": {n: vars(v) for n, v in s.parameters.items()}} for s in self.suspects
            ],
            "parameter_shift": [],
            "detectable": {name: vars(v) for name, v in self.detectable.items()},
            "data": {
                "source": str(self.log.path),
                "robot": str(self.model.path),
                "base": self.log.base,
                "joints": self.log.joints,
                "runs": [run.id for run in self.log.runs],
                "samples": sum(run.samples for run in self.log.runs),
                "seconds": self.log.seconds,
                "rates": sorted({round(1.0 / run.dt, 3) for run in self.log.runs}),
            },
        }  # fmt: skip

    def write(
        self, out: Path, command: str, extras: Mapping[str, Any] | None = None, *, seed: int, model_name: str = ""
    ) -> Path:
        """Write ``result.json``, with ``extras``, atomically into a folder, made if it is not there."""
        found = self.to_dict() | {"model": model_name or None} | dict(extras or {})
        return write_result(out, found, seed=seed, command=command)


def lines(d: RobotDiagnosis) -> Iterator[str]:
    """The verdict and its numbers, as the terminal shows them."""
    yield from ("", d.sentence)
    for text in (*d.notes, *(f"suspect, not proven: {s.name}: {s.reason}" for s in d.suspects)):
        yield f"  {text}"
    rows = []
    for c in d.causes:
        for name, v in c.parameters.items():
            unit = "" if v.unit == "1" else f" {v.unit}"
            rows.append((c.where, f"{c.name}.{name}", f"{v.value:.4g}{unit}", f"{v.ci95[0]:.4g} to {v.ci95[1]:.4g}"))
    if rows:
        yield ""
        yield from text_table(("where", "cause", "value", "95 % interval"), rows, left=2)
    for c in d.causes:
        if c.alternatives:
            yield f"{c.name} of {c.where}: this log does not distinguish it from {', '.join(c.alternatives)}"
    if d.causes:
        low, high = (100.0 * x for x in d.gain["ci95"])
        yield (
            f"\nerror on pieces of the log that took no part: {-100.0 * d.gain['rmse_reduction']:+.1f} % "
            f"({-high:+.1f} to {-low:+.1f} %)"
        )
    if d.cannot_know:
        yield from ("", "cannot be known from this log:")
        yield from (f"  {text}" for text in d.cannot_know)
    if d.next_experiment is not None:
        motions = " ".join(f"{name}={seconds:g}" for name, seconds in d.next_experiment.settings.items())
        yield f"\nnext recording: {d.next_experiment.what} (mrwarp log record --motion {motions})"


def sentence_of(causes: tuple[NamedCause, ...], unexplained: Unexplained | None = None) -> str:
    """The verdict in one sentence."""
    found = [cause_text(cause) for cause in causes]
    if unexplained is not None:
        found.append(f"something outside the catalogue: {unexplained.form}")
    return "; ".join(found) + "." if found else "Nothing is wrong with the simulation that this log could show."


_SMALL = {"s": "ms", "rad": "mrad", "m": "mm"}
"""Units in which a verdict, its page and its pictures give small quantities of a robot: thousandths, always."""


def in_page_unit(value: float, unit: str) -> tuple[float, str]:
    """A number with the one unit that its quantity has wherever people read of a robot."""
    return (1e3 * value, _SMALL[unit]) if unit in _SMALL else (value, unit)


def cause_text(cause: NamedCause) -> str:
    """A cause with place and size, such as "RL_calf_joint: Coulomb friction +0.61 N·m"."""
    name, value = next(iter(cause.parameters.items()))
    place, declared = "" if cause.where == "robot" else f"{cause.where}: ", CATALOGUE[cause.name]
    size, unit = in_page_unit(value.value, value.unit)
    unit = "" if unit == "1" else f" {unit}"
    if declared.says is not None:
        text = f"{place}{declared.says(value.value, name)}"
    elif "factor" in cause.parameters:
        text = f"{place}{declared.title} {cause.parameters['factor'].value:.2f} times the description's"
    else:
        text = f"{place}{declared.title} {size:+.3g}{unit}" + (f" ({name})" if name in "xyzrollpitch" else "")
    return text + (f" (or {', '.join(cause.alternatives)})" if cause.alternatives else "")
