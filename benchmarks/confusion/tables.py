"""Results of a suite: confusion matrix, shares of outcomes, coverage, time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.confusion.verdicts import OUTCOMES

_Case = dict[str, Any]


def report(cases: list[_Case]) -> str:
    """All tables of a suite as text."""
    if not cases:
        return "no cases"
    shares = [share(outcome, cases, lambda case, outcome=outcome: case["outcome"] == outcome) for outcome in OUTCOMES]
    lines = [*shares, *_coverage_lines(cases), _ambiguity_line(cases), _time_line(cases)]
    return "\n\n".join([matrix(cases), by_kind(cases), "\n".join(line for line in lines if line)])


def matrix(cases: list[_Case]) -> str:
    """Counts of truth (rows) against what was named (columns, numbered like the rows)."""
    rows = list(dict.fromkeys(_truth(case) for case in sorted(cases, key=lambda c: c["index"])))
    cells = Counter((_truth(case), _found(case)) for case in cases)
    columns = [*rows, *sorted({found for _, found in cells} - set(rows))]
    used = [c for c in columns if c in rows or any(cells[row, c] for row in rows)]
    width = max(len(name) for name in used) + 1
    lines = ["truth (rows) against what was named (columns)"]
    lines.append(" " * (width + 4) + "".join(f"{k + 1:4d}" for k in range(len(used))))
    for k, name in enumerate(used):
        counts = "".join(f"{cells[name, c] or '.':>4}" for c in used) if name in rows else "    (no truth)"
        lines.append(f"{k + 1:3d} {name:{width}s}{counts}")
    return "\n".join(lines)


def by_kind(cases: list[_Case]) -> str:
    """Outcomes of each kind of truth."""
    rows = list(dict.fromkeys(_truth(case) for case in sorted(cases, key=lambda c: c["index"])))
    counts = Counter((_truth(case), case["outcome"]) for case in cases)
    width = max(len(row) for row in [*rows, "all"])
    lines = [f"{'':{width}s}" + "".join(f"{outcome:>10s}" for outcome in OUTCOMES)]
    lines += [f"{row:{width}s}" + "".join(f"{counts[row, o]:10d}" for o in OUTCOMES) for row in rows]
    total = Counter(case["outcome"] for case in cases)
    return "\n".join([*lines, f"{'all':{width}s}" + "".join(f"{total[o]:10d}" for o in OUTCOMES)])


def share(label: str, cases: list[_Case], chosen: Callable[[_Case], bool]) -> str:
    """One line: count, share, Clopper-Pearson interval."""
    count, total = sum(chosen(case) for case in cases), len(cases)
    ci = binomtest(count, total).proportion_ci(0.95, method="exact")
    return f"{label:42s} {count:4d}/{total:<4d} {count / total:7.1%}  [{ci.low:.1%}, {ci.high:.1%}]"


def _coverage_lines(cases: list[_Case]) -> list[str]:
    found = [entry for case in cases for entry in case.get("coverage", [])]
    if not found:
        return []
    lines = [share("95 % intervals that cover the truth", found, lambda entry: entry["covered"])]
    for name in dict.fromkeys(entry["name"] for entry in found):
        own = [entry for entry in found if entry["name"] == name]
        ratio = np.mean([entry["value"] / entry["truth"] for entry in own])
        lines.append(share(f"  {name}, mean {ratio:.3f} of the truth", own, lambda entry: entry["covered"]))
    return lines


def _ambiguity_line(cases: list[_Case]) -> str:
    sets = [
        {"held": bool({cause["name"], *cause["alternatives"]} & set(case["kinds"]))}
        for case in cases
        for cause in [*case.get("causes", []), *case.get("parameter_shift", [])]
        if cause["alternatives"]
    ]
    return share("alternatives that hold the truth", sets, lambda entry: entry["held"]) if sets else ""


def _time_line(cases: list[_Case]) -> str:
    wall = [case["wall"] for case in cases if "wall" in case]
    if not wall:
        return ""
    making = np.mean([case["making"] for case in cases])
    return f"seconds per diagnosis: median {np.median(wall):.1f}, max {max(wall):.1f}; making a case: mean {making:.2f}"


def _truth(case: _Case) -> str:
    return "+".join(case["kinds"]) or ("+".join(case["background"]) or "none")


def _found(case: _Case) -> str:
    if case["outcome"] == "failed":
        return "(failed)"
    names = sorted(cause["name"] for cause in [*case["causes"], *case["parameter_shift"]])
    order = sorted(case["kinds"])
    if names:
        return "+".join(case["kinds"]) if names == order else "+".join(names)
    return {None: "(no verdict)", "none": "none"}.get(case["verdict"], f"({case['verdict']})")
