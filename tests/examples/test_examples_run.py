"""Every example runs as it stands."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.py"))
LINES = 60


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_runs_and_fits_on_a_screen(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """It ends without an error, prints what it found, and is short enough to be read at once."""
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LINES
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out.strip()
