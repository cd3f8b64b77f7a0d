"""Recordings are written so that they are read back bit for bit."""

from __future__ import annotations

import csv
import gzip
import io
import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.recording.data import (
    COLUMNS,
    HOLDING_COLUMNS,
    HOLDING_FILE,
    Holding,
    Recording,
    RecordingError,
    Trajectory,
)
from mrwarp.recording.tables import suffix_of
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
    units, declared = folder / "units.json", read_units(folder).declared
    if any(declared[key] != unit for key, unit in recording.units.items()):
        if units.is_file():
            raise RecordingError(f"{units}: the files next to it are in other units; choose another folder")
        write_bytes(units, (json.dumps(recording.units, ensure_ascii=False, indent=1) + "\n").encode())
    added = {**recording.header, **(header or {})}
    if suffix_of(path):
        ids = [run.id for run in recording.trajectories for _ in range(len(run.t))]
        _write_runs(recording.trajectories, path, added, {"trajectory": ids})
        return [path]
    files = [folder / (re.sub(r"[^\w.+=-]", "_", run.id) + kind) for run in recording.trajectories]
    if len(set(files)) < len(files):
        raise RecordingError(f"{folder}: two trajectories would be written to one file; rename one")
    for run, file in zip(recording.trajectories, files, strict=True):
        _write_runs((run,), file, {**run.header, **added}, {})
    return files


def save_holding(holding: Holding, folder: str | Path) -> Path:
    """Write break-away tests as ``folder/holding.csv``, with their header."""
    file = Path(folder) / HOLDING_FILE
    _write({name: getattr(holding, name) for name in HOLDING_COLUMNS}, file, holding.header)
    return file


def _write_runs(runs: Sequence[Trajectory], file: Path, header: dict[str, Any], columns: dict[str, Any]) -> None:
    """Write trajectories end to end, next to other columns."""
    names = [*COLUMNS, "temperature"] if all(run.temperature is not None for run in runs) else COLUMNS
    columns |= {name: np.concatenate([getattr(run, name) for run in runs]) for name in names}
    made = {flag: True for flag in ("qd_derived", "q_integrated") if any(getattr(run, flag) for run in runs)}
    _write(columns, file, {**header, **made})


def _write(columns: Mapping[str, Any], file: Path, header: dict[str, Any]) -> None:
    """Numbers get as many digits as bring them back exactly."""
    if file.name.endswith(".parquet"):
        import pyarrow as pa  # an extra: most recordings are CSV
        import pyarrow.parquet

        sink = io.BytesIO()
        table = pa.table(dict(columns)).replace_schema_metadata({"mrwarp": json.dumps(header)})
        pyarrow.parquet.write_table(table, sink)
        write_bytes(file, sink.getvalue())
        return
    text = io.StringIO()
    text.writelines(f"# {key}: {json.dumps(value)}\n" for key, value in header.items())
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(columns)
    rows.writerows(zip(*(np.asarray(column).tolist() for column in columns.values()), strict=True))
    data = text.getvalue().encode()
    # no time stamp and a fixed level: the same recording gives the same bytes
    write_bytes(file, gzip.compress(data, 6, mtime=0) if file.name.endswith(".gz") else data)
