"""The columns of one file of a recording as it was logged: CSV, plain or gzipped, and Parquet, which pyarrow reads.

A CSV begins with ``# key: value`` lines, then names its columns; Parquet keeps that header as JSON in its metadata.
"""

from __future__ import annotations

import csv
import gzip
import io
import json
import re
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.recording.data import UNITS, RecordingError
from mrwarp.recording.units import CONVERSIONS

SUFFIXES = (".csv", ".csv.gz", ".parquet")
"""File types that are recordings."""

MAX_BYTES = 2**29
"""Largest recording that is read, all files together and uncompressed [bytes]: 512 MiB, 14 hours at 200 Hz."""

EMPTY = frozenset(("", "#N/A", "NA", "N/A", "n/a", "NULL", "null", "None", "nan", "NaN", "NAN", "-nan", "-NaN"))
"""Cells that programs write where there is no number."""

_ALIKE = 20
"""Fewest lines by which the last one is judged."""
_UNIT = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]")
"""A unit in brackets."""
_LAST_NUMBER = re.compile(r"\.(\d*)(?:[eE][-+]?\d+)?\s*$")

_ALIASES = {
    "t": ("time", "timestamp", "zeit"),
    "q": ("theta", "position", "angle", "displacement", "pos", "winkel", "weg"),
    "qd": ("speed", "velocity", "omega", "vel", "dq", "rpm", "drehzahl", "geschwindigkeit"),
    "current": ("i", "i_coil", "coil_current", "amps", "strom"),
    "torque": ("tau", "force", "moment", "drehmoment", "kraft"),
}


@dataclass(frozen=True, kw_only=True)
class Table:
    """The columns of one file, as recorded."""

    file: Path
    header: dict[str, Any]
    size: int
    """Bytes that the content takes in memory."""
    first_line: int | None = None
    """Line of the first row in a text file, for messages; None where rows are not lines."""
    columns: dict[str, np.ndarray]
    """Float64, NaN where a cell is empty."""
    ids: np.ndarray | None = None
    """Trajectory of each row, or None for one trajectory."""
    cut: str = ""
    """Note on a last line that was left out because the file ends within it; empty: there is none."""

    def refuse(self, problem: str, *, row: int | None = None, column: str | None = None) -> RecordingError:
        """The error for a row (counted from 0) and a column of this file."""
        where = str(self.file)
        if row is not None:
            where += f", row {row + 1}" + (f" (line {row + self.first_line})" if self.first_line else "")
        if column is not None:
            where += f", column {column!r}"
        return RecordingError(f"{where}: {problem}")


def suffix_of(path: Path) -> str:
    """The recording suffix of a file name, or an empty string."""
    return next((s for s in reversed(SUFFIXES) if path.name.lower().endswith(s)), "")


def _of_a_joint(name: str) -> bool:
    """Whether a column belongs to a recording of one joint."""
    return name in UNITS or name == "trajectory"


def read_table(file: Path, required: Sequence[str], limit: int, keep: Callable[[str], bool] = _of_a_joint) -> Table:
    """Read one file.

    Args:
        file: A regular file.
        required: Columns that it must have.
        limit: Largest content [bytes], uncompressed: what other files of the recording leave.
        keep: Whether a column, by its name, is read.

    Raises:
        RecordingError: the file is refused.
    """
    try:
        size = file.stat().st_size
        with file.open("rb") as stream:
            start = stream.read(4)
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read ({error.strerror}); check its permissions") from None
    compressed, suffix = start[:2] == b"\x1f\x8b", suffix_of(file)
    _check_size(file, size, limit)
    if size and (suffix == ".parquet" or start == b"PAR1"):
        return _read_parquet(file, required, limit, keep)
    if size and suffix == ".csv.gz" and not compressed:
        raise RecordingError(f"{file}: named .gz, but not compressed with gzip; rename it to .csv or compress it")
    try:
        with gzip.open(file) if compressed else file.open("rb") as stream:
            data = stream.read(limit + 1)  # a small file may hold more than any memory
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingError(f"{file}: the gzip data is damaged ({error}); copy or record it again") from None
    if not data:
        raise RecordingError(f"{file}: the file is empty; record it again")
    if any(byte < 9 or 13 < byte < 32 for byte in data[:4096]):
        hint = "export it as CSV with columns t, q, qd, current, torque, or as .parquet"
        raise RecordingError(f"{file}: binary data, not text; {hint}")
    _check_size(file, len(data), limit)
    return _read_csv(file, data, required, keep)


