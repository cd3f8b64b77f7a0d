"""Numbers and verdicts of the report as text."""

from __future__ import annotations

import math

from mrwarp.paper import PaperValue
from mrwarp.reproduce.experiment import RELATIVE, Comparison

HEAD = ("condition", "quantity", "paper", "ours", "difference", "in joint SD", "kind", "why it differs")
"""Columns of the rows' table."""


def cells(row: Comparison) -> list[str]:
    """One row as text, in the order of :data:`HEAD`."""
    unit = f" [{row.unit}]" if row.unit else ""
    return [
        row.condition,
        row.quantity + unit,
        theirs(row.paper, row.digits),
        ours(row),
        "" if row.relative is None or not math.isfinite(row.relative) else f"{100.0 * row.relative:+.1f} %",
        "" if row.in_sd is None or not math.isfinite(row.in_sd) else f"{row.in_sd:+.1f}",
        "calibrated" if row.calibrated else "predicted",
        row.why if row.differs else "",
    ]


def theirs(value: PaperValue | None, digits: int) -> str:
    """The paper's figure."""
    if value is None:
        return "–"
    spread = "" if value.sd is None else f" ± {value.sd:.{digits}f}"
    return f"{value.mean:.{digits}f}{spread}"


def ours(row: Comparison) -> str:
    """Ours with its spread and what the spread is over."""
    if not math.isfinite(row.ours):
        return "no figure"
    spread = "" if row.sd is None else f" ± {row.sd:.{row.digits}f} (n = {row.n})"
    return f"{row.ours:.{row.digits}f}{spread}"


def agreement(rows: list[Comparison]) -> str:
    """How many rows agree by the measure of :attr:`Comparison.differs`."""
    judged = [row for row in rows if row.paper is not None]
    if not judged:
        return ""
    predicted = [row for row in judged if not row.calibrated]
    near = sum(not row.differs for row in predicted)
    measure = f"within the joint spread, or {100.0 * RELATIVE:.0f} % where the paper states none"
    text = f"{near} of {len(predicted)} predicted rows {measure}"
    fitted = len(judged) - len(predicted)
    return text + (f"; {fitted} rows were used to calibrate" if fitted else "")
