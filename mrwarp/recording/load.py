"""Recordings: measured runs of one joint on a bench, checked when they are read (format: docs/data.md)."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.recording.agreement import agreement, factor_note
from mrwarp.recording.angle import in_one_turn, integrated, replace_wrong_readings, undo_jumps, unwrap, wrap_length
from mrwarp.recording.column_checks import (
    check_finite,
    check_marks,
    check_plausible,
    check_units,
    held_channels,
    misread,
    sized_currents,
    turns_note,
    without_blanks,
    without_marks,
)
from mrwarp.recording.data import (
    COLUMNS,
    HOLDING_COLUMNS,
    HOLDING_FILE,
    NO_INPUT,
    REQUIRED,
    UNITS,
    Holding,
    Recording,
    RecordingError,
    Repair,
    Trajectory,
)
from mrwarp.recording.differentiate import differentiate, quiet_half
from mrwarp.recording.resample import UnevenError, even_pieces, thinned
from mrwarp.recording.saturation import mark_saturated
from mrwarp.recording.tables import KINDS, MAX_BYTES, TEXTS, Table, is_recording, read_table, suffix_of
from mrwarp.recording.units import Units, read_units
from mrwarp.recording.write import save_holding, save_recording

__all__ = [
    "COLUMNS",
    "HOLDING_FILE",
    "Holding",
    "Recording",
    "RecordingError",
    "Trajectory",
    "save_holding",
    "save_recording",
]

MIN_SAMPLES = 50
"""Fewest samples of a trajectory: one history window of the learned models."""

SAME_CURRENT = (0.05, 20.0)
"""Plausible ratio of the largest current of break-away tests to that of the recordings."""

SAME_TORQUE = (0.2, 50.0)
"""Plausible ratio of the largest break-away torque, at the recordings' currents, to their sliding torque.

A brake sticks about as it slides: 1 to 1.5 for MR fluids; the paper's device has 9. A wrong prefix is 1000.
"""

EPOCH = 1e8
"""Time [s] from which stamps count from 1970, not from the start of a recording: three years."""

MAX_RATE = 2e7
"""Fastest sampling [Hz] that is a bench's; a unit of time that gives a faster one is not offered."""

SLOW = 5.0
"""Sampling rate [Hz] below which a note asks for the unit of the stamps."""

_USUAL_RATES = (20.0, 2e4)
"""Sampling rates [Hz] of benches, which decide where two units of time would do."""

_STAMPS = (("ms", 1e3, "milliseconds"), ("us", 1e6, "microseconds"), ("ns", 1e9, "nanoseconds"))
"""Likely units of stamps with steps of more than 1 s: their number in a second, which is the longest interval."""


