"""Which form a robot's log has, by its files alone: nothing is read but the first line of a CSV."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Literal

LOG_FILE = "log.json"
"""File that describes a folder of recordings as a robot's log."""

PICKLES = (".pkl", ".pickle")
"""Files that run programs when they are read."""

Kind = Literal["own", "bag", "lerobot", "pace", "isaac"]

_HEAD = 65536
"""Longest first line of a CSV that is looked at [bytes]."""


def is_bag(path: Path) -> bool:
    """Whether a path is a bag: an .mcap, .db3 or .bag file, or the folder of a ROS 2 bag."""
    return path.suffix in (".mcap", ".db3", ".bag") or (path / "metadata.yaml").is_file()


def kind_of(path: Path) -> Kind | None:
    """Form of a robot's log, or None for what is none, as the recording of one joint.

    Forms are this project's own, a ROS bag, LeRobot's data set, PACE's tensors, the CSV of Isaac Sim's identification.
    """
    if (path / LOG_FILE).is_file() or path.name == LOG_FILE:
        return "own"
    if is_bag(path):
        return "bag"
    if (path / "meta" / "info.json").is_file():
        return "lerobot"
    if tensors_in(path):
        return "pace"
    return "isaac" if numbered_tables_in(path) else None


def tensors_in(path: Path) -> list[Path]:
    """Files of tensors as PyTorch saves them, and pickles, which are refused later: the path, or those of a folder."""
    names = (".pt", *PICKLES)
    return [path] if path.suffix in names else sorted(x for x in _files(path) if x.suffix in names)


def numbered_tables_in(path: Path) -> list[Path]:
    """CSV files with columns of numbered joints, all of them or none: the path, or those of a folder."""
    files = [path] if path.is_file() else _files(path)
    tables = sorted(x for x in files if x.suffix == ".csv")
    return tables if tables and all(joints_numbered(head_of(x)) for x in tables) else []


def head_of(path: Path) -> list[str]:
    """Names of a CSV's columns in lower case, after its comments; empty where it has none."""
    with path.open("rb") as stream:
        lines = stream.read(_HEAD).decode("utf-8-sig", "replace").splitlines()
    first = next((x for x in lines if x.strip() and not x.lstrip().startswith("#")), "")
    return [name.strip().strip('"').lower().replace(" ", "_") for name in first.split(",")]


def joints_numbered(names: list[str]) -> int:
    """N of columns time, q1 to qN, and perhaps dq1 to dqN and cmd1 to cmdN; 0 for other columns."""
    count = sum(bool(re.fullmatch(r"q\d+", name)) for name in names)
    groups = [[f"{group}{k + 1}" for k in range(count)] for group in ("q", "dq", "cmd")]
    layouts = [sum(groups[:most], []) for most in (1, 2, 3)]
    return count if names[1:] in layouts else 0


def _files(folder: Path) -> list[Path]:
    return [x for x in folder.iterdir() if x.is_file()] if folder.is_dir() else []
