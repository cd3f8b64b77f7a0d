"""``report.html`` of a diagnosis: one offline page for the engineer at the bench."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from mrwarp.diagnose import verdict_text as text
from mrwarp.diagnose.report.overview_pictures import draw
from mrwarp.diagnose.result import Diagnosis, Shift, Tried
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.effects.law import EffectParameter
from mrwarp.recording.data import NO_INPUT, true_names
from mrwarp.sysid.report.page import MOST_SHOWN, NOTHING, Table, page, screen
from mrwarp.sysid.report.words import both, capital, chance, change, percent, signed
from mrwarp.sysid.verdict import Cause, NextExperiment, Suspect, Value

_AS_IS = {"data", "extended"}
"""Texts that the page shows unchanged: names of files and what units do not change."""

_NUMBERS = 3
"""Numbers of a cause that the first screen shows."""

_KINDS = {"mechanism": "part of the device", "sensor": "only in what is measured", "calibration": "calibration"}


def render(d: Diagnosis, command: str, *, pictures: Mapping[str, bytes] | None = None, **tables: Table) -> str:
    """The page as text.

    ``pictures`` are PNGs by name; None: they are drawn here. Further ``tables`` are ``impact``, what changes in the
    robot, ``learned``, what is left to learn, and ``predicted``.
    """
    units = d.recording.units
    content = {key: x if key in _AS_IS else _truly(x, units) for key, x in _content(d).items()}
    return page(
        d,
        command,
        content | dict.fromkeys(("impact", "learned", "predicted")) | tables,
        draw(d)[0] if pictures is None else pictures,
        room="mrwarp.diagnose.report",
        source=d.recording.source.name if d.recording.source else "recording",
        filters={"percent": percent, "both": both, "variable": partial(text.variable, units=units)},
    )


def _truly(content: Any, units: Mapping[str, str]) -> Any:
    """Texts, in lists and objects too, with the control input called what it is."""
    if isinstance(content, str):
        return true_names(content, units)
    if isinstance(content, dict):
        return {key: item if key == "equation" else _truly(item, units) for key, item in content.items()}
    return [_truly(item, units) for item in content] if isinstance(content, list | tuple) else content


def _content(d: Diagnosis) -> dict[str, Any]:
    """Everything that the template shows, as plain text."""
    largest = text.largest_in_report(d)
    return {
        "verdict": d.verdict,
        "answers": _answers(d, largest),
        "sentence": d.sentence.removeprefix(" ".join(text.fault_sentences(d))).strip(),
        "faults": text.fault_sentences(d),
        "extended": d.model is not None and bool(d.causes),
        "facts": _facts(d),
        "causes": [_cause(c, largest) for c in d.causes],
        "suspects": [_suspect(x, largest) for x in d.suspects if x.possible],
        "separates": d.next_experiment is not None and bool(d.next_experiment.separates),
        "experiment": _experiment(d.next_experiment) if d.next_experiment else None,
        "gain": _gain(d),
        "shifts": [_shift(s, largest) for s in d.parameter_shift],
        "detectable": [_detectable(name, v, largest) for name, v in d.detectable.items()],
        "invisible": _invisible(d),
        "cannot_know": d.cannot_know,
        "tried": [(capital(text.title(t.name)), _taken(t), t.outcome) for t in sorted(d.tried, key=lambda t: -t.gain)],
        "data": _data(d),
        "notes": d.notes,
    }


def _answers(d: Diagnosis, largest: Mapping[str, float]) -> list[tuple[str, str]]:
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
    sizes = [_sized(next(iter(c.parameters.values())), c.name, largest).value for c in d.causes if c.parameters]
    return [*([", ".join(sizes[:MOST_SHOWN])] if sizes else []), error]


def _certainty(d: Diagnosis, largest: Mapping[str, float]) -> list[str]:
    """Interval of the size, or of the gain; what it cannot be distinguished from; else suspects."""
    if d.verdict is None:
        return ["not at all"]
    said = []
    sized = {c.name: _sized(next(iter(c.parameters.values())), c.name, largest) for c in d.causes if c.parameters}
    several = len(d.causes) > 1
    known = [f"{text.title(name)} " * several + size.interval for name, size in sized.items() if size.interval]
    said += [f"95 %: {', '.join(known[:MOST_SHOWN])}"] if known else []
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


def _sized(value: Value, effect: str, largest: Mapping[str, float]) -> text.Readable:
    parameter = next(iter(CATALOGUE[effect].parameters), None) if effect in CATALOGUE else None
    return text.readable(value, parameter, largest)


def _torque(value: float, d: Diagnosis) -> str:
    """A torque in the unit of the pictures."""
    return text.measured(value, d.baseline.unit, scaled=False)


def _taken(t: Tried) -> str:
    """Share that an effect takes away; at size zero it is the baseline, so less than nothing is nothing."""
    return "nothing" if t.gain < 5e-4 else f"{percent(t.gain)} ± {percent(1.96 * t.error)}"


def _facts(d: Diagnosis) -> list[tuple[str, str]]:
    """Three or four numbers: errors and what cannot be reached."""
    before, after = (_torque(x, d) for x in (d.baseline.rmse, d.extended.rmse))
    facts = [(percent(d.baseline.nrmse), f"error of the baseline, {before} RMS")]
    if d.gain:
        low, high = (percent(x) for x in d.gain.ci95)
        fall = signed(-d.gain.rmse_reduction)
        facts.append((percent(d.extended.nrmse), f"error with the extension, {after} RMS"))
        facts.append((fall, f"RMS ({low} to {high} less); each trajectory predicted by a fit to the others"))
    if d.account:
        # boosting says less of the rest than a model that did better
        least = min(d.baseline.nrmse * d.account.least**0.5, d.baseline.nrmse, d.extended.nrmse)
        facts.append((percent(least), "does not repeat from run to run: no model gets below that"))
    elif d.traces:
        facts.append((_torque(d.traces.noise_rms, d), "noise RMS: less cannot be reached"))
    return facts


def _cause(c: Cause, largest: Mapping[str, float]) -> dict[str, Any]:
    law = CATALOGUE.get(c.name)
    specs = {p.name: p for p in law.parameters} if law else {}
    return {
        "name": c.name,
        "title": capital(text.title(c.name)),
        "kind": _KINDS[law.kind] if law else "unknown kind",
        "sentence": law.sentence if law else "",
        "equation": law.equation if law else "",
        "parameters": (shown := [_parameter(name, v, specs.get(name), largest) for name, v in c.parameters.items()]),
        "numbers": both(f"{label} {value} ({interval})" for label, value, interval in shown[:_NUMBERS]),
        "gain": percent(c.gain),
        "chance": chance(c.p_value),
        "alternatives": text.either(c.alternatives),
        "remedy": law.remedy if law else "",
        "source": law.source if law else "",
    }


def _parameter(name: str, value: Value, spec: EffectParameter | None, largest: Mapping[str, float]) -> tuple[str, ...]:
    label = name.replace("_", " ")
    if spec is not None and spec.choices:
        return label, f"{value.value:g}", "how the data were logged; no part of the device"
    shown = text.readable(value, spec, largest)
    interval = shown.interval or ("set, not fitted" if spec is not None and spec.preset else "none")
    return label, shown.value, interval


def _suspect(s: Suspect, largest: Mapping[str, float]) -> tuple[str, ...]:
    law = CATALOGUE.get(s.name)
    specs = {p.name: p for p in law.parameters} if law else {}
    shown = [text.readable(v, specs.get(name), largest) for name, v in s.parameters.items()][:1]
    return capital(text.title(s.name)), *((shown[0].value, shown[0].interval) if shown else ("", "")), s.reason


def _shift(s: Shift, largest: Mapping[str, float]) -> tuple[str, ...]:
    law = CATALOGUE.get(s.name)
    shown = text.readable(s, law.parameters[0] if law else None, largest)
    remedy = law.remedy if law else ""
    return capital(text.title(s.name)), shown.value, shown.interval, text.either(s.alternatives) or "-", remedy


def _experiment(e: NextExperiment) -> dict[str, str]:
    names = [text.title(name) for name in e.separates]
    purpose = f"separates {both(names)}" if len(names) > 1 else f"shows {both(names) or 'more'}"
    settings = ", ".join(f"{name.replace('_', ' ')} {value:.4g}" for name, value in e.settings.items())
    seconds = f"{e.seconds:.0f} s" if e.seconds < 180.0 else f"{e.seconds / 60.0:.0f} min"
    kind = e.kind.replace("_", " ")
    return {"what": e.what, "seconds": seconds, "purpose": purpose, "kind": kind, "settings": settings}


def _gain(d: Diagnosis) -> dict[str, Any] | None:
    g = d.gain
    if g is None or not d.causes:
        return None
    low, high = g.ci95
    count = len(g.held_out)
    moves = f"falls by {percent(g.rmse_reduction)}"
    if g.rmse_reduction <= 0.0:
        moves = f"rises by {percent(-g.rmse_reduction)}"
    return {
        "text": f"On {count} whole trajectories, each predicted by a model that was fitted without it, the RMS error "
        f"{moves} (95 % interval over trajectories: {percent(low)} to {percent(high)}).",
        "regimes": [
            (name, _torque(before, d), _torque(after, d), change(before, after))
            for name, (before, after) in d.per_regime.items()
        ],
    }


def _invisible(d: Diagnosis) -> list[tuple[str, str]]:
    """Effects that no size would show, together where the reason is the same."""
    reasons: dict[str, list[str]] = {}
    for name, why in d.invisible.items():
        reasons.setdefault(why, []).append(text.title(name))
    return [(capital(", ".join(names)), capital(why)) for why, names in reasons.items()]


def _detectable(name: str, value: Value, largest: Mapping[str, float]) -> tuple[str, ...]:
    law = CATALOGUE.get(name)
    spec = law.parameters[0] if law else None
    if text.is_gain(spec) and value.unit == "1":
        size = abs(value.value - 1.0) if value.value > 0.5 else abs(value.value)  # as a factor, or as its change
        return capital(text.title(name)), percent(size, 2)
    factor, unit = text.shared_scale(value.value, value.unit, largest)
    size = f"{text.rounded(value.value * factor, 2)} {unit}".strip() + text.spring_constant(value)
    return capital(text.title(name)), size


def _data(d: Diagnosis) -> list[tuple[str, str]]:
    r = d.recording
    runs = r.trajectories
    rows = [("Source", str(r.source) if r.source else "not from a file")]
    if runs:
        length = sum(float(run.t[-1] - run.t[0]) for run in runs)
        rates = np.array([1.0 / run.dt for run in runs])
        equal = np.ptp(rates) < 0.01 * rates.min()
        rate = f"{rates.min():.4g} Hz" if equal else f"{rates.min():.4g} to {rates.max():.4g} Hz"
        derived = sum(run.qd_derived for run in runs)
        velocity = "as recorded"
        if derived:
            velocity = f"derived from the {text.quantity('q', r.units)}, without phase"
            velocity += "" if derived == len(runs) else f", in {derived} of the trajectories"
        rows += [
            ("Trajectories", f"{len(runs)}, together {length:.0f} s, {r.samples:,} samples at {rate}"),
            ("Units", ", ".join(f"{text.quantity(k, r.units)} [{u}]" for k, u in r.units.items() if u != NO_INPUT)),
            ("Velocity", velocity),
        ]
    rows += [("Put right", line) for line in r.repaired()]
    made = {k: v for k, v in r.header.items() if k != "effects"}
    if made:
        rows.append(("The files say", "; ".join(f"{k}: {v}" for k, v in made.items())[:600]))
    return rows
