"""``mrwarp reproduce``: bad input is refused, small walks go through end to end and are not made twice."""

import errno
import json
import os
from dataclasses import replace
from pathlib import Path

import pytest

from mrwarp.cli import main
from paper.reproduce import cache
from paper.reproduce import registry as catalogue
from paper.reproduce.comparison import Findings
from paper.reproduce.contents import TITLES
from paper.reproduce.settings import NotYet
from tests.messages import Refused


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--policy", "nothing.onnx"], "nothing.onnx: no such policy"),
        (["--policy-sticking", *"abcdef"], "sticking: 6 policies, but 5 for every robot; name at least one and"),
        (["--policy-mr-go", *"abcda"], "policies of mr_go: name each policy once; one that counts as two"),
        (
            ["--policy-go1", "a.onnx", "b.onnx"],
            "policies: 2 for go1, 5 for mr_go, 5 for mr_go_sal; name the same",
        ),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused, options: list[str], message: str
) -> None:
    """Exit code 2, no folder; of policies that are there, or files that look like them."""
    monkeypatch.chdir(tmp_path)
    for name in (*"abcdef", "a.onnx", "b.onnx"):
        (tmp_path / name).touch()
    assert message in refused("reproduce", "table6", "--out", tmp_path / "out", *options)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "instead"),
    [
        (["reproduce", "predictions"], "docs/beyond.md"),
        (["reproduce", "table6", "electrical"], "a table of 'mrwarp reproduce table6'"),
        (["study", "table2"], "mrwarp reproduce table2"),
        (["study", "limits"], "docs/beyond.md"),
        (["mission", "--thermal"], "docs/beyond.md"),
        (["impact", "--sensitivity"], "mrwarp reproduce sensitivity"),
        (["sweep", "--address"], "docs/policies.md: a sweep runs on one machine"),
    ],
)
def test_what_is_gone_says_where_it_is_now(words: list[str], instead: str, capsys: pytest.CaptureFixture) -> None:
    """One line, exit code 2; a folder of that name is no word of a command."""
    assert main([*words, "--out", "x"]) == 2
    assert capsys.readouterr().err.endswith(f"{words[-1]} is gone; see {instead}\n")


def test_catalogue_is_ordered_and_described() -> None:
    """Every need is known and comes before; ``all`` is every entry with a heading, none that only others read."""
    seen: list[str] = []
    for name, experiment in catalogue.CATALOGUE.items():
        assert name == experiment.name
        assert set(experiment.needs) <= set(seen)
        assert experiment.compute.__doc__
        seen.append(name)
    assert [name for name in catalogue.CATALOGUE if name in TITLES] == list(TITLES)


def test_stopped_run_leaves_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Ctrl-C: exit code 130, and the report says what was not run; how long it would have taken was said before."""

    def stop(job: object) -> Findings:
        """Stopped."""
        raise KeyboardInterrupt

    monkeypatch.setitem(catalogue.CATALOGUE, "walks", replace(catalogue.CATALOGUE["walks"], compute=stop))
    assert main(["reproduce", "table6", "--out", str(tmp_path)]) == 130
    assert capsys.readouterr().out.startswith("to make: walks 2 min, table6 1 s; about 3 min on two idle cores")
    assert json.loads((tmp_path / "result.json").read_text())["parts"]["table6"]["status"] == "not run"
    assert "not run" in (tmp_path / "report.md").read_text()


def test_what_is_not_made_is_no_success(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A missing input is reported, and the exit code says that something was not made."""

    def wait(job: object) -> Findings:
        """Waits."""
        raise NotYet("no policies yet")

    monkeypatch.setitem(catalogue.CATALOGUE, "fig5", replace(catalogue.CATALOGUE["fig5"], compute=wait))
    assert main(["reproduce", "fig5", "--out", str(tmp_path)]) == 1
    assert json.loads((tmp_path / "result.json").read_text())["parts"]["fig5"]["status"] == "waiting"


def test_a_full_disk_stops_the_run_and_keeps_what_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """It is not taken for a failure of one experiment after the other."""
    parts = {name: replace(catalogue.CATALOGUE[name], compute=lambda _: Findings()) for name in ("fig5", "fig11")}
    parts = {name: replace(part, needs=()) for name, part in parts.items()}
    for name, part in parts.items():
        monkeypatch.setitem(catalogue.CATALOGUE, name, part)
    assert main(["reproduce", "fig5", "--out", str(tmp_path)]) == 0
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    def full(path: Path, *_: object, **__: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))

    monkeypatch.setattr(Path, "write_text", full)
    monkeypatch.setattr(cache, "write_text", full)
    capsys.readouterr()
    assert main(["reproduce", "fig11", "fig5", "--out", str(tmp_path)]) == 1
    error = capsys.readouterr().err
    assert "No space left on device; make room" in error and error.count("\n") == 1
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
