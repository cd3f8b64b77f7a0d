"""Every example runs as it stands."""

import runpy
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.py"))
SLOW = {"fit_and_diagnose", "train_and_watch", "current_as_action", "newton_joint", "robot_log"}
"""Those that take tens of seconds."""
LINES = 60


@pytest.mark.parametrize(
    "path", [pytest.param(p, id=p.stem, marks=[pytest.mark.slow] * (p.stem in SLOW)) for p in EXAMPLES]
)
def test_an_example_runs_and_fits_on_a_screen(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """It ends without an error, prints what it found, and is short enough to be read at once."""
    monkeypatch.chdir(tmp_path)
    assert len(path.read_text(encoding="utf-8").splitlines()) <= LINES
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out.strip()
