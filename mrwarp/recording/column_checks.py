"""Values that no device of this kind has, and columns that do not go together: refused, with the likely reason."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mrwarp.recording.data import DEGREES, Recording, Repair, Trajectory, quantity
from mrwarp.recording.differentiate import differentiate
from mrwarp.recording.tables import Table
from mrwarp.recording.units import PER, Units

TURNS = 4.0
"""Turns in one direction from which an angle is that of a motor or shaft that goes round."""

LARGEST = 1e20
"""Largest number that is taken for a reading in any unit: nanoseconds since 1970 are 2e18."""

SIGNED = 0.02
"""Part of the largest current, in size, below which a negative one is the noise and zero of its sensor."""
FOLLOWS = 0.1
"""Share of the variance of the torque against the motion that the size of a signed current explains at least."""

_PLAUSIBLE = {
    # base unit: largest plausible value, unit that larger values are likely in, where the limit comes from
    "rad": (2.0 * np.pi, "deg"),  # a joint does not leave its middle by more than a turn
    "m": (10.0, "mm"),
    "A": (50.0, "mA"),  # MR coils take a few ampere
    "V": (500.0, "mV"),
    "N·m": (300.0, "mN·m"),  # ten times the paper's 26 N·m joint
    "N": (1.0e6, "mN"),
}
_OR = {"mN·m": (3e4, "N·cm"), "mA": (100.0, "%")}
"""Of these units another one that values up to a limit may be in."""

_MIXED = (
    (DEGREES, 1.6, "deg", "q"),
    (1.0 / DEGREES, 1.6, "deg/s", "qd"),
    (2.0 * np.pi / 60.0, 1.23, "rpm", "qd"),
    (1.0 / (2.0 * np.pi), 1.23, "rev", "q"),
)
"""Ratio of dq/dt to qd where one of them is in another unit and the other in radians, the largest factor from it (of
the last two half-way between them, in logarithms), that unit and its column."""

_MARKS = (999.0, 9999.0, 99999.0)
"""Marks that programs write, with either sign, where nothing was read."""
_BEYOND = 3.0
"""Least size of such a mark over all else in its column: nothing is near it."""
_SIMILAR = 0.5
"""Least correlation of dq/dt with qd that are one quantity in two units."""
_WORDS = (16, 32)
"""Bits of the signed numbers that programs read as unsigned ones."""
_HELD, _ALWAYS = 50, 0.9
"""Fewest changes of a channel, and share of them that come after equal times, where it is held in between."""
_COLD, _HOT = -100.0, 300.0
"""Temperatures [degC] that no bench has: -127 of a sensor that does not answer, 850 of an open wire, any mark."""
_POWER_UP = 85.0
"""Value that a common digital thermometer (DS18B20) gives before its first reading [degC]."""


def check_finite(table: Table) -> None:
    """Refuse what is no number, or larger than any reading.

    Raises:
        RecordingError: with its row and column.
    """
    for name, values in table.columns.items():
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0])
            what = "an empty cell or NaN" if np.isnan(values[row]) else "infinity"
            raise table.refuse(f"{what} instead of a number; cut it out or record again", row=row, column=name)
        if len(values) and (size := np.abs(values)).max() > LARGEST:
            row = int(size.argmax())
            raise table.refuse(f"{values[row]:.3g} is no measurement; cut it out or record again", row=row, column=name)


def check_marks(table: Table, run: dict[str, np.ndarray], rows: np.ndarray, units: Units) -> None:
    """Refuse marks of missing values, such as -999, far off all else in a column of a run, and numbers without a sign.

    Args:
        table: The file.
        run: Columns of the run, in the units that are kept, single wrong readings replaced.
        rows: Rows of the run in the file.
        units: Units of the file.

    Raises:
        RecordingError: with the first row, and the column.
    """
    for name in (name for name in ("q", "qd", "current", "torque") if name in table.columns):
        raw = table.columns[name][rows]
        kept = np.isclose(run[name], units.convert(name, raw))
        for mark in (sign * mark for mark in _MARKS for sign in (-1.0, 1.0)):
            at = (raw == mark) & kept
            if at.any() and np.abs(raw[~at]).max(initial=0.0) * _BEYOND < abs(mark) and not at.all():
                raise table.refuse(
                    f"{mark:g} in {int(at.sum())} rows, far off all others, as programs write where nothing was read; "
                    "cut these rows out or record again",
                    row=int(rows[at.argmax()]),
                    column=name,
                )
        for period in (2.0**bits for bits in _WORDS):
            part = raw / period
            high = part > 0.5
            if (
                name != "q"
                and part.min() >= 0.0
                and part.max() < 1.0
                and high.any()
                and np.abs(part - 0.5).min() > 0.25
            ):
                raise table.refuse(
                    f"{int(high.sum())} values are near {period:.0f}, all others near 0, as where a program reads "
                    f"negative numbers without their sign; subtract {period:.0f} from those above {0.5 * period:.0f}",
                    row=int(rows[high.argmax()]),
                    column=name,
                )


def held_channels(label: str, run: dict[str, np.ndarray]) -> list[Repair]:
    """Notes on channels of a run that change every second sample, or third, ... only."""
    found = []
    for name in (name for name in ("q", "qd", "torque") if name in run):
        size = np.abs(np.diff(run[name]))
        long, size = np.diff(np.flatnonzero(size)), size[size > 0.0]
        every = int(np.median(long)) if len(long) >= _HELD else 1
        # an encoder whose counts come at even times changes by one count
        if every > 1 and np.mean(long == every) > _ALWAYS and np.ptp(size) > 0.5 * size.max():
            period = every * float(np.median(np.diff(run["t"])))
            text = (
                f"{name} changes every {every} samples only, as where it is read at {1.0 / period:.3g} Hz and held: it "
                f"comes {500.0 * (period - period / every):.2g} ms late on average, which may pass for a lag of its "
                "sensor; log it at its own rate"
            )
            found.append(Repair(trajectory=label, kind="held", count=len(run[name]), text=text))
    return found


def without_marks(label: str, run: dict[str, np.ndarray]) -> list[Repair]:
    """Replace temperatures of a run that are none, or take the column away where all are; notes on them."""
    if "temperature" not in run:
        return []
    x = run["temperature"]
    wrong = (x < _COLD) | (x > _HOT)
    known = x[~wrong & (x != _POWER_UP)]
    first = int(np.argmax(x != _POWER_UP))  # readings before the first one
    if first and len(known) and abs(known[0] - _POWER_UP) > np.ptp(known):
        wrong[:first] = True
    if not wrong.any():
        return []
    reads, count = f"the temperature reads {x[wrong.argmax()]:g} degC in {int(wrong.sum())} of {len(x)} samples", len(x)
    if wrong.all():
        run.pop("temperature")
        text = f"{reads}, as where a sensor is not connected: the column is left out"
        return [Repair(trajectory=label, kind="left_out", count=count, text=text)]
    run["temperature"] = np.interp(np.arange(count), np.flatnonzero(~wrong), x[~wrong])
    at, text = tuple(float(t) for t in run["t"][wrong][:10]), f"{reads}, as a sensor that does not answer: "
    text += f"those next to them take their place (first at {at[0]:.4g} s)"
    return [Repair(trajectory=label, kind="replaced", count=int(wrong.sum()), at=at, text=text)]


def check_units(table: Table, parts: list[Trajectory], units: Units, turned: bool) -> None:
    """Refuse values that are clearly in another unit, where none was declared, and columns in two units.

    ``turned`` says whether the angle was unwrapped.

    Raises:
        RecordingError: with the column, the likely unit, and how to declare it.
    """
    largest = {
        "q": max(float(np.abs(part.q - np.median(part.q)).max()) for part in parts),
        "current": max(float(np.abs(part.current).max()) for part in parts),
        "torque": max(float(np.abs(part.torque).max()) for part in parts),
    }
    if turned or "q" not in table.columns or max(map(turns, parts)) > TURNS:
        largest.pop("q")  # a rotation: no joint is driven that far, in degrees either, without a turn back
    _refuse_several(table, largest, units)
    for key in largest.keys() - units.given:
        likely, more = _PLAUSIBLE.get(units.base(key), (np.inf, ""))[1], ""
        if key == "q" and (table.columns["q"] == np.rint(table.columns["q"])).all():
            more = f', or, if these are encoder counts, {{"q": "counts", "{next(iter(PER))}": ...}}'
        below, other = _OR.get(likely, (0.0, ""))
        more += f" (or {other})" if largest[key] <= below else ""
        remedy = f'convert them, or declare the unit in units.json next to the file: {{"{key}": "{likely}"}}{more}'
        check_plausible(table, key, largest[key], units.base(key), remedy)
    if units.base("q") != "rad":
        return
    for part in parts:
        ratio = derivative_ratio(part)
        unit, key = next((x[2:] for x in _MIXED if 1.0 / x[1] < ratio / x[0] < x[1]), ("", ""))
        if part.qd_derived or not key or _agreement(part) < _SIMILAR:  # columns of another kind are no other unit
            continue
        other, declared = ("qd" if key == "q" else "q"), {"q": "rad", "qd": "rad/s", key: unit}
        raise table.refuse(
            f"dq/dt is {ratio:.3g} times qd in trajectory {part.id!r}, so {key} looks like {unit} where {other} is in "
            f"radians; convert it, or declare it in units.json next to the file: {json.dumps(declared)}",
            column=key,
        )


def _refuse_several(table: Table, largest: Mapping[str, float], units: Units) -> None:
    """Refuse columns that look like other units all at once, so that one declaration mends them.

    Raises:
        RecordingError: with each column, its likely unit, and one units.json for all.
    """
    wrong = {}
    for key in (key for key in largest if key not in units.given):
        limit, likely = _PLAUSIBLE.get(units.base(key), (np.inf, ""))
        if largest[key] > limit:
            wrong[key] = likely
    if len(wrong) > 1:
        each = ", ".join(f"{key} up to {largest[key]:.4g} {units.base(key)} like {wrong[key]}" for key in wrong)
        raise table.refuse(
            f"values look like other units: {each}; convert them, or declare all in units.json next to the file: "
            f'{json.dumps(wrong, ensure_ascii=False)} (if they really are in these units: {{"trust_units": true}})'
        )


def check_plausible(table: Table, key: str, largest: float, unit: str, remedy: str) -> None:
    """Refuse a column whose largest value no device of this kind reaches.

    Raises:
        RecordingError: with the column and the remedy.
    """
    limit, likely = _PLAUSIBLE.get(unit, (np.inf, ""))  # what else a control input may be in has no limit
    if largest > limit:
        what = "away from their median" if key == "q" else "in size"
        raise table.refuse(
            f"values up to {largest:.4g} {unit} {what} look like {likely}; {remedy} (if they really are {unit}: "
            '{"trust_units": true})',
            column=key,
        )


def turns(part: Trajectory) -> float:
    """How often a trajectory goes round without turning back; 0 where it does turn back."""
    path, way = float(np.abs(np.diff(part.q)).sum()), abs(float(part.q[-1] - part.q[0]))
    return way / (2.0 * np.pi) if way > 0.9 * path else 0.0


def _agreement(part: Trajectory) -> float:
    """Correlation of dq/dt with the trajectory's qd."""
    derived = differentiate(part.q, part.dt)
    return float(derived @ part.qd / max(np.linalg.norm(derived) * np.linalg.norm(part.qd), 1e-300))


