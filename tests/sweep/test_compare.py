"""Figures of trials side by side: read from results, chosen, averaged over seeds, in table, CSV and picture."""

import csv
import json
import math
from pathlib import Path

import pytest

from mrwarp.sweep import compare
from mrwarp.sweep.compare import TrialRow
from mrwarp.sweep.grid import Trial
from mrwarp.sweep.runners import Status, write_status


def make_row(seed: int, current: str, **figures: float) -> TrialRow:
    """A trial with given figures; without any it failed."""
    values = {"seed": str(seed), "current": current}
    state = "done" if figures else "failed"
    fixed = {"name": f"seed={seed}_current={current}", "values": values, "state": state}
    return {**fixed, "attempts": 1, "wall_seconds": 2.0, "figures": figures}


ROWS = [
    make_row(0, "0", a=1.0, b=5.0),
    make_row(1, "0", a=3.0, b=5.0),
    make_row(0, "1.5", a=7.0, b=5.0),
    make_row(1, "1.5"),
]


def test_figures_are_the_numbers_of_a_result(tmp_path: Path) -> None:
    """Nested numbers by dotted name; texts, nulls, versions and the command are none."""
    content = {"a": {"b": [1, {"c": 2.5}]}, "ok": True, "text": "x", "none": None, "versions": {"numpy": 2}, "seed": 3}
    (tmp_path / "result.json").write_text(json.dumps(content))
    trial = Trial(folder=tmp_path, values={}, args=["walk"])
    assert compare.read_row(trial)["figures"] == {}
    write_status(trial, Status(state="done"))
    assert compare.read_row(trial)["figures"] == {"a.b.0": 1.0, "a.b.1.c": 2.5, "ok": 1.0}


def test_a_first_answer_is_named_as_not_final(tmp_path: Path) -> None:
    """Trials of ``diagnose --quick``; whether a result is final is no figure."""
    trial = Trial(folder=tmp_path / "seed=1", values={"seed": "1"}, args=["diagnose"])
    trial.folder.mkdir()
    write_status(trial, Status(state="done"))
    names = []
    for final in (False, True):
        (trial.folder / "result.json").write_text(json.dumps({"final": final, "a": 2.0}))
        row = compare.read_row(trial)
        names.append(row["name"])
        assert row["figures"] == {"a": 2.0}
    assert names == ["seed=1 (not final)", "seed=1"]


def test_a_limited_current_is_named_with_what_flowed(tmp_path: Path) -> None:
    """Trials at 1 and 1.5 A of devices that take 0.8 A: no two rows that say the same, or what did not flow."""
    rows = []
    for asked in ("0.5", "1", "1.5"):
        trial = Trial(folder=tmp_path / f"current={asked}", values={"current": asked}, args=["walk"])
        trial.folder.mkdir()
        content = {"current": min(float(asked), 0.8), "a": 2.0}
        (trial.folder / "result.json").write_text(json.dumps(content))
        write_status(trial, Status(state="done"))
        rows.append(compare.read_row(trial))
    names = ["current=0.5", "current=1 (0.8 A flowed)", "current=1.5 (0.8 A flowed)"]
    assert [row["name"] for row in rows] == [compare.condition(row) for row in rows] == names
    assert rows[0]["figures"] == {"a": 2.0}


def test_means_over_seeds_leave_out_failed_trials() -> None:
    """Two seeds at 0 A: 2 ± sqrt(2); one at 1.5 A has no spread."""
    first, second = compare.summary(ROWS, ["a"])
    assert first["condition"] == "current=0" and first["figures"]["a"] == {"mean": 2.0, "sd": math.sqrt(2.0), "n": 2}
    assert second["figures"]["a"]["mean"] == 7.0 and second["figures"]["a"]["n"] == 1
    assert math.isnan(second["figures"]["a"]["sd"])


def test_chosen_figures(capsys: pytest.CaptureFixture[str]) -> None:
    """Named ones, else those that differ; a name that is nowhere is said, with what there is."""
    assert compare.choose(ROWS, "walk", []) == ["a"]
    assert compare.choose(ROWS, "walk", ["b"]) == ["b"]
    assert compare.choose(ROWS, "walk", ["x"]) == ["a"]
    assert "--figure x: in no result; there are a, b, ..." in capsys.readouterr().err


def test_table_has_a_line_per_trial_and_per_repeated_condition() -> None:
    """The failed trial stands there without numbers."""
    lines = compare.table(ROWS, compare.summary(ROWS, ["a", "b"]), ["a", "b"])
    assert len(lines) == 1 + 4 + 1
    assert lines[4].split() == ["seed=1_current=1.5", "failed", "-", "-"]
    assert lines[5].split() == ["current=0", "n", "=", "2", "2", "±", "1.4", "5", "±", "0"]


def test_csv_holds_everything(tmp_path: Path) -> None:
    """One line per trial with its options, state and all figures."""
    compare.write_csv(ROWS, tmp_path / "trials.csv")
    with (tmp_path / "trials.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert [line["current"] for line in lines] == ["0", "0", "1.5", "1.5"]
    assert [line["a"] for line in lines] == ["1.0", "3.0", "7.0", ""]
    assert lines[3]["state"] == "failed"


@pytest.mark.parametrize("rows", [ROWS, ROWS[3:], ROWS[:1]])
def test_picture_of_any_number_of_results(tmp_path: Path, rows: list[TrialRow]) -> None:
    """Also where every trial failed."""
    compare.plot(rows, compare.summary(rows, ["a", "b"]), ["a", "b"], tmp_path / "trials.png")
    assert (tmp_path / "trials.png").read_bytes().startswith(b"\x89PNG")
