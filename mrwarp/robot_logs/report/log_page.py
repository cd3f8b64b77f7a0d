"""``report.html`` of a robot's log: what the page of a diagnosis says of a robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from mrwarp.robot_logs.report.compared_replays import UNITS
from mrwarp.robot_logs.report.walk_change import HEAD, WalkChange
from mrwarp.robot_logs.robot_verdict import NamedCause, RobotDiagnosis, cause_text, in_page_unit
from mrwarp.sysid.report.page import MOST_SHOWN, NOTHING, page, screen
from mrwarp.sysid.report.words import both, chance, change, percent, signed
from mrwarp.sysid.verdict import Value

MOST_SAID = 3
"""Most causes whose numbers stand next to the verdict."""


def render(d: RobotDiagnosis, pictures: Mapping[str, bytes], command: str, walked: WalkChange | None = None) -> str:
    """The page as text; ``pictures`` are PNGs by name."""
    content = {
        "answers": _answers(d),
        "causes": [_cause(c) for c in d.causes],
        "facts": _facts(d),
        "suspects": [(s.name.replace("_", " "), s.reason) for s in d.suspects],
        "gain": _gain(d),
        "joints": [_errors(joint, e, lambda x: f"{1e3 * x:.2f}") for joint, e in d.per_joint.items()],
        "channels": [_errors(c, e, partial(_number, unit=UNITS.get(c, ""))) for c, e in d.per_channel.items()],
        "experiment": d.next_experiment,
        "cannot_know": [_parted(x) for x in d.cannot_know],
        "session": [(joint, f"{1e3 * x:+.1f} mrad".replace("-", "−")) for joint, x in d.session.items()],
        "data": _data(d),
        "walked": walked,
        "walk_head": HEAD,
    }
    return page(d, command, content, pictures, room="mrwarp.robot_logs.report", source=d.log.path.name)


def _answers(d: RobotDiagnosis) -> list[tuple[str, str]]:
    """Missing causes, their sizes, how sure they are and what to do: the page's first screen."""
    if d.verdict is None:
        missing, size, sure, todo = ["unknown: this log cannot carry a verdict"], ["unknown"], ["not at all"], []
    else:
        many = len(d.causes) - MOST_SHOWN
        missing = [cause_text(c) for c in d.causes[:MOST_SHOWN]] + ([f"{many} more, below"] if many > 0 else [])
        missing += ["something outside the catalogue, see below"] if d.unexplained else []
        first = [next(iter(c.parameters.values())) for c in d.causes[:1]]
        size = [_number(v.value, v.unit) for v in first] or ["nothing beyond what healthy robots differ by"]
        sure, todo = [f"95 %: {_interval(v)}" for v in first], []
        if d.causes and d.gain is not None:
            size.append(f"error {signed(-d.gain.rmse_reduction, 0)}")
            sure.append("by pieces of the log that took no part")
            todo.append("take robot.usda: it has the causes")
    sure += [f"suspected, not proven: {both(s.name.replace('_', ' ') for s in d.suspects[:MOST_SHOWN])}"][
        : len(d.suspects)
    ]
    todo += ["record the motion below"] if d.next_experiment else []
    return screen(
        {
            "What is missing": missing or [NOTHING],
            "How big": size,
            "How sure": sure or ["smaller ones than those listed may be there"],
            "What to do": todo or ["nothing"],
        }
    )


def _number(value: float, unit: str) -> str:
    size, unit = in_page_unit(value, unit)
    shown = f"{size:.4g}".replace("-", "−")
    return shown if unit in ("1", "") else f"{shown} {unit}"


def _interval(v: Value) -> str:
    low, high = v.ci95
    if not (math.isfinite(low) and math.isfinite(high)):
        return "none: relative to the drives' torques"
    return f"{_number(low, v.unit).split()[0]} to {_number(high, v.unit)}"


def _facts(d: RobotDiagnosis) -> list[tuple[str, str]]:
    """Size and interval of each cause, what it gains on parts that took no part."""
    facts = []
    for c in d.causes[:MOST_SAID]:
        name, v = next(iter(c.parameters.items()))
        place = "" if c.where == "robot" else f" of {c.where}"
        facts.append((_number(v.value, v.unit), f"{c.name.replace('_', ' ')}{place}: {name}, 95 % {_interval(v)}"))
    if d.causes and d.gain is not None:
        low, high = (percent(x) for x in d.gain.ci95)
        fall = signed(-d.gain.rmse_reduction)
        facts.append((fall, f"error on parts of the log that took no part ({low} to {high} less)"))
    return facts


def _cause(c: NamedCause) -> dict[str, Any]:
    return {
        "title": cause_text(c),
        "name": c.name,
        "where": c.where,
        "parameters": [(n.replace("_", " "), _number(v.value, v.unit), _interval(v)) for n, v in c.parameters.items()],
        "gain": percent(c.gain),
        "chance": chance(c.p_value),
        "alternatives": ", ".join(x.replace("_", " ") for x in c.alternatives),
    }


def _gain(d: RobotDiagnosis) -> str:
    if not d.causes:
        return ""
    return (
        f"On parts of the log that took no part the error falls from {d.baseline.rmse:.3g} to {d.extended.rmse:.3g}, "
        "in units of what a healthy robot leaves in each channel."
    )


def _errors(name: str, e: Mapping[str, float], shown: Callable[[float], str]) -> tuple[str, ...]:
    before, after = e.values()
    return name, shown(before), shown(after), change(before, after)


def _parted(line: str) -> tuple[str, str]:
    """Causes that cannot be known, and why, with the motion that would show them."""
    what, colon, why = line.partition(": ")
    return (what.replace("_", " "), why) if colon else ("", line)


def _data(d: RobotDiagnosis) -> list[tuple[str, str]]:
    runs = d.log.runs
    channels = sorted({c for run in runs for c in (*run.joint, *run.base, *(["foot"] if run.feet else []))})
    pieces = sum(w.count for w in d.windows)
    return [
        ("log", str(d.log.path)),
        ("robot", f"{d.model.path}, base {d.log.base}, {len(d.model.joints)} joints"),
        ("recordings", f"{len(runs)}, {d.log.seconds:.1f} s"),
        ("channels", f"{', '.join(channels)}; tau is {d.log.tau_is}"),
        ("replayed", f"{pieces} windows of about {d.windows[0].t[0, -1]:.2f} s, each begun in the logged state"),
    ]
