"""Output folders: tried before the work, used by one process at a time; files whole or not there; ``result.json``."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mrwarp.run_dir import FolderError, atomic_write, check_writable, claim, one_line, write_result, write_text


@pytest.mark.parametrize("there", ["", "a", "a/b"])
def test_trying_leaves_the_disk_as_it_was(tmp_path: Path, there: str) -> None:
    """Whichever part of the path exists."""
    (tmp_path / there).mkdir(parents=True, exist_ok=True)
    before = sorted(tmp_path.rglob("*"))
    check_writable(tmp_path / "a" / "b" / "c")
    assert sorted(tmp_path.rglob("*")) == before


def test_a_file_in_the_way_is_refused(tmp_path: Path) -> None:
    """Place, cause and remedy; the file stays."""
    (tmp_path / "a").write_text("mine")
    with pytest.raises(FolderError, match=r"/a/b: cannot be written \(Not a directory\); free it or"):
        check_writable(tmp_path / "a" / "b")
    assert (tmp_path / "a").read_text() == "mine"


def test_a_full_disk_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders can still be made there, files cannot."""

    def fail(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(FolderError, match=r"out: cannot be written \(No space left on device\)"):
        check_writable(tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_claim_makes_the_folder_and_keeps_others_out(tmp_path: Path) -> None:
    """Until it ends."""
    out = tmp_path / "new"
    with claim(out):
        with pytest.raises(FolderError, match="new: another run writes here; wait for it or name another --out"):
            with claim(out):
                pass
    with claim(out):
        assert list(out.iterdir()) == []


def test_a_claim_ends_with_its_process(tmp_path: Path) -> None:
    """However that ends: after ``kill -9`` the folder is free, and as it was."""
    code = "import pathlib, sys, time; from mrwarp.run_dir import claim\nwith claim(pathlib.Path(sys.argv[1])):"
    code += " print('held', flush=True); time.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code, str(tmp_path)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        with pytest.raises(FolderError, match="another run writes here"), claim(tmp_path):
            pass
        other.kill()
        other.wait()
    with claim(tmp_path):
        assert list(tmp_path.iterdir()) == []


def test_a_claim_for_work_that_fails_leaves_no_empty_folder(tmp_path: Path) -> None:
    """An earlier file stays, and so does a folder with something in it."""
    for before, inside in (("", ""), ("a", ""), ("a/b", ""), ("", "kept")):
        root = tmp_path / f"{before.replace('/', '')}{inside}_case"
        (root / before).mkdir(parents=True)
        with pytest.raises(ValueError, match="work"), claim(root / "a" / "b"):
            if inside:
                (root / "a" / "b" / inside).touch()
            raise ValueError("work")
        assert (root / "a/b").exists() == bool(inside or before == "a/b")
        assert (root / "a").exists() == bool(inside or before)


def test_errors_of_the_system_fit_one_line() -> None:
    """With and without what the system says."""
    assert one_line(OSError(errno.EROFS, "Read-only file system", "out/a")) == "out/a: Read-only file system"
    assert one_line(OSError("two\nlines")) == "two lines"
    assert one_line(OSError()) == "OSError"


def test_folder_and_file_are_made(tmp_path: Path) -> None:
    """A folder that is not there is no obstacle, and nothing else is left in it."""
    path = write_text(tmp_path / "new" / "a.txt", "torque [N·m]")
    assert path.read_bytes() == "torque [N·m]".encode()
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_old_file_stays_when_writing_fails(tmp_path: Path, error: type[BaseException]) -> None:
    """Errors and Ctrl-C leave the old file and nothing next to it."""
    path = write_text(tmp_path / "a.txt", "old")
    with pytest.raises(error), atomic_write(path) as partial:
        partial.write_text("half of the n")
        assert path.read_text() == "old"
        raise error
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_a_partial_file_of_a_killed_process_is_no_obstacle(tmp_path: Path) -> None:
    """It is written over."""
    (tmp_path / "a.txt.part").write_text("left behind, and longer than what comes now")
    assert write_text(tmp_path / "a.txt", "new").read_text() == "new"
    assert [p.name for p in tmp_path.iterdir()] == ["a.txt"]


def test_a_full_disk_is_an_error_that_names_the_file(tmp_path: Path) -> None:
    """A write to a full disk names no file by itself; errors about other files keep theirs."""
    path = tmp_path / "a.txt"
    with pytest.raises(OSError, match=r"No space left on device: .*a\.txt'"), atomic_write(path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(FileNotFoundError, match=r"other\.txt'"), atomic_write(path):
        (tmp_path / "other.txt").read_text()
    assert list(tmp_path.iterdir()) == []


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
    """Values that JSON cannot hold raise and leave the earlier file as it was."""
    path = write_result(tmp_path, {"a": 1}, seed=0, command="")
    before = path.read_text()
    with pytest.raises(TypeError):
        write_result(tmp_path, {"a": object()}, seed=0, command="")
    assert path.read_text() == before
