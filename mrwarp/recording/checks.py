"""Checks of a recording's numbers: finite, uniformly sampled, and of a size that fits their unit."""

from __future__ import annotations

import json
from collections.abc import Iterator

import numpy as np

from mrwarp.recording.data import Trajectory
from mrwarp.recording.differentiate import differentiate
from mrwarp.recording.tables import Table
from mrwarp.recording.units import DEGREES, Units

MIN_SAMPLES = 50
"""Fewest samples of a trajectory: one history window of the learned models."""

MAX_JITTER = 0.5
"""Largest deviation of a sampling interval from the median interval, as a share of it; above, it is a gap."""

_PLAUSIBLE = {
    # base unit: largest plausible value, unit that larger values are likely in, where the limit comes from
    "rad": (2.0 * np.pi, "deg"),  # a joint does not leave its middle by more than a turn
    "m": (10.0, "mm"),
    "A": (50.0, "mA"),  # MR coils take a few ampere
    "V": (500.0, "mV"),
    "N·m": (300.0, "mN·m"),  # ten times the paper's 26 N·m joint
    "N": (1.0e6, "mN"),
}


def checked_trajectories(table: Table, units: Units, stem: str, in_folder: bool) -> list[Trajectory]:
    """The trajectories of one file, converted and checked.

    Args:
        table: What the file holds.
        units: What is declared.
        stem: The file's name, for the id of a trajectory that has none.
        in_folder: Whether there are other files: then the name also stands before the ids.
    """
    columns = converted(table, units)
    flag = bool(table.header.get("qd_derived", False))
    parts = []
    for name, rows in _groups(table.ids):
        part = {key: values if rows is None else values[rows] for key, values in columns.items()}
        _check_time(table, part["t"], np.arange(len(part["t"])) if rows is None else rows, name)
        dt = (part["t"][-1] - part["t"][0]) / (len(part["t"]) - 1)
        derived = "qd" not in part
        parts.append(
            Trajectory(
                id=stem if name is None else f"{stem}/{name}" if in_folder else name,
                qd=differentiate(part["q"], dt) if derived else part.pop("qd"),
                qd_derived=derived or flag,
                header=table.header,
                **part,
            )
        )
    if not units.trusted:
        _check_units(table, parts, units)
    return parts


def converted(table: Table, units: Units) -> dict[str, np.ndarray]:
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


def _check_time(table: Table, t: np.ndarray, rows: np.ndarray, name: str | None) -> None:
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


def _check_units(table: Table, parts: list[Trajectory], units: Units) -> None:
    """Refuse values that are clearly in another unit than declared."""
    check_plausible(table, "q", max(float(np.abs(part.q - np.median(part.q)).max()) for part in parts), units)
    check_plausible(table, "current", max(float(np.abs(part.current).max()) for part in parts), units)
    check_plausible(table, "torque", max(float(np.abs(part.torque).max()) for part in parts), units)
    if units.base("q") != "rad":
        return
    for part in parts:
        ratio = derivative_ratio(part)
        if part.qd_derived or not (0.6 < ratio / DEGREES < 1.6 or 0.6 < ratio * DEGREES < 1.6):
            continue
        key, unit, other = ("q", "deg", "qd") if ratio > 1.0 else ("qd", "deg/s", "q")
        declared = {"q": "deg", "qd": "rad/s"} if key == "q" else {"q": "rad", "qd": "deg/s"}
        raise table.refuse(
            f"dq/dt is {ratio:.3g} times qd in trajectory {part.id!r}, so {key} looks like {unit} where {other} is in "
            f"radians; convert it, or declare it in units.json beside the file: {json.dumps(declared)}",
            column=key,
        )


def check_plausible(table: Table, key: str, largest: float, units: Units) -> None:
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
