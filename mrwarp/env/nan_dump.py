"""What the NaN guard finds in an environment in which a number went wrong, and its file (safetensors).

Loads neither Warp nor torch.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from mrwarp.run_dir import atomic_write, no_file, one_line

META = "mrwarp_dump"
SCHEMA = 1
"""Version of the dump's layout."""

KEPT = 100
"""States kept per environment: as many torque steps, half a second."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One number of a kept state."""

    quantity: str
    """What it is, e.g. ``torque``."""
    part: str
    """Joint, leg or axis; empty where there is one only."""
    unit: str
    """Unit; empty for plain numbers."""

    def __str__(self) -> str:
        return f"{self.quantity} of {self.part}" if self.part else self.quantity


@dataclass(frozen=True, kw_only=True)
class Divergence:
    """What went wrong in one environment, and its last states."""

    env: int
    """Index of the environment."""
    columns: tuple[Column, ...]
    """What the columns of ``states`` are; the first is the time in the episode [s]."""
    states: np.ndarray
    """Up to :data:`KEPT` torque steps, oldest first, the last one is the wrong one; shape (n, D)."""
    bounds: np.ndarray
    """Least and largest value of each column of a sound state, shape (2, D)."""
    run: dict[str, Any] = field(default_factory=dict)
    """Seed, update and task of the run, plain values; of one that was read from a file."""

    def pick(self, quantity: str, unit: str) -> np.ndarray:
        """Columns of a quantity, shape (n, K)."""
        return self.states[:, [i for i, c in enumerate(self.columns) if (c.quantity, c.unit) == (quantity, unit)]]

    @property
    def finite(self) -> bool:
        """Whether all of the wrong state are numbers, one of them beyond its bounds."""
        return bool(np.isfinite(self.states[-1]).all())

    @property
    def column(self) -> int:
        """The first wrong number.

        Raises:
            IndexError: none is wrong.
        """
        last, (low, high) = self.states[-1], self.bounds
        return int(np.flatnonzero((last < low) | (last > high) if self.finite else ~np.isfinite(last))[0])

    @property
    def value(self) -> float:
        """The wrong value."""
        return float(self.states[-1, self.column])

    @property
    def time(self) -> float:
        """When, in the episode [s]."""
        return float(self.states[-1, 0])

    def __str__(self) -> str:
        column = self.columns[self.column]
        unit = f" {column.unit}" if column.unit else ""
        low, high = self.bounds[:, self.column]
        beyond = f", beyond [{low:g}, {high:g}]{unit}: the physics blew up" if self.finite else ""
        return f"environment {self.env}, {self.time:.3f} s into its episode: {column} is {self.value:g}{unit}{beyond}"


class DumpError(ValueError):
    """A dump cannot be read; the message names the file and the remedy."""


def save(found: Divergence, path: Path, run: dict[str, Any]) -> None:
    """Write a divergence atomically; other values than numbers, text and null in ``run`` cannot be written."""
    columns = [[column.quantity, column.part, column.unit] for column in found.columns]
    meta = {"schema": SCHEMA, "env": found.env, "columns": columns, "run": run}
    arrays = {"states": found.states.astype(np.float32), "bounds": found.bounds.astype(np.float64)}
    with atomic_write(path) as partial:
        save_file(arrays, str(partial), metadata={META: json.dumps(meta)})
        partial.chmod(0o644)  # safetensors keeps its files to their owner


def load(path: Path) -> Divergence:
    """Read what :func:`save` wrote, as data only.

    Raises:
        DumpError: the file is missing, no dump, or damaged.
    """
    if not path.is_file():
        raise DumpError(
            f"{path}: {no_file(path, 'dump')}; name a .safetensors file from the folder 'broken' of a training"
        )
    try:
        with safe_open(str(path), framework="np") as content:
            meta = json.loads((content.metadata() or {}).get(META, "null"))
            states, bounds = content.get_tensor("states"), content.get_tensor("bounds")
        if meta["schema"] != SCHEMA:
            raise ValueError(f"schema {meta['schema']!r} is not {SCHEMA}")
        columns = tuple(Column(quantity=str(q), part=str(p), unit=str(u)) for q, p, u in meta["columns"])
        if not 1 <= len(states) <= KEPT or states.shape[1:] != bounds.shape[1:] or bounds.shape != (2, len(columns)):
            raise ValueError(f"states {states.shape} and bounds {bounds.shape} do not fit {len(columns)} columns")
        if (states.dtype, bounds.dtype, columns[0].quantity) != (np.float32, np.float64, "time"):
            raise ValueError(f"states are {states.dtype}, bounds {bounds.dtype}, the first column {columns[0]}")
        run = dict(meta["run"])
        found = Divergence(env=int(meta["env"]), columns=columns, states=states, bounds=bounds, run=run)
        if not math.isfinite(found.time) or found.column < 0:
            raise ValueError(f"a time of {found.time}")
        return found
    except (SafetensorError, OSError, LookupError, TypeError, ValueError, RecursionError) as error:
        raise DumpError(f"{path}: no dump, or a damaged one ({one_line(error)}); run the training again") from error
