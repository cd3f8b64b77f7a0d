"""The kinds of files that commands read and write, known by their content: one that stands in another's place is named.

Reads the first bytes, and JSON as a whole; loads no engine.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mrwarp.run_dir import NOT_FINAL, is_not_final

MAX_JSON = 2**26
"""Longest JSON that is parsed to name it [bytes]: a result.json of a long training has a few megabytes."""

WANTED = {
    "model": "model.json",
    "bouc_wen": "model.json",
    "policy": "policy",
    "resume": "checkpoint",
    "actuator_file": "network",
    "numbers": "numbers.json",
    "compare": "result.json",
    "robot": "robot",
    **dict.fromkeys(("asset", "a", "b"), "USD file"),
}
"""The kind of file that an option names; ``policy`` is every ``policy_NAME`` too."""

_REMEDY = {
    "model.json": "give the model.json that 'mrwarp fit' or 'mrwarp diagnose' wrote",
    "policy": "name an .onnx file that 'mrwarp train' wrote",
    "checkpoint": "name the file checkpoint.pt that training wrote",
    "network": "name a .safetensors file that 'mrwarp learn' wrote",
    "numbers.json": "name the numbers.json that --calibrate wrote",
    "result.json": "name the result.json of an earlier run",
    "robot": "name mr_go, go1, or a robot's file",
    "USD file": "name a .usda file",
}

_MAGIC = {
    b"PAR1": ("recording", "a recording in Parquet"),
    b"PXR-USDC": ("USD file", "a USD file"),
    b"#usda": ("USD file", "a USD file"),
    b"\x89PNG": ("picture", "a picture"),
}
"""How files of each kind begin."""

_SUFFIXES = {
    ".onnx": ("policy", "an ONNX file"),
    ".pt": ("checkpoint", "a checkpoint of a training"),
    ".safetensors": ("network", "a safetensors file"),
    ".csv": ("recording", "a recording"),
}

_JSON = (
    (("parameters", "fitted_on", "units", "effects"), "model.json", "a model.json"),
    (("plant", "task"), "record", "the record of a policy's training"),
    (("stated", "measured"), "device.json", "the device.json of the library of devices"),
    (("joints", "base"), "log.json", "the log.json of a robot's log"),
    (("key", "findings"), "findings.json", "the findings.json of 'mrwarp reproduce'"),
)
"""Keys that a JSON file of each kind has, the kind, and its name in a message."""

_GROUPS = {"electrical", "thermal", "battery"}
_COLUMNS = {"t", "q", "qd", "current", "torque", "temperature"}


def refuse_other_kind(path: Path, option: str) -> None:
    """Raise ValueError for a file that is known to be of another kind than an option names, saying what it is.

    A file that is not recognised, or not there, is left to its own reader.
    """
    wanted = WANTED.get("policy" if option.startswith("policy_") else option)
    if wanted is None:
        return
    if path.is_dir():
        inside = path / "model.json"
        if wanted == "model.json":
            near = f"did you mean {inside}?" if inside.is_file() else _REMEDY[wanted]
            if not inside.is_file() and (early := _not_final(path / "result.json")):
                near = f"{early}; {near}"
            raise ValueError(f"{path}: is a folder, no model.json; {near}")
        return
    kind, name = kind_of(path)
    robots = ("robot", "USD file")
    if not kind or kind == wanted or (kind in robots and wanted in robots):
        return
    sibling = path.with_name("model.json")
    remedy = f"did you mean {sibling}?" if wanted == "model.json" and sibling.is_file() else _REMEDY[wanted]
    article = "no" if wanted in ("policy", "checkpoint", "network", "robot", "USD file") else "not a"
    raise ValueError(f"{path}: is {name}, {article} {wanted}; {remedy}")


def _not_final(path: Path) -> str:
    """That a file is a result which is not final, for a refusal; empty where it is not, or not there."""
    kind, name = kind_of(path)
    return f"{path.name} in it is {NOT_FINAL}" if kind == "result.json" and name.endswith(NOT_FINAL) else ""


def kind_of(path: Path) -> tuple[str, str]:
    """Kind of a file and its name in a message; both empty where it is not known."""
    try:
        with path.open("rb") as file:
            head = file.read(64)
        if not head.lstrip().startswith(b"{"):
            magic = next((found for start, found in _MAGIC.items() if head.startswith(start)), None)
            return magic or _SUFFIXES.get(path.suffix, ("", ""))
        if path.stat().st_size > MAX_JSON:
            return "", ""
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return "", ""
    return _json_kind(content)


def _json_kind(content: Any) -> tuple[str, str]:
    """Kind of a JSON file by its keys."""
    if not isinstance(content, dict) or not content:
        return "", ""
    for keys, kind, name in _JSON:
        if all(key in content for key in keys):
            return kind, name
    if isinstance(command := content.get("command"), str) and "versions" in content:
        early = f", which is {NOT_FINAL}" if is_not_final(content) else ""
        return "result.json", f"the result.json of '{' '.join(command.split()[:2])}'{early}"
    if content.keys() <= _GROUPS:
        return "numbers.json", "a numbers.json of the energy model"
    if content.keys() <= _COLUMNS:
        return "units.json", "the units.json of a recording"
    return "", ""
