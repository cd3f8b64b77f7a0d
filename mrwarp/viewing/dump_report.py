"""An environment in which a number went wrong, as text and picture: what was first, and the states that led to it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrwarp.env.nan_dump import Divergence
from mrwarp.run_dir import atomic_write
from mrwarp.runtime import text_table

PANELS = (
    ("position", "rad", "joint position [rad]"),
    ("velocity", "rad/s", "joint velocity [rad/s]"),
    ("torque", "N·m", "joint torque [N·m]"),
    ("action", "", "action"),
    ("coil current", "A", "coil current [A]"),
    ("foot force", "N", "foot force [N]"),
)
"""Quantity, unit and label of the picture's panels."""


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
    figure = Figure(figsize=(12, 7), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True)
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
        axis.grid(alpha=0.3)
    for axis in axes[1]:
        axis.set_xlabel("torque steps of 5 ms before the wrong one [ms]")
    figure.suptitle(str(found), wrap=True)
    with atomic_write(path) as partial:
        figure.savefig(partial, dpi=110, format="png")
