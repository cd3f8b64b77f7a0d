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
from paper.reproduce import age, paper_checks
from paper.reproduce.comparison import BRAKE
from paper.reproduce.contents import TITLES
from paper.reproduce.registry import judge_all
from paper.reproduce.verdicts import MOST_SEEDS, Figure, Judged, Results, Verdict, by_effect

ROOT = Path(mrwarp.__file__).parents[1]
"""The checkout."""

RESULTS = Path("docs/results/paper.json")
"""The committed figures, in the checkout."""

BLOCK = re.compile(r"(<!-- figures: (\w+) -->\n)(.*?)(<!-- /figures -->)", re.DOTALL)

KEPT = (
    *(
        "condition",
        "quantity",
        "unit",
        "paper",
        "ours",
        "sd",
        "n",
        "seeds",
        "error",
        "error_free",
        "calibrated",
        "digits",
    ),
)
"""Stored keys of a row."""


SAID = ("made", "rests_on", "claims", "claim_ids", "reasons", "tables")
"""Further stored keys of an entry."""


def collect(folders: tuple[Path, ...], root: Path = ROOT) -> Path:
    """Write the entries of some runs into the committed results; entries that no folder has stay as they are.

    Raises:
        ValueError: a folder has no ``result.json`` of these commands, or one of its entries was not made.
    """
    before = read(root) if (root / RESULTS).is_file() else {}
    parts: dict[str, Any] = {name: part for name, part in before.get("parts", {}).items() if name in TITLES}
    whole = before.get("whole")
    for folder in folders:
        found = read_json_file(folder / "result.json", "name the --out of 'mrwarp reproduce all'")
        if not isinstance(found, dict) or not isinstance(found.get("parts"), dict):
            raise ValueError(f"{folder / 'result.json'}: is no result of 'mrwarp reproduce'; name the --out of one")
        # without the folder, which is the user's, and the threads, which change no figure
        command = re.sub(r" --(out|threads) \S+", "", str(found.get("command")))
        origin = {"command": command, "versions": found.get("versions")}
        if set(TITLES) <= set(found["parts"]):
            spent = {name: sum(part[name] for part in found["parts"].values()) for name in ("seconds", "processor")}
            whole = {**origin, "made": datetime.now(UTC).date().isoformat(), **_short(spent)}
        for name, part in found["parts"].items():
            if "rows" not in part:
                raise ValueError(f"{folder}: {name} was not made ({part.get('message')}); make it first")
            if name in TITLES:
                rows = [{key: _short(row[key]) for key in KEPT} for row in part["rows"]]
                parts[name] = {**origin, "rows": rows, **{key: part[key] for key in SAID if key in part}}
    content = {"schema": SCHEMA, "whole": whole, "parts": parts}
    return write_text(root / RESULTS, json.dumps(plain(content), indent=1, ensure_ascii=False) + "\n")


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


def filled(text: str, content: Mapping[str, Any], where: str, today: Mapping[str, str] | None = None) -> str:
    """A page with its blocks written again, and below each when, by what code, and whether that has changed since.

    Args:
        text: The page.
        content: The committed results.
        where: Names the page.
        today: Hashes of :func:`paper.reproduce.age.hashes`; None computes them.

    Raises:
        ValueError: a block has no such name.
    """
    found = Results(content["parts"])
    found.whole = content.get("whole")
    old = age.stale(found.parts, today)

    def block(match: re.Match[str]) -> str:
        name = match[2]
        if name not in BLOCKS:
            raise ValueError(f"{where}: no figures are called {name!r}; choose from {', '.join(BLOCKS)}")
        entries = ENTRIES.get(name, ())
        note = f"\n\n{age.note(found.parts, entries, old)}" if entries else ""
        return f"{match[1]}{BLOCKS[name](found).rstrip()}{note}\n{match[4]}"

    return BLOCK.sub(block, text)


def fill(root: Path = ROOT, *, check: bool = False, today: Mapping[str, str] | None = None) -> list[Path]:
    """Write the blocks of all pages again, or only ``check`` them; returns the pages that differed."""
    content, differing = read(root), []
    today = age.hashes() if today is None else today
    for path in pages(root):
        text = path.read_text(encoding="utf-8")
        written = filled(text, content, str(path.relative_to(root)), today)
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


FIRST_SENTENCE = re.compile(r"(?<!\beq)(?<!\bEq)\. (?=[A-Z])")
"""Where the first sentence of a reason ends; the report has all of it."""

CLAIM_HEAD = ("where", "claim", "paper", "ours", "SD of ours", "effect", "verdict", "")
"""Columns of the table of claims."""


def claim_row(judged: Judged) -> list[str]:
    """A claim with its figures, in the order of :data:`CLAIM_HEAD`."""
    cells = _cells(list(judged.figures)) if judged.figures else ["", "", ""]
    verdict = judged.verdict.value
    if judged.needed is not None:
        more = "more than " if judged.needed >= MOST_SEEDS else ""
        verdict += f": {more}{judged.needed} seeds would decide"
    about = "" if judged.claim.excluded else judged.claim.about
    return [judged.claim.place, judged.claim.says, *cells, about, verdict, judged.why]


def _claims(found: Results) -> str:
    """All claims as one table: a reason by its first sentence, without the paper's spread and the names of effects.

    Claims that exclude each other are left out: the paper's figures against each other have a block of their own.
    """
    rows = []
    for judged in judge_all(found):
        if judged.claim.excluded:
            continue
        *figures, spread, _, verdict, why = claim_row(judged)
        rows.append([*figures, spread.partition(" (paper")[0], verdict, FIRST_SENTENCE.split(why)[0].rstrip(".")])
    return _table([name for name in CLAIM_HEAD if name != "effect"], rows)


