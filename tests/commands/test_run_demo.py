"""``mrwarp demo``: two pictures from nothing, away from a checkout; a missing extra is one line."""

import builtins
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

from mrwarp.cli import main


def test_it_ends_with_two_pictures_and_says_where_they_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """In an empty folder; the robots walk a second here."""
    monkeypatch.setattr("mrwarp.commands.run_demo.SECONDS", 1.0)
    monkeypatch.setattr("mrwarp.commands.run_demo.SAMPLES", 1600)
    monkeypatch.chdir(tmp_path)
    assert main(["demo"]) == 0
    assert sorted(os.listdir("runs/demo")) == ["loop.png", "walk.png"]
    printed = capsys.readouterr()
    said = printed.out
    assert "warning" not in said + printed.err
    assert "runs/demo/walk.png" in said and "runs/demo/loop.png" in said
    assert Path(said.split("--policy ")[1].split()[0]).is_file()  # the next command that it names works from here


def test_without_robots_it_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    """Before anything is written."""
    real = builtins.__import__

    def core_only(name: str, *args, **options) -> ModuleType:  # noqa: ANN002, ANN003
        if name.partition(".")[0] == "torch":
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *args, **options)

    monkeypatch.setattr(builtins, "__import__", core_only)
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    assert main(["demo", "--out", str(tmp_path / "demo")]) == 2
    assert capsys.readouterr().err == "mrwarp demo: needs torch, which is not installed: pip install 'mrwarp[sim]'\n"
    assert not (tmp_path / "demo").exists()
