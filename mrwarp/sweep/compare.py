"""The trials of a sweep side by side: figures out of their ``result.json``, a table, a CSV file and a picture."""

from __future__ import annotations

import csv
import json
import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from mrwarp.run_dir import atomic_write
from mrwarp.sweep.grid import Trial
from mrwarp.sweep.trial import FINISHED, State, Status

SHOWN: dict[str, tuple[str, ...]] = {
    "train": (
        "gate_passed", "gate.v_x_rmse.0.5", "gate.clock_match", "iterations", "seconds", "training.steps_per_second"
    ),
    "impact": (
        "couplings.constraint.change.min_height.percent", "couplings.constraint.change.peak_down_velocity.percent",
        "couplings.explicit.change.min_height.percent", "couplings.explicit.change.peak_down_velocity.percent",
    ),
}  # fmt: skip
"""Figures of a command that are shown when none are named."""

MOST = 6
"""Most figures in table and picture."""

NOT_FIGURES = ("schema", "seed", "versions", "command", "task")
"""Parts of a result that are no measurements."""

REPEATED = "seed"
"""Option whose values are repetitions of one condition."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One trial with what it measured."""

    trial: Trial
    status: Status
    figures: dict[str, float]
    """All numbers of the result by dotted name; true and false are 1 and 0."""


def read_figures(folder: Path) -> dict[str, float]:
    """All numbers in a trial's ``result.json`` by dotted name; none where it cannot be read."""
    try:
        content = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(content, dict):
        return {}
    found: dict[str, float] = {}

    def walk(value: Any, name: str) -> None:
        if isinstance(value, bool | int | float):
            found[name] = float(value)
        elif isinstance(value, dict | list):
            for key, item in value.items() if isinstance(value, dict) else enumerate(value):
                walk(item, f"{name}.{key}" if name else str(key))

    walk({key: value for key, value in content.items() if key not in NOT_FIGURES}, "")
    return found


def choose(rows: Sequence[Row], command: str, wanted: Sequence[str]) -> list[str]:
    """Names of the figures to show: those named, else the command's own, else the first that differ between trials.

    Raises:
        ValueError: a named figure is in no result.
    """
    known = list(dict.fromkeys(name for row in rows for name in row.figures))
    if wanted:
        for name in wanted:
            if known and name not in known:
                near = [other for other in known if name.split(".")[-1] in other][:MOST] or known[:MOST]
                raise ValueError(f"--figure {name}: in no result; there are {', '.join(near)}, ... (all in trials.csv)")
        return list(wanted)
    if own := [name for name in SHOWN.get(command, ()) if name in known]:
        return own
    swept = {option.replace("-", "_") for row in rows for option in row.trial.values}
    known = [name for name in known if name not in swept]
    differing = [name for name in known if len({row.figures.get(name) for row in rows if row.figures}) > 1]
    return (differing or known)[:MOST]