def counts(found: Results) -> tuple[str, str]:
    """How claims fare, a sentence each: all of them, and the physical effects that they are about."""
    judged = judge_all(found)
    fitted, excluded = (sum(j.verdict is v for j in judged) for v in (Verdict.CALIBRATED, Verdict.EXCLUDED))
    effects = by_effect(judged)
    many = "; ".join(f"{n} {verdict.value}" for verdict, n in effects.items())
    return (
        f"Of the paper's {len(judged)} claims {fitted} {'was' if fitted == 1 else 'were'} used to fit numbers, and "
        f"{excluded} contradict each other within the paper.",
        f"The others are about {sum(effects.values())} physical effects, each of which counts once, by its worst "
        f"claim: {many}.",
    )


def _verdicts(found: Results) -> str:
    """How claims fare."""
    return " ".join(counts(found))


def _readme(found: Results) -> str:
    """One sentence on how the claims fare, and where each of them stands."""
    effects = by_effect(judge_all(found))
    signs = [Verdict.REPRODUCED, Verdict.WORDS, Verdict.SIGN, Verdict.DIRECTION]
    agree, sized = sum(effects[verdict] for verdict in signs), effects[Verdict.REPRODUCED]
    return (
        f"Of about {sum(effects.values())} effects in the paper ours has the sign or outcome of {agree} and the size "
        f"of {sized or 'none'}, with settings tuned in view of its figures ([claims](docs/reproduce.md))."
    )


def _checks(_: Results) -> str:
    """The paper's figures against each other."""
    return "\n\n".join(f"**{check.title}** {check.arithmetic}" for check in paper_checks.all_checks())


def _part_table(part: str, name: str, without: tuple[str, ...] = ()) -> Callable[[Results], str]:
    """A table of an entry, as it printed it, ``without`` the lines that begin with these words."""

    def block(found: Results) -> str:
        try:
            table = found.table(part, name)
        except KeyError:
            return f"*Not among the committed figures; `mrwarp reproduce {part}` makes it.*"
        rows = [list(row) for row in table["rows"] if not row[0].startswith(without)]
        return f"{table['title']}:\n\n" + _table(list(table["head"]), rows)

    return block


def _rows_table(part: str) -> Callable[[Results], str]:
    """All rows of an entry: conditions down, quantities across; ours with the paper's, or with a brake that sticks.

    Ours with its SD over seeds, and the standard error by fitted numbers where there are some. Where there is a brake
    the paper's figures stand with the claims alone.
    """

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
            star = "\\*" if row["calibrated"] else f" ± {_number(row['error'], n)}" if row.get("error") else ""
            cells.setdefault(row["condition"], {})[row["quantity"]] = [ours + star, "", theirs]
        titles = {q: f"{q}{f' [{units[q]}]' if units[q] else ''}" for q in quantities}
        shown = (0, 1) if brake else (0, 2)
        head = ["", *((titles[q], "with the brake", "paper")[k] for q in quantities for k in shown)]
        lines = [
            [condition, *(found_cells.get(q, ["", "", ""])[k] for q in quantities for k in shown)]
            for condition, found_cells in cells.items()
        ]
        return _table(head, lines)

    return block


def _whole(found: Results) -> str:
    """Time of the whole report."""
    if found.whole is None:
        return "*Not measured yet; `mrwarp reproduce all` does.*"
    minutes = found.whole["processor"] / 60.0
    return (
        f"Measured on {found.whole['made']}: all entries from nothing took {minutes:.0f} minutes of one core together, "
        f"{minutes / 2.0:.0f} on each of two if both are busy throughout."
    )


TABLES: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "table4_falls": ("table4", "falls", ()),
    "table6_training": ("table6", "training", ()),
    "support": (
        "support",
        "choices",
        ("eps_hold 0.15", "eps_hold 0.25", "Kp_low 2.5", "Kp_low 10", "fixed support current, 1 A"),
    ),
}
"""Entry and identifier of the tables that a page may ask for, by their blocks' names, and lines that it leaves out."""

ROWS = ("table2",)
"""Entries whose rows a page may ask for."""

HOSTS = Path("docs/results/hosts.json")
"""Committed figures of ``python -m benchmarks.hosts``."""


def _hosts(_: Results) -> str:
    """Largest difference of each host from JointBatch over all devices, and where it is."""
    content = read_json_file(ROOT / HOSTS, "run 'python -m benchmarks.hosts'")
    lines = []
    for host, bound in content["bounds"].items():
        found = {row: hosts[host] for row, hosts in content["rows"].items() if host in hosts}
        worst = max(found, key=lambda row: found[row])
        largest = f"{found[worst]:.0e} ({worst})" if found[worst] else "0"
        lines.append([host, largest, f"{bound:.0e}"])
    return _table(["host", f"largest difference in {sum(content['cases'].values())} motions", "bound"], lines)


BLOCKS: dict[str, Callable[[Results], str]] = {
    "hosts": _hosts,
    "whole": _whole,
    "claims": _claims,
    "readme": _readme,
    "verdicts": _verdicts,
    "paper_checks": _checks,
    **{name: _part_table(*table) for name, table in TABLES.items()},
    **{name: _rows_table(name) for name in ROWS},
}
"""Blocks that a page may ask for, by name."""

ENTRIES = {
    **{name: (part,) for name, (part, *_) in TABLES.items()},
    **{name: (name,) for name in ROWS},
    **dict.fromkeys(("claims", "readme", "verdicts"), tuple(TITLES)),
}
"""Entries whose figures a block shows; the others are arithmetic, or have their own record."""
