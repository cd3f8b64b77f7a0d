"""Guesses: in order, as the documentation has it, at the end of an import."""

from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.robots.guesses import Guess, Subject, sorted_lines
from tests.robots.conftest import Robot

DOCS = Path(__file__).resolve().parents[2] / "docs" / "robot.md"


def test_the_table_of_the_documentation_is_this_one() -> None:
    """Every subject in its order, with how good the guess is."""
    rows = [line.split("|") for line in DOCS.read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    first = next(k for k, row in enumerate(rows) if row[1].strip() == "about")
    table = [(row[1].strip(), row[-2].strip()) for row in rows[first + 1 : first + 1 + len(Subject)]]
    assert table == [(subject.name.lower(), subject.value) for subject in Subject]


def test_what_changes_the_robot_most_comes_first() -> None:
    """For any order in which it was found."""
    guesses = [Guess(subject=subject, text=subject.name) for subject in reversed(Subject)]
    assert [line.split()[0] for line in sorted_lines(guesses)] == [subject.name for subject in Subject]


def test_an_import_ends_with_its_guesses(robot: Robot, capsys: pytest.CaptureFixture[str]) -> None:
    """After the table and the file's name; the same from the file."""
    path = robot()
    out = path.with_suffix(".usda")
    assert main(["robot", "import", str(path), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    notes = said[said.index("robot written:") :].splitlines()[1:]
    assert notes[0].startswith("guessed where the file is silent, first what would change the robot most")
    subjects = [note.rpartition("[")[2].partition(":")[0] for note in notes[1:]]
    order = [subject.name.lower() for subject in Subject]
    assert subjects == sorted(subjects, key=order.index) == ["stance", "gains", "holding", "second"]
    assert main(["robot", "show", str(out)]) == 0
    assert capsys.readouterr().out.splitlines()[-len(notes) :] == notes
