"""Recordings: measured runs of one joint on a bench, checked when they are read (format: docs/data.md)."""

from __future__ import annotations

import gzip
import io
import json
import os
import re
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from mrwarp.sysid.differentiate import differentiate

COLUMNS = ("t", "q", "qd", "current", "torque")
"""Columns of a recording; ``qd`` may be missing, ``trajectory`` and ``temperature`` may be added."""

MIN_SAMPLES = 50
"""Fewest samples of a trajectory: one history window of the learned models."""

MAX_BYTES = 2**29
"""Largest recording that is read, all files together and uncompressed [bytes]: 512 MiB, 14 hours at 200 Hz."""

MAX_JITTER = 0.5
"""Largest deviation of a sampling interval from the median interval, as a share of it; above, it is a gap."""

HOLDING_FILE = "holding.csv"
"""Break-away torques beside recordings (see :func:`load_holding`); not a recording itself."""

SUFFIXES = (".csv", ".csv.gz", ".parquet")
"""File types that are recordings."""

_SI = {"t": "s", "q": "rad", "qd": "rad/s", "current": "A", "torque": "N·m", "temperature": "degC"}
_REQUIRED = ("t", "q", "current", "torque")
_HOLDING = ("current", "torque")
_NULLS = ["", "NA", "N/A", "NaN", "nan", "-nan", "null", "NULL", "None"]


class RecordingError(ValueError):
    """A recording was refused; the message names file, row and column, and the remedy."""


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """One uninterrupted run, uniformly sampled. All arrays float64, shape (N,)."""

    id: str
    """Name of the trajectory, unique within its recording."""
    t: np.ndarray
    """Time [s]."""
    q: np.ndarray
    """Displacement [rad], or [m] for a linear device."""
    qd: np.ndarray
    """Velocity [rad/s] or [m/s]."""
    current: np.ndarray
    """Coil current [A] (or driver voltage [V])."""
    torque: np.ndarray
    """Measured torque [N·m] or force [N], positive against positive velocity (eq. 14)."""
    temperature: np.ndarray | None = None
    """Temperature [degC], if it was recorded."""
    qd_derived: bool = False
    """True where qd was derived from q by zero-phase differentiation."""
    header: dict[str, Any] = field(default_factory=dict)
    """What the trajectory's own file says about how it was made."""

    @property
    def dt(self) -> float:
        """Sampling interval [s]."""
        return float((self.t[-1] - self.t[0]) / (len(self.t) - 1))


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A set of trajectories of one device."""

    trajectories: tuple[Trajectory, ...]
    units: dict[str, str] = field(default_factory=lambda: {"q": "rad", "current": "A", "torque": "N·m"})
    """Units of q, current and torque as held here: rad or m, A or V, N·m or N; anything else was converted."""
    source: Path | None = None
    """File or folder it was read from."""
    header: dict[str, Any] = field(default_factory=dict)
    """What all files say alike about how they were made (the virtual bench writes its effects and seed)."""

    @property
    def samples(self) -> int:
        """Samples of all trajectories together."""
        return sum(len(trajectory.t) for trajectory in self.trajectories)


@dataclass(frozen=True, kw_only=True)
class Holding:
    """Break-away tests of a device at rest; both arrays float64, shape (N,)."""

    current: np.ndarray
    """Coil current [A] (or driver voltage [V])."""
    torque: np.ndarray
    """Torque at which the joint started to slip [N·m], or force [N]."""
    header: dict[str, Any] = field(default_factory=dict)
    """What the file says about how it was made."""


# --- reading ---


def load_recording(path: str | Path) -> Recording:
    """Read and check a recording: one CSV or Parquet file, or a folder of them (docs/data.md has the format).

    Reads at most :data:`MAX_BYTES`; writes nothing.

    Raises:
        RecordingError: the recording is refused; the message names file, row and column, and the remedy.
    """
    path = Path(path)
    files = _files(path)
    units = _read_units(path if path.is_dir() else path.parent)
    left = MAX_BYTES
    trajectories: list[Trajectory] = []
    for file in files:
        table, size = _read_table(file, left, _REQUIRED)
        left -= size
        prefix = f"{_stem(file)}/" if path.is_dir() else ""
        trajectories += _trajectories(table, units, prefix)
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
    file = _files(path / HOLDING_FILE if path.is_dir() else path)[0]
    table, _ = _read_table(file, MAX_BYTES, _HOLDING)
    units = _read_units(file.parent)
    columns = _converted(table, units)
    for name in _HOLDING:
        _plausible(table, name, float(np.abs(columns[name]).max()), units)
    return Holding(current=columns["current"], torque=columns["torque"], header=table.header)


@dataclass(frozen=True)
class _Table:
    """The columns of one file, as recorded."""

    file: Path
    columns: dict[str, np.ndarray]
    ids: np.ndarray | None
    """Trajectory of each row, or None for one trajectory."""
    header: dict[str, Any]
    first_line: int | None
    """Line of the first row in a text file, for messages; None where there are no lines."""

    def refuse(self, problem: str, *, row: int | None = None, column: str | None = None) -> RecordingError:
        """The error for a row (counted from 0) and a column of this file."""
        where = str(self.file)
        if row is not None:
            where += f", row {row + 1}" + (f" (line {row + self.first_line})" if self.first_line else "")
        if column is not None:
            where += f", column {column!r}"
        return RecordingError(f"{where}: {problem}")


def _files(path: Path) -> list[Path]:
    """The recording's files, sorted by name."""
    if path.is_dir():
        files = sorted(
            p for p in path.iterdir() if _suffix(p) and p.name != HOLDING_FILE and not p.name.startswith(".")
        )
        if not files:
            inside = sorted(p.name for p in path.iterdir() if p.is_dir() and any(_suffix(f) for f in p.iterdir()))
            hint = f"; name one of its folders: {', '.join(inside)}" if inside else ""
            raise RecordingError(f"{path}: no recording in this folder ({', '.join(SUFFIXES)} files){hint}")
    else:
        files = [path]
    for file in files:
        if not file.exists():
            raise RecordingError(f"{file}: there is no such file or folder; check the path")
        if not file.is_file():
            raise RecordingError(f"{file}: not a regular file; copy the data into a file first")
        if not _suffix(file):
            raise RecordingError(f"{file}: not a known kind of recording; use {', '.join(SUFFIXES)}")
    return files


