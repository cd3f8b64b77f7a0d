"""Configurations as plain values and back: what checkpoints, policies and results keep of them."""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Mapping
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, Union, get_args, get_origin, get_type_hints

ConfigT = TypeVar("ConfigT")


def plain(value: Any) -> Any:
    """A configuration as JSON gives it back: fields by name, choices by their values."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(entry) for key, entry in value.items()}
    if isinstance(value, tuple | list):
        return [plain(entry) for entry in value]
    return value.value if isinstance(value, enum.Enum) else str(value) if isinstance(value, Path) else value


def read(config: type[ConfigT], content: Mapping[str, Any]) -> ConfigT:
    """A configuration from what :func:`plain` gave; what the content does not name keeps its default.

    Raises:
        ValueError: an entry is of another kind than the field's, or no value that it takes.
    """
    hints = get_type_hints(config, include_extras=True)
    names = {field.name for field in dataclasses.fields(config)} & content.keys()  # type: ignore[arg-type]
    return config(**{name: _read(name, hints[name], content[name]) for name in names})


def _read(name: str, kind: Any, value: Any) -> Any:
    """An entry as its field's type has it."""
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) in (Union, UnionType):
        if value is None:
            return None
        kind = next(option for option in get_args(kind) if option is not type(None))
        return _read(name, kind, value)
    if kind is Any:
        return value
    origin = get_origin(kind) or kind
    try:
        if dataclasses.is_dataclass(kind):
            return read(kind, value)  # type: ignore[arg-type]
        if origin is tuple and isinstance(value, list):
            return tuple(value)
        if issubclass(origin, enum.Enum | Path):
            return origin(value)
    except (TypeError, AttributeError) as error:
        raise ValueError(f"{name} = {value!r}: {error}") from None
    wanted = {float: (int, float), tuple: tuple}.get(origin, origin)
    if not isinstance(value, wanted) or (isinstance(value, bool) and origin is not bool):
        raise ValueError(f"{name} = {value!r} is no {origin.__name__}")
    return value