def load_recording(path: str | Path, *, skip_bad: bool = False, declared: str | Path | None = None) -> Recording:
    """Read and check a recording: one file of a known kind, or a folder of them; at most :data:`MAX_BYTES`.

    Time stamps are put on an even grid and long gaps split a trajectory; ``Recording.repairs`` says where.

    Example:
        >>> import mrwarp
        >>> recording = mrwarp.load_recording("recordings")
        >>> recording.units["torque"], recording.trajectories[0].q.shape
        ('N·m', (750,))

    Args:
        path: The file or folder.
        skip_bad: Leave files of a folder out, by name, that would be refused.
        declared: JSON file that names units and columns, in place of the ``units.json`` next to the data.

    Raises:
        RecordingError: the recording is refused; the message names file, row and column, and the remedy.
    """
    path = Path(path)
    files = _files_of(path)
    units = read_units(path if path.is_dir() else path.parent, Path(declared) if declared else None)
    required = [name for name in REQUIRED if name != "current" or units.base("current") != NO_INPUT]
    left = MAX_BYTES
    read: dict[Path, _Read] = {}
    unclear: list[tuple[Table, _Read]] = []
    shifted: list[Repair] = []
    refused: dict[Path, RecordingError] = {}

    def refuse(file: Path, error: RecordingError) -> None:
        if len(files) == 1:
            raise error
        if not skip_bad:
            raise RecordingError(f"{error}; or leave this file out with --skip-bad") from None
        refused[file] = error
        text = f"left out, {str(error).removeprefix(str(file)).lstrip(',: ')}"
        read[file] = _Read(parts=[], repairs=[Repair(trajectory=file.name, kind="left_out", count=1, text=text)])

    origin = 0.0
    for file in files:
        try:
            table = read_table(file, required, left, called=units.names, seconds=lambda t: units.convert("t", t))
            left -= table.size
            if not origin and (origin := _epoch(table, units)):
                when = datetime.fromtimestamp(origin, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
                text = f"t is the time since 1970: it counts from {when} here"
                shifted.append(Repair(trajectory=path.name, kind="shifted", count=1, text=text))
            found = _checked(table, units, file.name.removesuffix(suffix_of(file)), path.is_dir(), origin)
        except RecordingError as error:
            refuse(file, error)
        else:
            read[file] = found
            if not units.trusted and misread(found.parts, units, table.columns.keys(), found.period):
                unclear.append((table, found))
    # the files have one unit: those that are clear say what the others are in
    asked = [table.file for table, _ in unclear]
    clear = [found for file, found in read.items() if file not in asked]
    others = [run for found in clear for run in found.parts]
    period = max((found.period for found in clear), default=0.0)
    for table, found in unclear:
        try:
            check_units(table, found.parts, units, found.period or period, others)
        except RecordingError as error:
            refuse(table.file, error)
    trajectories = [run for file in files for run in read[file].parts]
    repairs = [*shifted, *(repair for file in files for repair in read[file].repairs)]
    period = max(found.period for found in read.values())
    if not trajectories:
        error = refused[files[0]]
        raise RecordingError(f"{error}; --skip-bad leaves nothing: each of the {len(files)} files is refused")
    names = [trajectory.id for trajectory in trajectories]
    if len(set(names)) < len(names):
        double = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"{path}: two trajectories are called {double!r}; rename a file or a trajectory")
    if not units.trusted:
        label = path.name or str(path)
        repairs += [*factor_note(label, trajectories, units), *turns_note(label, trajectories, units)]
        repairs += _slow_note(label, trajectories, units)
    if period:
        trajectories = _in_one_turn(trajectories, repairs, period)
    recording = Recording(
        trajectories=tuple(trajectories),
        units={key: units.base(key) for key in ("q", "current", "torque")},
        source=path,
        header=_common([trajectory.header for trajectory in trajectories]),
        repairs=tuple(repairs),
        declared=units.given,
    )
    return mark_saturated(sized_currents(recording))


def _slow_note(label: str, runs: Sequence[Trajectory], units: Units) -> list[Repair]:
    """A note on samples so far from each other that their stamps may be in another unit, where no velocity says so."""
    dt = float(np.median([run.dt for run in runs]))
    if "t" in units.given or 1.0 / dt > SLOW or any(not run.qd_derived for run in runs):
        return []
    declared = json.dumps(units.content({"t": "ms"}), ensure_ascii=False)
    text = f"{dt:.3g} s between samples is long for a joint: if t is in milliseconds, declare {declared} in units.json"
    return [Repair(trajectory=label, kind="slow", count=len(runs), text=text)]


def check_same_units(recording: Recording, fitted: Recording) -> None:
    """Refuse recordings to predict in other units than what is fitted.

    Raises:
        RecordingError: they differ.
    """
    if recording.units != fitted.units:
        theirs, ours = (", ".join(x.units.values()) for x in (recording, fitted))
        raise RecordingError(f"{recording.source}: in {theirs}, but {fitted.source} in {ours}; convert one of them")


def find_holding(path: str | Path) -> Path | None:
    """The break-away tests that belong to a recording: ``holding.csv`` in its folder or in the folder above."""
    path = Path(path)
    folder = path if path.is_dir() else path.parent
    return next((f / HOLDING_FILE for f in (folder, folder.absolute().parent) if (f / HOLDING_FILE).is_file()), None)


def load_holding(path: str | Path, recording: Recording | None = None) -> Holding:
    """Read break-away tests: columns ``current`` [A] and ``torque`` [N·m], one row per test (docs/data.md).

    ``units.json`` is for recordings and does not apply.

    Args:
        path: The file (``.csv``, ``.csv.gz``, ``.parquet``), or the folder that holds ``holding.csv``.
        recording: Recordings of the same device. Numbers that cannot be of one device are refused; a device in V or N
            has its break-away tests in these, too.

    Raises:
        RecordingError: the file is refused; the message names file, row and column, and the remedy.
    """
    path = Path(path)
    file = _files_of(path / HOLDING_FILE if path.is_dir() else path)[0]
    table = read_table(file, HOLDING_COLUMNS, MAX_BYTES)
    units = {name: (recording.units if recording else UNITS)[name] for name in HOLDING_COLUMNS}
    remedy = f"convert them, this file is in {' and '.join(units.values())} regardless of units.json"
    check_finite(table)
    if not read_units(file.parent).trusted:
        for name, unit in units.items():
            check_plausible(table, name, float(np.abs(table.columns[name]).max()), unit, remedy)
        if recording is not None:
            _check_same_device(table, recording, units, remedy)
    return Holding(current=table.columns["current"], torque=table.columns["torque"], units=units, header=table.header)