def _suffix(path: Path) -> str:
    """The recording suffix of a file name, or an empty string."""
    return next((s for s in reversed(SUFFIXES) if path.name.lower().endswith(s)), "")


def _stem(path: Path) -> str:
    return path.name[: len(path.name) - len(_suffix(path))]


def _common(headers: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The entries that all headers hold alike."""
    first = headers[0]
    return {k: v for k, v in first.items() if all(k in h and h[k] == v for h in headers[1:])}


def _read_table(file: Path, limit: int, required: Sequence[str]) -> tuple[_Table, int]:
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
        raise _too_large(file, size)
    suffix = _suffix(file)
    if suffix == ".parquet" or start == b"PAR1":
        return _read_parquet(file, limit, required)
    data = _gunzip(file, limit) if start[:2] == b"\x1f\x8b" else file.read_bytes()
    if suffix == ".csv.gz" and start[:2] != b"\x1f\x8b":
        raise RecordingError(f"{file}: named .gz, but not compressed with gzip; rename it to .csv or compress it")
    if not data:
        raise RecordingError(f"{file}: the file is empty; record it again")
    return _read_csv(file, data, required), len(data)


def _too_large(file: Path, size: int) -> RecordingError:
    return RecordingError(
        f"{file}: {'more than ' if size == MAX_BYTES + 1 else ''}{size / 2**30:.1f} GiB is more than is read at once "
        f"({MAX_BYTES / 2**20:g} MiB per recording, uncompressed); split it into several recordings"
    )


def _gunzip(file: Path, limit: int) -> bytes:
    """Uncompressed content; stops at the limit, whatever the file claims."""
    chunks, total = [], 0
    try:
        with gzip.open(file) as stream:
            while chunk := stream.read(2**22):
                if not chunks:
                    _refuse_binary(file, chunk)
                chunks.append(chunk)
                total += len(chunk)
                if total > limit:
                    raise _too_large(file, MAX_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        raise RecordingError(f"{file}: the gzip data is damaged ({error}); copy or record it again") from None
    return b"".join(chunks)


def _refuse_binary(file: Path, data: bytes) -> None:
    start = data[:4096]
    if b"\0" in start or sum(byte < 9 or 13 < byte < 32 for byte in start) > 0:
        raise RecordingError(
            f"{file}: binary data, not text; export it as CSV with columns t, q, qd, current, torque, or as .parquet"
        )


def _read_csv(file: Path, data: bytes, required: Sequence[str]) -> _Table:
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
    table = _Table(file, {}, None, header, None if blank_lines else lines + 2)
    _check_names(table, names, line, required)
    body = pa.py_buffer(data).slice(first)
    if not data[first : first + 256].strip():
        raise table.refuse("no samples, only the column names; record it again")
    try:
        content = pyarrow.csv.read_csv(
            pa.BufferReader(body),
            read_options=pyarrow.csv.ReadOptions(column_names=names),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types={n: pa.string() if n == "trajectory" else pa.float64() for n in names},
                include_columns=[n for n in names if n in _SI or n == "trajectory"],
                null_values=_NULLS,
            ),
        )
    except (pa.ArrowInvalid, UnicodeDecodeError) as error:
        raise _bad_line(table, names, data[first:], str(error)) from None
    return _with_columns(table, content)


def _read_comment(line: str, header: dict[str, Any]) -> None:
    """Take ``# key: value`` with a JSON value, or keep the text where it is none."""
    key, colon, value = line.lstrip("# ").partition(":")
    if colon:
        try:
            header[key.strip()] = json.loads(value)
        except (ValueError, RecursionError):
            header[key.strip()] = value.strip()


def _check_names(table: _Table, names: list[str], line: str, required: Sequence[str]) -> None:
    """Refuse missing and double columns, with the likely reason."""
    missing = [name for name in required if name not in names]
    if missing:
        if len(names) == 1 and re.search(r"[;\t]", line):
            hint = "columns must be separated by commas, numbers written with a decimal point"
        elif all(re.fullmatch(r"[-+.\deE]+", name) for name in names):
            hint = f"the first line must name the columns: {', '.join(required)}"
        else:
            near = [name for name in names if name.lower() in (missing[0], *_ALIASES[missing[0]])]
            hint = f"rename {near[0]!r} to {missing[0]!r}" if near else f"add it [{_SI[missing[0]]}]"
        raise table.refuse(f"column {missing[0]!r} is missing (found: {', '.join(names)[:200]}); {hint}")
    double = [name for name in names if names.count(name) > 1]
    if double:
        raise table.refuse(f"two columns are called {double[0]!r}; remove or rename one")


_ALIASES = {
    "t": ("time", "timestamp", "t [s]", "time [s]"),
    "q": ("theta", "position", "angle", "displacement", "pos"),
    "current": ("i", "i_coil", "coil_current", "amps"),
    "torque": ("tau", "force", "moment"),
}


def _bad_line(table: _Table, names: list[str], body: bytes, message: str) -> RecordingError:
    """Find the line that the fast reader could not take."""
    numeric = [(i, name) for i, name in enumerate(names) if name in _SI]
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


def _read_parquet(file: Path, limit: int, required: Sequence[str]) -> tuple[_Table, int]:
    table = _Table(file, {}, None, {}, None)
    try:
        with pa.OSFile(str(file)) as stream:
            parquet = pyarrow.parquet.ParquetFile(stream)
            names = parquet.schema_arrow.names
            wanted = [n for n in names if n in _SI or n == "trajectory"]
            # 8 bytes a value: what the file takes in memory, however well it is compressed
            size = 8 * parquet.metadata.num_rows * max(len(wanted), 1)
            if size > limit:
                raise _too_large(file, size)
            _check_names(table, names, ",".join(names), required)
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
    return _with_columns(replace(table, header=header if isinstance(header, dict) else {}), content), size


def _with_columns(table: _Table, content: pa.Table) -> _Table:
    """Arrow's columns as arrays: numbers float64 with NaN for empty cells, trajectory ids as strings."""
    columns, ids = {}, None
    for name in content.column_names:
        column = content[name]
        if name == "trajectory":
            if column.null_count:
                row = int(np.flatnonzero(column.is_null().to_numpy())[0])
                raise table.refuse("no trajectory id; fill in the column or leave it out", row=row, column=name)
            ids = np.asarray(column.cast(pa.string()).to_pylist(), dtype=object)
            continue
        try:
            columns[name] = column.cast(pa.float64()).to_numpy().astype(np.float64)
        except pa.ArrowException:
            raise table.refuse(f"holds {column.type}, not numbers; store it as double", column=name) from None
    return replace(table, columns=columns, ids=ids)


# --- checking ---


def _trajectories(table: _Table, units: _Units, prefix: str) -> list[Trajectory]:
    """The trajectories of one file, converted and checked."""
    columns = _converted(table, units)
    flag = bool(table.header.get("qd_derived", False))
    parts = []
    for name, rows in _groups(table.ids):
        part = {key: values if rows is None else values[rows] for key, values in columns.items()}
        _check_time(table, part["t"], np.arange(len(part["t"])) if rows is None else rows, name)
        dt = (part["t"][-1] - part["t"][0]) / (len(part["t"]) - 1)
        derived = "qd" not in part
        parts.append(
            Trajectory(
                id=f"{prefix}{name}" if name is not None else _stem(table.file),
                qd=differentiate(part["q"], dt) if derived else part.pop("qd"),
                qd_derived=derived or flag,
                header=table.header,
                **part,
            )
        )
    if not units.trusted:
        _check_units(table, parts, units)
    return parts


def _converted(table: _Table, units: _Units) -> dict[str, np.ndarray]:
    """The columns in the units that are kept, each value a finite number."""
    for name, values in table.columns.items():
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            what = "an empty cell or NaN" if np.isnan(values[row]) else "infinity"
            raise table.refuse(f"{what} instead of a number; cut it out or record again", row=row, column=name)
    return {name: units.convert(name, values) for name, values in table.columns.items()}


def _groups(ids: np.ndarray | None) -> Iterator[tuple[str | None, np.ndarray | None]]:
    """Rows of each trajectory in the order of first appearance."""
    if ids is None:
        yield None, None
        return
    names, first, code = np.unique(ids, return_index=True, return_inverse=True)
    rows = np.split(np.argsort(code, kind="stable"), np.cumsum(np.bincount(code))[:-1])
    for k in np.argsort(first):
        yield str(names[k]), rows[k]


def _check_time(table: _Table, t: np.ndarray, rows: np.ndarray, name: str | None) -> None:
    of = "" if name is None else f" of trajectory {name!r}"
    if len(t) < MIN_SAMPLES:
        raise table.refuse(f"{len(t)} samples{of}; at least {MIN_SAMPLES} are needed, record a longer run")
    step = np.diff(t)
    if (step <= 0.0).any():
        k = int(np.flatnonzero(step <= 0.0)[0])
        raise table.refuse(
            f"time does not increase{of}: {t[k + 1]:.9g} s after {t[k]:.9g} s; sort the rows, or give each run its own "
            "'trajectory' id",
            row=int(rows[k + 1]),
            column="t",
        )
    dt = float(np.median(step))
    if dt > 1.0:
        raise table.refuse(
            f"{dt:g} s between samples{of}: these look like milliseconds; divide by 1000, or declare the unit in "
            'units.json: {"t": "ms"}',
            column="t",
        )
    odd = np.abs(step - dt) > MAX_JITTER * dt
    if odd.any():
        k = int(np.flatnonzero(odd)[0])
        what = "a gap" if step[k] > dt else "uneven sampling"
        raise table.refuse(
            f"{what}{of}: {step[k]:.6g} s between samples, elsewhere {dt:.6g} s; split the run there into two "
            "trajectories, or resample it uniformly",
            row=int(rows[k + 1]),
            column="t",
        )


_PLAUSIBLE = {
    # base unit: largest plausible value, unit that larger values are likely in, where the limit comes from
    "rad": (2.0 * np.pi, "deg"),  # a joint does not leave its middle by more than a turn
    "m": (10.0, "mm"),
    "A": (50.0, "mA"),  # MR coils take a few ampere
    "V": (500.0, "mV"),
    "N·m": (300.0, "mN·m"),  # ten times the paper's 26 N·m joint
    "N": (1.0e6, "mN"),
}
_DEGREES = 180.0 / np.pi


def _check_units(table: _Table, parts: list[Trajectory], units: _Units) -> None:
    """Refuse values that are clearly in another unit than declared."""
    _plausible(table, "q", max(float(np.abs(part.q - np.median(part.q)).max()) for part in parts), units)
    _plausible(table, "current", max(float(np.abs(part.current).max()) for part in parts), units)
    _plausible(table, "torque", max(float(np.abs(part.torque).max()) for part in parts), units)
    if units.base("q") != "rad":
        return
    for part in parts:
        ratio = derivative_ratio(part)
        if part.qd_derived or not (0.6 < ratio / _DEGREES < 1.6 or 0.6 < ratio * _DEGREES < 1.6):
            continue
        key, unit, other = ("q", "deg", "qd") if ratio > 1.0 else ("qd", "deg/s", "q")
        declared = {"q": "deg", "qd": "rad/s"} if key == "q" else {"q": "rad", "qd": "deg/s"}
        raise table.refuse(
            f"dq/dt is {ratio:.3g} times qd in trajectory {part.id!r}, so {key} looks like {unit} where {other} is in "
            f"radians; convert it, or declare it in units.json beside the file: {json.dumps(declared)}",
            column=key,
        )


def _plausible(table: _Table, key: str, largest: float, units: _Units) -> None:
    """Refuse a column whose largest value no device of this kind reaches."""
    base = units.base(key)
    limit, likely = _PLAUSIBLE[base]
    if units.trusted or largest <= limit:
        return
    what = "away from their median" if key == "q" else "in size"
    raise table.refuse(
        f"values up to {largest:.4g} {base} {what} look like {likely}; convert them, or declare the unit in units.json "
        f'beside the file: {{"{key}": "{likely}"}} (if they really are {base}: {{"trust_units": true}})',
        column=key,
    )


def derivative_ratio(part: Trajectory) -> float:
    """RMS of dq/dt over RMS of the trajectory's qd; 1 where either rests."""
    derived = differentiate(part.q, part.dt)
    own, other = float(np.sqrt(np.mean(part.qd**2))), float(np.sqrt(np.mean(derived**2)))
    return other / own if own > 1e-9 and other > 1e-9 else 1.0


# --- units ---

_CONVERSIONS: dict[str, dict[str, tuple[float, str]]] = {
    "t": {"s": (1.0, "s"), "ms": (1e-3, "s"), "us": (1e-6, "s"), "µs": (1e-6, "s")},
    "q": {
        "rad": (1.0, "rad"), "deg": (1.0 / _DEGREES, "rad"), "degree": (1.0 / _DEGREES, "rad"),
        "degrees": (1.0 / _DEGREES, "rad"), "°": (1.0 / _DEGREES, "rad"), "mrad": (1e-3, "rad"),
        "m": (1.0, "m"), "mm": (1e-3, "m"),
    },
    "qd": {
        "rad/s": (1.0, "rad/s"), "deg/s": (1.0 / _DEGREES, "rad/s"), "°/s": (1.0 / _DEGREES, "rad/s"),
        "mrad/s": (1e-3, "rad/s"), "rpm": (2.0 * np.pi / 60.0, "rad/s"), "m/s": (1.0, "m/s"), "mm/s": (1e-3, "m/s"),
    },
    "current": {"A": (1.0, "A"), "mA": (1e-3, "A"), "V": (1.0, "V"), "mV": (1e-3, "V")},
    "torque": {
        "N·m": (1.0, "N·m"), "Nm": (1.0, "N·m"), "N*m": (1.0, "N·m"), "N.m": (1.0, "N·m"), "N m": (1.0, "N·m"),
        "mN·m": (1e-3, "N·m"), "mNm": (1e-3, "N·m"), "mN*m": (1e-3, "N·m"), "kN·m": (1e3, "N·m"),
        "kNm": (1e3, "N·m"), "N": (1.0, "N"), "mN": (1e-3, "N"), "kN": (1e3, "N"),
    },
    "temperature": {"degC": (1.0, "degC"), "°C": (1.0, "degC"), "C": (1.0, "degC"), "K": (1.0, "degC")},
}  # fmt: skip
"""Unit as declared to its factor and the unit that is kept."""


@dataclass(frozen=True)
class _Units:
    """What ``units.json`` declares, completed."""

    declared: dict[str, str]
    trusted: bool = False
    """Values are not compared with what is plausible."""

    def base(self, key: str) -> str:
        """Unit that the values have after :meth:`convert`."""
        return _CONVERSIONS[key][self.declared[key]][1]

    def convert(self, key: str, values: np.ndarray) -> np.ndarray:
        """Values in the unit that is kept."""
        factor = _CONVERSIONS[key][self.declared[key]][0]
        if self.declared[key] == "K":
            return values - 273.15
        return values if factor == 1.0 else values * factor


def _read_units(folder: Path) -> _Units:
    path = folder / "units.json"
    declared: dict[str, Any] = {}
    if path.is_file():
        try:
            declared = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError) as error:
            raise RecordingError(f"{path}: not readable as JSON ({error}); repair or remove it") from None
        if not isinstance(declared, dict):
            raise RecordingError(f'{path}: must hold one object, e.g. {{"q": "deg", "current": "mA"}}')
    trusted = declared.pop("trust_units", False)
    if not isinstance(trusted, bool):
        raise RecordingError(f"{path}: trust_units = {trusted!r} must be true or false")
    units = dict(_SI)
    for key, unit in declared.items():
        if key not in _CONVERSIONS:
            raise RecordingError(f"{path}: there is no column {key!r}; known: {', '.join(_CONVERSIONS)}")
        if not isinstance(unit, str) or unit not in _CONVERSIONS[key]:
            known = ", ".join(_CONVERSIONS[key])
            raise RecordingError(f"{path}: the unit {unit!r} of {key} is not known; use one of {known}")
        units[key] = unit
    if "q" in declared and "qd" not in declared:
        units["qd"] = {"degree": "deg", "degrees": "deg"}.get(units["q"], units["q"]) + "/s"
    result = _Units(units, trusted)
    linear = result.base("q") == "m"
    for key, wanted in (("qd", "m/s" if linear else "rad/s"), ("torque", "N" if linear else "N·m")):
        if result.base(key) != wanted:
            raise RecordingError(
                f"{path}: q in {units['q']} does not go with {key} in {units[key]}; declare {key} in {wanted}"
            )
    return result


