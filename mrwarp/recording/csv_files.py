"""CSV recordings: ``# key: value`` lines, the names of the columns, then the numbers."""

from __future__ import annotations

import gzip
import io
import json
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.csv

from mrwarp.recording.columns import Table, check_names, with_columns
from mrwarp.recording.data import UNITS, RecordingError
from mrwarp.recording.open_files import too_large

_NULLS = ["", "NA", "N/A", "NaN", "nan", "-nan", "null", "NULL", "None"]


def gunzip(file: Path, limit: int, most: int) -> bytes:
    """Uncompressed content; stops at ``limit`` bytes, whatever the file claims; ``most`` is what the error names."""
    chunks, total = [], 0
    try:
        with gzip.open(file) as stream:
            while chunk := stream.read(2**22):
                if not chunks:
                    _refuse_binary(file, chunk)
                chunks.append(chunk)
                total += len(chunk)
                if total > limit:
                    raise too_large(file, most + 1, most)
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingError(f"{file}: the gzip data is damaged ({error}); copy or record it again") from None
    return b"".join(chunks)


def read_csv(file: Path, data: bytes, required: Sequence[str]) -> Table:
    """The columns of a file from its content."""
    _refuse_binary(file, data)
    if data.startswith(b"\xef\xbb\xbf"):  # the mark that spreadsheets put before UTF-8
        data = data[3:]
    header: dict[str, Any] = {}
    position, lines = 0, 0
    while True:
        end = data.find(b"\n", position)
        line = data[position : end if end >= 0 else len(data)].decode("utf-8", "replace").strip()
        if line.startswith("#"):
            _read_comment(line, header)
        elif line:
            break
        if end < 0:
            raise RecordingError(f"{file}: no columns; the first line must name them: {', '.join(required)}")
        position, lines = end + 1, lines + 1
    names = [name.strip().strip('"').strip() for name in line.split(",")]
    first = end + 1 if end >= 0 else len(data)
    blank_lines = any(0 <= data.find(blank, first) < len(data) - 8 for blank in (b"\n\n", b"\n\r\n"))
    table = Table(file, {}, None, header, None if blank_lines else lines + 2)
    check_names(table, names, line, required)
    body = pa.py_buffer(data).slice(first)
    if not data[first : first + 256].strip():
        raise table.refuse("no samples, only the column names; record it again")
    try:
        content = pyarrow.csv.read_csv(
            pa.BufferReader(body),
            read_options=pyarrow.csv.ReadOptions(column_names=names),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types={n: pa.string() if n == "trajectory" else pa.float64() for n in names},
                include_columns=[n for n in names if n in UNITS or n == "trajectory"],
                null_values=_NULLS,
            ),
        )
    except (pa.ArrowInvalid, UnicodeDecodeError) as error:
        raise _bad_line(table, names, data[first:], str(error)) from None
    return with_columns(table, content)


def csv_bytes(table: pa.Table, header: dict[str, Any]) -> bytes:
    """CSV text with the header as ``# key: JSON`` lines; numbers have as many digits as bring them back exactly."""
    sink = io.BytesIO()
    for key, value in header.items():
        sink.write(f"# {key}: {json.dumps(value)}\n".encode())
    sink.write((",".join(table.column_names) + "\n").encode())
    pyarrow.csv.write_csv(table, sink, pyarrow.csv.WriteOptions(include_header=False, quoting_style="needed"))
    return sink.getvalue()


def _refuse_binary(file: Path, data: bytes) -> None:
    start = data[:4096]
    if b"\0" in start or sum(byte < 9 or 13 < byte < 32 for byte in start) > 0:
        raise RecordingError(
            f"{file}: binary data, not text; export it as CSV with columns t, q, qd, current, torque, or as .parquet"
        )


def _read_comment(line: str, header: dict[str, Any]) -> None:
    """Take ``# key: value`` with a JSON value, or keep the text where it is none."""
    key, colon, value = line.lstrip("# ").partition(":")
    if colon:
        try:
            header[key.strip()] = json.loads(value)
        except (ValueError, RecursionError):
            header[key.strip()] = value.strip()


def _bad_line(table: Table, names: list[str], body: bytes, message: str) -> RecordingError:
    """Find the line that the fast reader could not take."""
    numeric = [(i, name) for i, name in enumerate(names) if name in UNITS]
    row = -1
    for raw in io.BytesIO(body):
        text = raw.decode("utf-8", "replace").strip()
        if not text:
            continue
        row += 1
        cells = text.split(",")
        if len(cells) != len(names):
            return table.refuse(f"{len(cells)} values for {len(names)} columns; complete or remove the line", row=row)
        for i, name in numeric:
            cell = cells[i].strip().strip('"')
            if cell not in _NULLS and not _is_number(cell):
                remedy = "write a plain number with a decimal point, or remove the line"
                return table.refuse(f"{cell[:40]!r} is no number; {remedy}", row=row, column=name)
    return table.refuse(f"not readable as CSV ({message.splitlines()[0][:200]}); export it again")


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return "_" not in text
