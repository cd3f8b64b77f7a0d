"""Files appear whole or not at all: they are written beside their place, then take it."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path


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
