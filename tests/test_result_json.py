"""result.json: complete, finite, and in one piece."""

import json
from pathlib import Path

import pytest

from mrwarp.run_dir import write_result


def test_result_holds_figures_seed_versions_and_command(tmp_path: Path) -> None:
    """Everything a reader needs to make it again stands in the file."""
    path = write_result(tmp_path / "new" / "folder", {"rmse": 0.1, "rows": [1, 2]}, seed=7, command="mrwarp x")
    content = json.loads(path.read_text())
    assert (content["rmse"], content["rows"], content["seed"], content["command"]) == (0.1, [1, 2], 7, "mrwarp x")
    assert content["schema"] == 1
    assert set(content["versions"]) >= {"python", "mrwarp", "warp-lang", "newton", "mujoco", "torch"}


def test_nan_becomes_null(tmp_path: Path) -> None:
    """JSON has no NaN or infinity: they are written as null, wherever they stand."""
    nan, inf = float("nan"), float("inf")
    path = write_result(tmp_path, {"a": nan, "b": [1.0, inf], "c": {"d": (-inf, 2.0)}}, seed=0, command="")
    content = json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(name))
    assert (content["a"], content["b"], content["c"]) == (None, [1.0, None], {"d": [None, 2.0]})


def test_a_failing_write_leaves_the_old_result(tmp_path: Path) -> None:
    """What cannot be written as JSON raises and leaves the earlier file as it was."""
    path = write_result(tmp_path, {"a": 1}, seed=0, command="")
    before = path.read_text()
    with pytest.raises(TypeError):
        write_result(tmp_path, {"a": object()}, seed=0, command="")
    assert path.read_text() == before
