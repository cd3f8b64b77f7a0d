"""Simulated data of an experiment as one ``.npz`` of plain arrays: what other experiments read without simulating."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrwarp.run_dir import atomic_write


def save(path: Path, tree: Any) -> None:
    """Write nested dicts, lists, dataclasses, arrays and plain values in one piece; never pickled."""
    arrays: dict[str, np.ndarray] = {}

    def strip(value: Any) -> Any:
        if is_dataclass(value) and not isinstance(value, type):
            value = {f.name: getattr(value, f.name) for f in fields(value)}
        if isinstance(value, np.ndarray):
            arrays[f"a{len(arrays)}"] = value
            return {"__array__": f"a{len(arrays) - 1}"}
        if isinstance(value, dict):
            return {str(name): strip(item) for name, item in value.items()}
        if isinstance(value, list | tuple):
            return [strip(item) for item in value]
        return value

    skeleton = np.array(json.dumps(strip(tree)))
    with atomic_write(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, tree=skeleton, **arrays)  # type: ignore[arg-type]


def load(path: Path) -> Any:
    """Read what :func:`save` wrote; dataclasses and tuples come back as dicts and lists."""
    with np.load(path, allow_pickle=False) as file:

        def fill(value: Any) -> Any:
            if isinstance(value, dict):
                if "__array__" in value:
                    return file[value["__array__"]]
                return {name: fill(item) for name, item in value.items()}
            return [fill(item) for item in value] if isinstance(value, list) else value

        return fill(json.loads(str(file["tree"])))