def _check_same_device(table: Table, recording: Recording, units: dict[str, str], remedy: str) -> None:
    """Refuse break-away tests whose currents or torques are far from those of the recordings."""
    current, torque = (np.abs(table.columns[name]) for name in HOLDING_COLUMNS)
    top = recording.current_range[1]
    sliding = float(np.percentile(np.abs(np.concatenate([run.torque for run in recording.trajectories])), 99))
    held = float(np.max(torque, where=current <= 1.2 * top, initial=0.0))
    for name, value, other, (low, high) in (
        ("current", float(current.max()), top, SAME_CURRENT),
        ("torque", held, sliding, SAME_TORQUE),
    ):
        if top > 0.0 and other > 0.0 and not low <= value / other <= high:
            raise table.refuse(
                f"up to {value:.4g} {units[name]}, but up to {other:.4g} {units[name]} in {recording.source}: a factor "
                f"of {value / other:.3g}, plausible are {low:g} to {high:g}; {remedy}, or take it away",
                column=name,
            )


def _files_of(path: Path) -> list[Path]:
    """The recording's files, sorted by name."""
    files = [path]
    if path.is_dir():
        files = sorted(p for p in path.iterdir() if is_recording(p) and p.name != HOLDING_FILE)
        if not files:
            inside = sorted(p.name for p in path.iterdir() if p.is_dir() and any(map(is_recording, p.iterdir())))
            hint = f"; name one of its folders: {', '.join(inside)}" if inside else ""
            if texts := sorted(p.name for p in path.iterdir() if suffix_of(p) in TEXTS):
                hint += f"; no rows of numbers at the beginning of {', '.join(texts[:3])}"
            raise RecordingError(f"{path}: no recording in this folder ({', '.join(KINDS)} files){hint}")
    for file in files:
        if not file.exists():
            raise RecordingError(f"{file}: there is no such file or folder; check the path")
        if not file.is_file():
            raise RecordingError(f"{file}: not a regular file; copy the data into a file first")
        if not suffix_of(file):
            raise RecordingError(f"{file}: not a known kind of recording; use {', '.join(KINDS)}")
    return files


