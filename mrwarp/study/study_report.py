"""The studies' tables as plain values for ``result.json`` and as text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from mrwarp.runtime import text_table
from mrwarp.study.paper_tables import LEAST, Row, Table2, Table3

UNITS = {
    "v_x_rmse": "m/s", "v_x_bias": "m/s", "height": "m", "height_rmse": "m", "tilt_rms": "deg",
    "yaw_rate_rmse": "rad/s",
}  # fmt: skip
"""Unit of each metric."""


def plain_row(row: Row) -> dict[str, Any]:
    """Conditions, and every metric with its spread over the seeds, their averages and the single rollouts."""
    metrics = {
        m: {**row.spread(m), "seeds": row.seeds[m].tolist(), "rollouts": row.rollouts[m].tolist()} for m in UNITS
    }
    return {"training": row.plant, "current": row.current, "fell": row.fell, **metrics}


def figures(table: Table2 | Table3) -> dict[str, Any]:
    """Everything a table found."""
    rows = {"rows": {name: plain_row(row) for name, row in table.rows.items()}, "units": UNITS}
    if isinstance(table, Table3):
        return {**rows, "ranking": table.ranking, "pairs": [asdict(pair) for pair in table.pairs]}
    changes = {name: getattr(table, name) for name in ("rmse", "bias")}
    return rows | {name: {sal: asdict(change) for sal, change in found.items()} for name, found in changes.items()}


def row_lines(rows: Mapping[str, Row]) -> list[str]:
    """Metrics of each row, mean ± SD over the seeds."""

    def cell(row: Row, metric: str) -> str:
        found, digits = row.spread(metric), 2 if metric == "tilt_rms" else 4
        return f"{found['mean']:.{digits}f} ± {found['sd']:.{digits}f}"

    shown = [
        (name, row.plant, f"{row.current:g}", *(cell(row, metric) for metric in UNITS),
         f"fell {row.fell}" if row.fell else "")
        for name, row in rows.items()
    ]  # fmt: skip
    return text_table(("", "training", "A", *(f"{m} [{unit}]" for m, unit in UNITS.items()), ""), shown, left=2)


def table2_lines(table: Table2) -> tuple[list[str], bool]:
    """Table 2, and whether actuator-aware training lowers RMSE and bias by :data:`LEAST`."""
    lines, met = row_lines(table.rows), True
    for sal in ("off", "on"):
        rmse, bias = table.rmse[sal], table.bias[sal]
        met = met and rmse.reduction >= LEAST["rmse"] and bias.reduction >= LEAST["bias"]
        lines.append(
            f"SAL {sal}: actuator-aware training lowers v_x RMSE by {rmse.reduction:.1%} (p = {rmse.p:.3f}, Welch over "
            f"seeds; asked for {LEAST['rmse']:.0%}), the absolute bias by {bias.reduction:.1%} (p = {bias.p:.3f}; "
            f"{LEAST['bias']:.0%}; averaged over seeds without sign {bias.by_seed:.1%})"
        )
        lines.append(f"SAL {sal}: {table.limits()[sal]}")
    return lines, met


def table3_lines(table: Table3) -> list[str]:
    """Table 3, and which models differ beyond chance."""
    lines = row_lines(table.rows)
    for metric, order in table.ranking.items():
        pairs = [pair for pair in table.pairs if pair.metric == metric]
        sure = [f"{pair.better} < {pair.worse}" for pair in pairs if pair.p < 0.05]
        none = "not tested" if pairs and all(math.isnan(pair.p) for pair in pairs) else "no pair"
        lines.append(f"{metric}: {' < '.join(order)}; beyond chance (p < 0.05): {', '.join(sure) or none}")
    return lines