def conditions(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Finished trials by condition: the grid's values without the seed."""
    found: dict[str, list[Row]] = {}
    for row in rows:
        name = ", ".join(f"{key}={value}" for key, value in row.trial.values.items() if key != REPEATED) or "all"
        found.setdefault(name, [])
        if row.status.state in FINISHED:
            found[name].append(row)
    return found


def summary(rows: Sequence[Row], names: Sequence[str]) -> list[dict[str, Any]]:
    """Mean, standard deviation over the trials of a condition, and their number, for each figure."""
    table = []
    for condition, members in conditions(rows).items():
        cells = {}
        for name in names:
            values = [row.figures[name] for row in members if math.isfinite(row.figures.get(name, math.nan))]
            cells[name] = {
                "mean": statistics.fmean(values) if values else math.nan,
                "sd": statistics.stdev(values) if len(values) > 1 else math.nan,
                "n": len(values),
            }
        table.append({"condition": condition, "figures": cells})
    return table


def lines(rows: Sequence[Row], names: Sequence[str]) -> list[str]:
    """The table that is printed: a line for each trial, then one for each condition with several seeds."""
    short = _short(names)
    head = ["trial", "state", *short]
    body = [
        [row.trial.name, row.status.state.value, *(_number(row.figures.get(name)) for name in names)] for row in rows
    ]
    repeated = [entry for entry in summary(rows, names) if any(cell["n"] > 1 for cell in entry["figures"].values())]
    for entry in repeated:
        cells = [f"{_number(c['mean'])} ± {_number(c['sd'])}" if c["n"] > 1 else _number(c["mean"])
                 for c in entry["figures"].values()]  # fmt: skip
        body.append([entry["condition"], f"n = {max(c['n'] for c in entry['figures'].values())}", *cells])
    width = [max(len(row[k]) for row in [head, *body]) for k in range(len(head))]
    text = []
    for row in [head, *body]:
        left = [cell.ljust(w) for cell, w in zip(row[:2], width[:2], strict=True)]
        right = [cell.rjust(w) for cell, w in zip(row[2:], width[2:], strict=True)]
        text.append("  ".join([*left, *right]).rstrip())
    if repeated:
        text.insert(1 + len(rows), "-" * max(map(len, text)))
    return text


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """All numbers of all trials, one line for each trial."""
    options = list(dict.fromkeys(key for row in rows for key in row.trial.values))
    names = list(dict.fromkeys(name for row in rows for name in row.figures))
    with atomic_write(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(["trial", *options, "state", "attempts", "wall_seconds", *names])
        for row in rows:
            status = row.status
            fixed = [status.state.value, status.attempts, f"{status.seconds:.3f}"]
            values = [row.figures.get(name, "") for name in names]
            writer.writerow([row.trial.name, *(row.trial.values.get(key, "") for key in options), *fixed, *values])


def plot(rows: Sequence[Row], names: Sequence[str], path: Path) -> None:
    """A panel for each figure: every trial a point, every condition's mean a bar; trials without a result are named."""
    groups = conditions(rows)
    names = names[:MOST]
    columns = min(len(names), 3) or 1
    height = 1.0 + 2.6 * max(math.ceil(len(names) / columns), 1)
    figure = Figure(
        figsize=(4.2 * columns + 0.6, height + 0.12 * max(map(len, groups), default=0)), layout="constrained"
    )
    axes = figure.subplots(max(math.ceil(len(names) / columns), 1), columns, squeeze=False).flatten()
    for axis, name, label in zip(axes, names, _short(names), strict=False):
        for k, members in enumerate(groups.values()):
            values = [row.figures[name] for row in members if name in row.figures]
            spread = [k + 0.12 * (i - (len(values) - 1) / 2) / max(len(values) - 1, 1) for i in range(len(values))]
            axis.plot(spread, values, "o", color="#1f6fb4", markersize=5, alpha=0.8)
            if values:
                axis.hlines(statistics.fmean(values), k - 0.25, k + 0.25, color="#b4451f", linewidth=2)
        axis.set_title(label, fontsize=9)
        turned = {"rotation": 30, "ha": "right"} if max(map(len, groups)) > 8 else {}
        axis.set_xticks(range(len(groups)), list(groups), fontsize=8, **turned)
        axis.set_xlim(-0.6, len(groups) - 0.4)
        axis.grid(alpha=0.3)
    for axis in axes[len(names) :]:
        axis.set_visible(False)
    lost = [row.trial.name for row in rows if row.status.state not in FINISHED]
    count = f"{len(rows) - len(lost)} of {len(rows)} trials; points are trials, bars are means"
    figure.suptitle(count + (f"\nwithout a result: {', '.join(lost[:4])}{' ...' * (len(lost) > 4)}" if lost else ""),
                    fontsize=9)  # fmt: skip
    figure.savefig(path, dpi=110)


def _number(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e6 else f"{value:.4g}"


def _short(names: Sequence[str]) -> list[str]:
    """Last parts of dotted names, as many as tell them apart."""
    parts = 1
    while True:
        found = [".".join(name.split(".")[-parts:]) for name in names]
        if len(set(found)) == len(names) or parts > 10:
            # a number alone says nothing
            return [".".join(name.split(".")[-2 - parts :]) if text.replace(".", "").isdigit() else text
                    for name, text in zip(names, found, strict=True)]  # fmt: skip
        parts += 1


def as_result(row: Row) -> dict[str, Any]:
    """A trial for ``result.json``."""
    status = row.status
    entry: dict[str, Any] = {
        "name": row.trial.name,
        "values": row.trial.values,
        "state": status.state.value,
        "attempts": status.attempts,
        "wall_seconds": status.seconds,
        "figures": row.figures,
    }
    if status.state is State.FAILED:
        entry |= {"why": status.why, "last_lines": status.lines}
    return entry
