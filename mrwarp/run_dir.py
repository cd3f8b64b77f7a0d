"""The folder that a run writes to: tried before the work, used by one process, every file whole or not there.

After a killed process a file is what it was before, with a ``.part`` next to it at most.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
from collections.abc import Iterator, Mapping
from enum import Enum
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

try:
    import fcntl
except ImportError:  # Windows has no such locks: there two runs in one folder are not distinguished
    fcntl = None

SCHEMA = 1
"""Version of the layout of ``result.json``."""

NOT_FINAL = "not final: the run was stopped, or still goes on"
"""State of a ``result.json`` that holds a first answer, for refusals."""

LIBRARIES = "mrwarp warp-lang newton mujoco mujoco-warp torch rsl-rl-lib numpy scipy usd-core safetensors".split()
"""Libraries whose versions a result names."""


class FolderError(OSError):
    """An output folder cannot be used; the message names it, the reason and the remedy."""


def one_line(error: BaseException) -> str:
    """Message of an error on one line; for an error of the system the file and the cause."""
    if not isinstance(error, OSError):
        return " ".join(str(error).split())
    where = f"{error.filename}: " if error.filename else ""
    return where + " ".join((error.strerror or str(error) or type(error).__name__).split())


def no_file(path: Path, kind: str) -> str:
    """Why a path is no regular file, for a refusal: ``is a folder, no policy`` or ``no such policy``."""
    if path.is_dir():
        return f"is a folder, no {kind}"
    return f"is no regular file, so no {kind}" if path.exists() else f"no such {kind}"


def check_output(path: Path | None, suffix: str) -> None:
    """Raise ValueError unless the path can become a file of this suffix; without a suffix, a folder."""
    if path is None:
        return
    if suffix and path.suffix != suffix:
        raise ValueError(f"{path}: the file's name must end with {suffix}")
    if path.is_dir() if suffix else path.exists() and not path.is_dir():
        raise ValueError(f"{path}: is a {'folder, name a file in it' if suffix else 'file, name a folder'}")
    existing = next(parent for parent in (path.absolute(), *path.absolute().parents) if parent.exists())
    if existing != path.absolute() and not existing.is_dir() or not os.access(existing, os.W_OK):
        raise ValueError(f"{path}: cannot be written, {existing} is no folder with write access")


def check_writable(out: Path) -> None:
    """Try an output folder before the work; nothing that the trial makes stays.

    Raises:
        FolderError: the folder cannot be made or written.
    """
    probe, made = out / ".probe.part", _missing(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        try:
            probe.write_bytes(bytes(4096))
        finally:
            probe.unlink(missing_ok=True)
    except OSError as error:
        reason = "it is a file" if isinstance(error, FileExistsError) else error.strerror
        raise FolderError(f"{out}: cannot be written ({reason}); free it or name another --out") from error
    finally:
        _remove_empty(made)


@contextlib.contextmanager
def claim(out: Path) -> Iterator[None]:
    """Make a folder and keep other processes out of it; ends with the process, however that ends.

    A folder that was made for this is removed again if it is still empty.

    Raises:
        FolderError: another process writes into it.
    """
    made = _missing(out)
    out.mkdir(parents=True, exist_ok=True)
    with contextlib.ExitStack() as stack:
        if fcntl is not None:
            handle = os.open(out, os.O_RDONLY)
            stack.callback(os.close, handle)
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise FolderError(f"{out}: another run writes here; wait for it or name another --out") from error
            except OSError:
                pass  # a file system without locks
        try:
            yield
        finally:
            _remove_empty(made)


def _missing(out: Path) -> list[Path]:
    """Folders that making ``out`` would make, innermost first."""
    return [folder for folder in (out, *out.parents) if not folder.exists()]


def _remove_empty(folders: list[Path]) -> None:
    """Remove folders, innermost first, up to one that holds something."""
    with contextlib.suppress(OSError):
        for folder in folders:
            folder.rmdir()


@contextlib.contextmanager
def atomic_write(path: Path) -> Iterator[Path]:
    """Give a path next to ``path`` to write to; it replaces ``path`` at the end, and is gone if the block fails.

    The folder is made if it is not there. An error that names no file, as on a full disk, names ``path``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".part")
    try:
        yield partial
        os.replace(partial, path)
    except OSError as error:
        if error.errno is None or error.filename not in (None, str(partial)):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> Path:
    """Write a file atomically; returns its path."""
    with atomic_write(path) as partial:
        partial.write_bytes(data)
    return path


def write_text(path: Path, text: str) -> Path:
    """Write UTF-8 text atomically; returns the file's path."""
    return write_bytes(path, text.encode("utf-8"))


def write_result(out: Path, figures: dict[str, Any], *, seed: int, command: str) -> Path:
    """Write ``out/result.json`` atomically: the figures, the seed, the versions and the command line.

    Args:
        out: Folder, made if it is not there.
        figures: What was measured; plain values.
        seed: Seed of everything random.
        command: Command line that made it.
    """
    content = {"schema": SCHEMA, **figures, "seed": seed, "versions": versions(), "command": command}
    return write_text(out / "result.json", json.dumps(plain(content), indent=2, allow_nan=False) + "\n")


def is_not_final(result: Any) -> bool:
    """Whether the content of a ``result.json`` is a first answer, as ``mrwarp diagnose`` writes it early."""
    return isinstance(result, Mapping) and result.get("final") is False


def plain(value: Any) -> Any:
    """A value in JSON's own types: no NumPy numbers, tuples or paths, and null for NaN and infinity."""
    if hasattr(value, "tolist"):  # of NumPy
        value = value.tolist()
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def versions() -> dict[str, str]:
    """Versions of Python and of :data:`LIBRARIES`."""
    return {"python": platform.python_version(), **{name: library_version(name) for name in LIBRARIES}}


@cache
def library_version(name: str) -> str:
    """Version of a library; ``not installed`` where it is missing."""
    try:
        return version(name)
    except PackageNotFoundError:
        return "not installed"
