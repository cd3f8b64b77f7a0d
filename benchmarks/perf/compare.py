"""Did it get slower? Ratios of this run against those of an earlier one; seconds are never compared.

A ratio is a cost in units of something measured in the same run, so it hardly depends on the machine. It has regressed
when it is larger than before by more than the tolerance, which is the spread of both runs.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mrwarp.options.json_file import read_json_file

LEAST_TOLERANCE = 0.10
"""Tolerance that every ratio has [1]: between runs on one machine they differ by a few per cent more than within."""


class CompareError(ValueError):
    """A file to compare with cannot be used; the message names the file and the remedy."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One ratio, then and now."""

    name: str
    """Which ratio, with the number of robots."""
    before: float
    """Its median in the file."""
    now: float
    """Its median in this run."""
    tolerance: float
    """How much larger it may be [1]: the quartiles' distance of both runs, relative, and at least 10 %."""

    @property
    def regressed(self) -> bool:
        """Whether the cost grew by more than the tolerance."""
        return self.now > self.before * (1.0 + self.tolerance)


def load_ratios(path: Path) -> dict[str, dict[str, float]]:
    """The ratios of a result that ``mrwarp perf`` wrote.

    Raises:
        CompareError: the file cannot be read, or is no such result.
    """
    remedy = "give a result.json of 'mrwarp perf', or benchmarks/perf_cpu.json"
    try:
        content = read_json_file(path, remedy)
    except ValueError as error:
        raise CompareError(str(error)) from None
    ratios = content.get("ratios") if isinstance(content, dict) else None
    if not isinstance(ratios, dict) or not ratios:
        raise CompareError(f"{path}: has no 'ratios'; {remedy}")
    for name, row in ratios.items():
        values = [row.get(key) for key in ("median", "low", "high")] if isinstance(row, dict) else [None]
        if not all(isinstance(v, int | float) and not isinstance(v, bool) and v > 0.0 for v in values):
            raise CompareError(f"{path}: ratio {name!r} needs positive median, low and high; {remedy}")
    return ratios


def compare(before: dict[str, Any], now: dict[str, Any]) -> list[Row]:
    """Ratios that both runs have, in the order of this one."""
    rows = []
    for name, row in now.items():
        if name in before:
            spread = [(r["high"] - r["low"]) / r["median"] for r in (before[name], row)]
            tolerance = max(LEAST_TOLERANCE, sum(s * s for s in spread) ** 0.5)
            rows.append(Row(name=name, before=before[name]["median"], now=row["median"], tolerance=tolerance))
    return rows
