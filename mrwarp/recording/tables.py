"""The columns of one file of a recording as it was logged: CSV, plain or gzipped, and Parquet, which pyarrow reads.

A CSV begins with ``# key: value`` lines, then names its columns; Parquet keeps that header as JSON in its metadata.
"""

from __future__ import annotations

import gzip
import json
import re
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.recording.containers import arrays_of, as_columns, guessed, sheet_as_text
from mrwarp.recording.data import UNITS, RecordingError
from mrwarp.recording.text_tables import NO_ID, CellError, Text, looks_tabular, pieces_of, read_head, read_rows
from mrwarp.recording.units import CONVERSIONS

SUFFIXES = (".csv", ".csv.gz", ".parquet")
"""File types that are recordings, of a joint or a robot."""

TEXTS = (".tsv", ".txt", ".dat", ".asc", ".tsv.gz", ".txt.gz", ".dat.gz")
"""Further names of tables as text; in a folder one counts only if it holds a table."""

CONTAINERS = (".mat", ".npz", ".xlsx")
"""Further file types that hold a joint's recording."""

KINDS = (*SUFFIXES, *CONTAINERS, *TEXTS)
"""All that a joint's recording may be, alone or in a folder."""

MAX_BYTES = 2**29
"""Largest recording that is read, all files together and uncompressed [bytes]: 512 MiB, 14 hours at 200 Hz."""

_HEAD = 2**20
"""Bytes in which the header and the names of a text's columns stand."""

_UNIT = re.compile(r"[\[(]([^\[(\])]*)[\])]")
"""A unit in the innermost brackets, so that brackets that never close take no time."""

