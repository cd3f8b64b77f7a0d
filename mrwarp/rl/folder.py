"""The output folder of a training: writable, and used by one process at a time."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows has no such locks: there two trainings in one folder are not told apart
    fcntl = None


class FolderError(OSError):
    """An output folder cannot be used; the message names it, the reason and the remedy."""


def check_writable(out: Path) -> None:
    """Make a folder and try to write in it.

    Raises:
        FolderError: it cannot be made or written.
    """
    probe = out / ".probe.part"
    try:
        out.mkdir(parents=True, exist_ok=True)
        try:
            probe.write_bytes(bytes(4096))
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise FolderError(f"{out}: cannot be written ({error.strerror}); free it or name another --out") from error


@contextlib.contextmanager
def claim(out: Path) -> Iterator[None]:
    """Keep other trainings out of a folder; ends with the process, however that ends, and leaves no file behind.

    Raises:
        FolderError: another training writes into it.
    """
    if fcntl is None:
        yield
        return
    handle = os.open(out, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise FolderError(f"{out}: another training writes here; wait for it or name another --out") from error
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(handle)
