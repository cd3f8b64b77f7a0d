"""``mrwarp replay-dump``: what went wrong first in an environment, and the states that led to it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mrwarp.env.nan_dump import Dump, load
from mrwarp.options.command_line import CommandLine
from mrwarp.options.trial_options import ReplayDump
from mrwarp.run_dir import atomic_write, check_output

PANELS = (
    ("position", "rad", "joint position [rad]"),
    ("velocity", "rad/s", "joint velocity [rad/s]"),
    ("torque", "N·m", "joint torque [N·m]"),
    ("action", "", "action"),
    ("coil current", "A", "coil current [A]"),
    ("foot force", "N", "foot force [N]"),
)
"""Quantity, unit and label of the picture's panels."""


def run(options: ReplayDump, line: CommandLine) -> int:
    """Print and draw a dump; 0 when done, 2 on bad input."""
    check_output(options.png, ".png")
    dump = load(options.file)
    print("\n".join([*report(dump), "", *table(dump, options.rows)]))
    if options.png is not None:
        plot(dump, options.png)
        print(f"picture: {options.png}")
    return 0


def report(dump: Dump) -> list[str]:
    """Lines that say what went wrong first, where and when."""
    found = dump.found
    run = ", ".join(f"{name} {dump.run[name]}" for name in ("update", "seed", "num_envs") if name in dump.run)
    last = found.states[-1]
    wrong = np.flatnonzero(~np.isfinite(last))
    others = [str(found.columns[i]) for i in wrong if i != found.column]
    lines = [f"first wrong: {found}", f"run: {run or 'not said'}"]
    if others:
        lines.append(
            f"no numbers in the same state: {len(others)} more, {', '.join(others[:6])}{' ...' * (len(others) > 6)}"
        )
    grown = _grown(dump)
    if grown:
        lines.append(f"largest change before: {grown}")
    lines.append(
        f"kept: {len(found.states)} torque steps, {found.states[0, 0]:.3f} to {found.time:.3f} s of the episode"
    )
    return lines


def table(dump: Dump, rows: int) -> list[str]:
    """The last states as text: trunk height, the largest joint speed and torque, and the wrong quantity."""
    found = dump.found
    heads = ["time [s]", "trunk z [m]", "max |qd| [rad/s]", "max |torque| [N·m]", str(found.columns[found.column])]
    parts = [
        found.states[:, 0],
        _pick(dump, "position", "m")[:, -1:].sum(1) if _pick(dump, "position", "m").size else None,
        _largest(_pick(dump, "velocity", "rad/s")),
        _largest(_pick(dump, "torque", "N·m")),
        found.states[:, found.column],
    ]
    shown = [(head, part) for head, part in zip(heads, parts, strict=True) if part is not None]
    width = [max(len(head), 10) for head, _ in shown]
    lines = ["  ".join(head.rjust(w) for (head, _), w in zip(shown, width, strict=True))]
    for i in range(max(len(found.states) - rows, 0), len(found.states)):
        lines.append("  ".join(f"{part[i]:.4g}".rjust(w) for (_, part), w in zip(shown, width, strict=True)))
    return lines


def plot(dump: Dump, path: Path) -> None:
    """Draw the joints, currents and feet over the kept time; what went wrong in red."""
    found = dump.found
    figure = Figure(figsize=(12, 7), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True)
    # steps before the last one: a new episode may have begun in between
    time = 5.0 * np.arange(1 - len(found.states), 1)
    with np.errstate(over="ignore", invalid="ignore"):
        for axis, (quantity, unit, label) in zip(axes.flat, PANELS, strict=True):
            for i, column in enumerate(found.columns):
                if column.quantity == quantity and column.unit == unit:
                    wrong = i == found.column
                    values = np.where(np.abs(found.states[:, i]) < 1e9, found.states[:, i], np.nan)
                    axis.plot(time, values, color="#b4451f" if wrong else "#1f6fb4", linewidth=2.0 if wrong else 0.7,
                              zorder=3 if wrong else 2, label=str(column) if wrong else None)  # fmt: skip
                    if wrong:
                        axis.axvline(0.0, color="#b4451f", linestyle=":", linewidth=1)
                        axis.legend()
            axis.set_ylabel(label)
            axis.grid(alpha=0.3)
    for axis in axes[1]:
        axis.set_xlabel("torque steps of 5 ms before the wrong one [ms]")
    figure.suptitle(str(found), wrap=True)
    with atomic_write(path) as partial:
        figure.savefig(partial, dpi=110, format="png")


def _grown(dump: Dump) -> str:
    """The number that changed most in the last step before the wrong one, relative to its spread before that."""
    states = dump.found.states[:-1].astype(np.float64)
    if len(states) < 10:
        return ""
    with np.errstate(all="ignore"):
        spread = states[:-1].std(0) + 1e-6 * (1.0 + np.abs(states[:-1]).max(0))
        ratio = np.abs(states[-1] - states[-2]) / spread
    ratio[0] = 0.0  # the time
    ratio[~np.isfinite(ratio)] = 0.0
    i = int(ratio.argmax())
    if ratio[i] < 4.0:
        return ""
    unit = f" {dump.found.columns[i].unit}".rstrip()
    return f"{dump.found.columns[i]} from {states[-2, i]:.4g} to {states[-1, i]:.4g}{unit} in one step"


def _pick(dump: Dump, quantity: str, unit: str) -> np.ndarray:
    """Columns of a quantity, shape (n, K)."""
    names = [(column.quantity, column.unit) for column in dump.found.columns]
    return dump.found.states[:, [i for i, name in enumerate(names) if name == (quantity, unit)]]


def _largest(values: np.ndarray) -> Any:
    """Largest magnitude per state, NaN where one is; None without columns."""
    return np.abs(values).max(1) if values.size else None