def _check_size(file: Path, size: int, limit: int) -> None:
    if size > limit:
        raise RecordingError(
            f"{file}: {size / 2**30:.1f} GiB is more than is read at once "
            f"({MAX_BYTES / 2**20:g} MiB per recording, uncompressed); split it into several recordings"
        )


def _read_csv(file: Path, data: bytes, required: Sequence[str], keep: Callable[[str], bool]) -> Table:
    header: dict[str, Any] = {}
    position, lines, line = 3 if data.startswith(b"\xef\xbb\xbf") else 0, 0, ""  # a spreadsheet's mark before UTF-8
    while not line or line.startswith("#"):
        if position >= len(data):
            raise RecordingError(f"{file}: no columns; the first line must name them: {', '.join(required)}")
        end = data.find(b"\n", position) + 1 or len(data)
        line = data[position:end].decode("utf-8", "replace").strip()
        position, lines = end, lines + 1
        key, colon, value = line.lstrip("# ").partition(":")
        if line.startswith("#") and colon:
            try:
                header[key.strip()] = json.loads(value)
            except (ValueError, RecursionError):
                header[key.strip()] = value.strip()
    names = [name.strip().strip('"').strip() for name in line.split(",")]
    blank_lines = any(0 <= data.find(blank, position) < len(data) - 8 for blank in (b"\n\n", b"\n\r\n"))
    first_line = None if blank_lines else lines + 1
    table = Table(file=file, header=header, size=len(data), first_line=first_line, columns={})
    _check_names(table, names, line, required)
    if not data[position : position + 256].strip():
        raise table.refuse("no samples, only the column names; record it again")
    try:
        text = data[position:].decode("utf-8")
    except UnicodeDecodeError as error:
        raise table.refuse(f"not readable as CSV ({error}); export it again") from None
    text, cut = _without_cut_line(text, len(names))
    table = replace(table, cut=cut)
    numbers = [k for k, name in enumerate(names) if keep(name) and name != "trajectory"]
    values = _plain_numbers(text, len(names), numbers)
    if values is None:
        return _cell_by_cell(table, text, names, keep)
    ids = None
    if "trajectory" in names and keep("trajectory"):
        at = names.index("trajectory")
        if '"' in text:
            cells = [row[at] for row in _rows(table, text)]
        else:
            cells = [line.split(",", at + 1)[at].strip() for line in text.splitlines() if line and not line.isspace()]
        ids = np.array(cells, dtype=object)
        if len(empty := np.flatnonzero(ids == "")):
            raise _without_id(table, int(empty[0]))
    return replace(table, columns={names[k]: values[:, i].copy() for i, k in enumerate(numbers)}, ids=ids)


def _without_cut_line(text: str, count: int) -> tuple[str, str]:
    """Lines of ``count`` cells without a last one in which the file ends, and a note on it.

    It lacks the line's end, and cells, or digits of a last number that has as many in all the other lines.
    """
    start = text.rfind("\n") + 1
    last = text[start:]
    lines = text[:start].splitlines()
    if not last.strip() or len(lines) < _ALIKE or '"' in last:
        return text, ""
    digits = {_decimals(line) for line in lines}
    fewer = last.count(",") + 1 < count
    if not fewer and (len(digits) > 1 or _decimals(last) >= max(digits)):
        return text, ""
    return text[:start], (
        f"the file ends within its last line, {last.strip()[-40:]!r}: that line is left out; was the logger stopped, "
        "or is the copy not complete?"
    )


