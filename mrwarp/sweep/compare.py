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
from mrwarp.sweep.trial import FINISHED, State, Status, read_status

SHOWN: dict[str, tuple[str, ...]] = {
    "train": (
        *("gate_passed", "gate.v_x_rmse.0.5", "gate.clock_match"),
        *("iterations", "seconds", "training.steps_per_second"),
    ),
    "impact": tuple(
        f"couplings.{coupling}.change.{figure}.percent"
        for coupling in ("constraint", "explicit")
        for figure in ("min_height", "peak_down_velocity")
    ),
}
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

    @property
    def condition(self) -> str:
        """The grid's values without the seed."""
        return ", ".join(f"{key}={value}" for key, value in self.trial.values.items() if key != REPEATED) or "all"

    def as_result(self) -> dict[str, Any]:
        """The trial's entry in the sweep's ``result.json``."""
        status = self.status
        entry = {"name": self.trial.name, "values": self.trial.values, "state": status.state.value}
        entry |= {"attempts": status.attempts, "wall_seconds": status.seconds, "figures": self.figures}
        return entry | ({"why": status.why, "last_lines": status.lines} if status.state is State.FAILED else {})


def read_row(trial: Trial, folder: Path) -> Row:
    """A trial as its folder has it; figures only where it ended with a result."""
    status = read_status(folder)
    return Row(trial=trial, status=status, figures=read_figures(folder) if status.state in FINISHED else {})


def read_figures(folder: Path) -> dict[str, float]:
    """All numbers in a trial's ``result.json`` by dotted name; none where it cannot be read."""
    found: dict[str, float] = {}

    def walk(value: Any, name: str) -> None:
        if isinstance(value, bool | int | float):
            found[name] = float(value)
        elif isinstance(value, dict | list):
            for key, item in value.items() if isinstance(value, dict) else enumerate(value):
                walk(item, f"{name}.{key}" if name else str(key))

    try:
        content = json.loads((folder / "result.json").read_text(encoding="utf-8"))
        walk({key: value for key, value in content.items() if key not in NOT_FIGURES}, "")
    except (OSError, ValueError, AttributeError):
        return {}
    return found


def choose(rows: Sequence[Row], command: str, wanted: Sequence[str]) -> list[str]:
    """Names of the figures to show: those named, else the command's own, else the first that differ between trials.

    Raises:
        ValueError: a named figure is in no result.
    """
    known = list(dict.fromkeys(name for row in rows for name in row.figures))
    for name in wanted if known else ():
        if name not in known:
            near = [other for other in known if name.split(".")[-1] in other][:MOST] or known[:MOST]
            raise ValueError(f"--figure {name}: in no result; there are {', '.join(near)}, ... (all in trials.csv)")
    if wanted:
        return list(wanted)
    if own := [name for name in SHOWN.get(command, ()) if name in known]:
        return own
    swept = {option.replace("-", "_") for row in rows for option in row.trial.values}
    known = [name for name in known if name not in swept]
    differing = [name for name in known if len({row.figures.get(name) for row in rows if row.figures}) > 1]
    return (differing or known)[:MOST]


def summary(rows: Sequence[Row], names: Sequence[str]) -> list[dict[str, Any]]:
    """Mean, standard deviation over the finished trials of a condition, and their number, for each figure."""
    table = []
    for condition, members in _conditions(rows).items():
        cells = {}
        for name in names:
            values = [row.figures[name] for row in members if math.isfinite(row.figures.get(name, math.nan))]
            mean = statistics.fmean(values) if values else math.nan
            sd = statistics.stdev(values) if len(values) > 1 else math.nan
            cells[name] = {"mean": mean, "sd": sd, "n": len(values)}
        table.append({"condition": condition, "figures": cells})
    return table