def derivative_ratio(part: Trajectory) -> float:
    """RMS of dq/dt over RMS of the trajectory's qd; 1 where either rests."""
    derived = differentiate(part.q, part.dt)
    own, other = float(np.sqrt(np.mean(part.qd**2))), float(np.sqrt(np.mean(derived**2)))
    return other / own if own > 1e-9 and other > 1e-9 else 1.0


def sized_currents(recording: Recording) -> Recording:
    """Take the size of a current that makes a field, where it was logged with a sign; a note says so.

    A fluid does not know in which direction its coil is wound. A motor does: there the torque follows the current with
    its sign, over a line, better than the torque against the motion follows its size, and the sign stays. It stays,
    too, where the torque has one direction only, as that of two swapped columns.
    """
    runs = recording.trajectories
    torque, current, qd = (np.concatenate([getattr(run, x) for run in runs]) for x in ("torque", "current", "qd"))
    if recording.units["current"] not in ("A", "V") or current.min() >= -SIGNED * np.abs(current).max():
        return recording
    even, signed = _follows(np.abs(current), torque * np.sign(qd)), _follows(current, torque)
    if current.max() > 0.0 and not (torque.min() < 0.0 < torque.max() and even > max(signed, FOLLOWS)):
        return recording
    negative = int(np.count_nonzero(current < 0.0))
    text = f"{quantity('current', recording.units)}: negative at {negative} samples, which count by their size"
    repairs = (*recording.repairs, Repair(trajectory=runs[0].id, kind="sized", count=negative, text=text))
    sized = tuple(replace(run, current=np.abs(run.current)) for run in runs)
    return replace(recording, trajectories=sized, repairs=repairs)


def _follows(x: np.ndarray, y: np.ndarray) -> float:
    """Share of the variance of one column that a line over another explains; 0 where one does not change."""
    return float(np.corrcoef(x, y)[0, 1] ** 2) if np.ptp(x) > 0.0 and np.ptp(y) > 0.0 else 0.0
