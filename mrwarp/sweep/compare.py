"""The trials of a sweep side by side: figures out of their ``result.json``, a table, a CSV file and a picture.

A row is a trial as the sweep's ``result.json`` has it; its ``figures`` are all numbers of the trial's result by dotted
name, true and false as 1 and 0, and none where it has no result.
"""

from __future__ import annotations

import csv
import json
import math
import statistics
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mrwarp.run_dir import atomic_write, is_not_final, write_result
from mrwarp.runtime import closest, drawing, panels, text_table
from mrwarp.sweep.grid import Trial
from mrwarp.sweep.runners import FINISHED, read_status

SHOWN = {
    "train": ["gate_passed", "gate.v_x_rmse.0.5", "gate.clock_match", "iterations", "seconds"],
    "impact": [
        f"couplings.{coupling}.change.{figure}.percent"
        for coupling in ("constraint", "explicit")
        for figure in ("min_height", "peak_down_velocity")
    ],
}
"""Figures of a command that are shown when none are named."""

MOST = 6
"""Most figures that are shown when none are named."""

NOT_FIGURES = ("schema", "final", "seed", "versions", "command", "task", "current")
"""Parts of a result that are no measurements."""

TrialRow = dict[str, Any]


def report(trials: Sequence[Trial], figures: Sequence[str], out: Path, command: str) -> bool:
    """Print the table and write ``trials.csv``, ``trials.png`` and ``result.json``; whether all have a result."""
    rows, swept = [read_row(trial) for trial in trials], trials[0].args[0]
    names = choose(rows, swept, figures)
    means = summary(rows, names)
    print("\n" + "\n".join(table(rows, means, names)))
    write_csv(rows, out / "trials.csv")
    states = Counter(row["state"] for row in rows)
    write_result(out, {"swept": swept, "states": states, "conditions": means, "trials": rows}, seed=0, command=command)
    if names:
        with drawing("trials.png"):
            plot(rows, means, names, out / "trials.png")
    finished = sum(states[state] for state in FINISHED)
    print(f"\n{finished} of {len(rows)} trials have a result; trials.csv, trials.png and result.json in {out}")
    return finished == len(rows)


def read_row(trial: Trial) -> TrialRow:
    """A trial as its folder has it; a current that the devices limited is named with what flowed."""
    status, figures, name, values = read_status(trial), {}, trial.folder.name, trial.values
    if status.state in FINISHED:
        content = json.loads((trial.folder / "result.json").read_text(encoding="utf-8"))
        figures = dict(_numbers({key: value for key, value in content.items() if key not in NOT_FIGURES}))
        if is_not_final(content):
            name += " (not final)"
        flowed = content.get("current")
        if "current" in values and isinstance(flowed, int | float) and float(values["current"]) != flowed:
            limited = f" ({flowed:g} A flowed)"
            name, values = name + limited, {**values, "current": values["current"] + limited}
    return {"name": name, "values": values, **asdict(status), "figures": figures}


def _numbers(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    if isinstance(value, bool | int | float):
        yield name, float(value)
    elif isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _numbers(item, f"{name}.{key}" if name else str(key))


def condition(row: TrialRow) -> str:
    """The grid's values without the seed, whose values are repetitions."""
    return ", ".join(f"{key}={value}" for key, value in row["values"].items() if key != "seed") or "all"


def choose(rows: Sequence[TrialRow], command: str, wanted: Sequence[str]) -> list[str]:
    """Names of the figures to show: those named, else the command's own, else the first that differ between trials.

    A named figure that is in no result is said and left out.
    """
    known = list(dict.fromkeys(name for row in rows for name in row["figures"]))
    for name in wanted if known else ():
        if name not in known:
            some = f"{closest(name, known)}there are {', '.join(known[:MOST])}, ... (all in trials.csv)"
            print(f"mrwarp sweep: --figure {name}: in no result; {some}", file=sys.stderr)
    if shown := [name for name in wanted or SHOWN.get(command, ()) if name in known]:
        return shown
    differing = [name for name in known if len({row["figures"].get(name) for row in rows if row["figures"]}) > 1]
    return (differing or known)[:MOST]


def summary(rows: Sequence[TrialRow], names: Sequence[str]) -> list[dict[str, Any]]:
    """Mean, standard deviation over the finished trials of a condition, and their number, for each figure."""
    found = []
    for own in dict.fromkeys(condition(row) for row in rows):
        cells = {}
        for name in names:
            values = [row["figures"][name] for row in rows if condition(row) == own and name in row["figures"]]
            mean = statistics.fmean(values) if values else math.nan
            sd = statistics.stdev(values) if len(values) > 1 else math.nan
            cells[name] = {"mean": mean, "sd": sd, "n": len(values)}
        found.append({"condition": own, "figures": cells})
    return found


def table(rows: Sequence[TrialRow], means: Sequence[dict[str, Any]], names: Sequence[str]) -> list[str]:
    """The lines that are printed: one for each trial, then one for each condition with several seeds."""
    cells = []
    for row in rows:
        found = [row["figures"].get(name) for name in names]
        cells.append([row["name"], row["state"], *("-" if value is None else f"{value:.4g}" for value in found)])
    for mean in means:
        found = list(mean["figures"].values())
        if found and found[0]["n"] > 1:
            texts = [f"{cell['mean']:.4g} ± {cell['sd']:.2g}" for cell in found]
            cells.append([mean["condition"], f"n = {found[0]['n']}", *texts])
    return text_table(["trial", "state", *names], cells, left=2)


def write_csv(rows: Sequence[TrialRow], path: Path) -> None:
    """All numbers of all trials, one line for each trial."""
    names = dict.fromkeys(name for row in rows for name in row["figures"])
    columns = ["trial", *rows[0]["values"], "state", "attempts", "wall_seconds", *names]
    with atomic_write(path) as partial, partial.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns, extrasaction="ignore")
        writer.writeheader()
        writer.writerows({"trial": row["name"], **row, **row["values"], **row["figures"]} for row in rows)


def plot(rows: Sequence[TrialRow], means: Sequence[dict[str, Any]], names: Sequence[str], path: Path) -> None:
    """A panel for each figure: every trial a point, every condition's mean a bar."""
    conditions = [mean["condition"] for mean in means]
    size = max(6.0, 0.8 * len(conditions)), 1.5 + 1.8 * len(names)
    figure, axes = panels(size, len(names), 1, sharex=True)
    for panel, name in zip(axes[:, 0], names, strict=True):
        own = [row for row in rows if name in row["figures"]]
        places = [conditions.index(condition(row)) for row in own]
        panel.plot(places, [row["figures"][name] for row in own], "o", color="#1f6fb4", markersize=5, alpha=0.6)
        bars = [mean["figures"][name]["mean"] for mean in means]
        panel.plot(range(len(means)), bars, "_", color="#b4451f", markersize=24, markeredgewidth=2)
        panel.set_title(name, fontsize=9)
    axes[-1, 0].set_xticks(range(len(means)), conditions, fontsize=8, rotation=30, ha="right")
    axes[-1, 0].set_xlim(-0.6, len(means) - 0.4)
    finished = sum(bool(row["figures"]) for row in rows)
    figure.suptitle(f"{finished} of {len(rows)} trials; points are trials, bars are means", fontsize=9)
    figure.savefig(path, dpi=110)
