"""Recordings are written so that they are read back bit for bit."""

from __future__ import annotations

import gzip
import io
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from mrwarp.recording.csv_files import csv_bytes
from mrwarp.recording.data import COLUMNS, HOLDING_COLUMNS, UNITS, Holding, Recording, RecordingError, Trajectory
from mrwarp.recording.open_files import HOLDING_FILE, suffix_of
from mrwarp.recording.units import read_units
from mrwarp.run_dir import write_bytes


def save_recording(
    recording: Recording, path: str | Path, *, header: dict[str, Any] | None = None, kind: str = ".csv.gz"
) -> list[Path]:
    """Write a recording so that :func:`load_recording` gives the same values, bit for bit.

    Args:
        recording: What to write.
        path: A file (``.csv``, ``.csv.gz``, ``.parquet``) for all trajectories, or a folder for one file each.
        header: Entries added to the header: ``# key: JSON`` lines before the CSV, metadata of Parquet.
        kind: File type in a folder.

    Returns:
        The files written.

    Raises:
        RecordingError: the folder holds files in other units, or two ids give one file name.
    """
    path = Path(path)
    folder = path.parent if suffix_of(path) else path
    folder.mkdir(parents=True, exist_ok=True)
    _write_units(folder, recording.units)
    added = {**recording.header, **(header or {})}
    if suffix_of(path):
        _write(recording.trajectories, path, added, with_ids=True)
        return [path]
    files = [folder / (re.sub(r"[^\w.+=-]", "_", run.id) + kind) for run in recording.trajectories]
    if len(set(files)) < len(files):
        raise RecordingError(f"{folder}: two trajectories would be written to one file; rename one")
    for run, file in zip(recording.trajectories, files, strict=True):
        _write((run,), file, {**run.header, **added}, with_ids=False)
    return files


def _write_units(folder: Path, units: dict[str, str]) -> None:
    """Write ``units.json`` where it is needed; refuse a folder whose files are in other units."""
    path, usual = folder / "units.json", {key: UNITS[key] for key in units}
    if path.is_file():
        there = read_units(folder)
        if any(there.declared[key] != unit for key, unit in units.items()):
            raise RecordingError(f"{path}: the files beside it are in other units; choose another folder")
    elif units != usual:
        write_bytes(path, (json.dumps(units, ensure_ascii=False, indent=1) + "\n").encode())


def save_holding(holding: Holding, folder: str | Path) -> Path:
    """Write break-away tests as ``folder/holding.csv``, with their header."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    file = Path(folder) / HOLDING_FILE
    table = pa.table({name: pa.array(getattr(holding, name)) for name in HOLDING_COLUMNS})
    write_bytes(file, csv_bytes(table, holding.header))
    return file


def _write(trajectories: Sequence[Trajectory], file: Path, header: dict[str, Any], *, with_ids: bool) -> None:
    columns: dict[str, Any] = {}
    if with_ids:
        columns["trajectory"] = pa.array([t.id for t in trajectories for _ in range(len(t.t))])
    for name in COLUMNS:
        columns[name] = pa.array(np.concatenate([getattr(t, name) for t in trajectories]))
    if all(t.temperature is not None for t in trajectories):
        columns["temperature"] = pa.array(np.concatenate([t.temperature for t in trajectories]))  # type: ignore[arg-type]
    if any(t.qd_derived for t in trajectories):
        header = {**header, "qd_derived": True}
    table = pa.table(columns)
    if file.name.endswith(".parquet"):
        sink = io.BytesIO()
        pyarrow.parquet.write_table(table.replace_schema_metadata({"mrwarp": json.dumps(header)}), sink)
        write_bytes(file, sink.getvalue())
        return
    data = csv_bytes(table, header)
    # no time stamp and a fixed level: the same recording gives the same bytes
    write_bytes(file, gzip.compress(data, 6, mtime=0) if file.name.endswith(".gz") else data)
