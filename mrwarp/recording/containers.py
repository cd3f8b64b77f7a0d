"""Arrays by name out of the files of MATLAB and numpy, and the cells of a spreadsheet.

Nothing in such a file is run: MATLAB's are read as numbers, numpy's without pickles.
"""

from __future__ import annotations

import csv
import io
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.recording.agreement import SAME
from mrwarp.recording.data import NO_INPUT, RecordingError, is_command

_COLUMNS = 64
"""Most columns of a matrix whose columns have names of their own."""
_FEWEST = 50
"""Fewest samples of an array that is a column: as many as a run needs."""
_DEPTH = 4
"""Structures within structures that are looked into."""


def arrays_of(file: Path, limit: int) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Numeric arrays of a ``.mat`` or ``.npz`` by name, and its single numbers and texts.

    Fields of a structure are called ``data.q``, columns of a matrix ``X[:,0]``; a matrix that is called as asked for
    may hold a run in each column.

    Args:
        file: The file.
        limit: Largest content [bytes].

    Raises:
        RecordingError: it is too large, damaged, or holds pickles.
    """
    if file.suffix.lower() == ".npz":
        found = _npz(file, limit)
    else:
        with file.open("rb") as stream:
            new = stream.read(512).startswith(b"MATLAB 7.3") or _is_hdf5(file)
        found = _hdf5(file) if new else _mat(file)
    arrays, header = dict[str, np.ndarray](), dict[str, Any]()
    for name, value in found:
        if isinstance(value, str):
            header[name] = value
        elif value.size == 1:
            header[name] = value.item()
        elif value.dtype.kind in "biuf" and value.ndim <= 2:
            arrays |= _columns(name, np.squeeze(value).astype(np.float64))
    if sum(8 * x.size for x in arrays.values()) > 2 * limit:
        raise RecordingError(f"{file}: larger than what is read at once; split it into several recordings")
    return arrays, header


def _columns(name: str, value: np.ndarray) -> dict[str, np.ndarray]:
    """An array under its name, a matrix also column by column, samples first."""
    if value.ndim < 2:
        return {name: value}
    value = value.T if value.shape[0] < value.shape[1] else value
    found = {name: value}
    if value.shape[1] <= _COLUMNS:
        found |= {f"{name}[:,{k}]": value[:, k] for k in range(value.shape[1])}
    return found


def _npz(file: Path, limit: int) -> Iterator[tuple[str, Any]]:
    try:
        with zipfile.ZipFile(file) as archive:
            if sum(part.file_size for part in archive.infolist()) > limit:
                raise RecordingError(f"{file}: larger than what is read at once; split it into several recordings")
        with np.load(file, allow_pickle=False) as content:
            for name in content.files:
                value = content[name]
                yield name, str(value) if value.dtype.kind in "US" and value.size == 1 else value
    except (OSError, ValueError, KeyError, zipfile.BadZipFile, EOFError) as error:
        reason = str(error).splitlines()[0][:120]
        raise RecordingError(f"{file}: not a readable .npz of plain arrays ({reason}); save it again") from None


def _mat(file: Path) -> Iterator[tuple[str, Any]]:
    from scipy.io import loadmat  # most recordings are CSV

    try:
        content = loadmat(file, squeeze_me=True, struct_as_record=False)
    except Exception as error:  # a damaged file raises any error
        reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise RecordingError(f"{file}: not a readable MATLAB file ({reason}); save it again with -v7") from None
    for name, value in content.items():
        if not name.startswith("__"):
            yield from _fields(name, value, _DEPTH)


def _fields(name: str, value: Any, depth: int) -> Iterator[tuple[str, Any]]:
    """Arrays and texts of a value of MATLAB, those of a structure by its fields."""
    if hasattr(value, "_fieldnames"):
        for field in value._fieldnames if depth else ():
            yield from _fields(f"{name}.{field}", getattr(value, field), depth - 1)
    elif isinstance(value, str):
        yield name, value
    elif isinstance(value, np.ndarray) and value.dtype == object:
        for k, part in enumerate(value.ravel()[:_COLUMNS] if depth else ()):
            yield from _fields(f"{name}[{k}]", part, depth - 1)
    elif np.asarray(value).dtype.kind in "biuf":
        yield name, np.asarray(value)


def _is_hdf5(file: Path) -> bool:
    with file.open("rb") as stream:
        return any(stream.read(8) == b"\x89HDF\r\n\x1a\n" for offset in (0, 512) if stream.seek(offset) == offset)


def _hdf5(file: Path) -> Iterator[tuple[str, Any]]:
    import h5py  # an extra: MATLAB's newer files alone

    def walk(group: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
        for key, value in group.items():
            inside = f"{name}.{key}" if name else key
            if isinstance(value, h5py.Group) and depth and not key.startswith("#"):
                yield from walk(value, inside, depth - 1)
            elif isinstance(value, h5py.Dataset) and value.dtype.kind in "biuf":
                if value.attrs.get("MATLAB_class") == b"char":
                    yield inside, "".join(chr(int(code)) for code in np.asarray(value).flat)
                else:
                    yield inside, np.asarray(value).T

    try:
        with h5py.File(file, "r") as content:
            yield from walk(content, "", _DEPTH)
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        reason = str(error).splitlines()[0][:120]
        raise RecordingError(f"{file}: not a readable MATLAB file ({reason}); save it again with -v7") from None


def sheet_as_text(file: Path, limit: int) -> bytes:
    """The first sheet of a spreadsheet that holds numbers, as a CSV.

    Raises:
        RecordingError: it is damaged, too large, or holds none.
    """
    import openpyxl  # an extra

    try:
        with zipfile.ZipFile(file) as archive:
            if sum(part.file_size for part in archive.infolist()) > limit:
                raise RecordingError(f"{file}: larger than what is read at once; save the sheet as CSV")
        book = openpyxl.load_workbook(file, read_only=True, data_only=True)
        for sheet in book.worksheets:
            text = io.StringIO()
            writer = csv.writer(text, lineterminator="\n")
            numbers = 0
            for row in sheet.iter_rows(values_only=True):
                cells = list(row)
                while cells and cells[-1] is None:
                    cells.pop()
                numbers += sum(isinstance(cell, int | float) for cell in cells) > 1
                if cells:
                    writer.writerow(["" if cell is None else cell for cell in cells])
            if numbers:
                return text.getvalue().encode()
    except RecordingError:
        raise
    except Exception as error:  # a damaged archive raises any error
        reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
        raise RecordingError(f"{file}: not a readable spreadsheet ({reason}); save the sheet as CSV") from None
    raise RecordingError(f"{file}: no sheet holds a table of numbers; save the sheet as CSV")


def as_columns(
    arrays: Mapping[str, np.ndarray], ids: np.ndarray | None
) -> tuple[dict[str, np.ndarray], np.ndarray | None]:
    """Columns of equal length; matrices hold a run in each column, and become one after another.

    Raises:
        ValueError: their lengths differ.
    """
    shapes = {name: x.shape for name, x in arrays.items()}
    lengths = {shape[0] for shape in shapes.values()}
    runs = {shape[1] for shape in shapes.values() if len(shape) > 1}
    if len(lengths) > 1 or len(runs) > 1:
        listed = ", ".join(f"{name} {' x '.join(map(str, shape))}" for name, shape in shapes.items())
        raise ValueError(f"arrays of different lengths ({listed}); cut them to the same samples")
    if not runs:
        return dict(arrays), None if ids is None else np.asarray(ids.tolist()).astype(str).astype(object)
    length, count = lengths.pop(), runs.pop()
    columns = {name: x.T.ravel() if x.ndim > 1 else np.tile(x, count) for name, x in arrays.items()}
    return columns, np.repeat(np.array([f"{k + 1:02d}" for k in range(count)], dtype=object), length)


def guessed(arrays: Mapping[str, np.ndarray], called: Mapping[str, str], meant: Callable[[str], str]) -> dict[str, Any]:
    """A declaration of which array is likely which quantity: by its name, else by how it runs; "..." where none is.

    The time rises evenly, the velocity is the derivative of the angle, and a control input stays for a while.
    """
    long = {name: x for name, x in arrays.items() if x.ndim == 1 and len(x) >= _FEWEST}
    found = dict(called)
    for name in long:
        quantity = meant(name.rpartition(".")[2])
        if quantity and quantity not in found and name not in found.values():
            found[quantity] = name
    free = [name for name in long if name not in found.values()]
    rising = [name for name in free if (np.diff(long[name]) > 0.0).all()]
    if "t" not in found and rising:
        found["t"] = min(rising, key=lambda name: float(np.ptp(np.diff(long[name])) / np.ptp(long[name])))
        free.remove(found["t"])
    if "qd" not in found and found.get("t") in long:
        angles = [found["q"]] if found.get("q") in long else free
        found |= _angle_of(long, long[found["t"]], angles, free)
    length = len(long.get(found.get("t", ""), ()))
    free = [name for name in free if name not in found.values() and len(long[name]) == length]
    commands = [name for name in free if is_command(long[name])]
    if "current" not in found and len(commands) == 1 and len(free) > 1:
        found["current"] = commands[0]
        free.remove(commands[0])
    if "torque" not in found and len(free) == 1:
        found["torque"] = free.pop()
    wanted = ("q", "torque", *(("current",) if free else ()))
    found |= {quantity: "..." for quantity in wanted if quantity not in found}
    content: dict[str, Any] = {"columns": {k: found[k] for k in ("t", "q", "qd", "current", "torque") if k in found}}
    return content if "current" in found else {**content, "current": NO_INPUT}


def _angle_of(
    long: Mapping[str, np.ndarray], t: np.ndarray, angles: Sequence[str], free: Sequence[str]
) -> dict[str, str]:
    """The two arrays of which one is the derivative of the other, if any are."""
    best, pair = 1.0 - SAME, dict[str, str]()
    for q in [name for name in angles if len(long[name]) == len(t)]:
        rate = np.gradient(long[q], t)
        for qd in [name for name in free if name != q and len(long[name]) == len(t)]:
            norm = float(np.linalg.norm(rate) * np.linalg.norm(long[qd]))
            together = float(rate @ long[qd]) / norm if norm > 0.0 else 0.0
            if together > best:
                best, pair = together, {"q": q, "qd": qd}
    return pair