_ALIASES = {
    "t": ("time", "timestamp", "zeit"),
    "q": ("theta", "position", "angle", "displacement", "pos", "winkel", "weg"),
    "qd": ("speed", "velocity", "omega", "vel", "dq", "rpm", "drehzahl", "geschwindigkeit"),
    "current": ("i", "i_coil", "coil_current", "coil", "cur", "amps", "strom"),
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
    notes: tuple[str, ...] = ()
    """Rows and cells that were left out or filled in when it was read."""

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
    return next((s for s in sorted(KINDS, key=len, reverse=True) if path.name.lower().endswith(s)), "")


def is_recording(path: Path) -> bool:
    """Whether a path of a folder is a recording: a file with one of the endings, and no note as a text."""
    suffix = "" if path.name.startswith(".") or not path.is_file() else suffix_of(path)
    return bool(suffix) and (suffix not in TEXTS or holds_table(path))


def holds_table(file: Path) -> bool:
    """Whether a text begins with a table, and not with words as a note does."""
    try:
        with gzip.open(file) if file.name.lower().endswith(".gz") else file.open("rb") as stream:
            return looks_tabular(stream.read(4096))
    except (OSError, EOFError, zlib.error):
        return True  # the reason is named when it is read


def _of_a_joint(name: str) -> bool:
    """Whether a column belongs to a recording of one joint."""
    return name in UNITS or name == "trajectory"


def read_table(
    file: Path,
    required: Sequence[str],
    limit: int,
    keep: Callable[[str], bool] = _of_a_joint,
    *,
    called: Mapping[str, str] | None = None,
    seconds: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Table:
    """Read one file.

    Args:
        file: A regular file.
        required: Columns that it must have.
        limit: Largest content [bytes], uncompressed: what other files of the recording leave.
        keep: Whether a column, by its name, is read.
        called: Column that a quantity stands in, where the file calls it otherwise.
        seconds: Turns stamps into seconds, so that a text sampled far more quickly than a joint moves is averaged while
            it is read; None: it is read as it is.

    Raises:
        RecordingError: the file is refused.
    """
    called = called or {}
    try:
        size = file.stat().st_size
        with file.open("rb") as stream:
            start = stream.read(4)
    except OSError as error:
        raise RecordingError(f"{file}: cannot be read ({error.strerror}); check its permissions") from None
    compressed, suffix = start[:2] == b"\x1f\x8b", suffix_of(file)
    _check_size(file, size, limit)
    if size and (suffix == ".parquet" or start == b"PAR1"):
        return _read_parquet(file, required, limit, keep, called)
    if size and suffix in CONTAINERS:
        return _of_container(file, required, limit, keep, called, seconds)
    if size and suffix.endswith(".gz") and not compressed:
        raise RecordingError(f"{file}: named .gz, but not compressed with gzip; rename it to .csv or compress it")
    try:
        with gzip.open(file) if compressed else file.open("rb") as stream:
            data = stream.read(_HEAD)
            if not data:
                raise RecordingError(f"{file}: the file is empty; record it again")
            if any(byte < 9 or 13 < byte < 32 for byte in data[:4096]):
                hint = "export it as CSV with columns t, q, qd, current, torque, or as .parquet"
                raise RecordingError(f"{file}: binary data, not text; {hint}")
            # a small file may hold more than any memory
            rest = pieces_of(stream, data, limit, lambda total: _too_large(file, total))  # pyright: ignore[reportArgumentType]
            return _read_text(file, data, rest, required, keep, called, seconds)
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingError(f"{file}: the gzip data is damaged ({error}); copy or record it again") from None


def _check_size(file: Path, size: int, limit: int) -> None:
    if size > limit:
        raise _too_large(file, size)


def _too_large(file: Path, size: int) -> RecordingError:
    return RecordingError(
        f"{file}: {size / 2**30:.1f} GiB is more than is read at once "
        f"({MAX_BYTES / 2**20:g} MiB per recording, uncompressed); split it into several recordings"
    )


def _read_text(
    file: Path,
    data: bytes,
    pieces: Iterator[bytes],
    required: Sequence[str],
    keep: Callable[[str], bool],
    called: Mapping[str, str],
    seconds: Callable[[np.ndarray], np.ndarray] | None,
) -> Table:
    """A table of text, whose beginning is ``data`` and whose whole content are the pieces."""
    known = {*UNITS, "trajectory", *called.values(), *(alias for names in _ALIASES.values() for alias in names)}
    try:
        text, begin = read_head(data, lambda name: name.lower() in known or name in known or bool(_meant(name)))
    except RecordingError as error:
        raise RecordingError(f"{file}: {error}: {', '.join(required)}") from None
    table = Table(file=file, header=text.header, size=0, first_line=text.first_line, columns={})
    text.names = _called(table, text.names, called)
    try:
        _check_names(table, text.names, text.line, required)
    except RecordingError as error:
        if any(map(_meant, text.names)) or "must name the columns" in str(error):
            raise
        text.columns = _first_rows(text, data[begin:])
        declared = json.dumps(guessed(text.columns, called, _meant), ensure_ascii=False)
        raise RecordingError(f"{error}; or say which is which in units.json, as {declared}") from None
    if not data[begin : begin + 256].strip():
        raise table.refuse("no samples, only the column names; record it again")
    try:
        read_rows(text, _from(pieces, begin), keep, seconds)
    except CellError as error:
        table = replace(table, first_line=text.first_line)
        raise table.refuse(error.problem, row=error.row, column=error.column) from None
    except UnicodeDecodeError as error:
        raise table.refuse(f"not readable as CSV ({error}); export it again") from None
    return replace(
        table,
        columns=text.columns,
        ids=text.ids,
        notes=tuple(text.notes),
        first_line=text.first_line,
        size=text.size,
    )


def _first_rows(text: Text, data: bytes) -> dict[str, np.ndarray]:
    """All columns of the first rows of a table, as far as they can be read."""
    try:
        read_rows(text, iter([data[: data.rfind(b"\n") + 1]]), lambda name: True, None)
    except (CellError, UnicodeDecodeError):
        return {}
    return text.columns


def _from(pieces: Iterator[bytes], begin: int) -> Iterator[bytes]:
    """Pieces without their first bytes."""
    for piece in pieces:
        yield piece[begin:]
        begin = 0


def _called(table: Table, names: Sequence[str], called: Mapping[str, str]) -> list[str]:
    """Names of the columns as quantities, where declarations say what the file calls them.

    Raises:
        RecordingError: a declared name is not there.
    """
    for quantity, name in called.items():
        if name not in names:
            found = ", ".join(names)[:200]
            raise table.refuse(f"column {name!r}, declared as {quantity!r}, is missing (found: {found}); correct it")
    own = {name: quantity for quantity, name in called.items()}
    return [own.get(name, f"{name} (not {name})" if name in called else name) for name in names]


def _of_container(
    file: Path,
    required: Sequence[str],
    limit: int,
    keep: Callable[[str], bool],
    called: Mapping[str, str],
    seconds: Callable[[np.ndarray], np.ndarray] | None,
) -> Table:
    """A table out of a container of arrays, or of a sheet."""
    if suffix_of(file) == ".xlsx":
        data = sheet_as_text(file, limit)
        return _read_text(file, data, iter([data]), required, keep, called, seconds)
    arrays, header = arrays_of(file, limit)
    table = Table(file=file, header=header, size=sum(8 * x.size for x in arrays.values()), columns={})
    names = list(arrays)
    renamed = _called(table, names, called)
    missing = [name for name in required if name not in renamed and not (name == "q" and "qd" in renamed)]
    if missing:
        shapes = ", ".join(f"{name} {' x '.join(map(str, x.shape))}" for name, x in list(arrays.items())[:24])
        declared = json.dumps(guessed(arrays, called, _meant), ensure_ascii=False)
        raise table.refuse(
            f"no array is called {missing[0]!r}; it holds {shapes or 'no numbers'}; say which is which in units.json, "
            f"as {declared}"
        )
    kept = {name: x for name, x in zip(renamed, arrays.values(), strict=True) if keep(name) and name != "trajectory"}
    try:
        columns, ids = as_columns(kept, arrays.get(called.get("trajectory", "trajectory")))
    except ValueError as error:
        raise table.refuse(f"{error}") from None
    return replace(table, columns=columns, ids=ids)


def _read_parquet(
    file: Path, required: Sequence[str], limit: int, keep: Callable[[str], bool], called: Mapping[str, str]
) -> Table:
    import pyarrow as pa  # an extra: most recordings are CSV
    import pyarrow.parquet

    try:
        with pa.OSFile(str(file)) as stream:
            parquet = pyarrow.parquet.ParquetFile(stream)
            names = parquet.schema_arrow.names
            table = Table(file=file, header={}, size=0, columns={})
            renamed = dict(zip(names, _called(table, names, called), strict=True))
            wanted = [n for n in names if keep(renamed[n])]
            # 8 bytes a value: what the file takes in memory, however well it is compressed
            size = 8 * parquet.metadata.num_rows * max(len(wanted), 1)
            _check_size(file, size, limit)
            header = json.loads((parquet.schema_arrow.metadata or {}).get(b"mrwarp", b"{}"))
            table = Table(
                file=file, header=header if isinstance(header, dict) else {"header": header}, size=size, columns={}
            )
            _check_names(table, list(renamed.values()), ",".join(names), required)
            content = parquet.read(columns=wanted).rename_columns([renamed[n] for n in wanted])
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
            hint = "columns must be separated by commas, semicolons, tabulators or spaces"
        elif all(re.fullmatch(r"[-+.\deE]+", name) for name in names):
            hint = f"the first line must name the columns: {', '.join(required)}"
        else:
            near = _near(names, missing[0]) or _by_unit(names, missing[0])
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
    asked = [name for name in (*missing, "qd") if name not in names]
    near = {name: found[0] for name in asked if (found := _near(names, name))}
    near |= {name: found[0] for name in asked if name not in near and (found := _by_unit(names, name))}
    said = {name: unit for name, old in near.items() if (unit := _unit_in(old, name))}
    units = {name: unit for name, unit in said.items() if CONVERSIONS[name].get(unit) != (1.0, UNITS[name])}
    hint = "rename " + ", ".join(f"{old!r} to {name!r}" for name, old in near.items())
    hint += f", and declare {json.dumps(units, ensure_ascii=False)} in units.json" if units else ""
    declared = json.dumps({"columns": near, **units}, ensure_ascii=False)
    return f"{hint}; or leave the file as it is and declare {declared} in units.json"


def _near(names: list[str], name: str) -> list[str]:
    """Columns that are likely meant by a name; its unit, in brackets or not, or a joint's number may follow it."""
    bare = {each: each.removesuffix(_unit_in(each, name)).lower() for each in names}
    plain = {each: re.sub(r"\s*[\[(].*|[\s_]*\d*$", "", text) for each, text in bare.items()}
    return [each for each, text in plain.items() if text in (name, *_ALIASES[name])]


def _by_unit(names: list[str], name: str) -> list[str]:
    """The one column whose unit only this quantity has, as ``load_Nm`` a torque; empty where none or several have."""
    others = {unit for other, units in CONVERSIONS.items() if other != name for unit in units}
    found = [each for each in names if not _meant(each) and _unit_in(each, name) in CONVERSIONS[name].keys() - others]
    return found if len(found) == 1 else []


def _meant(column: str) -> str:
    """The quantity that a column's name stands for, or an empty text."""
    return next((name for name in _ALIASES if _near([column], name)), "")


def _unit_in(column: str, name: str) -> str:
    """The unit in a column's name, in brackets or as its last word (``angle_deg``); empty where there is none.

    What a logger writes in brackets may be a channel's number.
    """
    last = re.split(r"[_\s]", column)[-1]
    found = _UNIT.search(column)
    if found:
        return found[1].strip() if re.search(r"[^\W\d]|[°%]", found[1]) else ""
    return last if last != column and last in CONVERSIONS[name] else ""


def _with_columns(table: Table, content: Any) -> Table:
    """Arrow's columns as arrays."""
    import pyarrow as pa

    columns, ids = {}, None
    for name in content.column_names:
        column = content[name]
        if name == "trajectory":
            if column.null_count:
                empty = int(np.flatnonzero(column.is_null().to_numpy())[0])
                raise table.refuse(NO_ID, row=empty, column=name)
            ids = np.asarray(column.cast(pa.string()).to_pylist(), dtype=object)
            continue
        try:
            columns[name] = column.cast(pa.float64()).to_numpy().astype(np.float64)
        except pa.ArrowException:
            raise table.refuse(f"holds {column.type}, not numbers; store it as double", column=name) from None
    return replace(table, columns=columns, ids=ids)
