"""One file of a recording as it was logged: its columns, and what is wrong with their names and types."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from mrwarp.recording.data import UNITS, RecordingError

_ALIASES = {
    "t": ("time", "timestamp", "t [s]", "time [s]"),
    "q": ("theta", "position", "angle", "displacement", "pos"),
    "current": ("i", "i_coil", "coil_current", "amps"),
    "torque": ("tau", "force", "moment"),
}


@dataclass(frozen=True)
class Table:
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


def check_names(table: Table, names: list[str], line: str, required: Sequence[str]) -> None:
    """Refuse missing and double columns, with the likely reason."""
    missing = [name for name in required if name not in names]
    if missing:
        if len(names) == 1 and re.search(r"[;\t]", line):
            hint = "columns must be separated by commas, numbers written with a decimal point"
        elif all(re.fullmatch(r"[-+.\deE]+", name) for name in names):
            hint = f"the first line must name the columns: {', '.join(required)}"
        else:
            near = [name for name in names if name.lower() in (missing[0], *_ALIASES[missing[0]])]
            hint = f"rename {near[0]!r} to {missing[0]!r}" if near else f"add it [{UNITS[missing[0]]}]"
        found = ", ".join(name if name.isprintable() else repr(name) for name in names)[:200]
        raise table.refuse(f"column {missing[0]!r} is missing (found: {found}); {hint}")
    double = [name for name in names if names.count(name) > 1]
    if double:
        raise table.refuse(f"two columns are called {double[0]!r}; remove or rename one")


def with_columns(table: Table, content: pa.Table) -> Table:
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
