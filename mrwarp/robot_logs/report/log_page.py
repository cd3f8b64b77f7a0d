"""``report.html`` of a robot's log: one offline page, styled as that of a joint."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

from mrwarp.diagnose import verdict_text as text
from mrwarp.diagnose.report.first_screen import MOST_SHOWN, NOTHING, heading, screen
from mrwarp.robot_logs.report.compared_replays import UNITS
from mrwarp.robot_logs.report.walk_change import HEAD, WalkChange
from mrwarp.robot_logs.robot_verdict import NamedCause, RobotDiagnosis, cause_text, in_page_unit
from mrwarp.run_dir import versions
from mrwarp.sysid.verdict import Value

MOST_SAID = 3
"""Most causes whose numbers stand next to the verdict."""


def render(d: RobotDiagnosis, pictures: Mapping[str, bytes], command: str, walked: WalkChange | None = None) -> str:
    """The page as text; ``pictures`` are PNGs by name."""
    loaders = [PackageLoader(f"mrwarp.{room}", ".") for room in ("robot_logs.report", "diagnose.report")]
    environment = Environment(
        loader=ChoiceLoader(loaders), autoescape=True, undefined=StrictUndefined, trim_blocks=True
    )
    page = environment.get_template("log_page.html.jinja").render(
        source=d.log.path.name,
        heading=heading(d.log.path.name),
        answers=_answers(d),
        sentence=d.sentence,
        causes=[_cause(c) for c in d.causes],
        facts=_facts(d),
        suspects=[(s.name.replace("_", " "), s.reason) for s in d.suspects],
        unexplained=d.unexplained,
        gain=_gain(d),
        joints=_joints(d),
        channels=_channels(d),
        experiment=d.next_experiment,
        cannot_know=[_parted(x) for x in d.cannot_know],
        session=_session(d),
        data=_data(d),
        notes=d.notes,
        walked=walked,
        walk_head=HEAD,
        command=command,
        seconds=f"{d.seconds:.0f}",
        versions=", ".join(f"{name} {number}" for name, number in versions().items()),
        pictures={name: base64.b64encode(data).decode() for name, data in pictures.items()},
    )
    return page.encode("utf-8", "replace").decode("utf-8")


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
        if d.causes:
            size.append(f"error {text.percent(-d.gain['rmse_reduction'], 0).replace('-', '−')}")
            sure.append("by pieces of the log that took no part")
            todo.append("take robot.usda: it has the causes")
    sure += [f"suspected, not proven: {text.both(s.name.replace('_', ' ') for s in d.suspects[:MOST_SHOWN])}"][
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
    return f"{_number(low, v.unit).split()[0]} to {_number(high, v.unit)}"


def _facts(d: RobotDiagnosis) -> list[tuple[str, str]]:
    """Size and interval of each cause, what it gains on parts that took no part."""
    facts = []
    for c in d.causes[:MOST_SAID]:
        name, v = next(iter(c.parameters.items()))
        place = "" if c.where == "robot" else f" of {c.where}"
        facts.append((_number(v.value, v.unit), f"{c.name.replace('_', ' ')}{place}: {name}, 95 % {_interval(v)}"))
    if d.causes:
        low, high = (text.percent(x) for x in d.gain["ci95"])
        change = text.percent(-d.gain["rmse_reduction"]).replace("-", "−")
        facts.append((change, f"error on parts of the log that took no part ({low} to {high} less)"))
    return facts


def _cause(c: NamedCause) -> dict[str, Any]:
    return {
        "title": cause_text(c),
        "name": c.name,
        "where": c.where,
        "parameters": [(n.replace("_", " "), _number(v.value, v.unit), _interval(v)) for n, v in c.parameters.items()],
        "gain": text.percent(c.gain),
        "chance": text.chance(c.p_value),
        "alternatives": ", ".join(x.replace("_", " ") for x in c.alternatives),
    }


def _gain(d: RobotDiagnosis) -> str:
    if not d.causes:
        return ""
    return (
        f"On parts of the log that took no part the error falls from {d.baseline.rmse:.3g} to {d.extended.rmse:.3g}, "
        "in units of what a healthy robot leaves in each channel."
    )


def _joints(d: RobotDiagnosis) -> list[tuple[str, ...]]:
    return [
        (joint, f"{1e3 * e['baseline']:.2f}", f"{1e3 * e['extended']:.2f}", _change(e["baseline"], e["extended"]))
        for joint, e in d.per_joint.items()
    ]


def _channels(d: RobotDiagnosis) -> list[tuple[str, ...]]:
    return [
        (name, *(_number(x, UNITS.get(name, "")) for x in e.values()), _change(e["baseline"], e["extended"]))
        for name, e in d.per_channel.items()
    ]


def _change(before: float, after: float) -> str:
    return f"{100.0 * (after / before - 1.0):+.0f} %".replace("-", "−") if before > 0.0 else "–"


def _parted(line: str) -> tuple[str, str]:
    """Causes that cannot be known, and why, with the motion that would show them."""
    what, colon, why = line.partition(": ")
    return (what.replace("_", " "), why) if colon else ("", line)


def _session(d: RobotDiagnosis) -> list[tuple[str, str]]:
    return [(joint, f"{1e3 * value:+.1f} mrad".replace("-", "−")) for joint, value in d.session.items()]


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
