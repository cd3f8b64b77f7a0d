"""Findings of the NaN guard in an environment with a wrong number: as file (safetensors), as text, as picture.

Loads neither Warp nor torch.
"""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from mrwarp.run_dir import atomic_write, no_file, one_line
from mrwarp.runtime import panels, text_table

META = "mrwarp_dump"
SCHEMA = 1
"""Version of the dump's layout."""

KEPT = 100
"""States kept per environment: as many torque steps, half a second."""


PANELS = (
    ("position", "rad", "joint position [rad]"),
    ("velocity", "rad/s", "joint velocity [rad/s]"),
    ("torque", "N·m", "joint torque [N·m]"),
    ("action", "", "action"),
    ("coil current", "A", "coil current [A]"),
    ("foot force", "N", "foot force [N]"),
)
"""Quantity, unit and label of the picture's panels."""


@dataclass(frozen=True, kw_only=True)
class Column:
    """One number of a kept state."""

    quantity: str
    """Its quantity, e.g. ``torque``."""
    part: str
    """Joint, leg or axis; empty where there is one only."""
    unit: str
    """Unit; empty for plain numbers."""

    def __str__(self) -> str:
        return f"{self.quantity} of {self.part}" if self.part else self.quantity


@dataclass(frozen=True, kw_only=True)
class Divergence:
    """The wrong number of one environment, and its last states."""

    env: int
    """Index of the environment."""
    columns: tuple[Column, ...]
    """Names of the columns of ``states``; the first is the time in the episode [s]."""
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
            f"{path}: {no_file(path, 'dump')}; name a .safetensors file from the folder 'diverged' of a training"
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


def report(found: Divergence) -> list[str]:
    """Lines that say what went wrong first, where and when."""
    run = ", ".join(f"{name} {found.run[name]}" for name in ("update", "seed", "num_envs") if name in found.run)
    others = [str(found.columns[i]) for i in np.flatnonzero(~np.isfinite(found.states[-1])) if i != found.column]
    lines = [f"first wrong: {found}", f"run: {run or 'not said'}"]
    if others:
        more = f"{', '.join(others[:6])}{' ...' * (len(others) > 6)}"
        lines.append(f"no numbers in the same state: {len(others)} more, {more}")
    if change := largest_change(found):
        lines.append(f"largest change before: {change}")
    first = found.states[0, 0]
    return [*lines, f"kept: {len(found.states)} torque steps, {first:.3f} to {found.time:.3f} s of the episode"]


def largest_change(found: Divergence) -> str:
    """The number that changed most in the last step before the wrong one, relative to its spread before that."""
    states = found.states[:-1].astype(np.float64)
    if len(states) < 10:
        return ""
    with np.errstate(all="ignore"):
        spread = states[:-1].std(0) + 1e-6 * (1.0 + np.abs(states[:-1]).max(0))
        ratio = np.nan_to_num(np.abs(states[-1] - states[-2]) / spread, nan=0.0, posinf=0.0)
    ratio[0] = 0.0  # the time
    i = int(ratio.argmax())
    unit = f" {found.columns[i].unit}".rstrip()
    change = f"{found.columns[i]} from {states[-2, i]:.4g} to {states[-1, i]:.4g}{unit} in one step"
    return change if ratio[i] >= 4.0 else ""


def table(found: Divergence, rows: int) -> list[str]:
    """The last states as text: trunk height, the largest joint speed and torque, and the wrong quantity."""
    parts = {
        "time [s]": found.states[:, :1],
        "trunk z [m]": found.pick("position", "m")[:, -1:],
        "max |qd| [rad/s]": np.abs(found.pick("velocity", "rad/s")),
        "max |torque| [N·m]": np.abs(found.pick("torque", "N·m")),
        str(found.columns[found.column]): found.states[:, found.column :][:, :1],
    }
    shown = {head: part.max(1)[-rows:] for head, part in parts.items() if part.size}
    return text_table([*shown], [[f"{x:.4g}" for x in row] for row in zip(*shown.values(), strict=True)], left=0)


def plot(found: Divergence, path: Path) -> None:
    """Draw the joints, currents and feet over the kept time; what went wrong in red."""
    figure, axes = panels((12, 7), 2, 3, sharex=True)
    # steps before the last one: a new episode may have begun in between
    time = 5.0 * np.arange(1 - len(found.states), 1)
    with np.errstate(invalid="ignore"):
        drawn = replace(found, states=np.where(np.abs(found.states) < 1e9, found.states, np.nan))
    for axis, (quantity, unit, label) in zip(axes.flat, PANELS, strict=True):
        axis.plot(time, drawn.pick(quantity, unit), color="#1f6fb4", linewidth=0.7)
        column = found.columns[found.column]
        if (column.quantity, column.unit) == (quantity, unit):
            axis.plot(time, drawn.states[:, found.column], color="#b4451f", linewidth=2.0, zorder=3, label=str(column))
            axis.axvline(0.0, color="#b4451f", linestyle=":", linewidth=1)
            axis.legend()
        axis.set_ylabel(label)
    for axis in axes[1]:
        axis.set_xlabel("torque steps of 5 ms before the wrong one [ms]")
    figure.suptitle(str(found), wrap=True)
    with atomic_write(path) as partial:
        figure.savefig(partial, dpi=110, format="png")
