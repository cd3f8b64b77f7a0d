"""Pages are filled from the committed results, and a page that differs is seen."""

import json
import re
from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.kernels import gate
from mrwarp.run_dir import plain
from paper.reproduce import age, cache, pages
from paper.reproduce.contents import TITLES

ROW = {"condition": "a", "quantity": "x", "unit": "m", "paper": {"mean": 1.0, "sd": None}, "ours": 0.123456789}
PART = {
    "rows": [
        {
            **ROW,
            "sd": 0.5,
            "n": 3,
            "seeds": [1 / 3],
            "calibrated": True,
            "digits": 2,
            "why": "because",
            "error": 0.0,
            "error_free": 0,
        }
    ],
    "claims": {"it holds": True},
    "claim_ids": {"it": "it holds"},
    "reasons": {"drop/height": "because"},
    "tables": [],
    "made": "2026-11-29",
    "rests_on": "0123456789abcdef",
}


def test_committed_pages_are_those_of_the_committed_results() -> None:
    """The check of ``make lint``."""
    assert pages.fill(check=True) == []


def test_collected_results_keep_figures_alone(tmp_path: Path) -> None:
    """Six digits, without reasons of rows; command and versions with them. Another run adds its entries."""
    (tmp_path / "run").mkdir()
    (tmp_path / "docs/results").mkdir(parents=True)
    result = {"parts": {"table2": PART}, "command": "mrwarp reproduce table2 --out x", "versions": {"mrwarp": "1"}}
    (tmp_path / "run/result.json").write_text(json.dumps(plain(result)))
    found = json.loads(pages.collect((tmp_path / "run",), tmp_path).read_text())
    row = found["parts"]["table2"]["rows"][0]
    assert row["ours"] == 0.123457 and "why" not in row
    part = found["parts"]["table2"]
    assert row["seeds"] == [0.333333] and part["claim_ids"] == {"it": "it holds"} and part["reasons"]
    assert part["command"] == "mrwarp reproduce table2" and part["versions"] == {"mrwarp": "1"}
    (tmp_path / "run/result.json").write_text(json.dumps(plain({**result, "parts": {"table3": PART, "walks": PART}})))
    pages.collect((tmp_path / "run",), tmp_path)
    assert list(pages.read(tmp_path)["parts"]) == ["table2", "table3"]


def test_the_time_of_a_whole_report_is_kept(tmp_path: Path) -> None:
    """Of one with every entry; half an hour of one core is a quarter on each of two."""
    (tmp_path / "docs/results").mkdir(parents=True)
    timed = {**PART, "seconds": 60.0, "processor": 90.0}
    walks = {**PART, "seconds": 1.0, "processor": 10.0}
    result = {"parts": {**dict.fromkeys(TITLES, timed), "walks": walks}, "command": "c"}
    (tmp_path / "result.json").write_text(json.dumps(plain(result)))
    pages.collect((tmp_path,), tmp_path)
    whole = pages.read(tmp_path)["whole"]
    assert whole["processor"] == 90.0 * len(TITLES) + 10.0
    (tmp_path / "result.json").write_text(json.dumps(plain({**result, "parts": {"table2": PART}})))
    pages.collect((tmp_path,), tmp_path)
    assert pages.read(tmp_path)["whole"] == whole
    text = pages.filled("<!-- figures: whole -->\n<!-- /figures -->\n", pages.read(tmp_path), "README.md")
    assert f"{whole['processor'] / 60.0:.0f} minutes of one core" in text


def test_fill_writes_blocks_and_check_sees_a_changed_figure(tmp_path: Path) -> None:
    """A block is written again, the text around it stays."""
    (tmp_path / "docs/results").mkdir(parents=True)
    (tmp_path / pages.RESULTS).write_text(json.dumps({"parts": {"table2": PART}}))
    page = tmp_path / "README.md"
    page.write_text("before\n<!-- figures: table2 -->\nold\n<!-- /figures -->\nafter\n")
    today = {"table2": PART["rests_on"]}
    assert pages.fill(tmp_path, check=True, today=today) == [page] and "old" in page.read_text()
    assert pages.fill(tmp_path, today=today) == [page]
    assert page.read_text() == (
        "before\n<!-- figures: table2 -->\n|  | x [m] | paper |\n| --- | --- | --- |\n| a | 0.12 ± 0.50\\* | 1.00 |\n"
        "\n*`mrwarp reproduce table2`, 2026-11-29, code 01234567.*\n<!-- /figures -->\nafter\n"
    )
    assert pages.fill(tmp_path, check=True, today=today) == []
    assert pages.fill(tmp_path, check=True, today={"table2": "another"}) == [page]
    pages.fill(tmp_path, today={"table2": "another"})
    assert "code 01234567; **stale**: what they rest on has changed since" in page.read_text()
    pages.fill(tmp_path, today=today)
    page.write_text(page.read_text().replace("0.12", "0.13"))
    assert pages.fill(tmp_path, check=True, today=today) == [page]


def test_unknown_blocks_and_entries_that_were_not_made_are_refused(tmp_path: Path) -> None:
    """The message names the page or the entry."""
    with pytest.raises(ValueError, match="README.md: no figures are called 'tabel2'"):
        pages.filled("<!-- figures: tabel2 -->\n<!-- /figures -->", {"parts": {}}, "README.md")
    (tmp_path / "result.json").write_text(json.dumps({"parts": {"table2": {"message": "failed"}}}))
    with pytest.raises(ValueError, match="table2 was not made"):
        pages.collect((tmp_path,), tmp_path)


def test_a_changed_constant_makes_its_entries_stale_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Walks rest on kernels; a sentence in them changes nothing, a number all entries that walk, but not the report."""
    at, parse, other = Path(gate.__file__), cache._parse, tmp_path / "gate.py"
    text, today = at.read_text(encoding="utf-8"), age.hashes()
    monkeypatch.setattr(cache, "_parse", lambda path: parse.__wrapped__(other) if path == at else parse(path))

    def changed(old: str, new: str) -> set[str]:
        assert old in text
        other.write_text(text.replace(old, new, 1), encoding="utf-8")
        now = age.hashes()
        return {name for name in now if now[name] != today[name]}

    assert changed('"""', '"""Other words. ') == set()
    assert {"walks", "table6", "table4", "table2"} <= changed("return", "return 1.0 +")
    monkeypatch.undo()
    parts = {name: {"rests_on": value} for name, value in today.items()}
    assert age.stale(parts) == [] and age.stale({**parts, "fig5": {}}, today) == ["fig5"]


def test_stale_entries_are_listed_and_noted(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """With the day and the time that they take; of several entries of a block it says how many."""
    monkeypatch.setattr(age, "stale", lambda parts, today=None: ["table7"])
    assert main(["reproduce", "docs", "--stale"]) == 0
    assert capsys.readouterr().out.startswith("stale: table7 (20")
    parts = {"table2": PART, "table3": {**PART, "made": "2026-11-30"}}
    said = age.note(parts, ("table2", "table3"), ["table3"])
    assert said.startswith("*2 entries, 2026-11-29 to 2026-11-30; 1 of them **stale**: what they rest on")


@pytest.mark.parametrize("page", pages.pages(), ids=lambda page: page.name)
def test_a_figure_with_its_spread_stands_in_a_block(page: Path) -> None:
    """Typed in by hand it would be older than the code; these pages name the commit or the command next to it."""
    text = pages.BLOCK.sub("", page.read_text(encoding="utf-8"))
    typed = [line for line in text.splitlines() if re.search(r"\d ± \d", line)]
    assert not typed or page.name in ("beyond.md", "choices.md", "data.md"), typed
