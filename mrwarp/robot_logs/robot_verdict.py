"""The verdict over a robot's log: typed data, from which report and ``result.json`` are written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import RobotLog
from mrwarp.robot_logs.windows import Windows
from mrwarp.runtime import text_table
from mrwarp.sysid.verdict import Answer, Cause, Unexplained


@dataclass(frozen=True, kw_only=True)
class NamedCause(Cause):
    """A cause at a place; alternatives are followed by `` of PLACE`` where that is another place."""

    where: str
    """A joint, a leg, a body, or ``robot``."""
    change: Mapping[int, float]
    """Change of each of its parameters."""


@dataclass(frozen=True, kw_only=True)
class RobotDiagnosis(Answer):
    """A verdict over a robot's log; errors are RMS, each channel in units of its healthy error."""

    causes: tuple[NamedCause, ...] = ()
    per_joint: Mapping[str, Mapping[str, float]]
    """RMSE of the angle over windows that took no part, before and after, by joint [rad]."""
    per_channel: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """Errors by channel, in the channel's unit."""
    session: Mapping[str, float]
    """Where each joint settled relative to its command in this session [rad]."""
    parameters: tuple[Parameter, ...]
    theta: np.ndarray
    """Changes of the named causes, shape (P,)."""
    setup: np.ndarray | None = None
    """Changes by which drives are set up otherwise than the log says, which are no faults, shape (P,)."""
    model: ReplayModel
    log: RobotLog
    windows: tuple[Windows, ...]

    def to_dict(self) -> dict[str, Any]:
        """The figures of ``result.json``, with those of a robot."""
        found = super().to_dict()
        for row in found["causes"]:
            del row["change"]
        return found | {
            **{name: getattr(self, name) for name in ("per_joint", "per_channel", "session")},
            "parameter_shift": [],
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
        }


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
    if d.causes and d.gain is not None:
        low, high = (100.0 * x for x in d.gain.ci95)
        yield (
            f"\nerror on pieces of the log that took no part: {-100.0 * d.gain.rmse_reduction:+.1f} % "
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
