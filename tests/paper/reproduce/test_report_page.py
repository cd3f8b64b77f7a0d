"""The report: text from anywhere stays text, in HTML and in Markdown; each row says what it is."""

import re
from pathlib import Path

from mrwarp.paper import PaperValue
from paper.reproduce import report_page as report
from paper.reproduce.cache import Outcome
from paper.reproduce.comparison import Comparison, Findings, TextTable

EVIL = '<script>alert("x")</script> | `a` *b* [c](d) & \\'


def made(tmp_path: Path, **outcome) -> tuple[str, str]:
    """The page and the Markdown of one experiment whose every text is hostile."""
    row = Comparison(
        condition=EVIL, quantity=EVIL, unit="m", paper=PaperValue(mean=1.0, sd=0.1), ours=2.0, sd=0.1, n=3, why=EVIL
    )
    found = Findings(
        rows=[row],
        claims={EVIL: False},
        notes=[EVIL],
        tables=[TextTable(title=EVIL, head=[EVIL], rows=[[EVIL]])],
        pictures={"a.png": EVIL, "missing.png": "not there"},
    )
    (tmp_path / "fig5").mkdir()
    (tmp_path / "fig5" / "a.png").write_bytes(b"\x89PNG")
    outcome = Outcome(**{"name": "fig5", "status": "made", "findings": found, **outcome})
    paths = report.write({"fig5": outcome}, tmp_path, EVIL)
    return paths[0].read_text(), paths[1].read_text()


def test_hostile_text_stays_text(tmp_path: Path) -> None:
    """No tag and no attribute of it reaches the page; in Markdown no cell and no link is opened by it."""
    html, text = made(tmp_path)
    assert "<script" not in html
    assert html.count("&lt;script&gt;") >= 7
    assert "http" not in html.replace("http-equiv", "")
    assert "<script" not in text
    assert "](d)" not in text.replace("\\]", "")
    table = [line for line in text.splitlines() if line.startswith("|")]
    columns = {len(re.findall(r"(?<!\\)\|", line)) for line in table[:3]}
    assert columns == {len(report.HEAD) + 1}


def test_rows_that_agree_are_counted_and_carry_no_reason() -> None:
    """A row without a spread of the paper's is judged by 5 %."""
    row = Comparison(condition="", quantity="", unit="", paper=PaperValue(mean=1.0), ours=1.04, why="reason")
    far = Comparison(condition="", quantity="", unit="", paper=PaperValue(mean=1.0, sd=0.1), ours=2.0, why="reason")
    assert report.agreement([row, far]) == "1 of 2 rows do not differ beyond their interval"
    assert [report.cells(each)[-1] for each in (row, far)] == ["", "reason"]


def test_an_experiment_without_findings_says_why(tmp_path: Path) -> None:
    """In both files, and nothing else of it is shown."""
    html, text = made(tmp_path, status="failed", findings=None, message=EVIL)
    assert "failed: &lt;script&gt;" in html
    assert "failed: &lt;script>" in text
    assert "<table" not in html
