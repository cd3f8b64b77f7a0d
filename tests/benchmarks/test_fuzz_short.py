"""The fuzzers' short version: cases of each kind of input, each a good read or a refusal that helps."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.fuzz import runner
from benchmarks.fuzz.coverage import Lines
from benchmarks.fuzz.kinds import KINDS
from benchmarks.fuzz.runner import isolated, run
from mrwarp.run_dir import one_line


@pytest.mark.parametrize("cases", [12, pytest.param(120, marks=pytest.mark.slow)])
def test_mutated_files_are_read_or_refused(cases: int, tmp_path: Path) -> None:
    """No exception but the reader's own, no hang, nothing left behind; every refusal names the file and a remedy."""
    # the command itself: a batch is forked, and must not inherit the threads and locks of all tests before this one
    line = [sys.executable, "-m", "benchmarks.fuzz", "--kind", *KINDS, "--cases", str(cases), "--seed", "1"]
    line += ["--seconds", "100", "--out", str(tmp_path)]
    done = subprocess.run(line, cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode in (0, 1), done.stderr
    outcomes = 0
    for kind in KINDS:
        state = json.loads((tmp_path / f"{kind}-1.json").read_text())
        assert state["failures"] == 0, [path.read_text() for path in (tmp_path / "failures").glob("*.txt")][:3]
        assert state["cases"] == cases == sum(state["counts"].values())
        outcomes += len(state["counts"])
    assert outcomes > 2 * len(KINDS)


def test_command_lines_are_refused(tmp_path: Path) -> None:
    """60 random command lines that cannot be right: exit code 2 and a reason, or help."""
    state = run("cli", 60, seed=1, out=tmp_path, seconds=100.0)
    assert state["failures"] == 0, [path.read_text() for path in (tmp_path / "failures").glob("*.txt")][:3]


def test_a_run_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two halves count the same as a whole."""
    monkeypatch.setattr(runner, "BATCH", 40)
    run("checkpoint", 40, seed=2, out=tmp_path / "parts", seconds=100.0)
    parts = run("checkpoint", 80, seed=2, out=tmp_path / "parts", seconds=100.0)
    whole = run("checkpoint", 80, seed=2, out=tmp_path / "whole", seconds=100.0)
    assert parts["counts"] == whole["counts"] and parts["cases"] == 80


def test_failures_are_found_and_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A reader that lets other errors escape, hangs or leaves files behind is caught, with its input."""
    original = KINDS["checkpoint"]

    def careless(path: Path) -> None:
        (path.parent / "left.part").write_text("x")
        raise KeyError(path.read_bytes()[:2])

    monkeypatch.setitem(KINDS, "checkpoint", replace(original, read=careless))
    state = run("checkpoint", 3, seed=0, out=tmp_path, seconds=100.0)
    assert state["failures"] == 3 and state["counts"] == {"FAILED": 3}
    assert "KeyError" in next((tmp_path / "failures").glob("*.txt")).read_text()


def test_a_process_that_ends_is_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ended from outside, once: the batch counts. Ended by its input, each time: a failure."""
    original, flag = KINDS["checkpoint"], tmp_path / "ended"

    def ends(path: Path) -> None:
        if not flag.exists():
            flag.touch()
            os._exit(3)
        original.read(path)

    monkeypatch.setitem(KINDS, "checkpoint", replace(original, read=ends))
    assert isolated("checkpoint", 0, 0, 5)["failures"] == []

    monkeypatch.setitem(KINDS, "checkpoint", replace(original, read=lambda path: os._exit(3)))
    (failure,) = isolated("checkpoint", 0, 0, 5)["failures"]
    assert "process ended with 3" in failure["problem"]


def test_lines_are_new_once() -> None:
    """A line of mrwarp counts when it runs for the first time; other code never does."""
    lines = Lines()
    with lines:
        one_line(ValueError("a"))
    assert lines.new > 0
    with lines:
        one_line(ValueError("b"))
        sorted([2, 1], key=lambda x: -x)
    assert lines.new == 0
    with lines:
        one_line(OSError("c"))
    assert lines.new > 0


def test_new_lines_lead_further() -> None:
    """Guided by lines: other cases than without, the same ones each time, no failures."""
    batches = [isolated("dump", 3, 0, 150, coverage=guided) for guided in (False, True, True)]
    assert all(batch["failures"] == [] for batch in batches)
    assert batches[1]["counts"] == batches[2]["counts"] != batches[0]["counts"]
