"""LeRobot's data sets, versions 2 and 3, as robot logs: one recording per episode.

``meta/info.json`` names the numbers of each vector column, Parquet files under ``data/`` hold the rows: one file per
episode in version 2, several episodes per file in version 3. Images and videos are not read. The format is that of
https://huggingface.co/docs/lerobot/lerobot-dataset-v3 and ``DatasetInfo`` of github.com/huggingface/lerobot.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from mrwarp.recording.tables import MAX_BYTES
from mrwarp.robot_logs.forms.mapped_log import Columns, Source, log_of
from mrwarp.robot_logs.robot_log import LogError, RobotLog
from mrwarp.run_dir import one_line

VERSIONS = ("v2.", "v3.")
"""Beginnings of ``codebase_version`` that are read."""

STATE, ACTION = "observation.state", "action"

SUFFIXES = {"pos": "", "position": "", "vel": "vel", "velocity": "vel", "torque": "effort", "effort": "effort"}
"""Quantity of a number by the end of its name: ``shoulder_pan.pos``; without such an end it is an angle."""

CHANNELS = {
    (STATE, ""): "q", (STATE, "vel"): "qd", (STATE, "effort"): "tau",
    (ACTION, ""): "q_des", (ACTION, "vel"): "qd_des", (ACTION, "effort"): "tau_ff",
}  # fmt: skip
"""Channel of a robot's log, by feature and kind of number. An action is computed from its row's state."""

FURTHER = {
    "observation.velocity": "qd",
    "observation.effort": "tau",
    "observation.torque": "tau",
}
"""Features of their own that hold one number for each angle of the state."""

INDEX = ("timestamp", "episode_index", "frame_index")


def read_lerobot(path: Path, m: Mapping[str, Any], *, skip_bad: bool = False) -> RobotLog:
    """Read a data set; arguments and errors as of :func:`mrwarp.robot_logs.forms.mapped_log.log_of`."""
    file, info = path / "meta" / "info.json", _info(path / "meta" / "info.json")
    features = info["features"]
    layout = _layout(file, features, m)
    names = list(dict.fromkeys(name for channel, name, _, _ in layout if channel == "q"))
    wanted = list(dict.fromkeys(feature for _, _, feature, _ in layout))
    table, notes = _rows(path, wanted), _grippers(names, m)
    values = {feature: _vectors(path, table, feature, features[feature]) for feature in wanted}
    t, episode = (table[name].to_numpy().astype(float) for name in INDEX[:2])
    order = np.lexsort((table["frame_index"].to_numpy() if "frame_index" in table.column_names else t, episode))
    filled: dict[str, np.ndarray] = {}
    for channel, name, feature, column in layout:
        if name in names:
            filled.setdefault(channel, np.full((len(t), len(names)), np.nan))
            filled[channel][:, names.index(name)] = values[feature][:, column]
    recordings = []
    for number in np.unique(episode).astype(int):
        rows = order[episode[order] == number]
        recordings.append(Columns(id=f"episode_{number:06d}", t=t[rows], joint={c: x[rows] for c, x in filled.items()}))
    if (listed := info.get("total_episodes", len(recordings))) != len(recordings):
        notes.append(f"{file.name} lists {listed} episodes, the files here hold {len(recordings)}")
    low, high = (f(filled["q"]) for f in (np.nanmin, np.nanmax))
    question = (
        f"{file.name} does not say the unit of {STATE} (values {low:.4g} to {high:.4g}): is it degrees (--units q=deg) "
        "or radians (--units q=rad)? Where it is LeRobot's -100 to 100 of a calibrated range, it is no angle, and "
        "cannot be used without that calibration"
    )
    return log_of(
        path,
        m,
        Source(names=names, units=_units(features), question=question, notes=notes),
        recordings,
        skip_bad=skip_bad,
    )


def _info(file: Path) -> dict[str, Any]:
    try:
        info = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise LogError(f"{file}: is no JSON ({one_line(error)}); copy the data set again") from None
    version = info.get("codebase_version") if isinstance(info, dict) else None
    if not isinstance(version, str) or not version.startswith(VERSIONS):
        raise LogError(
            f"{file}: codebase_version = {version!r}; read are {' and '.join(v + 'x' for v in VERSIONS)}: "
            "convert the data set by LeRobot's scripts"
        )
    features = info.get("features")
    if not isinstance(features, dict) or not all(isinstance(x, dict) for x in features.values()):
        raise LogError(f"{file}: features = {str(features)[:60]} is no object; copy the data set again")
    for needed in (STATE, ACTION):
        if needed not in features:
            raise LogError(f"{file}: there is no feature {needed!r}; features: {', '.join(features)[:300]}")
    return info


def _layout(file: Path, features: Mapping[str, Any], m: Mapping[str, Any]) -> list[tuple[str, str, str, int]]:
    """Channel and joint of each number, with its feature and place in the vector."""
    found = []
    angles: list[str] = []
    for feature in (STATE, ACTION):
        names, width = _names(features[feature]), _width(file, feature, features[feature])
        if names is None and feature == ACTION and width == len(angles):
            names = angles  # as many as angles: in their order
        if names is None:
            names = _given(file, feature, width, m)
        if len(names) != width:
            raise LogError(f"{file}: {feature} has {len(names)} names for {width} numbers; correct the names")
        for k, name in enumerate(names):
            stem, _, end = name.rpartition(".")
            kind = SUFFIXES.get(end) if stem else None
            found.append((CHANNELS[feature, kind or ""], stem if kind is not None else name, feature, k))
        angles = angles or [name for channel, name, _, _ in found if channel == "q"]
    if double := next((name for name in angles if angles.count(name) > 1), ""):
        raise LogError(f"{file}: {STATE} names {double} twice; name it once")
    if not angles:
        raise LogError(f"{file}: {STATE} holds no angle ({', '.join(_names(features[STATE]) or ())[:200]})")
    for feature, channel in FURTHER.items():
        if feature in features and _width(file, feature, features[feature]) == len(angles):
            found += [(channel, name, feature, k) for k, name in enumerate(angles)]
    return found


def _given(file: Path, feature: str, width: int, m: Mapping[str, Any]) -> list[str]:
    """Names of numbers that the data set leaves without: those of the map's list."""
    given = m.get("joints")
    if isinstance(given, list) and len(given) == width:
        return [str(name) if name else f"left out {k}" for k, name in enumerate(given)]
    raise LogError(
        f'{file}: does not name the {width} numbers of {feature}; a map does, {{"joints": ["NAME", ...]}}, with null '
        "for what is no joint, by --map MAP.json, or as map.json next to meta"
    )


