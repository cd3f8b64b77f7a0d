"""Results of a suite: confusion matrix, outcomes against what is asked for, coverage, gain, time."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.confusion.experiment import RESULTS
from benchmarks.confusion.families import Plan
from benchmarks.confusion.verdicts import OUTCOMES

_Case = dict[str, Any]


def report(plan: Plan, cases: list[_Case]) -> str:
    """All tables of a suite as text."""
    if not cases:
        return "no cases"
    parts = [matrix(cases), by_kind(cases), "\n".join(acceptance(plan, cases))]
    extra = [
        *_coverage_lines(cases),
        *_gain_lines(cases),
        _ambiguity_line(cases),
        *_resolved_lines(cases),
        _time_line(cases),
    ]
    return "\n\n".join([*parts, "\n".join(line for line in extra if line)])


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


def acceptance(plan: Plan, cases: list[_Case]) -> list[str]:
    """Shares with Clopper-Pearson intervals against what is asked for."""

    def line(label: str, chosen: Iterable[str], *, least: float | None = None, most: float | None = None) -> str:
        return share(label, cases, lambda case: case["outcome"] in chosen, least=least, most=most)

    wrong = ("wrong", "failed")
    if plan.family in ("single", "other"):
        right, either = (0.98, None) if plan.level >= 0.8 else (0.95, None) if plan.level >= 0.4 else (None, 0.85)
        return [
            line("right", ("right",), least=right),
            line("right or ambiguous with the truth", ("right", "ambiguous"), least=either),
            line("missed", ("missed",)),
            line("name right, rest not", ("other",)),
            line("wrong", wrong, most=0.01),
        ]
    if plan.family == "none":
        groups = sorted({(case.get("noise", "realistic"), case.get("size", "large")) for case in cases})
        lines = [line("false alarms", ("wrong", "failed", "other"), most=0.01)]
        for noise, size in groups:
            chosen = [c for c in cases if (c.get("noise", "realistic"), c.get("size", "large")) == (noise, size)]
            lines.append(share(f"false alarms, {noise}, {size}", chosen, lambda c: c["outcome"] != "right", most=0.01))
        for spread in sorted({case.get("base_spread", 0.02) for case in cases}):
            chosen = [c for c in cases if c.get("base_spread", 0.02) == spread]
            lines.append(share(f"false alarms, base ±{spread:.0%}", chosen, lambda c: c["outcome"] != "right"))
        return lines
    if plan.family == "uncatalogued":
        return [
            line("unexplained on the right variable", ("right",), least=0.90),
            line("unexplained on another", ("other",)),
            line("missed", ("missed",)),
            line("named", wrong, most=0.01),
        ]
    if plan.family == "pairs":
        return [
            line("exact", ("right",), least=0.85),
            line("exact or ambiguous with the truth", ("right", "ambiguous"), least=0.95),
            line("names right, rest not", ("other",)),
            line("missed (one of two, or both)", ("missed",)),
            line("wrong", wrong, most=0.02),
        ]
    if plan.family == "background":
        on = [c for c in cases if c["outcome"] == "right"]
        hit = share("  unexplained on the right variable", on, _right_variable) if on else ""
        return [
            line("right name and unexplained", ("right",), least=0.80),
            *([hit] if hit else []),
            line("or ambiguous", ("right", "ambiguous")),
            line("name right, rest not", ("other",)),
            line("missed", ("missed",)),
            line("wrong", wrong, most=0.02),
        ]
    if plan.family in ("foreign", "outside"):
        return _foreign_lines(cases)
    return [
        line("right", ("right",)),
        line("right or ambiguous with the truth", ("right", "ambiguous")),
        line("missed", ("missed",)),
        line("wrong", wrong),
    ]


def _foreign_lines(cases: list[_Case]) -> list[str]:
    """Limits for devices by other laws, by the number of hidden effects, and of their accounts."""
    none, one, more = ([c for c in cases if min(len(c["kinds"]), 2) == n] for n in range(3))
    lines = []
    if none:
        lines.append(share("nothing hidden: named", none, lambda c: c["outcome"] != "right", most=0.02))
    if one:
        lines.append(share("one effect: right", one, lambda c: c["outcome"] == "right", least=0.85))
        lines.append(share("one effect: wrong", one, lambda c: c["outcome"] in ("wrong", "failed"), most=0.02))
    if more:
        hidden = [{"found": any(name in _names(cause) for cause in c["causes"])} for c in more for name in c["kinds"]]
        named = [{"false": not set(_names(cause)) & set(c["kinds"])} for c in more for cause in c["causes"]]
        lines.append(share("two or three: found of the true ones", hidden, lambda x: x["found"], least=0.75))
        lines += [share("two or three: false among the named", named, lambda x: x["false"], most=0.03)] if named else []
    lines.append(share("a fault of the recording reported", cases, lambda c: bool(c.get("faults")), most=0.02))
    with_account = [c for c in cases if c.get("account")]
    if with_account:
        near = [{"near": 1.0 / 1.5 <= not_repeatable_ratio(c) <= 1.5} for c in with_account]
        silent = [c for c in with_account if c["account"]["repeatable"]["share"] > 0.1]
        lines.append(share("not repeatable within 1.5 of the truth", near, lambda x: x["near"], least=0.9))
        if silent:
            lines.append(share("unexplained empty, a tenth repeats", silent, lambda c: not c["unexplained"], most=0.0))
    return lines


def _names(cause: dict[str, Any]) -> list[str]:
    return [cause["name"], *cause["alternatives"]]


def not_repeatable_ratio(case: _Case) -> float:
    """The account's share that does not repeat over the true one: the squared noise of the squared mismatch."""
    return case["account"]["not_repeatable"]["share"] / (case["noise_share"] / case["baseline"]) ** 2