# --- writing ---


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
    folder = path.parent if _suffix(path) else path
    folder.mkdir(parents=True, exist_ok=True)
    _write_units(folder, recording.units)
    added = {**recording.header, **(header or {})}
    if _suffix(path):
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
    path, usual = folder / "units.json", {key: _SI[key] for key in units}
    if path.is_file():
        there = _read_units(folder)
        if any(there.declared[key] != unit for key, unit in units.items()):
            raise RecordingError(f"{path}: the files beside it are in other units; choose another folder")
    elif units != usual:
        _replace(path, (json.dumps(units, ensure_ascii=False, indent=1) + "\n").encode())


def save_holding(holding: Holding, folder: str | Path) -> Path:
    """Write break-away tests as ``folder/holding.csv``, with their header."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    file = Path(folder) / HOLDING_FILE
    table = pa.table({name: pa.array(getattr(holding, name)) for name in _HOLDING})
    _replace(file, _csv(table, holding.header))
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
        _replace(file, sink.getvalue())
        return
    data = _csv(table, header)
    # no time stamp and a fixed level: the same recording gives the same bytes
    _replace(file, gzip.compress(data, 6, mtime=0) if file.name.endswith(".gz") else data)


def _csv(table: pa.Table, header: dict[str, Any]) -> bytes:
    """CSV text with the header as ``# key: JSON`` lines; numbers have as many digits as bring them back exactly."""
    sink = io.BytesIO()
    for key, value in header.items():
        sink.write(f"# {key}: {json.dumps(value)}\n".encode())
    sink.write((",".join(table.column_names) + "\n").encode())
    pyarrow.csv.write_csv(table, sink, pyarrow.csv.WriteOptions(include_header=False, quoting_style="needed"))
    return sink.getvalue()


def _replace(path: Path, data: bytes) -> None:
    """Write in one piece: whoever reads sees the old file or the new one."""
    partial = path.with_name(path.name + ".part")
    partial.write_bytes(data)
    os.replace(partial, path)
