"""Folder of a run: what is wrong with a path, atomic writes, one process at a time, and ``result.json``."""

from __future__ import annotations

import contextlib
import json
import math
import os
import platform
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

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


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Path beside ``path`` to write to; it takes its place when the block ends, and is gone if the block fails.

    The folder is made if it is not there. After a killed process ``path`` is what it was, beside a ``.part``.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".part")
    try:
        yield partial
        os.replace(partial, path)
    except OSError as error:  # a write to a full disk names no file
        if error.errno is None or error.filename not in (None, str(partial)):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def write_bytes(path: Path, data: bytes) -> Path:
    """Write a file in one piece; returns its path."""
    with replacing(path) as partial:
        partial.write_bytes(data)
    return path


def write_text(path: Path, text: str) -> Path:
    """Write UTF-8 text in one piece; returns the file's path."""
    return write_bytes(path, text.encode("utf-8"))


SCHEMA = 1
"""Version of the result's layout."""

_LIBRARIES = (
    "mrwarp",
    "warp-lang",
    "newton",
    "mujoco",
    "mujoco-warp",
    "torch",
    "rsl-rl-lib",
    "numpy",
    "scipy",
    "usd-core",
    "safetensors",
)


def write_result(out: Path, figures: dict[str, Any], *, seed: int, command: str) -> Path:
    """Write ``out/result.json`` in one piece: the figures, the seed, the versions and the command line.

    Args:
        out: Folder, made if it is not there.
        figures: What was measured; plain values.
        seed: Seed of everything random.
        command: Command line that made it.
    """
    content = {"schema": SCHEMA, **figures, "seed": seed, "versions": versions(), "command": command}
    return write_text(out / "result.json", json.dumps(plain(content), indent=2, allow_nan=False) + "\n")


def plain(value: Any) -> Any:
    """The same with null for NaN and infinity, which JSON does not have."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def versions() -> dict[str, str]:
    """Versions of Python and of the libraries that a result depends on."""
    found = {"python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "not installed"
    return found
