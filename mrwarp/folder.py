"""The output folder of a command: writable, and used by one process at a time."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows has no such locks: there two runs in one folder are not told apart
    fcntl = None


class FolderError(OSError):
    """An output folder cannot be used; the message names it, the reason and the remedy."""


def check_writable(out: Path) -> None:
    """Refuse before the work what could not be written after it; leaves nothing behind.

    Raises:
        FolderError: the folder cannot be made or written.
    """
    probe = out / ".probe.part"
    made = [folder for folder in (out, *out.parents) if not folder.exists()]
    try:
        out.mkdir(parents=True, exist_ok=True)
        try:
            probe.write_bytes(bytes(4096))
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise FolderError(f"{out}: cannot be written ({error.strerror}); free it or name another --out") from error
    finally:
        with contextlib.suppress(OSError):
            for folder in made:
                folder.rmdir()


def place_and_cause(error: OSError) -> str:
    """What cannot be read or written and why, on one line."""
    where = f"{error.filename}: " if error.filename else ""
    return where + " ".join((error.strerror or str(error) or type(error).__name__).split())


@contextlib.contextmanager
def claim(out: Path) -> Iterator[None]:
    """Keep other processes out of a folder, which is made; ends with the process, however that ends.

    Raises:
        FolderError: another process writes into it.
    """
    out.mkdir(parents=True, exist_ok=True)
    if fcntl is None:
        yield
        return
    handle = os.open(out, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise FolderError(f"{out}: another run writes here; wait for it or name another --out") from error
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(handle)
