"""Tables as text: the separator, the names and the decimal sign are found; a long file is read in pieces.

A file of millions of rows per second is averaged while it is read, so that its memory is that of the slower log.
"""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, BinaryIO

import numpy as np

from mrwarp.recording.data import UNITS, RecordingError

EMPTY = frozenset(("", "#N/A", "NA", "N/A", "n/a", "NULL", "null", "None", "nan", "NaN", "NAN", "-nan", "-NaN"))
"""Cells that programs write where there is no number."""
NO_ID = "no trajectory id; fill in the column or leave it out"
"""Refusal of a row whose trajectory is not named."""
MARKS = ("#", "%")
"""Beginnings of lines that are no data: a header, or the names of columns as numpy and MATLAB write them."""

_SEPARATORS = ("\t", ";", ",", None)
"""Separators of cells; None: white space."""
_PIECE = 2**22
"""Bytes that are parsed at once: many rows, and little memory."""
_LOOKED_AT = 40
"""Most lines in which the names of columns are looked for."""
_LINE = 4000
"""Longest line that may name columns."""
_ALIKE = 20
"""Fewest lines by which the last one is judged."""
_FASTEST, _KEPT = 20_000.0, 10_000.0
"""Sampling rate [Hz] above which means over samples are read, and the least rate of these: a joint's coil, friction and
shaft act within milliseconds."""
_LAST_NUMBER = re.compile(r"[.,](\d*)(?:[eE][-+]?\d+)?\s*$")
_DECIMAL_COMMA = re.compile(r"^[-+]?\d+,\d+(?:[eE][-+]?\d+)?$")


@dataclass
class Text:
    """A table that was read from text."""

    names: list[str]
    header: dict[str, Any]
    line: str
    """The line of names, as it stands."""
    first_line: int | None
    """Line of the first row; None where rows are not lines."""
    separator: str | None
    """None: any white space."""
    comma: bool = False
    """Whether numbers have a decimal comma."""
    columns: dict[str, np.ndarray] = field(default_factory=dict)
    ids: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)
    size: int = 0


class CellError(Exception):
    """A cell or a line that cannot be read: what is wrong, its row counted from 0, and the column."""

    def __init__(self, problem: str, row: int, column: str | None = None) -> None:
        super().__init__(problem)
        self.problem, self.row, self.column = problem, row, column


def read_head(data: bytes, known: Callable[[str], bool]) -> tuple[Text, int]:
    """Header and names of a table, and where its rows begin.

    Args:
        data: The beginning of the file.
        known: Whether a column may be called so.

    Raises:
        RecordingError: there are no names; without the file's name.
    """
    position = 3 if data.startswith(b"\xef\xbb\xbf") else 0  # a spreadsheet's mark before UTF-8
    header: dict[str, Any] = {}
    lines, commented, skipped, first = 0, "", 0, None
    found: tuple[str, int, int] | None = None
    while position < len(data) and skipped < _LOOKED_AT:
        end = data.find(b"\n", position) + 1 or len(data)
        line = data[position:end].decode("utf-8", "replace").strip()
        lines += 1
        if line.startswith(MARKS):
            bare = line.lstrip("#% \t")
            key, colon, value = bare.partition(":")
            names = next((x for x in (value, bare) if _named(x, known) > 1), "")
            if colon and not names:
                header[key.strip()] = _value(value)
            else:
                commented = names or bare or commented
        elif line and _numbers(line) and commented and len(_split(commented, _separator(commented))) == _numbers(line):
            found = commented, position, lines  # the rows begin here
            break
        elif line:
            if first is None:
                first = line, end, lines + 1
            if _named(line, known) or not skipped and _numbers(line):
                found = line, end, lines + 1
                break
            skipped += 1
        position = end
    if found is None and first is None:
        raise RecordingError("no columns; the first line must name them")
    line, begin, number = found or first  # pyright: ignore[reportGeneralTypeIssues]
    separator = _separator(line)
    names = _split(line, separator)
    table = Text(names=names, header=header, line=line, first_line=number, separator=separator)
    if found and skipped and first and first[0] != line:
        table.notes.append(f"{skipped} lines before the names of the columns are left out")
    sample = data[begin : begin + 4096].decode("utf-8", "replace").splitlines()[:_ALIKE]
    cells = [cell for row in sample for cell in _split(row, separator)]
    table.comma = separator != "," and any(_DECIMAL_COMMA.match(cell) for cell in cells)
    if separator is None and sample and len(names) > len(_split(sample[0], None)):
        table.names = _joined(names)
    return table, begin


