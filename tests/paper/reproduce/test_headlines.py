"""The committed figures come out again: a change that moves the science is seen. Walks are shorter here."""

import json
from pathlib import Path

import pytest

from mrwarp.cli import main
from paper.reproduce import pages
from paper.reproduce.cache import Runner
from paper.reproduce.registry import CATALOGUE
from paper.reproduce.settings import Settings

pytestmark = pytest.mark.slow

NEAR = 0.1
"""Relative difference that is allowed where the committed figure has a smaller spread."""


def moved(entries: tuple[str, ...], settings: Settings, out: Path) -> list[str]:
    """Rows that lie beyond their committed spread, with both figures; entries that failed."""
    runner = Runner(catalogue=CATALOGUE, settings=settings, out=out)
    runner.run(entries)
    committed, found = pages.read()["parts"], []
    for name in entries:
        outcome = runner.outcomes[name]
        if outcome.findings is None:
            found.append(f"{name}: {outcome.message}")
            continue
        ours = {(row.condition, row.quantity): row.ours for row in outcome.findings.rows}
        for row in committed[name]["rows"]:
            now, was = ours.get((row["condition"], row["quantity"])), row["ours"]
            if now is None or abs(now - was) > max(row["sd"] or 0.0, NEAR * abs(was)):
                found.append(f"{name}: {row['condition']}, {row['quantity']}: {now}, committed {was}")
    return found


@pytest.mark.parametrize("entries", ["fig4", "table2", "table3", "table4 fig6 sensitivity", "table5 fig7"])
def test_quick_entries(entries: str, tmp_path: Path) -> None:
    """At the report's own sizes; those that read the same simulation are made together."""
    assert moved(tuple(entries.split()), Settings(), tmp_path) == []


def test_walks_and_mission(tmp_path: Path) -> None:
    """Two metres of thirty and of ten, one rollout of each policy: rows, pictures, report; again, all of it is kept."""
    settings, entries = Settings(distance=2.0, window=2.0, rollouts=1), ("table6", "table7", "fig10", "fig11")
    sizes = ("--distance", "2", "--window", "2", "--rollouts", "1")
    for status in ("made", "kept"):
        assert main(["reproduce", *entries, "fig8", "fig9", "--out", str(tmp_path), *sizes]) == 0
        result = json.loads((tmp_path / "result.json").read_text())
        assert {part["status"] for part in result["parts"].values()} == {status}
    assert [row["calibrated"] for row in result["parts"]["table6"]["rows"]] == [True] * 4 + [False] * 16
    assert (tmp_path / "fig8" / "torques.png").stat().st_size > 10_000
    assert "data:image/png;base64" in (tmp_path / "report.html").read_text()
    assert moved(entries, settings, tmp_path) == []
