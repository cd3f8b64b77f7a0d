"""The report: one offline HTML page and one Markdown file from the outcomes of a run, and a row of it as text."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from mrwarp.run_dir import versions, write_text
from mrwarp.runtime import text_table
from paper.reproduce import pages, verdicts
from paper.reproduce.cache import Outcome
from paper.reproduce.comparison import Comparison, Findings
from paper.reproduce.contents import TITLES
from paper.reproduce.registry import CLAIMS

HEAD = ("condition", "quantity", "paper", "ours", "difference", "in standard errors", "kind", "why it differs")
"""Columns of the rows' table."""

STATUS = {"made": "", "kept": "", "waiting": "not made yet", "failed": "failed", "not run": "not run"}
"""The report's text on an entry without findings."""

INTRODUCTION = (
    "Each row has the paper's figure (mean ± SD), ours (mean ± sample SD), and the difference. It is relative to the "
    "paper's and in units of the standard error of both (positive: ours is further from 0). A row differs if the "
    f"difference leaves its {100.0 * verdicts.LEVEL:.0f} % interval; a figure that the paper states without a spread "
    f"counts as known to {100.0 * verdicts.STATED:.0f} %. 'Calibrated' rows were used to fit a number of our model. "
    "All others were made with the paper's rows in view (docs/choices.md)."
)
"""How to read the tables."""


def write(outcomes: Mapping[str, Outcome], out: Path, command: str) -> tuple[Path, Path]:
    """Write ``report.html`` and ``report.md`` of the entries, each in an atomic write.

    Pictures lie in each experiment's folder below ``out``.
    """
    page = {
        "entries": [
            *_verdicts(outcomes),
            *(_entry(outcome, out / name) for name, outcome in outcomes.items() if name in TITLES),
        ],
        "head": HEAD,
        "introduction": INTRODUCTION,
        "command": command,
        "versions": ", ".join(f"{name} {version}" for name, version in versions().items()),
    }
    loader, written = PackageLoader("paper.reproduce", "."), []
    for kind in ("html", "md"):
        environment = Environment(
            loader=loader, autoescape=kind == "html", undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
        )
        environment.filters["md"] = _text
        text = environment.get_template(f"report.{kind}.jinja").render(**page)
        written.append(write_text(out / f"report.{kind}", text.rstrip() + "\n"))
    return written[0], written[1]


def lines(outcome: Outcome) -> list[str]:
    """The rows of one part as text, without their reasons."""
    seconds = f" ({outcome.seconds:.0f} s)" if outcome.seconds else ""
    found = ["", f"{TITLES[outcome.name]}: {outcome.status}{seconds}"]
    if outcome.findings is None:
        return [*found, f"  {outcome.message}".rstrip()]
    rows = [cells(row)[:-1] for row in outcome.findings.rows]
    if rows:
        found += [f"  {row}" for row in text_table(HEAD[:-1], rows, left=len(rows[0]))]
    return found + [f"  {'holds ' if holds else 'MISSED'}  {text}" for text, holds in outcome.findings.claims.items()]


def cells(row: Comparison) -> list[str]:
    """One row as text, in the order of :data:`HEAD`."""
    figure = row.figure
    off = (math.nan, math.nan) if figure is None else (100.0 * figure.relative, figure.in_errors)
    theirs = "–" if row.paper is None else _spread(row.paper.mean, row.paper.sd, row.digits)
    ours = _spread(row.ours, row.sd, row.digits) + ("" if row.sd is None else f" (n = {row.n})")
    return [
        row.condition,
        row.quantity + (f" [{row.unit}]" if row.unit else ""),
        theirs,
        ours if math.isfinite(row.ours) else "no figure",
        f"{off[0]:+.1f} %" if math.isfinite(off[0]) else "",
        f"{off[1]:+.1f}" if math.isfinite(off[1]) else "",
        "calibrated" if row.calibrated else "",
        row.why if row.differs else "",
    ]


def _spread(mean: float, sd: float | None, digits: int) -> str:
    return f"{mean:.{digits}f}" + ("" if sd is None else f" ± {sd:.{digits}f}")


def agreement(rows: Sequence[Comparison]) -> str:
    """How many rows agree by the measure of :attr:`Comparison.differs`."""
    judged = [row for row in rows if row.paper is not None]
    if not judged:
        return ""
    near = [not row.differs for row in judged if not row.calibrated]
    fitted = len(judged) - len(near)
    calibrated = f"; {fitted} more were used to calibrate" if fitted else ""
    return f"{sum(near)} of {len(near)} rows do not differ beyond their interval{calibrated}"


def _entry(outcome: Outcome, folder: Path) -> dict[str, Any]:
    """Data of one entry for the templates."""
    found = outcome.findings or Findings()
    message = f"{STATUS[outcome.status]}: {outcome.message}".removesuffix(": ")
    return {
        "name": outcome.name,
        "title": TITLES[outcome.name],
        "message": message if outcome.findings is None else "",
        "agreement": agreement(found.rows),
        "claims": list(found.claims.items()),
        "rows": [cells(row) for row in found.rows],
        "notes": found.notes,
        "tables": [(table.title, table.head, table.rows) for table in found.tables],
        "pictures": [
            {"file": file, "caption": caption, "data": base64.b64encode((folder / file).read_bytes()).decode()}
            for file, caption in found.pictures.items()
            if (folder / file).is_file()
        ],
    }


def _verdicts(outcomes: Mapping[str, Outcome]) -> list[dict[str, Any]]:
    """The claims of what was made, as a first entry; none where no claim has all its rows."""
    found = verdicts.Results({name: asdict(o.findings) for name, o in outcomes.items() if o.findings is not None})
    rows = []
    for claim in CLAIMS:
        if claim.entry in found.parts:
            try:
                rows.append(pages.claim_row(verdicts.judge(claim, found)))
            except KeyError:  # a row that this run has not, as where no robot arrived
                continue
    entry = {"name": "claims", "title": "Every claim of the paper that was made", "message": "", "agreement": ""}
    table = ("Claims and verdicts, see docs/reproduce.md", pages.CLAIM_HEAD, rows)
    return [{**entry, "claims": [], "rows": [], "notes": [], "tables": [table], "pictures": []}] if rows else []


def _text(text: str) -> str:
    """Text that Markdown shows as it is: on one line, without markup and without HTML."""
    text = " ".join(str(text).split()).replace("\\", "\\\\").replace("&", "&amp;").replace("<", "&lt;")
    for mark in "|`*[]#":
        text = text.replace(mark, "\\" + mark)
    return text.replace("_", "\\_") if "__" in text or text.startswith("_") else text
