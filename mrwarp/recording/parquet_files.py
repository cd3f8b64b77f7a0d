"""Parquet recordings: the header is JSON in the file's metadata."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet

from mrwarp.recording.columns import Table, check_names, with_columns
from mrwarp.recording.data import UNITS, RecordingError
from mrwarp.recording.open_files import too_large


def read_parquet(file: Path, limit: int, most: int, required: Sequence[str]) -> tuple[Table, int]:
    """The columns of a file, and how many bytes they take of the limit; ``most`` is what the error names."""
    table = Table(file, {}, None, {}, None)
    try:
        with pa.OSFile(str(file)) as stream:
            parquet = pyarrow.parquet.ParquetFile(stream)
            names = parquet.schema_arrow.names
            wanted = [n for n in names if n in UNITS or n == "trajectory"]
            # 8 bytes a value: what the file takes in memory, however well it is compressed
            size = 8 * parquet.metadata.num_rows * max(len(wanted), 1)
            if size > limit:
                raise too_large(file, size, most)
            check_names(table, names, ",".join(names), required)
            header = json.loads((parquet.schema_arrow.metadata or {}).get(b"mrwarp", b"{}"))
            header = header if isinstance(header, dict) else {"header": header}
            content = parquet.read(columns=wanted)
    except (pa.ArrowException, OSError, ValueError, RecursionError) as error:
        if isinstance(error, RecordingError):
            raise
        reason = str(error).splitlines()[0][:200]
        raise table.refuse(f"not a readable Parquet file ({reason}); export it again") from None
    if content.num_rows == 0:
        raise table.refuse("no samples; record it again")
    return with_columns(replace(table, header=header if isinstance(header, dict) else {}), content), size
