"""Files are whole or not there."""

import errno
import os
from pathlib import Path

import pytest

from mrwarp.run_dir import replacing, write_text


def test_folder_and_file_are_made(tmp_path: Path) -> None:
    """A folder that is not there is no obstacle, and nothing else is left in it."""
    path = write_text(tmp_path / "new" / "a.txt", "torque [N·m]")
    assert path.read_bytes() == "torque [N·m]".encode()
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_old_file_stays_when_writing_fails(tmp_path: Path, error: type[BaseException]) -> None:
    """Errors and Ctrl-C leave the old file and nothing beside it."""
    path = write_text(tmp_path / "a.txt", "old")
    with pytest.raises(error), replacing(path) as partial:
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
    with pytest.raises(OSError, match=r"No space left on device: .*a\.txt'"), replacing(path):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(FileNotFoundError, match=r"other\.txt'"), replacing(path):
        (tmp_path / "other.txt").read_text()
    assert list(tmp_path.iterdir()) == []