def _decimals(line: str) -> int:
    """Digits after the point of the last number of a line, 0 where it has none."""
    found = _LAST_NUMBER.search(line)
    return len(found[1]) if found else 0


def _plain_numbers(text: str, count: int, wanted: Sequence[int]) -> np.ndarray | None:
    """Columns that hold numbers alone, shape (N, columns); None where a cell is none, or a line short or quoted."""
    try:
        values = np.loadtxt(io.StringIO(text), delimiter=",", comments=None, usecols=wanted, ndmin=2)
    except ValueError:
        return None
    return values if len(values) and text.count(",") == len(values) * (count - 1) else None


def _cell_by_cell(table: Table, text: str, names: list[str], keep: Callable[[str], bool]) -> Table:
    """The slow way, which takes text and empty cells, and knows where one is wrong."""
    rows = _rows(table, text)
    for k, row in enumerate(rows):
        if len(row) != len(names):
            problem = f"{len(row)} values for {len(names)} columns; complete or remove the line"
            raise table.refuse(problem, row=k)
    if rows and not any(_reads(cell) for cell in rows[0]):
        units = {n: cell.strip(" []()") for n, cell in zip(names, rows[0], strict=True) if n in UNITS and cell.strip()}
        declared = json.dumps({n: unit for n, unit in units.items() if unit != UNITS[n]}, ensure_ascii=False)
        hint = f"; if it names units, declare {declared} in units.json" if declared != "{}" else ""
        raise table.refuse(f"no number in it ({', '.join(rows[0])[:60]}): remove the line{hint}", row=0)
    columns, ids = {}, None
    for name, cells in zip(names, zip(*rows, strict=True), strict=True):
        if name == "trajectory" and keep(name):
            if "" in cells:
                raise _without_id(table, cells.index(""))
            ids = np.asarray(cells, dtype=object)
        elif keep(name):
            columns[name] = np.array([_number(table, cell, row, name) for row, cell in enumerate(cells)])
    return replace(table, columns=columns, ids=ids)


def _rows(table: Table, text: str) -> list[list[str]]:
    """Cells of the lines that are not blank."""
    try:
        return [row for row in csv.reader(io.StringIO(text), strict=True) if row]
    except csv.Error as error:
        raise table.refuse(f"not readable as CSV ({error}); export it again") from None


def _reads(cell: str) -> bool:
    """Whether a cell is a number or empty."""
    try:
        return cell.strip() in EMPTY or np.isfinite(float(cell))
    except ValueError:
        return False


def _number(table: Table, cell: str, row: int, name: str) -> float:
    text = cell.strip()
    if text in EMPTY:
        return float("nan")
    try:
        if "_" not in text:  # Python's own way to write a number, no other program's
            return float(text)
    except ValueError:
        pass
    problem = f"{text[:40]!r} is no number; write a plain number with a decimal point, or remove the line"
    raise table.refuse(problem, row=row, column=name)


def _without_id(table: Table, row: int) -> RecordingError:
    return table.refuse("no trajectory id; fill in the column or leave it out", row=row, column="trajectory")


def _read_parquet(file: Path, required: Sequence[str], limit: int, keep: Callable[[str], bool]) -> Table:
    import pyarrow as pa  # an extra: most recordings are CSV
    import pyarrow.parquet

    try:
        with pa.OSFile(str(file)) as stream:
            parquet = pyarrow.parquet.ParquetFile(stream)
            names = parquet.schema_arrow.names
            wanted = [n for n in names if keep(n)]
            # 8 bytes a value: what the file takes in memory, however well it is compressed
            size = 8 * parquet.metadata.num_rows * max(len(wanted), 1)
            _check_size(file, size, limit)
            header = json.loads((parquet.schema_arrow.metadata or {}).get(b"mrwarp", b"{}"))
            table = Table(
                file=file, header=header if isinstance(header, dict) else {"header": header}, size=size, columns={}
            )
            _check_names(table, names, ",".join(names), required)
            content = parquet.read(columns=wanted)
    except RecordingError:
        raise
    except (pa.ArrowException, OSError, ValueError, RecursionError) as error:
        reason = str(error).splitlines()[0][:200]
        raise RecordingError(f"{file}: not a readable Parquet file ({reason}); export it again") from None
    if content.num_rows == 0:
        raise table.refuse("no samples; record it again")
    return _with_columns(table, content)


