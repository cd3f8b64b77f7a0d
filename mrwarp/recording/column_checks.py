"""Values that no device of this kind has, and columns that do not go together: refused, with the likely reason."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mrwarp.recording.agreement import OTHER, Agreement, agreement, exchanged, proposals, tried
from mrwarp.recording.data import UNITS, Recording, Repair, Trajectory, is_command, quantity
from mrwarp.recording.tables import Table
from mrwarp.recording.units import CONVERSIONS, PER, Units

TURNS = 4.0
"""Turns in one direction from which an angle is that of a motor or shaft that goes round."""

LARGEST = 1e20
"""Largest number that is taken for a reading in any unit: nanoseconds since 1970 are 2e18."""

SIGNED = 0.02
"""Part of the largest current, in size, below which a negative one is the noise and zero of its sensor."""
FOLLOWS = 0.1
"""Share of the variance of the torque, in size, that the size of a signed current explains at least."""

_PLAUSIBLE = {
    # base unit: largest plausible value, units that larger values are likely in, where the limit comes from
    "rad": (2.0 * np.pi, ("deg", "mrad")),  # a joint does not leave its middle by more than a turn
    "m": (10.0, ("mm",)),
    "A": (50.0, ("mA", "uA")),  # MR coils take a few ampere
    "V": (500.0, ("mV",)),
    "N·m": (300.0, ("mN·m",)),  # ten times the paper's 26 N·m joint
    "N": (1.0e6, ("mN",)),
}
_OR = {"mN·m": (3e4, "N·cm"), "mA": (100.0, "%")}
"""Of these units another one that values up to a limit may be in."""

_MARKS = (999.0, 9999.0, 99999.0)
"""Marks that programs write, with either sign, where nothing was read."""
_BEYOND = 3.0
"""Least size of such a mark over all else in its column: nothing is near it."""
_OTHER_PERIODS, _ON_PERIOD, _COUNTS = (180.0, 360.0, 720.0, *(2.0**bits for bits in range(8, 33))), 0.01, 256
"""Lengths after which readings begin again that are in degrees, or counts of an encoder; how near one is to
them; fewest counts."""
_WORDS = (16, 32)
"""Bits of the signed numbers that programs read as unsigned ones."""
_HELD, _ALWAYS = 50, 0.9
"""Fewest changes of a channel, and share of them that come after equal times, where it is held in between."""
_NEAR, _LONGEST = 0.3, 5.0
"""Share by which the rows of a slower channel may be more or less far spaced; longest of these, in usual ones."""
_COLD, _HOT = -100.0, 300.0
"""Temperatures [degC] that no bench has: -127 of a sensor that does not answer, 850 of an open wire, any mark."""
_POWER_UP = 85.0
"""Value that a common digital thermometer (DS18B20) gives before its first reading [degC]."""


def without_blanks(table: Table, runs: Sequence[np.ndarray]) -> Table:
    """A table whose slower channels go on between their values, with notes on them.

    Such a channel has a value in every second row, or third, ..., and blank cells or NaN in between. A command is held
    until its next value, all else goes straight to it. Single blank cells are no slower channel, and stay.

    Args:
        table: The file.
        runs: Its rows, run by run.
    """
    columns, notes = dict(table.columns), list(table.notes)
    for name, values in table.columns.items():
        blank = np.isnan(values)
        if name == "t" or not blank.any():
            continue
        if blank.all() and name in ("qd", "temperature"):
            columns.pop(name)
            notes.append(f"the column {name} is empty: it is left out")
            continue
        filled = values.copy()
        for rows in runs:
            at = np.flatnonzero(~blank[rows])
            spaced = np.diff(at)
            every = float(np.median(spaced)) if len(spaced) >= _HELD else 1.0
            even = np.abs(spaced - every) <= max(1.0, _NEAR * every)
            if every < 2.0 or even.mean() < _ALWAYS or spaced.max() > _LONGEST * every:
                break
            t, known = table.columns["t"][rows], values[rows][at]
            if name == "current" and is_command(known):
                before = np.maximum(np.searchsorted(at, np.arange(len(rows)), side="right") - 1, 0)
                filled[rows], how = known[before], "held until the next one, as a command"
            else:
                filled[rows], how = np.interp(t, t[at], known), "joined by straight lines"
        else:
            columns[name] = filled
            notes.append(
                f"{name} has a value once in {every:.3g} rows, as a slower channel: its values are {how}; what is "
                "quicker is not in it"
            )
    return replace(table, columns=columns, notes=tuple(notes))


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


@dataclass(frozen=True, kw_only=True)
class Misread:
    """A column whose unit is not the declared one, or not the default one."""

    column: str
    problem: str
    proposals: list[dict[str, Any]]
    """Declarations that may put it right."""


def misread(
    parts: Sequence[Trajectory],
    units: Units,
    recorded: Collection[str],
    period: float = 0.0,
    others: Sequence[Trajectory] = (),
) -> Misread | None:
    """The first thing that is wrong with the units of runs.

    Args:
        parts: The runs.
        units: Their units.
        recorded: Columns that the file has.
        period: Length after which the angle's reading begins again, in the unit that is kept; 0 where it does not.
        others: Runs of the recording, in one unit with these, that are right as they are.
    """
    found = agreement(parts) if {"q", "qd"} <= set(recorded) else None
    if {"q", "qd"} <= set(recorded) and (found is None or found.factor < 0.0) and exchanged(parts):
        text = "qd is not the derivative of q, and q is that of qd: are two columns swapped"
        names = {"q": units.names.get("qd", "qd"), "qd": units.names.get("q", "q")}
        return Misread(column="qd", problem=text, proposals=[{"columns": {**units.names, **names}}])
    if found is not None and not 1.0 / OTHER < found.factor < OTHER:
        text = f"dq/dt is {found.factor:.3g} times qd" + ("" if found.constant else " in the middle")
        more = {key: x[2][0] for key, x in _oversized(parts, units).items() if x[2]}
        return Misread(column="qd", problem=text, proposals=[{**x, **more} for x in proposals(parts, units, found)])
    other = _other_period(period)
    if other and "q" not in units.given and units.base("q") == "rad":
        follows = {"qd": units.declared["qd"]} if "qd" in recorded else {}
        degrees = [{"q": "deg", "qd": "deg/s"}, {"q": "deg", **follows}]
        counted = {"q": "counts", next(iter(PER)): round(other)}
        whole = other >= _COUNTS and other == 2.0 ** round(np.log2(other))
        text = f"values that begin again after {period:.5g}"
        proposed = [{**counted, "qd": "counts/s"}, {**counted, **follows}] if whole else degrees
        return Misread(column="q", problem=text, proposals=proposed)
    large = _oversized(parts, units, angle="q" in recorded)
    # where other columns are not in the plain units either, many turns are likelier degrees
    if not large or (list(large) == ["q"] and _rotates(parts, units, found, period, others)):
        return None
    (key, (size, what, likely)), *more = large.items()
    text = f"values up to {size:.4g} {units.base(key)} {what}"
    if more:
        each = (
            f"{name} up to {x[0]:.4g} {units.base(name)} like {(x[2] or ['no unit'])[0]}" for name, x in large.items()
        )
        text = f"values look like other units: {', '.join(each)}"
    known = {"qd": units.declared["qd"]} if key == "q" and "qd" in recorded else {}
    if known and likely and found is not None and found.same:
        known = {"qd": f"{likely[0]}/s"}
    known |= {name: x[2][0] for name, x in more if x[2]}
    return Misread(column=key, problem=text, proposals=[{key: unit, **known} for unit in likely])


def _oversized(
    parts: Sequence[Trajectory], units: Units, *, angle: bool = False
) -> dict[str, tuple[float, str, list[str]]]:
    """Columns of no declared unit that no device of this kind reaches: their size, what it is of, and likely units."""
    found = {}
    for key in (*(("q",) if angle else ()), "current", "torque"):
        if key in units.given:
            continue
        columns = [getattr(part, key) for part in parts]
        size = max(float(np.abs(x - (np.median(x) if key == "q" else 0.0)).max()) for x in columns)
        limit, likely = _PLAUSIBLE.get(units.base(key), (np.inf, ()))
        if size > limit:
            smaller = [unit for unit in likely if size * CONVERSIONS[key][unit][0] <= limit][:1]
            smaller += [other for unit, (most, other) in _OR.items() if unit in smaller and size <= most]
            found[key] = size, "away from their median" if key == "q" else "in size", smaller
    return found


def _rotates(
    parts: Sequence[Trajectory], units: Units, found: Agreement | None, period: float, others: Sequence[Trajectory]
) -> bool:
    """Whether an angle of many turns is one: its velocity says so, it begins again, or goes on and on.

    So does that of other runs of many turns, which is in the same unit. That one of these goes on and on says so of
    runs in one direction alone: a ramp over a joint's range in degrees next to its swings would look similar.
    """
    if period or (found is not None and found.same) or max(map(turns, parts)) > TURNS:
        return True
    if not others or "q" not in _oversized(others, units, angle=True):
        return False
    shown = agreement(others)
    return (shown is not None and shown.same) or (min(map(turns, parts)) > 0.0 and max(map(turns, others)) > TURNS)


def _other_period(period: float) -> float:
    """The length in degrees or counts of an encoder that a reading begins again after; 0 where it is none of these.

    No angle in degrees, and no count, begins again after 25 of them.
    """
    return next((x for x in _OTHER_PERIODS if period and abs(period / x - 1.0) < _ON_PERIOD), 0.0)


def check_units(
    table: Table, parts: list[Trajectory], units: Units, period: float, others: Sequence[Trajectory] = ()
) -> None:
    """Refuse values that are clearly in another unit, where none was declared, and columns in two units.

    Each remedy that is named has been tried: with it these checks pass.

    Args:
        table: The file.
        parts: Its runs.
        units: Units of the recording.
        period: As in :func:`misread`.
        others: As in :func:`misread`.

    Raises:
        RecordingError: with the column, the likely unit, and how to declare it.
    """
    recorded = table.columns.keys()
    wrong = misread(parts, units, recorded, period, others)
    if wrong is None:
        return

    def still(runs: Sequence[Trajectory], declared: Units) -> object:
        one = declared.convert("q", np.ones(1))[0] / units.convert("q", np.ones(1))[0]
        return misread(runs, declared, recorded, abs(period * one), others)

    passed = tried(wrong.proposals, parts, units, still)
    if not passed:
        said = "no unit that is known makes them plausible; convert them, and try again"
        if wrong.column == "qd":
            said = "no unit and no factor makes them one; leave the column qd out, then it is derived, and try again"
        raise table.refuse(f"{wrong.problem}; {said}", column=wrong.column)
    key, looks = _looks(units, passed[0])
    where = "in units.json next to the file"
    if others and tried([passed[0]], others, units, still) != [passed[0]]:
        where = "in a units.json next to this file in a folder of its own (the other files are right as they are)"
    remedy = f"{json.dumps(passed[0], ensure_ascii=False)}"
    if wrong.column != "qd":
        whole = wrong.column == "q" and (table.columns["q"] == np.rint(table.columns["q"])).all()
        counts = f', or, if these are encoder counts, {{"q": "counts", "{next(iter(PER))}": ...}}' if whole else ""
        key = wrong.column
        more = "".join(f" (or {x[key]})" for x in passed[1:] if x[key] != passed[0][key])
        really = json.dumps(units.content({wrong.column: units.declared[wrong.column]}), ensure_ascii=False)
        look = "" if "look like" in wrong.problem else f" look like {passed[0][wrong.column]}"
        raise table.refuse(
            f"{wrong.problem}{look}; convert them, or declare the unit {where}: {remedy}{counts}"
            f"{more} (if they really are {units.base(key)}: {really})",
            column=wrong.column if look else None,
        )
    more = "".join(f", or {json.dumps(x, ensure_ascii=False)}" for x in passed[1:2])
    if "columns" in passed[0] and passed[0]["columns"] != units.names:
        text = f"as it seems; exchange their names, or declare it {where}: {remedy}"
    elif looks:
        text = f"so {looks}; convert it, or declare it {where}: {remedy}"
    else:
        text = f"and no two units explain it: is there a gear between them? Declare {where}: {remedy} if the angle is "
        text += f"the joint's{more}{' if the velocity is' if more else ''}, or leave the column qd out"
    raise table.refuse(f"{wrong.problem}, {text}", column=key)


def _looks(units: Units, content: Mapping[str, Any]) -> tuple[str, str]:
    """First column that a declaration changes, and what its columns look like; empty for a factor alone."""
    changed = [
        key
        for key in ("q", "qd", "t", "current", "torque")
        if content.get(key, units.declared[key]) != units.declared[key]
    ]
    looks = " and ".join(f"{key} looks like {content[key]}" for key in changed)
    other = next((key for key in ("q", "qd") if key not in changed), "")
    if looks and other and changed[0] in ("q", "qd"):
        looks += (
            f" where {other} is in {'radians' if units.base('q') == 'rad' else 'metres'}"
            if (units.declared[other] == UNITS[other])
            else f" where {other} is in {units.declared[other]}"
        )
    return (changed[0] if changed else "qd"), looks


def turns_note(label: str, parts: Sequence[Trajectory], units: Units) -> list[Repair]:
    """A note on an angle of many turns whose unit no file names, where the velocity agrees with it."""
    if "q" in units.given or units.base("q") != "rad" or units.trusted:
        return []
    reach = max(float(np.abs(part.q - np.median(part.q)).max()) for part in parts)
    found = agreement(parts)
    if reach <= _PLAUSIBLE["rad"][0] or found is None or not found.same or max(map(turns, parts)) > TURNS:
        return []
    degrees = json.dumps(units.content({"q": "deg", "qd": "deg/s"}), ensure_ascii=False)
    text = (
        f"q goes {reach / (2.0 * np.pi):.3g} turns to either side, and dq/dt agrees with qd: taken as rad and rad/s, "
        f"as of a motor in front of a gear; if both are in degrees, declare {degrees} in units.json"
    )
    return [Repair(trajectory=label, kind="turns", count=len(parts), text=text)]


def check_plausible(table: Table, key: str, largest: float, unit: str, remedy: str) -> None:
    """Refuse a column whose largest value no device of this kind reaches.

    Raises:
        RecordingError: with the column and the remedy.
    """
    limit, likely = _PLAUSIBLE.get(unit, (np.inf, ("",)))  # what else a control input may be in has no limit
    if largest > limit:
        raise table.refuse(
            f"values up to {largest:.4g} {unit} in size look like {likely[0]}; {remedy} (if they really are {unit}: "
            '{"trust_units": true})',
            column=key,
        )


def turns(part: Trajectory) -> float:
    """How often a trajectory goes round without turning back; 0 where it does turn back."""
    path, way = float(np.abs(np.diff(part.q)).sum()), abs(float(part.q[-1] - part.q[0]))
    return way / (2.0 * np.pi) if way > 0.9 * path else 0.0


def sized_currents(recording: Recording) -> Recording:
    """Take the size of a current that makes a field, where it was logged with a sign; a note says so.

    A fluid does not know in which direction its coil is wound. A motor does: there the torque follows the current with
    its sign, over a line, better than the torque against the motion follows its size, and half as well as its own size
    does: the sign stays. It stays, too, where the torque has one direction only, as that of two swapped columns.
    """
    runs = recording.trajectories
    torque, current, qd = (np.concatenate([getattr(run, x) for run in runs]) for x in ("torque", "current", "qd"))
    if recording.units["current"] not in ("A", "V") or current.min() >= -SIGNED * np.abs(current).max():
        return recording
    size, signed = np.abs(current), _follows(current, torque)
    even = max(_follows(size, torque * np.sign(qd)), 0.5 * _follows(size, np.abs(torque - np.median(torque))))
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
