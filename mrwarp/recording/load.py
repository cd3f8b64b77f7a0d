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
from mrwarp.recording.columns import Table
from mrwarp.recording.csv_files import gunzip, read_csv
from mrwarp.recording.data import (
    COLUMNS,
    HOLDING_COLUMNS,
    REQUIRED,
    Holding,
    Recording,
    RecordingError,
    Trajectory,
)
from mrwarp.recording.open_files import HOLDING_FILE, SUFFIXES, files_of, stem_of, suffix_of, too_large
from mrwarp.recording.parquet_files import read_parquet
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
    files = files_of(path)
    units = read_units(path if path.is_dir() else path.parent)
    left = MAX_BYTES
    trajectories: list[Trajectory] = []
    for file in files:
        table, size = _read_table(file, left, REQUIRED)
        left -= size
        prefix = f"{stem_of(file)}/" if path.is_dir() else ""
        trajectories += checked_trajectories(table, units, prefix)
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
    file = files_of(path / HOLDING_FILE if path.is_dir() else path)[0]
    table, _ = _read_table(file, MAX_BYTES, HOLDING_COLUMNS)
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


def _read_table(file: Path, limit: int, required: Sequence[str]) -> tuple[Table, int]:
    """One file's columns and how many bytes they took of the limit."""
    try:
        size = file.stat().st_size
        with file.open("rb") as stream:
            start = stream.read(4)
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read ({error.strerror}); check its permissions") from None
    if size == 0:
        raise RecordingError(f"{file}: the file is empty; record it again")
    if size > limit:
        raise too_large(file, size, MAX_BYTES)
    suffix = suffix_of(file)
    if suffix == ".parquet" or start == b"PAR1":
        return read_parquet(file, limit, MAX_BYTES, required)
    data = gunzip(file, limit, MAX_BYTES) if start[:2] == b"\x1f\x8b" else file.read_bytes()
    if suffix == ".csv.gz" and start[:2] != b"\x1f\x8b":
        raise RecordingError(f"{file}: named .gz, but not compressed with gzip; rename it to .csv or compress it")
    if not data:
        raise RecordingError(f"{file}: the file is empty; record it again")
    return read_csv(file, data, required), len(data)


def _common(headers: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The entries that all headers hold alike."""
    first = headers[0]
    return {k: v for k, v in first.items() if all(k in h and h[k] == v for h in headers[1:])}
