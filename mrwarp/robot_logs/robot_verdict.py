"""The verdict over a robot's log: typed data, from which report and ``result.json`` are written."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy import stats

from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.causes.robot_causes import CATALOGUE
from mrwarp.robot_logs.likelihood import Likelihood
from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import RobotLog
from mrwarp.robot_logs.robot_proof import Sizes
from mrwarp.robot_logs.selection import Found, Hypothesis, Posterior, own_members, posterior
from mrwarp.robot_logs.windows import Windows
from mrwarp.runtime import text_table
from mrwarp.sysid.verdict import Answer, Cause, Unexplained, Value


@dataclass(frozen=True, kw_only=True)
class NamedCause(Cause):
    """A cause at a place; alternatives are followed by `` of PLACE`` where that is another place."""

    where: str
    """A joint, a leg, a body, or ``robot``."""
    change: Mapping[int, float]
    """Change of each of its parameters."""
    relative_to: str = ""
    """Quantity by whose unknown scale its numbers count; they have no interval then. Empty of others."""


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
            rows.append((c.where, f"{c.name}.{name}", f"{v.value:.4g}{unit}", interval_text(v, c.relative_to)))
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


def interval_text(value: Value, relative_to: str = "") -> str:
    """A 95 % interval in a value's unit, or that the log gives none."""
    low, high = value.ci95
    return f"{low:.4g} to {high:.4g}" if np.isfinite([low, high]).all() else f"none: relative to {relative_to}"


def sentence_of(causes: tuple[NamedCause, ...], unexplained: Unexplained | None, left: float, most: float) -> str:
    """The verdict in one sentence.

    Args:
        causes: What is named.
        unexplained: What acts outside the catalogue.
        left: The replay's error with the causes, in healthy ones [1].
        most: Beyond it the replay is not right, with causes or without [1].
    """
    found = [cause_text(cause) for cause in causes]
    if unexplained is not None:
        found.append(f"something outside the catalogue: {unexplained.form}")
    if left > most:
        off = f"the replay's error is {left:.3g} times a healthy robot's"
        found.append(f"even so {off}" if found else f"No cause is proven, and {off}")
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
    text += f", relative to {cause.relative_to}" if cause.relative_to else ""
    return text + (f" (or {', '.join(cause.alternatives)})" if cause.alternatives else "")


def values_of(first: Parameter, mean: float, half: float) -> dict[str, Value]:
    """The numbers of a cause from the change of its first parameter and the half of that change's interval."""
    low, high = sorted(first.absolute(mean + s * half) for s in (-1.0, 1.0))
    values = {first.name: Value(value=first.absolute(mean), ci95=(low, high), unit=first.unit)}
    if first.relative:
        values["factor"] = Value(value=1.0 + mean, ci95=(1.0 + mean - half, 1.0 + mean + half), unit="1")
    return values


def named_cause(
    f: Found, found: list[Found], size: Sizes, likelihood: Likelihood, parameters: list[Parameter], now: Posterior
) -> NamedCause:
    """A cause with its size and what it explains."""
    others = [x.hypothesis for x in found if x is not f]
    first = parameters[own_members(f.hypothesis, others)[0]]
    mean, half = size.of(f.hypothesis, [x.hypothesis for x in found], now, parameters)
    mean, half = mean - first.declared.own, half + first.declared.own + first.unsure
    name, where, values = f.hypothesis.cause, f.hypothesis.where, values_of(first, mean, half)
    if first.declared.if_negative and mean < 0.0:
        name, where, number = first.declared.if_negative
        values = {number: Value(value=-mean, ci95=(-mean - half, -mean + half), unit=first.unit)}
    return NamedCause(
        name=name,
        where=where,
        parameters=values,
        p_value=float(2.0 * stats.norm.sf(abs(f.z))),
        alternatives=tuple(dict.fromkeys([*(_place(d, f.hypothesis.where) for d in f.alternatives), *first.others])),
        gain=explained(f, found, likelihood, parameters, now),
        change={k: float(size.size[k]) for k in f.hypothesis.members},
    )


def explained(
    f: Found, found: list[Found], likelihood: Likelihood, parameters: list[Parameter], now: Posterior | None = None
) -> float:
    """Share of the squared mismatch that a cause takes away next to the others [1]; ``now`` is with all of them."""
    now = now or posterior(likelihood, parameters, [x.hypothesis for x in found])
    without = posterior(likelihood, parameters, [x.hypothesis for x in found if x is not f]).mean.copy()
    without[list(f.hypothesis.members)] = 0.0
    return float(max(1.0 - likelihood.at(now.mean) / max(likelihood.at(without), 1e-12), 0.0))


def _place(hypothesis: Hypothesis, here: str) -> str:
    return hypothesis.cause if hypothesis.where == here else f"{hypothesis.cause} of {hypothesis.where}"
