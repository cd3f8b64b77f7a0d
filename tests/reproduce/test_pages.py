"""Pages are filled from the committed results, and a page that differs is seen."""

import json
from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.reproduce import pages
from mrwarp.run_dir import plain

ROW = {"condition": "a", "quantity": "x", "unit": "m", "paper": {"mean": 1.0, "sd": None}, "ours": 0.123456789}
PART = {
    "rows": [{**ROW, "sd": 0.5, "n": 3, "calibrated": True, "digits": 2, "why": "because"}],
    "claims": {"it holds": True},
    "tables": [],
}


def test_committed_pages_are_those_of_the_committed_results() -> None:
    """What ``make lint`` asks."""
    assert pages.fill(check=True) == []


def test_collected_results_keep_figures_alone(tmp_path: Path) -> None:
    """Six digits, no reasons; command and versions beside. Another run adds its entries."""
    (tmp_path / "run").mkdir()
    (tmp_path / "docs/results").mkdir(parents=True)
    result = {"parts": {"table2": PART}, "command": "mrwarp reproduce table2", "versions": {"mrwarp": "1"}}
    (tmp_path / "run/result.json").write_text(json.dumps(plain(result)))
    found = json.loads(pages.collect((tmp_path / "run",), tmp_path).read_text())
    row = found["parts"]["table2"]["rows"][0]
    assert row["ours"] == 0.123457 and "why" not in row
    part = found["parts"]["table2"]
    assert part["command"] == "mrwarp reproduce table2" and part["versions"] == {"mrwarp": "1"}
    (tmp_path / "run/result.json").write_text(json.dumps(plain({**result, "parts": {"table3": PART, "walks": PART}})))
    pages.collect((tmp_path / "run",), tmp_path)
    assert list(pages.read(tmp_path)["parts"]) == ["table2", "table3"]


def test_fill_writes_blocks_and_check_sees_a_changed_figure(tmp_path: Path) -> None:
    """A block is written anew, the text around it stays."""
    (tmp_path / "docs/results").mkdir(parents=True)
    (tmp_path / pages.RESULTS).write_text(json.dumps({"parts": {"table2": PART}}))
    page = tmp_path / "README.md"
    page.write_text("before\n<!-- figures: table2 -->\nold\n<!-- /figures -->\nafter\n")
    assert pages.fill(tmp_path, check=True) == [page] and "old" in page.read_text()
    assert pages.fill(tmp_path) == [page]
    assert page.read_text() == (
        "before\n<!-- figures: table2 -->\n|  | x [m] | paper |\n| --- | --- | --- |\n| a | 0.12 ± 0.50\\* | 1.00 |\n"
        "<!-- /figures -->\nafter\n"
    )
    assert pages.fill(tmp_path, check=True) == []
    page.write_text(page.read_text().replace("0.12", "0.13"))
    assert pages.fill(tmp_path, check=True) == [page]


def test_unknown_blocks_and_entries_that_were_not_made_are_refused(tmp_path: Path) -> None:
    """The message names the page or the entry."""
    with pytest.raises(ValueError, match="README.md: no figures are called 'tabel2'"):
        pages.filled("<!-- figures: tabel2 -->\n<!-- /figures -->", {"parts": {}}, "README.md")
    (tmp_path / "result.json").write_text(json.dumps({"parts": {"table2": {"message": "failed"}}}))
    with pytest.raises(ValueError, match="table2 was not made"):
        pages.collect((tmp_path,), tmp_path)


def test_command_refuses_a_folder_without_results(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One line, exit code 2, nothing written."""
    assert main(["reproduce", "docs", "--results", str(tmp_path)]) == 2
    assert "result.json" in capsys.readouterr().err
