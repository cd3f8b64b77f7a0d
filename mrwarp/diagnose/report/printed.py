"""A diagnosis in the terminal, and further results as tables of the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from mrwarp.diagnose import verdict_text as text
from mrwarp.diagnose.result import Diagnosis
from mrwarp.recording.data import true_names
from mrwarp.runtime import text_table
from mrwarp.sysid.report.page import Table
from mrwarp.sysid.report.words import percent


def lines(d: Diagnosis, tables: Mapping[str, Table]) -> list[str]:
    """The verdict, its numbers and the further tables."""
    found = ["", d.sentence]
    advice = f"; {d.next_experiment.what}" if d.next_experiment is not None else ""
    unsaid = [why for why in d.cannot_know if why not in d.sentence]
    found += [f"  note: {d.spikes.sentence}"] if d.spikes else []
    found += [f"  cannot be known: {why.removesuffix(advice)}" for why in unsaid]
    for s in d.suspects:
        found.append(f"  {'suspect, not proven' if s.possible else 'not possible'}: {text.title(s.name)}: {s.reason}")
    found = [true_names(line, d.recording.units) for line in found]
    numbers = {f"{cause.name}.{name}": value for cause in d.causes for name, value in cause.parameters.items()}
    if d.law is not None and d.dry_friction is not None:
        numbers = {f"Coulomb friction ({d.law.title})": d.dry_friction, **numbers}
    largest = text.largest_in_report(d)
    rows = []
    for name, value in numbers.items():
        shown = text.readable(value, largest=largest)
        rows.append((name, shown.value, shown.interval))
    for shift in d.parameter_shift:
        low, high = shift.ci95
        rows.append((f"{shift.name} (calibration)", f"{shift.value:.4g}", f"{low:.4g} to {high:.4g}"))
    if rows:
        found += ["", *text_table(("", "value", "95 % interval"), rows)]
    for cause in d.causes:
        if cause.alternatives:
            found.append(f"{cause.name}: these data do not distinguish it from {', '.join(cause.alternatives)}")
    if d.verdict is not None:
        before, after = (text.measured(e.rmse, e.unit, scaled=False) for e in (d.baseline, d.extended))
        errors = [("baseline", before, f"NRMSE {d.baseline.nrmse:.2%}")]
        if d.gain is not None:
            low, high = d.gain.ci95
            change, least, most = (f"{-100.0 * x:+.1f}" for x in (d.gain.rmse_reduction, low, high))
            errors.append(("with the extension", after, f"NRMSE {d.extended.nrmse:.2%}"))
            errors.append(("change", f"{change} %", f"{most} to {least} %"))
        found.append(f"\nRMS error, each of {len(d.per_trajectory)} trajectories predicted by a fit to the others")
        found += text_table(("", "", ""), errors)[1:]
    if d.next_experiment is not None:
        said = true_names(d.next_experiment.what, d.recording.units)
        found.append(f"next experiment, {d.next_experiment.seconds:.0f} s: {said}")
    for name, table in tables.items():
        found.append(f"\n{name}: " + " | ".join(table.head))
        found += ["  " + " | ".join(row) for row in table.rows]
    return found


def predicted_table(means: Mapping[str, Any]) -> Table:
    """Errors on recordings that took no part, see :func:`mrwarp.diagnose.held_out.summary`."""
    rows = [
        (
            name or "all",
            percent(m["baseline"], 2),
            percent(m["extended"], 2),
            f"{m['better']} of {m['trajectories']} trajectories",
        )
        for name, m in means.items()
    ]
    return Table(head=("Mean NRMSE", "Baseline", "With the extension", "Better in"), rows=rows)


def learned_table(found: Mapping[str, Any], unit: str) -> Table:
    """Error left for a learned residual, see :func:`mrwarp.identify.learn.left_to_learn`."""
    pairs = {
        "RMS of what it has to add, all trajectories": found["target"],
        f"RMSE without it, on {len(found['held_out'])} trajectories it was not trained on": found["physical"],
        "RMSE with it, on the same": found["with_learned"],
    }
    rows = [
        (name, *(text.measured(x, unit, scaled=False) for x in (a, b)), f"{100.0 * (b / a - 1.0):+.0f} %")
        for name, (a, b) in pairs.items()
    ]
    return Table(head=("", "On the baseline", "On the extension", "Change"), rows=rows)


def impact_table(found: Mapping[str, Any], figures: Mapping[str, tuple[str, str]]) -> Table:
    """A walking robot that is hit, with the joint as the baseline has it and as the extension has it.

    Args:
        found: Result of :func:`mrwarp.trials.impact_figures.impact_change`.
        figures: Name in words and unit of each figure.
    """
    rows = []
    for row in found["rows"]:
        for name, (words, unit) in figures.items():
            figure, (factor, unit) = row[name], (100.0, "%") if unit == "1" else (1.0, unit)
            before, after, low, high = (factor * x for x in (figure["before"], figure["after"], *figure["ci95"]))
            cells = (f"{before:.4g} {unit}", f"{after:.4g} {unit}", f"{low:+.2g} to {high:+.2g} {unit}")
            rows.append((f"{row['current']:g} A, {words}", *cells))
    return Table(head=("Impact on the walking robot", "Baseline", "With the extension", "Change, 95 %"), rows=rows)
