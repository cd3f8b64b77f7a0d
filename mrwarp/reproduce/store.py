"""Simulated data of an experiment as one ``.npz`` of plain arrays: what other experiments read without simulating."""

from __future__ import annotations

import json
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from mrwarp.run_dir import atomic_write

T = TypeVar("T")


def save(path: Path, data: Any) -> None:
    """Write nested dataclasses, dicts, lists, arrays and plain values in an atomic write; never pickled."""
    arrays: dict[str, np.ndarray] = {}

    def strip(value: Any) -> Any:
        """The same with every array as its number in the file."""
        if is_dataclass(value):
            return {f.name: strip(getattr(value, f.name)) for f in fields(value)}
        if isinstance(value, np.ndarray):
            arrays[f"a{len(arrays)}"] = value
            return {"__array__": f"a{len(arrays) - 1}"}
        if isinstance(value, dict):
            return {name: strip(item) for name, item in value.items()}
        return [strip(item) for item in value] if isinstance(value, list | tuple) else value

    skeleton = np.array(json.dumps(strip(data)))
    with atomic_write(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, tree=skeleton, **arrays)  # type: ignore[arg-type]


def load(path: Path, kind: type[T]) -> T:
    """Read what :func:`save` wrote of a dataclass, with those nested in its fields, lists and dicts by their types."""
    with np.load(path, allow_pickle=False) as file:

        def fill(value: Any, kind: Any) -> Any:
            if isinstance(value, dict) and "__array__" in value:
                return file[value["__array__"]]
            if is_dataclass(kind):
                hints = get_type_hints(kind)
                return kind(**{name: fill(item, hints[name]) for name, item in value.items()})  # type: ignore[operator]
            items = get_args(kind)[-1] if get_origin(kind) in (list, dict) else Any
            if isinstance(value, dict):
                return {name: fill(item, items) for name, item in value.items()}
            return [fill(item, items) for item in value] if isinstance(value, list) else value

        return fill(json.loads(str(file["tree"])), kind)
