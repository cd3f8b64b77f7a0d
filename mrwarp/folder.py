"""Files and folders of a command: what is wrong with one, and an output folder that one process uses at a time."""

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
    made = _missing(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        try:
            probe.write_bytes(bytes(4096))
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        raise FolderError(f"{out}: cannot be written ({error.strerror}); free it or name another --out") from error
    finally:
        _remove_empty(made)


def _missing(out: Path) -> list[Path]:
    """The folders that making ``out`` would make, innermost first."""
    return [folder for folder in (out, *out.parents) if not folder.exists()]


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders, innermost first, up to one that holds something."""
    with contextlib.suppress(OSError):
        for folder in folders:
            folder.rmdir()


def check_output(path: Path | None, suffix: str) -> None:
    """Raise ValueError unless the path can become a file (or with no suffix, a folder)."""
    if path is None:
        return
    if suffix and path.suffix != suffix:
        raise ValueError(f"{path}: the file's name must end with {suffix}")
    if path.is_dir() if suffix else path.exists() and not path.is_dir():
        raise ValueError(f"{path}: is a {'folder, name a file in it' if suffix else 'file, name a folder'}")
    existing = next(parent for parent in (path.absolute(), *path.absolute().parents) if parent.exists())
    if existing != path.absolute() and not existing.is_dir() or not os.access(existing, os.W_OK):
        raise ValueError(f"{path}: cannot be written, {existing} is no folder with write access")


def place_and_cause(error: OSError) -> str:
    """What cannot be read or written and why, on one line."""
    where = f"{error.filename}: " if error.filename else ""
    return where + " ".join((error.strerror or str(error) or type(error).__name__).split())


def one_line(error: BaseException) -> str:
    """What an error says, on one line; of one of the system's, place and cause."""
    return place_and_cause(error) if isinstance(error, OSError) else " ".join(str(error).split())


def no_file(path: Path, kind: str) -> str:
    """What a path is that should be a file: not there, or something else, such as ``is a folder, no policy``."""
    if path.is_dir():
        return f"is a folder, no {kind}"
    return f"is no regular file, so no {kind}" if path.exists() else f"no such {kind}"


@contextlib.contextmanager
def claim(out: Path) -> Iterator[None]:
    """Keep other processes out of a folder, which is made; ends with the process, however that ends.

    A folder that was made for work that fails is removed again if it is still empty.

    Raises:
        FolderError: another process writes into it.
    """
    made = _missing(out)
    out.mkdir(parents=True, exist_ok=True)
    try:
        with _locked(out):
            yield
    except BaseException:
        _remove_empty(made)
        raise


@contextlib.contextmanager
def _locked(out: Path) -> Iterator[None]:
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