def _names(feature: Mapping[str, Any]) -> list[str] | None:
    """Names of a vector's numbers: a list, or lists by group as ``{"motors": [...]}``; None where there are none."""
    names = feature.get("names")
    if isinstance(names, dict):
        names = [name for group in names.values() if isinstance(group, list) for name in group]
    whole = isinstance(names, list) and all(isinstance(name, str) for name in names)
    return names if whole and names and (len(names) > 1 or feature.get("shape") == [1]) else None


def _width(file: Path, name: str, feature: Mapping[str, Any]) -> int:
    shape = feature.get("shape")
    if not isinstance(shape, list) or len(shape) != 1 or not isinstance(shape[0], int) or shape[0] < 1:
        raise LogError(f"{file}: {name} has the shape {shape}; needed is one vector a row, such as [6]")
    return shape[0]


def _units(features: Mapping[str, Any]) -> dict[str, str]:
    """Units that a data set says for itself, as ``unit`` or ``units`` of a feature: none of LeRobot's own does."""
    found = {}
    for feature, channel in ((STATE, "q"), (ACTION, "q_des"), *FURTHER.items()):
        unit = features.get(feature, {}).get("unit", features.get(feature, {}).get("units"))
        if isinstance(unit, str):
            found[channel] = {"degrees": "deg", "degree": "deg", "radians": "rad", "radian": "rad"}.get(unit, unit)
    return found


def _rows(path: Path, wanted: Sequence[str]) -> pa.Table:
    """Rows of all Parquet files of the data set, those columns alone that are needed."""
    files = sorted((path / "data").rglob("*.parquet")) if (path / "data").is_dir() else []
    if not files:
        raise LogError(f"{path / 'data'}: no Parquet files; copy the data set with its data, videos are not needed")
    tables, size = [], 0
    for file in files:
        try:
            schema = pyarrow.parquet.read_schema(file)
            missing = [name for name in (*INDEX[:2], *wanted) if name not in schema.names]
            if missing:
                raise LogError(f"{file}: there is no column {missing[0]!r}, which meta/info.json lists")
            columns = [name for name in (*INDEX, *wanted) if name in schema.names]
            table = pyarrow.parquet.read_table(file, columns=columns)
        except (pa.ArrowException, OSError) as error:
            raise LogError(f"{file}: cannot be read ({one_line(error)[:200]}); copy it again") from None
        tables.append(table)
        size += table.nbytes
        if size > MAX_BYTES:
            raise LogError(f"{path}: more than {MAX_BYTES / 2**20:g} MiB of numbers; copy fewer episodes")
    try:
        return pa.concat_tables(tables, promote_options="permissive").combine_chunks()
    except pa.ArrowException as error:
        raise LogError(f"{path / 'data'}: files differ in their columns ({one_line(error)[:200]})") from None


def _vectors(path: Path, table: pa.Table, name: str, feature: Mapping[str, Any]) -> np.ndarray:
    """A vector column, shape (N, C)."""
    column, width = table[name].combine_chunks(), feature["shape"][0]
    flat = column.flatten() if pa.types.is_list(column.type) or pa.types.is_fixed_size_list(column.type) else column
    if column.null_count or len(flat) != width * len(column) or not pa.types.is_floating(flat.type):
        raise LogError(f"{path}: {name} does not hold {width} numbers in every row, as meta/info.json has it")
    return np.asarray(flat.to_numpy(zero_copy_only=False), dtype=float).reshape(-1, width)


def _grippers(names: Sequence[str], m: Mapping[str, Any]) -> list[str]:
    """Note on grippers whose numbers would be taken as angles."""
    given = m.get("joints")
    taken = set(given) if isinstance(given, dict) else set(names)
    own = [name for name in names if "gripper" in name.lower() and name in taken]
    return [
        f"{name} is taken as an angle: LeRobot's arms log grippers as 0 to 100 of their range even where other joints "
        "are degrees; if this one is such, leave it out by joints of the map"
        for name in own
    ]
