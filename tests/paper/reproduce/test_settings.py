"""Entries on the studies' policies: what they depend on, and sentences of figure 4."""

import pytest

from paper.reproduce import fig4, settings
from paper.reproduce.registry import CATALOGUE
from paper.reproduce.settings import NotYet


@pytest.mark.parametrize("name", ["table2", "table3", "fig4"])
def test_entries_depend_on_the_network_they_run(name: str) -> None:
    """Another PG-RLSTM must make them again: it walks in tables 2 and 3."""
    assert "pg_rlstm.safetensors" in {path.name for path in CATALOGUE[name].files()}


def test_networks_are_those_that_learn(monkeypatch: pytest.MonkeyPatch) -> None:
    """A law has none; a network that is not there is named."""
    assert [path.name for path in settings.networks(("bouc_wen", "lstm"))] == ["lstm.safetensors"]
    monkeypatch.setattr(settings, "shipped_model", lambda kind: None)
    with pytest.raises(NotYet, match="no trained network for lstm"):
        settings.networks(("bouc_wen", "lstm"))


def test_figure4_compares_the_bench_with_the_device() -> None:
    """By what either leaves to its own Bouc-Wen model."""
    assert "are milder here" in fig4.why(1.5, 0.777, 0.3)
    assert "are no milder here" in fig4.why(1.5, 0.777, 0.9)
