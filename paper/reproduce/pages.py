"""Fills the figures of README and docs from committed results, so that no stated figure has a second source.

A page marks a block by ``<!-- figures: NAME -->`` and ``<!-- /figures -->`` on lines of their own; what stands between
is written here. The results are those of a whole report, without its pictures and reasons.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import mrwarp
from mrwarp.options.json_file import read_json_file
from mrwarp.run_dir import SCHEMA, plain, write_text
from paper.reproduce import paper_checks
from paper.reproduce.comparison import BRAKE
from paper.reproduce.contents import TITLES, Mark
from paper.reproduce.registry import judge_all
from paper.reproduce.verdicts import BY_EFFECT, MOST_SEEDS, Figure, Judged, Results, Verdict, by_effect

ROOT = Path(mrwarp.__file__).parents[1]
"""The checkout."""

RESULTS = Path("docs/results/paper.json")
"""The committed figures, in the checkout."""

BLOCK = re.compile(r"(<!-- figures: (\w+) -->\n)(.*?)(<!-- /figures -->)", re.DOTALL)

KEPT = ("condition", "quantity", "unit", "paper", "ours", "sd", "n", "seeds", "calibrated", "digits")
"""Stored keys of a row."""


SAID = ("claims", "claim_ids", "reasons", "tables")
"""Further stored keys of an entry."""


def collect(folders: tuple[Path, ...], root: Path = ROOT) -> Path:
    """Write the entries of some runs into the committed results; entries that no folder has stay as they are.

    A folder of ``mrwarp study table2`` or ``causes`` is an entry, named by :func:`study_name`.

    Raises:
        ValueError: a folder has no ``result.json`` of these commands, or one of its entries was not made.
    """
    before = read(root) if (root / RESULTS).is_file() else {}
    parts: dict[str, Any] = before.get("parts", {})
    whole = before.get("whole")
    for folder in folders:
        found = read_json_file(folder / "result.json", "name the --out of 'mrwarp reproduce all'")
        if isinstance(found, dict) and "evaluation" in found:
            origin = _origin(found)
            kept = {key: _short(_spreads(found[key])) for key in ("rows", "rmse", "bias", "policies") if key in found}
            parts[study_name(found)] = {**origin, "rows": [], "claims": {}, "tables": [], "study": kept}
            continue
        if not isinstance(found, dict) or not isinstance(found.get("parts"), dict):
            raise ValueError(f"{folder / 'result.json'}: is no result of 'mrwarp reproduce'; name the --out of one")
        origin = _origin(found)
        if set(TITLES) <= set(found["parts"]):
            spent = {name: sum(part[name] for part in found["parts"].values()) for name in ("seconds", "processor")}
            whole = {**origin, **_short(spent)}
        for name, part in found["parts"].items():
            if "rows" not in part:
                raise ValueError(f"{folder}: {name} was not made ({part.get('message')}); make it first")
            if name in TITLES or name == "fig4_strengths":  # no figure of the paper, but a page shows it
                rows = [{key: _short(row[key]) for key in KEPT} for row in part["rows"]]
                parts[name] = {**origin, "rows": rows, **{key: part[key] for key in SAID if key in part}}
    content = {"schema": SCHEMA, "whole": whole, "parts": parts}
    return write_text(root / RESULTS, json.dumps(plain(content), indent=1, ensure_ascii=False) + "\n")


def _origin(found: Mapping[str, Any]) -> dict[str, Any]:
    """Day, command and versions; without the folder, which is the user's, and the threads, which change no figure."""
    command = re.sub(r" --(out|threads) \S+", "", str(found.get("command")))
    return {"made": datetime.now(UTC).date().isoformat(), "command": command, "versions": found.get("versions")}


def study_name(found: Mapping[str, Any]) -> str:
    """Name of an evaluation of a study's policies: its kind, their folder and the ground, if it is not flat."""
    kind = str(found["command"]).split("study ")[-1].split()[0]
    words = ["study", kind, Path(found["evaluation"]["folder"]).name, found["evaluation"]["terrain"]]
    return " ".join(word for word in words if word != "flat")


def _spreads(value: Any) -> Any:
    """Figures without those of single seeds and rollouts."""
    if isinstance(value, dict):
        return {name: _spreads(item) for name, item in value.items() if name not in ("seeds", "rollouts", "interval")}
    return value