def _common(headers: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The entries that all headers share."""
    first = headers[0]
    return {k: v for k, v in first.items() if all(k in h and h[k] == v for h in headers[1:])}


def _epoch(table: Table, units: Units) -> float:
    """The whole second at which a table begins whose clock counts from 1970; 0 for any other clock."""
    t = units.convert("t", table.columns["t"])
    first = float(np.floor(t.min())) if len(t) and np.isfinite(t).all() else 0.0
    return first if EPOCH < first < 1e3 * EPOCH else 0.0


@dataclass(frozen=True, kw_only=True)
class _Read:
    """Content of one file."""

    parts: list[Trajectory]
    repairs: list[Repair]
    period: float = 0.0
    """Longest length after which its angle begins again; 0 where it does not."""


def _checked(table: Table, units: Units, stem: str, in_folder: bool, origin: float) -> _Read:
    """The trajectories of one file, converted; the file's name ``stem`` begins their ids in a folder."""
    table = without_blanks(table, [rows for _, rows in _groups(table)])
    check_finite(table)
    if not units.trusted:
        _check_stamps(table, units, stem, in_folder)
    return _read(table, units, stem, in_folder, origin)


def _read(table: Table, units: Units, stem: str, in_folder: bool, origin: float) -> _Read:
    """The trajectories of one file, converted and put right."""
    columns = {name: units.convert(name, values) for name, values in table.columns.items()}
    columns["t"] = columns["t"] - origin if origin else columns["t"]
    if "current" not in columns:
        columns["current"] = np.zeros(len(columns["t"]))
    flags = {flag: bool(table.header.get(flag, False)) for flag in ("qd_derived", "q_integrated")}
    parts, repairs, period = [], [], 0.0
    repairs += [Repair(trajectory=table.file.name, kind="left_out", count=1, text=text) for text in table.notes]
    for name, rows in _groups(table):
        label = stem if name is None else f"{stem}/{name}" if in_folder else name
        rows, done = thinned(label, columns, rows)
        repairs += done
        run = {key: values[rows] for key, values in columns.items()}
        lengths = units.periods()
        if "q" in run and (found := wrap_length(run["t"], run["q"], float(units.convert("q", np.ones(1))[0]))):
            lengths.append(found)
        repairs += [*replace_wrong_readings(label, run, units, lengths), *without_marks(label, run)]
        if not units.trusted:
            check_marks(table, run, rows, units)
        repairs += held_channels(label, run)
        pieces = [slice(0, len(rows))]
        if "q" in run:
            own, done = unwrap(label, run, units, lengths)
            period = max(period, own)
            repairs += done
            pieces, done = undo_jumps(label, run, units)
            repairs += done
        for own, part in _named(label, pieces):
            even, done = _even_parts(table, {key: x[part] for key, x in run.items()}, rows[part], name, own)
            repairs += done
            for each, part in even:
                trajectory = _trajectory(each, part, table.header, flags)
                parts.append(trajectory)
                if "q" not in run:
                    text = (
                        "there is no angle: q was integrated from qd and begins at 0, and an offset of qd would let it "
                        "drift; what depends on the place (C, q_offset) is not to be trusted"
                    )
                    repairs.append(Repair(trajectory=each, kind="integrated", count=len(trajectory.t), text=text))
    return _Read(parts=parts, repairs=repairs, period=period)


def _check_stamps(table: Table, units: Units, stem: str, in_folder: bool) -> None:
    """Refuse stamps more than a second from each other, or that only count samples, with a declaration that was tried.

    Raises:
        RecordingError: naming the unit that they look like.
    """
    t = units.convert("t", table.columns["t"])
    first = next(_groups(table))[1]
    steps = np.diff(t[first])
    dt = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    counts = dt == 1.0 and not (t % 1.0).any() and "t" not in units.given
    if not (dt > 1.0 or counts):
        return

    def right(proposal: dict[str, Any]) -> bool:
        try:
            declared = units.declaring(proposal)
            found = _read(table, declared, stem, in_folder, _epoch(table, declared))
        except RecordingError:
            return False
        rate = float(np.median([1.0 / part.dt for part in found.parts]))
        return rate < MAX_RATE and misread(found.parts, declared, table.columns.keys(), found.period) is None

    passed = [(unit, size, name) for unit, size, name in _STAMPS if dt <= size and right({"t": unit})]
    passed.sort(key=lambda entry: not _USUAL_RATES[0] <= entry[1] / dt <= _USUAL_RATES[1])  # else in their order
    samples = " (numbers of samples by their rate)" if counts else ""
    if not passed:
        text = f"{dt:g} s between samples, and no unit of time makes them a log of a bench"
        if counts and (step := _sample_step(table, units, stem, in_folder)) and right({"scale": {"t": step}}):
            declared = json.dumps(units.content({"scale": {"t": step}}))
            text = f"{dt:g} s between samples: these are numbers of samples; q and qd say that one takes {step:g} s: "
            raise table.refuse(f"{text}declare {declared} in units.json, or divide{samples}", column="t")
        raise table.refuse(f'{text}: write t in seconds{samples}, or declare {{"scale": {{"t": SECONDS}}}}', column="t")
    (unit, per_second, name), *others = passed
    declared = json.dumps(units.content({"t": unit}), ensure_ascii=False)
    more = "".join(f"; {x[2]} where it was sampled at {x[1] / dt:.4g} Hz, not at {per_second / dt:.4g}" for x in others)
    raise table.refuse(
        f"{dt:g} s between samples: these look like {name}; divide by {per_second:.0f}{samples}, or declare "
        f"the unit in units.json: {declared}{more}",
        column="t",
    )


def _sample_step(table: Table, units: Units, stem: str, in_folder: bool) -> float:
    """Time of a sample [s] by which dq/dt is ``qd`` where stamps only count samples; 0 where nothing shows it."""
    try:
        found = agreement(_read(table, units, stem, in_folder, 0.0).parts)
    except RecordingError:
        return 0.0
    return float(f"{found.factor:.3g}") if found is not None and 0.0 < found.factor < 1.0 else 0.0


def _named(label: str, pieces: list[slice]) -> list[tuple[str, slice]]:
    """Names and rows of the runs in a run that are long enough; of the first where none is."""
    if len(pieces) == 1:
        return [(label, pieces[0])]
    parts = [(f"{label}#{k + 1}", piece) for k, piece in enumerate(pieces)]
    return [part for part in parts if part[1].stop - part[1].start >= MIN_SAMPLES] or parts[:1]


def _trajectory(name: str, part: dict[str, np.ndarray], header: dict[str, Any], flags: dict[str, bool]) -> Trajectory:
    """A trajectory of evenly sampled columns; its velocity is derived, or its angle integrated, where it is missing."""
    part, half = dict(part), None
    derived, integral = "qd" not in part, "q" not in part
    dt = (part["t"][-1] - part["t"][0]) / (len(part["t"]) - 1)
    if derived:
        half = quiet_half(part["q"], dt)
        part["qd"] = differentiate(part["q"], dt, half)
    if integral:
        part["q"] = integrated(part["qd"], dt)
    return Trajectory(
        id=name,
        qd_derived=derived or flags["qd_derived"],
        q_integrated=integral or flags["q_integrated"],
        qd_half=half,
        header=header,
        **part,
    )


def _in_one_turn(runs: list[Trajectory], repairs: list[Repair], period: float) -> list[Trajectory]:
    """Runs of an angle that begins again after a period, by whole ones to where the first is; adds a note."""
    found = in_one_turn([run.q for run in runs], period)
    moved = [run.id for run, q in zip(runs, found, strict=True) if q is not run.q]
    if not moved:
        return runs
    whole = "turns" if np.isclose(period, 2.0 * np.pi) else "lengths after which the reading begins again"
    text = f"moved by whole {whole} to where {runs[0].id} is: the reading begins again between them"
    repairs += [Repair(trajectory=name, kind="unwrapped", count=1, text=text) for name in moved]
    return [replace(run, q=q) for run, q in zip(runs, found, strict=True)]


def _groups(table: Table) -> Iterator[tuple[str | None, np.ndarray]]:
    """Rows of each trajectory in the order of first appearance."""
    if table.ids is None:
        yield None, np.arange(len(table.columns["t"]))
        return
    names, first, code = np.unique(table.ids, return_index=True, return_inverse=True)
    for k in np.argsort(first):
        yield str(names[k]), np.flatnonzero(code == k)


def _even_parts(
    table: Table, part: dict[str, np.ndarray], rows: np.ndarray, name: str | None, label: str
) -> tuple[list[tuple[str, dict[str, np.ndarray]]], list[Repair]]:
    """Evenly sampled runs of one trajectory with their names, and what was done to its time stamps."""
    of, t = "" if name is None else f" of trajectory {name!r}", part["t"]
    if len(t) < MIN_SAMPLES:
        raise table.refuse(f"{len(t)} samples{of}; at least {MIN_SAMPLES} are needed, record a longer run")
    try:
        pieces, gaps = even_pieces(part)
    except UnevenError as error:
        raise table.refuse(f"{error}{of}", row=int(rows[error.row]), column="t") from None
    kept = [piece for piece in pieces if len(piece.columns["t"]) >= MIN_SAMPLES]
    if not kept:
        raise table.refuse(
            f"{len(gaps)} gaps{of}, the first of {gaps[0][1]:.3g} s at {gaps[0][0]:.6g} s, leave no run of "
            f"{MIN_SAMPLES} samples; record again without them",
            column="t",
        )
    repairs, parts = [], []
    if gaps:
        places = ", ".join(f"{long:.3g} s at {at:.5g} s" for at, long in gaps[:3]) + (", ..." if len(gaps) > 3 else "")
        lost = sum(len(piece.columns["t"]) for piece in pieces if len(piece.columns["t"]) < MIN_SAMPLES)
        text = f"split at {len(gaps)} gaps ({places}) into {len(kept)} trajectories"
        text += f"; {lost} samples between them are too few to use" if lost else ""
        at = tuple(at for at, _ in gaps[:10])
        repairs.append(Repair(trajectory=label, kind="split", count=len(gaps), at=at, text=text))
    for k, piece in enumerate(kept):
        own = f"{label}#{k + 1}" if len(kept) > 1 else label
        parts.append((own, piece.columns))
        if text := piece.text():
            count = piece.moved or piece.repeated or len(piece.columns["t"])
            repairs.append(Repair(trajectory=own, kind="resampled", count=count, at=piece.at, text=text))
    return parts, repairs