def share(
    label: str,
    cases: list[_Case],
    chosen: Callable[[_Case], bool],
    *,
    least: float | None = None,
    most: float | None = None,
) -> str:
    """One line: count, share, Clopper-Pearson interval, and whether the asked-for share is met."""
    count, total = sum(chosen(case) for case in cases), len(cases)
    ci = binomtest(count, total).proportion_ci(0.95, method="exact")
    text = f"{label:42s} {count:4d}/{total:<4d} {count / total:7.1%}  [{ci.low:.1%}, {ci.high:.1%}]"
    for limit, met, sign in (
        (least, count >= (least or 0.0) * total, "≥"),
        (most, count <= (most or 0.0) * total, "≤"),
    ):
        if limit is not None:
            text += f"  {sign} {limit:.0%}: {'met' if met else 'NOT MET'}"
    return text


def _coverage_lines(cases: list[_Case]) -> list[str]:
    found = [entry for case in cases for entry in case.get("coverage", [])]
    if not found:
        return []
    lines = [share("95 % intervals that cover the truth", found, lambda entry: entry["covered"])]
    for name in dict.fromkeys(entry["name"] for entry in found):
        own = [entry for entry in found if entry["name"] == name]
        ratio = np.median([entry["value"] / entry["truth"] for entry in own])
        lines.append(share(f"  {name}, median {ratio:.3f} of the truth", own, lambda entry: entry["covered"]))
    return lines


def _gain_lines(cases: list[_Case]) -> list[str]:
    """Claimed gains against those on untouched data, and how well untouched sessions agree among themselves."""
    made = [case for case in cases if case.get("untouched_gain") and case.get("gain")]
    if not made:
        return []

    def near(label: str, pairs: list[tuple[float, float]]) -> str:
        return share(label, [{"near": abs(a - b) <= 0.2 * abs(b)} for a, b in pairs], lambda entry: entry["near"])

    pooled = [(c["gain"], c["untouched_gain"]) for c in made]
    again = [(c["gain"], c["repeated_gain"]) for c in made]
    crossed = [(a, b) for c in made for a, b in itertools.permutations(c["session_gains"], 2)]
    inside = [{"in": c["claimed_interval"][0] <= c["untouched_gain"] <= c["claimed_interval"][1]} for c in made]
    claimed, real, repeated = np.mean([[c["gain"], c["untouched_gain"], c["repeated_gain"]] for c in made], axis=0)
    return [
        near("claimed gain within 20 %: same motion again", again),
        near("  of sessions with new motion, together", pooled),
        near("  of one such session", [(c["gain"], x) for c in made for x in c["session_gains"]]),
        near("  (one such session of another)", crossed),
        share("  its 95 % interval holds that of new motion", inside, lambda entry: entry["in"]),
        f"  mean: claimed {claimed:.4f}, same motion again {repeated:.4f}, new motion {real:.4f}",
    ]


def _ambiguity_line(cases: list[_Case]) -> str:
    sets = [
        {"held": bool({cause["name"], *cause["alternatives"]} & set(case["kinds"]))}
        for case in cases
        for cause in [*case.get("causes", []), *case.get("parameter_shift", [])]
        if cause["alternatives"]
    ]
    return share("alternatives that hold the truth", sets, lambda entry: entry["held"], least=0.95) if sets else ""


def _resolved_lines(cases: list[_Case]) -> list[str]:
    """Outcomes of the proposed experiments: all together, and by the causes they were to separate."""
    made = [case for case in cases if "resolved" in case]
    if not made:
        return []
    results = [case["resolved"] for case in made]
    lines = [
        share("resolved by the proposed experiment", results, lambda r: r["result"] == "resolved", least=0.90),
        "  " + ", ".join(f"{n} {name}" for name in RESULTS if (n := sum(r["result"] == name for r in results))),
    ]
    groups: dict[str, list[dict[str, Any]]] = {}
    for case in made:
        rivals = ["|".join([c["name"], *c["alternatives"]]) for c in case["causes"] if c["alternatives"]]
        experiment = case["resolved"].get("kind", "no experiment")
        label = f"  {_truth(case)}, was {', '.join(rivals)}: {experiment}"
        groups.setdefault(label, []).append(case["resolved"])
    for label in sorted(groups):
        lines.append(share(label, groups[label], lambda r: r["result"] == "resolved"))
    return lines


def _time_line(cases: list[_Case]) -> str:
    wall = [case["wall"] for case in cases if "wall" in case]
    if not wall:
        return ""
    making = np.mean([case["making"] for case in cases])
    return f"seconds per diagnosis: median {np.median(wall):.1f}, max {max(wall):.1f}; making a case: mean {making:.2f}"


def _right_variable(case: _Case) -> bool:
    from benchmarks.confusion.effects import EFFECTS

    right = frozenset().union(*(EFFECTS[name].depends_on for name in case["background"]))
    return bool(case.get("unexplained") and right & set(case["unexplained"]["depends_on"][:2]))


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
