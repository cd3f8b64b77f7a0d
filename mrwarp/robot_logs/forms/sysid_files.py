"""Files of other identification tools as robot logs: PACE's tensors, and the CSV of Isaac Sim's system identification.

PACE (github.com/leggedrobotics/pace-sim2real, ``scripts/pace/data_collection.py``) saves ``time``, ``dof_pos`` and
``des_dof_pos`` by PyTorch, in radians, in the order of its configuration's ``joint_order``. Isaac Sim's extension
``isaacsim.robot_setup.sysid`` reads CSV files with the columns time, q1 to qN, and perhaps dq1 to dqN and cmd1 to cmdN
(``trajectory_csv_core.py`` of version 6.2), in the order of the articulation's joints and in Isaac's own units.
"""

from __future__ import annotations

import pickle
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.recording.tables import MAX_BYTES, read_table
from mrwarp.robot_logs.forms.mapped_log import Columns, Source, log_of
from mrwarp.robot_logs.kinds import PICKLES, head_of, joints_numbered, numbered_tables_in, tensors_in
from mrwarp.robot_logs.robot_log import LogError, RobotLog
from mrwarp.run_dir import one_line

PACE = {"dof_pos": "q", "des_dof_pos": "q_des", "dof_vel": "qd"}
"""Channel of a robot's log by PACE's names; ``dof_vel`` is of programs that write its files."""

RADIANS = {"q": "rad"}


def read_pace(path: Path, m: Mapping[str, Any], *, skip_bad: bool = False) -> RobotLog:
    """Read PACE's files; arguments and errors as of :func:`mrwarp.robot_logs.forms.mapped_log.log_of`."""
    recordings, names = [], None
    for file in tensors_in(path):
        own, found = _pace(file)
        if names is not None and (own or names) != names or recordings and _width(recordings) != _width([found]):
            raise LogError(f"{file}: has other joints than the files before it; read it by itself")
        names = own or names
        recordings.append(found)
    order = 'in the order of joint_order of the environment\'s configuration: {"joints": ["LF_HAA", ...]}'
    return _named(path, m, names, recordings, order, skip_bad)


def _pace(file: Path) -> tuple[list[str] | None, Columns]:
    """Names of the joints where a file holds them, and its recording."""
    if file.suffix in PICKLES:
        raise LogError(
            f"{file}: a pickle can run any program when it is read; save a dictionary of tensors by torch.save as .pt"
        )
    if file.stat().st_size > MAX_BYTES:
        raise LogError(f"{file}: more than {MAX_BYTES / 2**20:g} MiB; split it")
    import torch

    try:
        data = torch.load(file, map_location="cpu", weights_only=True)
    except Exception as error:  # torch raises many types for damaged files
        if isinstance(error, pickle.UnpicklingError) and zipfile.is_zipfile(file):
            raise LogError(f"{file}: holds more than tensors, and is not read for safety; save tensors alone") from None
        raise LogError(f"{file}: is no file of tensors ({one_line(error)[:120]}); save it again") from None
    needed = ("time", "dof_pos", "des_dof_pos")
    if missing := next((x for x in needed if not isinstance(data, dict) or x not in data), None):
        keys = ", ".join(map(str, data))[:200] if isinstance(data, dict) else type(data).__name__
        raise LogError(f"{file}: there is no {missing} ({keys}); PACE's files hold {', '.join(needed)}")
    arrays = {}
    for key in ("time", *PACE):
        if key in data:
            if not isinstance(data[key], torch.Tensor):
                raise LogError(f"{file}: {key} is a {type(data[key]).__name__}, no tensor; save it as one")
            arrays[key] = data[key].double().numpy()
    shape = arrays["dof_pos"].shape
    if len(shape) != 2 or any(x.shape != (shape if key != "time" else shape[:1]) for key, x in arrays.items()):
        shapes = ", ".join(f"{key} {x.shape}" for key, x in arrays.items())
        raise LogError(f"{file}: shapes do not fit: {shapes}; needed are time (N,) and the others (N, joints)")
    own = data.get("joint_names", data.get("joint_order"))
    names = list(own) if isinstance(own, list | tuple) and len(own) == shape[1] else []
    joint = {channel: arrays[key] for key, channel in PACE.items() if key in arrays}
    return names if names and all(isinstance(x, str) for x in names) else None, Columns(
        id=file.stem, t=arrays["time"], joint=joint
    )


def read_isaac(path: Path, m: Mapping[str, Any], *, skip_bad: bool = False) -> RobotLog:
    """Read CSV files of numbered joints; arguments and errors as :func:`~mrwarp.robot_logs.forms.mapped_log.log_of`."""
    recordings, left = [], MAX_BYTES
    for file in numbered_tables_in(path):
        names = head_of(file)
        table = read_table(file, [], left, lambda _: True)
        left -= table.size
        columns = list(table.columns.values())
        count, joint = joints_numbered(names), {}
        for group, channel in enumerate(("q", "qd", "q_des")):
            own = columns[1 + group * count : 1 + (group + 1) * count]
            joint |= {channel: np.stack(own, axis=1)} if own else {}
        found = Columns(id=file.stem, t=columns[0], joint=joint)
        if recordings and _width(recordings) != count:
            raise LogError(f"{file}: {count} joints, the files before it have {_width(recordings)}; read it by itself")
        recordings.append(found)
    order = 'in the order of the articulation\'s joints: {"joints": ["shoulder", ...]}'
    return _named(path, m, None, recordings, order, skip_bad)


def _width(recordings: Sequence[Columns]) -> int:
    return recordings[0].joint["q"].shape[1]


def _named(
    path: Path,
    m: Mapping[str, Any],
    names: Sequence[str] | None,
    recordings: Sequence[Columns],
    order: str,
    skip_bad: bool,
) -> RobotLog:
    """A log whose columns the files or a map's list name."""
    width, given = _width(recordings), m.get("joints")
    if names is None and not (isinstance(given, list) and len(given) == width):
        raise LogError(
            f"{path}: does not name the joints of its {width} columns; name them in a map, {order}, null for "
            "one to leave out: --map MAP.json, or map.json next to the file"
        )
    own = names or [f"column {k + 1}" for k in range(width)]
    notes = ["angles are taken in rad, as this form of file has them; --units q=deg says otherwise"]
    units = m.get("units") or {}
    source = Source(names=own, units=RADIANS, question="", notes=[] if "q" in units else notes)
    return log_of(path, m, source, recordings, skip_bad=skip_bad)