def read_rows(
    table: Text,
    pieces: Iterator[bytes],
    keep: Callable[[str], bool],
    seconds: Callable[[np.ndarray], np.ndarray] | None,
) -> None:
    """Read the rows of a table into its columns.

    Args:
        table: Its names; takes columns, ids and notes.
        pieces: Its content from the first row on, in any pieces.
        keep: Whether a column, by its name, is read.
        seconds: Turns stamps into seconds, so that quick samples are averaged; None: all are read.

    Raises:
        CellError: a line or a cell cannot be read.
        UnicodeDecodeError: it is no text.
    """
    wanted = [k for k, name in enumerate(table.names) if keep(name) and name != "trajectory"]
    at = table.names.index("trajectory") if "trajectory" in table.names and keep("trajectory") else None
    found: list[np.ndarray] = []
    ids: list[np.ndarray] = []
    rows, every, left = 0, 0, np.empty((0, len(wanted)))
    for text, last in _texts(pieces):
        if last:
            text, cut = _without_cut_line(text, table)
            table.notes += [cut] if cut else []
        if "\n\n" in text.rstrip("\n") or "\n\r\n" in text.rstrip():
            table.first_line = None
        if not text.strip():
            continue
        values, names = _parsed(text, table, wanted, at, rows)
        rows += len(values)
        table.size += 8 * values.size
        if at is not None:
            ids.append(names)
        if not every:
            every = _averaged(values, [table.names[k] for k in wanted], seconds if at is None else None)
        if every > 1:
            values = np.concatenate([left, values])
            whole = len(values) // every * every
            left, values = values[whole:], _means(values[:whole], every, [table.names[k] for k in wanted])
        found.append(values)
    together = np.concatenate(found) if found else left
    table.columns = {table.names[k]: together[:, i].copy() for i, k in enumerate(wanted)}
    table.ids = np.concatenate(ids) if ids else None
    if every > 1:
        table.first_line = None
        table.notes.append(f"{rows} rows are more than a joint needs: means over {every} of them are used")


def _texts(pieces: Iterator[bytes]) -> Iterator[tuple[str, bool]]:
    """Whole lines as text, and whether they are the last ones; the last have enough of them to be judged by."""
    held, rest = b"", b""
    for piece in pieces:
        rest += piece
        if len(rest) < _PIECE:
            continue
        if held:
            yield held.decode("utf-8"), False
        end = rest.rfind(b"\n") + 1
        held, rest = rest[:end], rest[end:]
    yield (held + rest).decode("utf-8"), True


def _parsed(
    text: str, table: Text, wanted: Sequence[int], at: int | None, before: int
) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of some lines, shape (N, columns), and their ids; ``before`` is the number of rows before them."""
    if table.comma:
        text = text.replace(",", ".")
    ids = np.empty(0, dtype=object)
    values = None if '"' in text else _plain(text, table, wanted)
    if values is None:
        return _cell_by_cell(text, table, wanted, at, before)
    if at is not None:
        rows = (line for line in text.splitlines() if line and not line.isspace())
        ids = np.array([_split(line, table.separator)[at] for line in rows], dtype=object)
        if len(empty := np.flatnonzero(ids == "")):
            raise CellError(NO_ID, before + int(empty[0]), "trajectory")
    return values, ids


def _plain(text: str, table: Text, wanted: Sequence[int]) -> np.ndarray | None:
    """Columns that hold numbers alone; None where a cell is none, or a line is short or quoted."""
    try:
        values = np.loadtxt(io.StringIO(text), delimiter=table.separator, comments=None, usecols=wanted, ndmin=2)
    except ValueError:
        return None
    if table.separator is None:
        return values if len(text.split()) == len(values) * len(table.names) else None
    return values if len(values) and text.count(table.separator) == len(values) * (len(table.names) - 1) else None


def _cell_by_cell(
    text: str, table: Text, wanted: Sequence[int], at: int | None, before: int
) -> tuple[np.ndarray, np.ndarray]:
    """The slow way, which takes text and empty cells, and knows where one is wrong."""
    count = len(table.names)
    try:
        if table.separator is None:
            rows = [row for line in text.splitlines() if (row := line.split())]
        else:
            rows = [row for row in csv.reader(io.StringIO(text), delimiter=table.separator, strict=True) if row]
    except csv.Error as error:
        raise CellError(f"not readable as CSV ({error}); export it again", before) from None
    for k, row in enumerate(rows):
        if len(row) == count + 1 and not row[-1].strip():
            row.pop()  # a separator at the end of the line
        if len(row) != count:
            raise CellError(f"{len(row)} values for {count} columns; complete or remove the line", before + k)
    if rows and not before and not any(_reads(cell) for cell in rows[0]):
        raise CellError(_units_row(table, rows[0]), 0)
    ids = np.array([row[at] for row in rows], dtype=object) if at is not None else np.empty(0, dtype=object)
    if at is not None and len(empty := np.flatnonzero(ids == "")):
        raise CellError(NO_ID, before + int(empty[0]), "trajectory")
    values = np.empty((len(rows), len(wanted)))
    for i, k in enumerate(wanted):
        values[:, i] = [_number(row[k], before + n, table.names[k]) for n, row in enumerate(rows)]
    return values, ids


def _units_row(table: Text, row: Sequence[str]) -> str:
    """Advice on a first row without any number."""
    units = {n: cell.strip(" []()") for n, cell in zip(table.names, row, strict=True) if n in UNITS and cell.strip()}
    declared = json.dumps({n: unit for n, unit in units.items() if unit != UNITS[n]}, ensure_ascii=False)
    hint = f"; if it names units, declare {declared} in units.json" if declared != "{}" else ""
    return f"no number in it ({', '.join(row)[:60]}): remove the line{hint}"


def _averaged(values: np.ndarray, names: Sequence[str], seconds: Callable[[np.ndarray], np.ndarray] | None) -> int:
    """Number of rows of which the means are read, by the rate of the first ones; 1: each row is."""
    if seconds is None or "t" not in names or len(values) < 2:
        return 1
    t = seconds(values[:, list(names).index("t")])
    step = np.diff(t)
    usual = float(np.median(step))
    rate = 1.0 / usual if np.isfinite(usual) and usual > 0.0 else 0.0
    return max(1, round(rate / _KEPT)) if rate > _FASTEST else 1


def _means(values: np.ndarray, every: int, names: Sequence[str]) -> np.ndarray:
    """Means over each ``every`` rows; the control input, which may be a command, is that of the middle row."""
    blocks = values.reshape(-1, every, values.shape[1])
    out = blocks.mean(axis=1)
    if "current" in names:
        k = list(names).index("current")
        out[:, k] = blocks[:, every // 2, k]
    return out


def _without_cut_line(text: str, table: Text) -> tuple[str, str]:
    """Lines without a last one in which the file ends, and a note on it.

    It lacks the line's end, and cells, or digits of a last number that has as many in all the other lines.
    """
    start = text.rfind("\n") + 1
    last = text[start:]
    lines = text[:start].splitlines()
    if not last.strip() or len(lines) < _ALIKE or '"' in last:
        return text, ""
    digits = {_decimals(line) for line in lines}
    fewer = len(_split(last, table.separator)) < len(table.names)
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


def _value(text: str) -> Any:
    """A header's value: JSON, else the text itself."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):
        return text.strip()