def _short(value: Any) -> Any:
    """Numbers to six digits: a run on another machine need not differ in what nobody states."""
    if isinstance(value, dict):
        return {name: _short(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_short(item) for item in value]
    return float(f"{value:.6g}") if isinstance(value, float) and math.isfinite(value) else value


def read(root: Path = ROOT) -> dict[str, Any]:
    """The committed results.

    Raises:
        ValueError: they are not there or damaged.
    """
    found = read_json_file(root / RESULTS, "run 'mrwarp reproduce docs --results DIR'")
    if not isinstance(found, dict) or not isinstance(found.get("parts"), dict):
        raise ValueError(f"{root / RESULTS}: is no file of results; run 'mrwarp reproduce docs --results DIR'")
    return found


def pages(root: Path = ROOT) -> list[Path]:
    """README and every page of the documentation."""
    return [root / "README.md", *sorted((root / "docs").glob("*.md"))]


def filled(text: str, content: Mapping[str, Any], where: str) -> str:
    """A page with its blocks written again.

    Raises:
        ValueError: a block has no such name; ``where`` names the page.
    """
    found = Results(content["parts"])
    found.whole = content.get("whole")

    def block(match: re.Match[str]) -> str:
        name = match[2]
        if name not in BLOCKS:
            raise ValueError(f"{where}: no figures are called {name!r}; choose from {', '.join(BLOCKS)}")
        return f"{match[1]}{BLOCKS[name](found).rstrip()}\n{match[4]}"

    return BLOCK.sub(block, text)


def fill(root: Path = ROOT, *, check: bool = False) -> list[Path]:
    """Write the blocks of all pages again, or only ``check`` them; returns the pages that differed."""
    content, differing = read(root), []
    for path in pages(root):
        text = path.read_text(encoding="utf-8")
        written = filled(text, content, str(path.relative_to(root)))
        if written != text:
            differing.append(path)
            if not check:
                write_text(path, written)
    return differing


def _table(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)


def _number(value: float, digits: int) -> str:
    if not math.isfinite(value):
        return "none"
    text = f"{value:.{digits}f}".replace("-", "−")
    return text.lstrip("−") if not float(text.replace("−", "-")) else text


def _cells(figures: list[Figure]) -> list[str]:
    """The paper's figures, ours, and the spreads of both."""

    def many(values: list[float | None]) -> str:
        return ", ".join("–" if v is None else _number(v, f.digits) for v, f in zip(values, figures, strict=True))

    theirs, ours = [f.paper_sd for f in figures], [f.sd for f in figures]
    spread = f"{many(ours)} (paper {many(theirs)})" if any(theirs) else many(ours) if any(ours) else ""
    return [many([f.paper for f in figures]), many([f.ours for f in figures]), spread]


CLAIM_HEAD = ("where", "claim", "paper", "ours", "SD of ours", "effect", "kind", "verdict", "")
"""Columns of the table of claims."""


def claim_row(judged: Judged) -> list[str]:
    """A claim with its figures, in the order of :data:`CLAIM_HEAD`."""
    cells = _cells(list(judged.figures)) if judged.figures else ["", "", ""]
    calibrated = judged.verdict is Verdict.CALIBRATED
    kind = "" if judged.claim.excluded else judged.mark.value
    verdict = "" if calibrated else judged.verdict.value
    if judged.needed is not None:
        more = "more than " if judged.needed >= MOST_SEEDS else ""
        verdict += f": {more}{judged.needed} seeds would decide"
    about = "" if judged.claim.excluded else judged.claim.about
    return [judged.claim.place, judged.claim.says, *cells, about, kind, verdict, judged.why]


def _claims(found: Results) -> str:
    """All claims as one table."""
    return _table(list(CLAIM_HEAD), [claim_row(judged) for judged in judge_all(found)])


def _tally(found: Results) -> tuple[list[Judged], int, int, dict[Mark, dict[Verdict, int]]]:
    judged = judge_all(found)
    fitted, excluded = (sum(j.verdict is v for j in judged) for v in (Verdict.CALIBRATED, Verdict.EXCLUDED))
    return judged, fitted, excluded, by_effect(judged)


def counts(found: Results) -> dict[str, str]:
    """How claims fare, a sentence each: all of them, the effects with a choice in view, those that were predicted."""
    judged, fitted, excluded, effects = _tally(found)

    def many(mark: Mark) -> str:
        return ", ".join(f"{n} {verdict.value}" for verdict, n in effects[mark].items() if n) or "none"

    return {
        "all": (
            f"Of the paper's {len(judged)} claims {fitted} {'is' if fitted == 1 else 'are'} calibrated and {excluded} "
            "contradict each other within the paper. The others are about "
            f"{sum(sum(n.values()) for n in effects.values())} physical effects, each of which counts once, by "
            "its worst claim."
        ),
        "in view": f"Of {sum(effects[Mark.IN_VIEW].values())} tuned in view: {many(Mark.IN_VIEW)}.",
        "predicted": f"Of {sum(effects[Mark.PREDICTED].values())} predicted: {many(Mark.PREDICTED)}.",
    }


def _verdicts(found: Results) -> str:
    """How claims fare, and the three largest differences of those that are not calibrated."""
    judged = [judged for judged in judge_all(found) if judged.mark is not Mark.CALIBRATED]
    largest = []
    by_place = {j.claim.place: j for j in sorted(judged, key=lambda j: j.largest)}  # of each place the largest
    for j in sorted(by_place.values(), key=lambda j: -j.largest)[:3]:
        worst = max((f for f in j.figures if not f.calibrated), key=lambda f: abs(f.relative))
        ours, theirs = (_number(value, worst.digits) for value in (worst.ours, worst.paper))
        largest.append(f"{j.claim.place}, {j.claim.says}: {ours} where the paper has {theirs}")
    said = counts(found)
    first = f"{said['all']} {said['in view']} The three largest differences: {'; '.join(largest)}."
    return f"{first}<br>\n{said['predicted']}"


def _readme(found: Results) -> str:
    """Three sentences on how the claims fare, and where each of them stands."""
    judged, fitted, excluded, by_mark = _tally(found)
    total = {verdict: sum(by_mark[mark][verdict] for mark in by_mark) for verdict in BY_EFFECT}
    predicted = sum(by_mark[Mark.PREDICTED].values())
    return (
        f"Of the paper's {len(judged)} claims {fitted} {'was' if fitted == 1 else 'were'} used to fit numbers, and "
        f"{excluded} contradict each other within the paper. The others are about {sum(total.values())} physical "
        f"effects: {total[Verdict.REPRODUCED]} reproduced, {total[Verdict.DIRECTION]} with the paper's sign but "
        f"not its size, {total[Verdict.UNRESOLVED]} not resolved by our seeds, {total[Verdict.NOT]} not reproduced. "
        f"{predicted or 'None'} of them {'was' if predicted < 2 else 'were'} predicted: settings were tuned while "
        "looking at the figures ([every claim and the reason of each difference](docs/reproduce.md))."
    )


def _checks(_: Results) -> str:
    """The paper's figures against each other."""
    return "\n\n".join(f"**{check.title}** {check.arithmetic}" for check in paper_checks.all_checks())


def _part_table(part: str, name: str) -> Callable[[Results], str]:
    """A table of an entry, as it printed it."""

    def block(found: Results) -> str:
        if part not in found.parts:
            return f"*Not among the committed figures; `mrwarp reproduce {part}` makes it.*"
        table = found.table(part, name)
        return f"{table['title']}:\n\n" + _table(list(table["head"]), [list(row) for row in table["rows"]])

    return block


def _rows_table(part: str) -> Callable[[Results], str]:
    """All rows of an entry: conditions down, quantities across; ours, with a brake that sticks, and the paper's."""

    def block(found: Results) -> str:
        rows = [row for row in found.parts[part]["rows"] if row["paper"] is not None]
        quantities = list(dict.fromkeys(row["quantity"] for row in rows))
        units = {row["quantity"]: row["unit"] for row in rows}
        brake = any(row["condition"].endswith(BRAKE) for row in rows)
        cells: dict[str, dict[str, list[str]]] = {}
        for row in rows:
            n = min(row["digits"], 3)
            ours, theirs = (
                _number(mean, n) + ("" if sd is None else f" ± {_number(sd, n)}")
                for mean, sd in ((row["ours"], row["sd"]), (row["paper"]["mean"], row["paper"]["sd"]))
            )
            if row["condition"].endswith(BRAKE):
                cells[row["condition"].removesuffix(BRAKE)][row["quantity"]][1] = ours
                continue
            star = "\\*" if row["calibrated"] else ""
            cells.setdefault(row["condition"], {})[row["quantity"]] = [ours + star, "", theirs]
        titles = {q: f"{q}{f' [{units[q]}]' if units[q] else ''}" for q in quantities}
        shown = (0, 1, 2) if brake else (0, 2)
        head = ["", *((titles[q], "with the brake", "paper")[k] for q in quantities for k in shown)]
        lines = [
            [condition, *(found_cells.get(q, ["", "", ""])[k] for q in quantities for k in shown)]
            for condition, found_cells in cells.items()
        ]
        return _table(head, lines)

    return block


def _studies(begins: str, *names: tuple[str, str]) -> Callable[[Results], str]:
    """Table 2 by policies of several folders, each with how it is called: what training changes, and the p-values."""

    def block(found: Results) -> str:
        lines = []
        for title, name in names:
            if name not in found.parts:
                return f"*Not among the committed figures: {name}.*"
            study = found.parts[name]["study"]
            for metric, key, text in (("v_x_rmse", "rmse", "RMSE"), ("v_x_bias", "bias", "bias")):
                cells = [f"{title}: {text} [m/s]"]
                for sal, pair in (("off", "AC"), ("on", "BD")):
                    change = study[key][sal]
                    cells += [_number(study["rows"][each][metric]["mean"], 3) for each in pair]
                    p = change["p"]
                    cells += [f"{_number(100.0 * change['reduction'], 0)} %", "< 0.001" if p < 0.001 else f"{p:.2g}"]
                fell = ", ".join(str(study["rows"][each]["fell"]) for each in "ABCD")
                lines.append([*cells, fell if key == "rmse" else ""])
        head = [begins, "A", "C", "lower, SAL off", "p", "B", "D", "lower, SAL on", "p", "fell: A, B, C, D"]
        return _table(head, lines)

    return block


QUALITY = {
    "tilt_rms": ("roll-pitch RMS [deg]", 2),
    "roll": ("mean roll [deg]", 2),
    "pitch": ("mean pitch [deg]", 2),
    "sides": ("left against right [%]", 1),
    "slip": ("slip [m/s]", 3),
    "v_x_rmse": ("v_x RMSE [m/s]", 3),
}
"""Figures of the table of rules, with their titles and digits."""


RATED = {"study": "explicit torque", "study_brake": "brake", "energy": "price on power"}
"""Folders of the policies in that table, and what they are called there."""


def _quality(found: Results) -> str:
    """Largest figures of each plant's policies, and what breaks a rule."""
    lines = []
    for folder, title in RATED.items():
        if (name := f"study quality {folder}") not in found.parts:
            return f"*Not among the committed figures: {name}.*"
        policies = found.parts[name]["study"]["policies"]
        for plant in dict.fromkeys(row["plant"] for row in policies):
            rows = [row for row in policies if row["plant"] == plant]
            worst = [_number(max(abs(row[figure]) for row in rows), digits) for figure, (_, digits) in QUALITY.items()]
            faults = [f"seed {row['seed']}: {', '.join(row['broken'])}" for row in rows if row["broken"]]
            kept = sum(not row["broken"] for row in rows)
            lines.append([f"{plant}, {title}", *worst, f"{kept} of {len(rows)}", "; ".join(faults)])
    return _table(["plant", *(title for title, _ in QUALITY.values()), "keep all rules", "broken"], lines)


CAUSES = (
    "Go1",
    "MR_Go's masses, no devices",
    "and the devices' drag at 0 A",
    "and damping at 1.5 A",
    "and holding alone at 1.5 A",
    "and both",
)
"""Steps of ``paper_tables.STEPS``, as the table calls them."""


def _causes(found: Results) -> str:
    """The bias of either training on one plant after another."""
    if "study causes study" not in found.parts:
        return "*Not among the committed figures: study causes.*"
    rows = found.parts["study causes study"]["study"]["rows"]
    cells = [
        [_spread(row[step]["v_x_bias"]) for row in rows.values()] for step in next(iter(rows.values()))
    ]  # by step, both trainings
    head = ["v_x bias [m/s] on", *rows]
    return _table(head, [[name, *line] for name, line in zip(CAUSES, cells, strict=True)])


def _spread(value: Mapping[str, float]) -> str:
    return f"{_number(value['mean'], 3)} ± {_number(value['sd'], 3)}"


def _whole(found: Results) -> str:
    """Time of the whole report."""
    if found.whole is None:
        return "*Not measured yet; `mrwarp reproduce all` does.*"
    minutes = found.whole["processor"] / 60.0
    return (
        f"Measured on {found.whole['made']}: all entries from nothing took {minutes:.0f} minutes of one core together, "
        f"{minutes / 2.0:.0f} on each of two if both are busy throughout."
    )


def _strengths(found: Results) -> str:
    """Figure 4 with the bench's effects halved and doubled, and between them the shipped networks of figure 4."""
    if "fig4_strengths" not in found.parts:
        return "*Not among the committed figures; `mrwarp reproduce fig4 --train` makes it.*"
    table = found.parts["fig4_strengths"]["tables"][0]
    average = {
        name: sum(found.row("fig4", f"{name}, {amps} A", "RMSE").ours for amps in ("1", "1.2", "1.5")) / 3.0
        for name in ("MLP", "Bouc-Wen", "LSTM", "PG-RLSTM")
    }
    below = [100.0 * (1.0 - average["PG-RLSTM"] / average[name]) for name in ("Bouc-Wen", "LSTM", "MLP")]
    cells = [*(f"{value:.3f}" for value in average.values()), *(f"{value:.0f}" for value in below)]
    theirs, *rows = [list(row) for row in table["rows"] if row[0] != "times 1"]
    rows.append(["times 1", *cells, "yes" if found.holds("fig4", "pg_rlstm_lowest") else "no"])
    rows = [theirs, *sorted(rows, key=lambda row: float(row[0].split()[-1]))]
    return _table(list(table["head"]), rows)


HOSTS = Path("docs/results/hosts.json")
"""Committed figures of ``python -m benchmarks.hosts``."""


def _hosts(_: Results) -> str:
    """Largest difference of each host from JointBatch, by laws and effects."""
    content = read_json_file(ROOT / HOSTS, "run 'python -m benchmarks.hosts'")
    hosts: dict[str, float] = content["bounds"]
    rows = []
    for row, found in content["rows"].items():
        cells = ["–" if name not in found else f"{found[name]:.0e}" if found[name] else "0" for name in hosts]
        rows.append([f"{row} ({content['cases'][row]})", *cells])
    rows.append(["**bound**", *(f"{bound:.0e}" for bound in hosts.values())])
    return _table(["device (motions)", *hosts], rows)


BLOCKS: dict[str, Callable[[Results], str]] = {
    "hosts": _hosts,
    "whole": _whole,
    "claims": _claims,
    "readme": _readme,
    "verdicts": _verdicts,
    "paper_checks": _checks,
    "table2": _rows_table("table2"),
    "table2_policies": _studies(
        "policies",
        ("`policies/study_brake`", "study table2 study_brake"),
        ("`policies/study_randomised`", "study table2 study_randomised"),
    ),
    "table2_rough": _studies(
        "policies on rough ground",
        ("`policies/study_randomised`", "study table2 study_randomised rough"),
        ("`policies/study_rough`", "study table2 study_rough rough"),
    ),
    "table2_unseen": _studies("policies", ("new seeds", "study table2 unseen")),
    "causes": _causes,
    "quality": _quality,
    "fig4_strengths": _strengths,
    "table3": _rows_table("table3"),
    "table4": _rows_table("table4"),
    "table4_zero": _part_table("table4", "zero"),
    "table4_readings": _part_table("table4", "readings"),
    "table4_knees": _part_table("table4", "knees"),
    "table4_falls": _part_table("table4", "falls"),
    "table4_bound": _part_table("table4", "bound"),
    "table6_training": _part_table("table6", "training"),
    "table6_closed": _part_table("table6", "closed_form"),
    "table6_electrical": _part_table("electrical", "both_branches"),
    "predictions": _part_table("predictions", "frozen"),
    "support": _part_table("support", "choices"),
    "table6": _rows_table("table6"),
    "fig10": _rows_table("fig10"),
    "fig11": _rows_table("fig11"),
}
"""Blocks that a page may ask for, by name."""
