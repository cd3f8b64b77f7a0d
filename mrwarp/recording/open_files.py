"""Files of a recording: which they are, and the error for one that is too large."""

from __future__ import annotations

from pathlib import Path

from mrwarp.recording.data import RecordingError

HOLDING_FILE = "holding.csv"
"""Break-away torques beside recordings (see :func:`load_holding`); not a recording itself."""

SUFFIXES = (".csv", ".csv.gz", ".parquet")
"""File types that are recordings."""


def files_of(path: Path) -> list[Path]:
    """The recording's files, sorted by name."""
    if path.is_dir():
        files = sorted(
            p for p in path.iterdir() if suffix_of(p) and p.name != HOLDING_FILE and not p.name.startswith(".")
        )
        if not files:
            inside = sorted(p.name for p in path.iterdir() if p.is_dir() and any(suffix_of(f) for f in p.iterdir()))
            hint = f"; name one of its folders: {', '.join(inside)}" if inside else ""
            raise RecordingError(f"{path}: no recording in this folder ({', '.join(SUFFIXES)} files){hint}")
    else:
        files = [path]
    for file in files:
        if not file.exists():
            raise RecordingError(f"{file}: there is no such file or folder; check the path")
        if not file.is_file():
            raise RecordingError(f"{file}: not a regular file; copy the data into a file first")
        if not suffix_of(file):
            raise RecordingError(f"{file}: not a known kind of recording; use {', '.join(SUFFIXES)}")
    return files


def suffix_of(path: Path) -> str:
    """The recording suffix of a file name, or an empty string."""
    return next((s for s in reversed(SUFFIXES) if path.name.lower().endswith(s)), "")


def stem_of(path: Path) -> str:
    """The file's name without that suffix."""
    return path.name[: len(path.name) - len(suffix_of(path))]


def too_large(file: Path, size: int, most: int) -> RecordingError:
    """The error for a file of ``size`` bytes where a recording may have ``most``; ``most + 1`` says: or larger."""
    return RecordingError(
        f"{file}: {'more than ' if size == most + 1 else ''}{size / 2**30:.1f} GiB is more than is read at once "
        f"({most / 2**20:g} MiB per recording, uncompressed); split it into several recordings"
    )