def lines(rows: Sequence[Row], names: Sequence[str]) -> list[str]:
    """The table that is printed: a line for each trial, then one for each condition with several seeds."""
    trials = [[r.trial.name, r.status.state.value, *(_number(r.figures.get(name)) for name in names)] for r in rows]
    means = []
    for entry in summary(rows, names):
        cells = list(entry["figures"].values())
        if (most := max((cell["n"] for cell in cells), default=0)) > 1:
            texts = [_number(cell["mean"]) + (f" ± {_number(cell['sd'])}" if cell["n"] > 1 else "") for cell in cells]
            means.append([entry["condition"], f"n = {most}", *texts])
    table = [["trial", "state", *_short(names)], *trials, *means]
    width = [max(map(len, column)) for column in zip(*table, strict=True)]
    text = [
        "  ".join(f"{cell:{'<' if k < 2 else '>'}{w}}" for k, (cell, w) in enumerate(zip(row, width, strict=True)))
        for row in table
    ]
    if means:
        text.insert(1 + len(rows), "-" * max(map(len, text)))
    return [line.rstrip() for line in text]


def write_csv(rows: Sequence[Row], path: Path) -> None:
    """All numbers of all trials, one line for each trial."""
    options = dict.fromkeys(key for row in rows for key in row.trial.values)
    names = dict.fromkeys(name for row in rows for name in row.figures)
    with atomic_write(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, ["trial", *options, "state", "attempts", "wall_seconds", *names])
        writer.writeheader()
        for row in rows:
            status = row.status
            fixed = {"state": status.state.value, "attempts": status.attempts, "wall_seconds": f"{status.seconds:.3f}"}
            writer.writerow({"trial": row.trial.name, **row.trial.values, **fixed, **row.figures})


def plot(rows: Sequence[Row], names: Sequence[str], path: Path) -> None:
    """A panel for each figure: every trial a point, every condition's mean a bar; trials without a result are named."""
    groups, names = _conditions(rows), names[:MOST]
    longest = max(map(len, groups))
    columns = min(len(names), 3)
    panel_rows = math.ceil(len(names) / columns)
    size = (4.2 * columns + 0.6, 1.0 + 2.6 * panel_rows + 0.12 * longest)
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(panel_rows, columns, squeeze=False).flatten()
    turned = {"rotation": 30, "ha": "right"} if longest > 8 else {}
    for axis, name, label in zip(axes, names, _short(names), strict=False):
        for k, members in enumerate(groups.values()):
            values = [row.figures[name] for row in members if name in row.figures]
            spread = [k + 0.12 * (i - (len(values) - 1) / 2) / max(len(values) - 1, 1) for i in range(len(values))]
            axis.plot(spread, values, "o", color="#1f6fb4", markersize=5, alpha=0.8)
            if values:
                axis.hlines(statistics.fmean(values), k - 0.25, k + 0.25, color="#b4451f", linewidth=2)
        axis.set_title(label, fontsize=9)
        axis.set_xticks(range(len(groups)), list(groups), fontsize=8, **turned)
        axis.set_xlim(-0.6, len(groups) - 0.4)
        axis.grid(alpha=0.3)
    for axis in axes[len(names) :]:
        axis.set_visible(False)
    lost = [row.trial.name for row in rows if row.status.state not in FINISHED]
    title = f"{len(rows) - len(lost)} of {len(rows)} trials; points are trials, bars are means"
    title += f"\nwithout a result: {', '.join(lost[:4])}{' ...' * (len(lost) > 4)}" if lost else ""
    figure.suptitle(title, fontsize=9)
    figure.savefig(path, dpi=110)


def _conditions(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Finished trials by condition."""
    return {
        condition: [row for row in rows if row.condition == condition and row.status.state in FINISHED]
        for condition in dict.fromkeys(row.condition for row in rows)
    }


def _number(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return "-"
    return f"{value:.0f}" if value == round(value) and abs(value) < 1e6 else f"{value:.4g}"


def _short(names: Sequence[str]) -> list[str]:
    """Last parts of dotted names, as many as tell them apart; of a name that ends in a number two parts more."""
    for parts in range(1, 10):
        shorter = [".".join(name.split(".")[-parts:]) for name in names]
        if len(set(shorter)) == len(names):
            return [
                ".".join(name.split(".")[-2 - parts :]) if text.replace(".", "").isdigit() else text
                for name, text in zip(names, shorter, strict=True)
            ]
    return list(names)
