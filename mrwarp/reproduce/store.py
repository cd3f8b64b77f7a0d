"""Simulated data of an experiment as one ``.npz`` of plain arrays: what other experiments read without simulating."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

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
    """Read what :func:`save` wrote of a dataclass."""
    with np.load(path, allow_pickle=False) as file:
        return typed(json.loads(str(file["tree"])), kind, file)


def typed(value: Any, kind: Any, arrays: Mapping[str, np.ndarray] | None = None) -> Any:
    """Plain values as the dataclasses that their type names, in fields, lists and dicts; null as NaN for a number.

    Args:
        value: Plain values, as JSON holds them.
        kind: Their type.
        arrays: Arrays by their number in the file.

    Raises:
        KeyError, TypeError: the values are not of that type.
    """
    if isinstance(value, dict) and "__array__" in value and arrays is not None:
        return arrays[value["__array__"]]
    kinds = [item for item in get_args(kind) if item is not type(None)]
    if get_origin(kind) in (Union, UnionType):
        return None if value is None else typed(value, kinds[0], arrays)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(**{name: typed(item, hints[name], arrays) for name, item in value.items()})  # type: ignore[operator]
    items = kinds[-1] if kinds else Any
    if isinstance(value, dict):
        return {name: typed(item, items, arrays) for name, item in value.items()}
    if isinstance(value, list):
        return [typed(item, items, arrays) for item in value]
    return math.nan if value is None and kind is float else value
