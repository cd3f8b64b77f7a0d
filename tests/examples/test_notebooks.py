"""Every notebook runs from top to bottom, and shows the pictures that it was committed with."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.examples.notebooks import FOLDER, executed

NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
LARGEST = 100_000
"""Bytes of a notebook with its pictures."""


def _pictures(notebook: dict[str, Any]) -> list[int]:
    """Cells that show a picture."""
    outputs = [(k, out) for k, cell in enumerate(notebook["cells"]) for out in cell.get("outputs", ())]
    return [k for k, out in outputs if "image/png" in out.get("data", ())]


def test_there_are_three_with_pictures() -> None:
    """As they are read on the web, without running them."""
    assert len(NOTEBOOKS) >= 3
    for path in NOTEBOOKS:
        assert _pictures(json.loads(path.read_text(encoding="utf-8"))) and path.stat().st_size < LARGEST


def test_no_output_names_a_folder_of_one_machine() -> None:
    """Nor the loading of kernels, with its times."""
    for path in NOTEBOOKS:
        said = path.read_text(encoding="utf-8")
        assert not [word for word in ("/root/", "/home/", ".cache", "load on device") if word in said], path.name


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In an empty folder; its pictures come from the same cells."""
    monkeypatch.chdir(tmp_path)
    assert _pictures(executed(path)) == _pictures(json.loads(path.read_text(encoding="utf-8")))
