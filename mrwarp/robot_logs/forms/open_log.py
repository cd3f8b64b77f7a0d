"""A robot's log in any form that is known, by its files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from mrwarp.robot_logs.forms.bag import read_bag
from mrwarp.robot_logs.forms.lerobot import read_lerobot
from mrwarp.robot_logs.forms.mapped_log import map_of
from mrwarp.robot_logs.forms.sysid_files import read_isaac, read_pace
from mrwarp.robot_logs.kinds import kind_of
from mrwarp.robot_logs.robot_log import LogError, RobotLog, load_log


def open_log(
    path: Path, *, skip_bad: bool = False, map_file: Path | None = None, units: Mapping[str, str] | None = None
) -> RobotLog:
    """Read a log: a folder with ``log.json``, a bag, or files of another project.

    Args:
        path: The log.
        skip_bad: Leave out recordings that would be refused, by name.
        map_file: What the files do not say; without it ``map.json`` next to them, if it is there.
        units: Unit of channels, before the map's own.

    Raises:
        LogError: it is refused; the message names place and remedy.
    """
    kind = kind_of(path)
    if kind in ("own", None):
        if map_file is not None or units:
            option = "--map" if map_file is not None else "--units"
            raise LogError(f"{path}: {option} is for logs without log.json; write units and gains into that file")
        return load_log(path, skip_bad=skip_bad)
    m = map_of(path, map_file, units)
    if kind == "bag":
        return read_bag(path, m)
    if kind == "lerobot":
        return read_lerobot(path, m, skip_bad=skip_bad)
    return (read_pace if kind == "pace" else read_isaac)(path, m, skip_bad=skip_bad)
