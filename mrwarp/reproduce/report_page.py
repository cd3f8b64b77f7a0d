"""The report: one offline HTML page and one Markdown file from the outcomes of a run."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from mrwarp.reproduce import formatting as words
from mrwarp.reproduce.experiment import Experiment, Findings
from mrwarp.reproduce.runner import Outcome
from mrwarp.run_dir import versions, write_text

STATUS = {
    "made": "",
    "kept": "",
    "waiting": "not made yet",
    "failed": "failed",
    "not run": "not run",
}
"""What the report says of an entry without findings."""

INTRODUCTION = (
    "Each row has the paper's figure (mean ± SD), ours (mean ± sample SD), the difference relative to the paper's and "
    "in units of the joint spread, the root of the two variances' sum (positive: ours is further from 0). A row "
    "differs if it is off by more than one joint spread, or by more than 5 % where the paper states no spread. "
    "'Calibrated' rows were used to fit a number of our model; all others are predictions."
)
"""How to read the tables."""


def write(
    outcomes: Mapping[str, Outcome], catalogue: Mapping[str, Experiment], out: Path, command: str
) -> tuple[Path, Path]:
    """Write ``report.html`` and ``report.md`` of the shown experiments, each in one piece.

    Args:
        outcomes: How each experiment ended.
        catalogue: Their descriptions.
        out: Folder of the run; pictures lie in each experiment's folder below it.
        command: Command line that made it.
    """
    entries = [
        _entry(outcome, catalogue[name], out / name) for name, outcome in outcomes.items() if catalogue[name].shown
    ]
    page = {"entries": entries, "head": words.HEAD, "introduction": INTRODUCTION, "command": command,
            "versions": ", ".join(f"{name} {version}" for name, version in versions().items())}  # fmt: skip
    environment = Environment(
        loader=PackageLoader("mrwarp.reproduce", "."), autoescape=True, undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True,
    )  # fmt: skip
    html = environment.get_template("report.html.jinja").render(**page)
    return write_text(out / "report.html", html), write_text(out / "report.md", markdown(page, out))


def markdown(page: dict[str, Any], out: Path) -> str:
    """The page as Markdown; pictures are linked relative to the folder."""
    lines = ["# The paper's experiments, ours beside theirs", "", _text(page["introduction"]), ""]
    lines += [f"Made by {_text(page['command'])} with {_text(page['versions'])}.", ""]
    for entry in page["entries"]:
        lines += [f"## {_text(entry['title'])}", ""]
        if entry["message"]:
            lines += [_text(entry["message"]), ""]
            continue
        lines += [f"{_text(entry['agreement'])}.", ""] if entry["agreement"] else []
        lines += [f"* {'holds' if holds else '**does not hold**'}: {_text(claim)}" for claim, holds in entry["claims"]]
        lines += [""] if entry["claims"] else []
        lines += _table(page["head"], entry["rows"]) if entry["rows"] else []
        for note in entry["notes"]:
            lines += [_text(note), ""]
        for title, head, rows in entry["tables"]:
            lines += [f"**{_text(title)}**", "", *_table(head, rows)]
        for picture in entry["pictures"]:
            lines += [f"![{_text(picture['caption'])}]({entry['name']}/{picture['file']})", ""]
    return "\n".join(lines).rstrip() + "\n"


def _entry(outcome: Outcome, experiment: Experiment, folder: Path) -> dict[str, Any]:
    found = outcome.findings or Findings()
    status = STATUS[outcome.status]
    rows = list(found.rows)
    return {
        "name": experiment.name, "title": experiment.title, "seconds": f"{outcome.seconds:.0f} s",
        "message": f"{status}: {outcome.message}".removesuffix(": ") if outcome.findings is None else "",
        "agreement": words.agreement(rows), "claims": list(found.claims.items()),
        "rows": [words.cells(row) for row in rows], "notes": list(found.notes),
        "tables": [(table.title, table.head, table.rows) for table in found.tables],
        "pictures": [
            {"file": file, "caption": caption, "data": base64.b64encode((folder / file).read_bytes()).decode()}
            for file, caption in found.pictures.items() if (folder / file).is_file()
        ],
    }  # fmt: skip


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [
        "| " + " | ".join(_text(cell) for cell in head) + " |",
        "|" + "---|" * len(head),
        *("| " + " | ".join(_text(cell) for cell in row) + " |" for row in rows),
        "",
    ]


def _text(text: str) -> str:
    """Text that Markdown shows as it is: on one line, without markup and without HTML."""
    text = " ".join(str(text).split()).replace("\\", "\\\\").replace("&", "&amp;").replace("<", "&lt;")
    for mark in "|`*[]#":
        text = text.replace(mark, "\\" + mark)
    return text.replace("_", "\\_") if "__" in text or text.startswith("_") else text
