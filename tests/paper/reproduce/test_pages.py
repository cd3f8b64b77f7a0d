"""Pages are filled from the committed results, and a page that differs is seen."""

import json
from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.run_dir import plain
from paper.reproduce import pages
from paper.reproduce.contents import TITLES
from paper.reproduce.verdicts import Results

ROW = {"condition": "a", "quantity": "x", "unit": "m", "paper": {"mean": 1.0, "sd": None}, "ours": 0.123456789}
PART = {
    "rows": [{**ROW, "sd": 0.5, "n": 3, "seeds": [1 / 3], "calibrated": True, "digits": 2, "why": "because"}],
    "claims": {"it holds": True},
    "claim_ids": {"it": "it holds"},
    "reasons": {"drop/height": "because"},
    "tables": [],
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


def test_studies_are_entries_of_their_own(tmp_path: Path) -> None:
    """Named by kind, policies and ground; without the single seeds. A table of several folders has a line each."""
    (tmp_path / "docs/results").mkdir(parents=True)
    metric = {"mean": 0.04, "sd": 0.01, "seeds": [0.03, 0.05], "rollouts": [[0.03], [0.05]]}
    row = {"training": "t", "current": 0.0, "fell": 2, "v_x_rmse": metric, "v_x_bias": metric}
    change = {"reduction": 0.6, "p": 0.0004, "interval": [0.0, 1.0]}
    study = {"rows": dict.fromkeys("ABCD", row), **{key: {"off": change, "on": change} for key in ("rmse", "bias")}}
    for ground in ("flat", "rough"):
        found = {**study, "evaluation": {"folder": "policies/study_rough", "terrain": ground}}
        (tmp_path / "result.json").write_text(json.dumps({**found, "command": "mrwarp study table2 --out x"}))
        pages.collect((tmp_path,), tmp_path)
    parts = pages.read(tmp_path)["parts"]
    assert list(parts) == ["study table2 study_rough", "study table2 study_rough rough"]
    assert "seeds" not in json.dumps(parts) and "interval" not in json.dumps(parts)
    names = ("`here`", "study table2 study_rough rough"), ("`there`", "study table2 study_rough")
    lines = pages._studies("policies", *names)(Results(parts)).splitlines()
    assert len(lines) == 6
    cells = "0.040 | 0.040 | 60 % | < 0.001"
    assert lines[2] == f"| `here`: RMSE [m/s] | {cells} | {cells} | 2, 2, 2, 2 |"


def test_fill_writes_blocks_and_check_sees_a_changed_figure(tmp_path: Path) -> None:
    """A block is written again, the text around it stays."""
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


def test_strengths_stand_around_the_shipped_networks() -> None:
    """Halved, as it is, doubled; the middle row is that of figure 4's own entry."""
    rmse = {"MLP": 0.8, "Bouc-Wen": 0.4, "LSTM": 0.4, "PG-RLSTM": 0.2}
    rows = [
        {
            **ROW,
            "condition": f"{name}, {amps} A",
            "quantity": "RMSE",
            "ours": value,
            "sd": 0.1,
            "n": 3,
            "calibrated": False,
            "digits": 3,
        }
        for name, value in rmse.items()
        for amps in ("1", "1.2", "1.5")
    ]
    head = ["effects", *rmse, "below Bouc-Wen [%]", "below LSTM [%]", "below MLP [%]", "lowest"]
    strengths = ("the paper's device", "times 0.5", "times 2")
    table = {"head": head, "rows": [[text, *"1234567", "yes"] for text in strengths]}
    claims = {"claims": {"it is lowest": False}, "claim_ids": {"pg_rlstm_lowest": "it is lowest"}}
    parts = {"fig4": {"rows": rows, **claims}, "fig4_strengths": {"tables": [table]}}
    lines = pages._strengths(Results(parts)).splitlines()
    assert [line.split(" | ")[0] for line in lines[2:]] == [
        "| the paper's device",
        "| times 0.5",
        "| times 1",
        "| times 2",
    ]
    assert lines[4] == "| times 1 | 0.800 | 0.400 | 0.400 | 0.200 | 50 | 50 | 75 | no |"