def _check_names(table: Table, names: list[str], line: str, required: Sequence[str]) -> None:
    """Refuse missing and double columns, with the likely reason."""
    missing = [name for name in required if name not in names]
    if missing == ["q"] and "qd" in names and not _near(names, "q"):
        missing = []  # it is integrated
    if missing:
        if len(names) == 1 and re.search(r"[;\t]", line):
            hint = "columns must be separated by commas, numbers written with a decimal point"
        elif all(re.fullmatch(r"[-+.\deE]+", name) for name in names):
            hint = f"the first line must name the columns: {', '.join(required)}"
        else:
            near = _near(names, missing[0])
            hint = _renames(names, missing) if near else f"add it [{UNITS[missing[0]]}]"
            if len(near) > 1 and all(each[-1].isdigit() for each in near):
                hint = f"{', '.join(near[:4])}: a recording is of one joint, so write one file for each, or {hint}"
            if not near and missing[0] == "current":
                hint += ', or declare {"current": "none"} in units.json for a device without a control input'
            if not near and missing[0] == "q" and (speeds := _near(names, "qd")):
                hint = f"rename {speeds[0]!r} to 'qd' and it is integrated"
        found = ", ".join(name if name.isprintable() else repr(name) for name in names)[:200]
        raise table.refuse(f"column {missing[0]!r} is missing (found: {found}); {hint}")
    double = [name for name in names if names.count(name) > 1]
    if double:
        raise table.refuse(f"two columns are called {double[0]!r}; remove or rename one")


def _renames(names: list[str], missing: list[str]) -> str:
    """Names for columns that are there by another one, and the units that stand in it."""
    near = {name: found[0] for name in (*missing, "qd") if name not in names and (found := _near(names, name))}
    said = {name: unit for name, old in near.items() if (unit := _unit_in(old, name))}
    units = {name: unit for name, unit in said.items() if CONVERSIONS[name].get(unit) != (1.0, UNITS[name])}
    hint = "rename " + ", ".join(f"{old!r} to {name!r}" for name, old in near.items())
    return hint + (f", and declare {json.dumps(units, ensure_ascii=False)} in units.json" if units else "")


def _near(names: list[str], name: str) -> list[str]:
    """Columns that are likely meant by a name; its unit, in brackets or not, or a joint's number may follow it."""
    bare = {each: each.removesuffix(_unit_in(each, name)).lower() for each in names}
    plain = {each: re.sub(r"\s*[\[(].*|[\s_]*\d*$", "", text) for each, text in bare.items()}
    return [each for each, text in plain.items() if text in (name, *_ALIASES[name])]


def _unit_in(column: str, name: str) -> str:
    """The unit in a column's name, in brackets or as its last word (``angle_deg``); empty where there is none."""
    last = re.split(r"[_\s]", column)[-1]
    found = _UNIT.search(column)
    return found[1] if found else last if last != column and last in CONVERSIONS[name] else ""


def _with_columns(table: Table, content: Any) -> Table:
    """Arrow's columns as arrays."""
    import pyarrow as pa

    columns, ids = {}, None
    for name in content.column_names:
        column = content[name]
        if name == "trajectory":
            if column.null_count:
                raise _without_id(table, int(np.flatnonzero(column.is_null().to_numpy())[0]))
            ids = np.asarray(column.cast(pa.string()).to_pylist(), dtype=object)
            continue
        try:
            columns[name] = column.cast(pa.float64()).to_numpy().astype(np.float64)
        except pa.ArrowException:
            raise table.refuse(f"holds {column.type}, not numbers; store it as double", column=name) from None
    return replace(table, columns=columns, ids=ids)
