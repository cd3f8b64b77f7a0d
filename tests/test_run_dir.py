"""Output folders: tried before the work, used by one process at a time."""

import errno
import os
from pathlib import Path

import pytest

from mrwarp.run_dir import FolderError, check_writable, claim, place_and_cause


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


def test_a_claim_for_work_that_fails_leaves_no_empty_folder(tmp_path: Path) -> None:
    """What was there before stays, and so does a folder with something in it."""
    for before, inside in (("", ""), ("a", ""), ("a/b", ""), ("", "kept")):
        root = tmp_path / f"{before.replace('/', '')}{inside}_case"
        (root / before).mkdir(parents=True)
        with pytest.raises(ValueError, match="work"), claim(root / "a" / "b"):
            if inside:
                (root / "a" / "b" / inside).touch()
            raise ValueError("work")
        assert (root / "a/b").exists() == bool(inside or before == "a/b")
        assert (root / "a").exists() == bool(inside or before)


def test_place_and_cause_are_one_line() -> None:
    """With and without what the system says."""
    assert place_and_cause(OSError(errno.EROFS, "Read-only file system", "out/a")) == "out/a: Read-only file system"
    assert place_and_cause(OSError("two\nlines")) == "two lines"
    assert place_and_cause(OSError()) == "OSError"
