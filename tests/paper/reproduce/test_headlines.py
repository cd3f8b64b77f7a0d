"""The committed figures come out again: a change that moves the science is seen. Walks are shorter here."""

from pathlib import Path

import pytest

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


@pytest.mark.parametrize("entry", ["fig4", "table2", "table3", "table4", "fig6", "sensitivity", "table5", "fig7"])
def test_quick_entries(entry: str, tmp_path: Path) -> None:
    """At the report's own sizes."""
    assert moved((entry,), Settings(), tmp_path) == []


def test_walks_and_mission(tmp_path: Path) -> None:
    """A third of the distance, one rollout of each policy."""
    settings = Settings(distance=10.0, window=5.0, rollouts=1)
    assert moved(("table6", "table7", "fig10", "fig11"), settings, tmp_path) == []