def _separator(line: str) -> str | None:
    """Separator of a line's cells: the most frequent of tabulator, semicolon and comma; None: white space."""
    most = max(filter(None, _SEPARATORS), key=line.count)
    return most if line.count(most) else None


def _split(line: str, separator: str | None) -> list[str]:
    """Cells of a line."""
    cells = line.split() if separator is None else line.split(separator)
    cells = [cell.strip().strip('"').strip() for cell in cells]
    return cells[:-1] if len(cells) > 1 and not cells[-1] and separator == ";" else cells


def _named(line: str, known: Callable[[str], bool]) -> int:
    """Cells of a line that are names of columns."""
    return 0 if len(line) > _LINE else sum(map(known, _split(line, _separator(line))))


def _joined(names: Sequence[str]) -> list[str]:
    """Names between spaces, with a unit in brackets that belongs to the one before it."""
    found: list[str] = []
    for name in names:
        if found and name[:1] in "[(":
            found[-1] += f" {name}"
        else:
            found.append(name)
    return found


def _numbers(line: str) -> int:
    """Cells of a line that holds numbers alone, by any separator: a decimal comma is none; 0 for any other line."""
    rows = [_split(line, separator) for separator in _SEPARATORS]
    return max(len(row) if len(row) > 1 and all(map(_reads, row)) else 0 for row in rows)


def _is_row(line: str) -> bool:
    """Whether a line may be a table's row: three cells or more, two numbers at least, one text at most as its id."""
    rows = {separator: _split(line, separator) for separator in _SEPARATORS}
    return any(
        len(row) > 2
        and sum(_reads(cell) and cell not in EMPTY for cell in row) > 1
        and sum(not _reads(cell) for cell in row) <= (separator is not None)  # words stand between spaces
        for separator, row in rows.items()
    )


def _reads(cell: str) -> bool:
    """Whether a cell is a number, of either decimal sign, or empty."""
    try:
        return cell.strip() in EMPTY or np.isfinite(float(cell.replace(",", ".")))
    except ValueError:
        return False


def _number(cell: str, row: int, name: str) -> float:
    text = cell.strip()
    if text in EMPTY:
        return float("nan")
    try:
        if "_" not in text:  # Python's own way to write a number, no other program's
            return float(text)
    except ValueError:
        pass
    problem = f"{text[:40]!r} is no number; write a plain number with a decimal point, or remove the line"
    raise CellError(problem, row, name)


def pieces_of(stream: BinaryIO, before: bytes, limit: int, refuse: Callable[[int], RecordingError]) -> Iterator[bytes]:
    """The beginning of a stream, then its rest in pieces, up to a limit [bytes]."""
    yield before
    total = len(before)
    while piece := stream.read(_PIECE):
        total += len(piece)
        if total > limit:
            raise refuse(total)
        yield piece


def looks_tabular(data: bytes) -> bool:
    """Whether a text holds a table: three rows of one, one after another, within its beginning."""
    if any(byte < 9 or 13 < byte < 32 for byte in data):
        return False
    rows = [_is_row(line) for line in data.decode("utf-8", "replace").splitlines()[: 2 * _LOOKED_AT]]
    return any(map(all, zip(rows, rows[1:], rows[2:], strict=False)))
