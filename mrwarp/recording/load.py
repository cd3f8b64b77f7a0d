"""Recordings: measured runs of one joint on a bench, checked when they are read (format: docs/data.md)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.recording.checks import (
    MAX_JITTER,
    MIN_SAMPLES,
    check_plausible,
    checked_trajectories,
    converted,
    derivative_ratio,
)
from mrwarp.recording.data import (
    COLUMNS,
    HOLDING_COLUMNS,
    HOLDING_FILE,
    REQUIRED,
    Holding,
    Recording,
    RecordingError,
    Trajectory,
)
from mrwarp.recording.tables import SUFFIXES, read_table, suffix_of
from mrwarp.recording.units import read_units
from mrwarp.recording.write import save_holding, save_recording

__all__ = [
    "COLUMNS",
    "HOLDING_FILE",
    "MAX_BYTES",
    "MAX_JITTER",
    "MIN_SAMPLES",
    "SUFFIXES",
    "Holding",
    "Recording",
    "RecordingError",
    "Trajectory",
    "check_same_units",
    "derivative_ratio",
    "find_holding",
    "load_holding",
    "load_recording",
    "save_holding",
    "save_recording",
]

MAX_BYTES = 2**29
"""Largest recording that is read, all files together and uncompressed [bytes]: 512 MiB, 14 hours at 200 Hz."""


def load_recording(path: str | Path) -> Recording:
    """Read and check a recording: one CSV or Parquet file, or a folder of them (docs/data.md has the format).

    Reads at most :data:`MAX_BYTES`; writes nothing.

    Raises:
        RecordingError: the recording is refused; the message names file, row and column, and the remedy.
    """
    path = Path(path)
    files = _files_of(path)
    units = read_units(path if path.is_dir() else path.parent)
    left = MAX_BYTES
    trajectories: list[Trajectory] = []
    for file in files:
        table = read_table(file, REQUIRED, left, MAX_BYTES)
        left -= table.size
        trajectories += checked_trajectories(table, units, file.name.removesuffix(suffix_of(file)), path.is_dir())
    names = [trajectory.id for trajectory in trajectories]
    double = next((name for name in names if names.count(name) > 1), None) if len(set(names)) < len(names) else None
    if double is not None:
        raise RecordingError(f"{path}: two trajectories are called {double!r}; rename a file or a trajectory")
    return Recording(
        trajectories=tuple(trajectories),
        units={key: units.base(key) for key in ("q", "current", "torque")},
        source=path,
        header=_common([trajectory.header for trajectory in trajectories]),
    )


def check_same_units(recording: Recording, fitted: Recording) -> None:
    """Refuse recordings to predict in other units than what is fitted.

    Raises:
        RecordingError: they differ.
    """
    if recording.units != fitted.units:
        theirs, ours = (", ".join(x.units.values()) for x in (recording, fitted))
        raise RecordingError(f"{recording.source}: in {theirs}, but {fitted.source} in {ours}; convert one of them")


def find_holding(path: str | Path) -> Path | None:
    """The break-away tests that belong to a recording: ``holding.csv`` in its folder or in the folder above."""
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    return next((f / HOLDING_FILE for f in (folder, folder.absolute().parent) if (f / HOLDING_FILE).is_file()), None)


def load_holding(path: str | Path) -> Holding:
    """Read break-away tests: columns ``current`` [A] and ``torque`` [N·m], one row per test (docs/data.md).

    Args:
        path: The file (``.csv``, ``.csv.gz``, ``.parquet``), or the folder that holds ``holding.csv``.

    Raises:
        RecordingError: the file is refused; the message names file, row and column, and the remedy.
    """
    path = Path(path)
    file = _files_of(path / HOLDING_FILE if path.is_dir() else path)[0]
    table = read_table(file, HOLDING_COLUMNS, MAX_BYTES, MAX_BYTES)
    units = read_units(file.parent)
    columns = converted(table, units)
    for name in HOLDING_COLUMNS:
        check_plausible(table, name, float(np.abs(columns[name]).max()), units)
    return Holding(
        current=columns["current"],
        torque=columns["torque"],
        units={name: units.base(name) for name in HOLDING_COLUMNS},
        header=table.header,
    )


def _files_of(path: Path) -> list[Path]:
    """The recording's files, sorted by name."""
    files = [path]
    if path.is_dir():
        files = sorted(
            p for p in path.iterdir() if suffix_of(p) and p.name != HOLDING_FILE and not p.name.startswith(".")
        )
        if not files:
            inside = sorted(p.name for p in path.iterdir() if p.is_dir() and any(suffix_of(f) for f in p.iterdir()))
            hint = f"; name one of its folders: {', '.join(inside)}" if inside else ""
            raise RecordingError(f"{path}: no recording in this folder ({', '.join(SUFFIXES)} files){hint}")
    for file in files:
        if not file.exists():
            raise RecordingError(f"{file}: there is no such file or folder; check the path")
        if not file.is_file():
            raise RecordingError(f"{file}: not a regular file; copy the data into a file first")
        if not suffix_of(file):
            raise RecordingError(f"{file}: not a known kind of recording; use {', '.join(SUFFIXES)}")
    return files


def _common(headers: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The entries that all headers hold alike."""
    first = headers[0]
    return {k: v for k, v in first.items() if all(k in h and h[k] == v for h in headers[1:])}
