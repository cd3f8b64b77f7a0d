"""Entries of a JSON file from outside: each is read as data, checked, and refused by its place, value and remedy."""

from __future__ import annotations

import json
import reprlib
import sys
from collections import Counter
from pathlib import Path
from typing import Any

_SHORT = reprlib.Repr()
_SHORT.maxlevel, _SHORT.maxstring, _SHORT.maxother, _SHORT.maxlong = 3, 80, 80, 80


class JsonFileError(ValueError):
    """A JSON file, or one of its entries, was refused; the message names path, key, value and remedy."""


def read_json_file(path: Path, remedy: str) -> Any:
    """Content of a JSON file.

    Raises:
        JsonFileError: it cannot be read, is not JSON, or a key stands twice in one object.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise JsonFileError(f"{path}: not JSON: {error}; {remedy}") from None
    except OSError as error:
        raise JsonFileError(f"{path}: {error.strerror}; {remedy}") from None
    return read_json(text, str(path), remedy)


def read_json(text: str, where: str, remedy: str = "") -> Any:
    """Content of a JSON text.

    Raises:
        JsonFileError: it is not JSON, or a key stands twice in one object.
    """
    try:
        return json.loads(text, object_pairs_hook=_unique)
    except JsonFileError as error:
        raise JsonFileError(f"{where}: {error}") from None
    except (ValueError, RecursionError) as error:
        raise JsonFileError(f"{where}: not JSON: {error}{'; ' * bool(remedy)}{remedy}") from None


def shown(value: Any) -> str:
    """A value of a file for a message: as Python writes it, on one line, shortened."""
    found = _SHORT.repr(value)
    return found if len(found) <= _SHORT.maxstring else found[: _SHORT.maxstring - 3] + "..."


def key_shown(name: str) -> str:
    """A key of a file for a message: as it is, unless it is long or cannot be printed."""
    return name if name.isprintable() and len(name) <= _SHORT.maxstring else shown(name)


def checked_number(value: Any, where: str) -> float:
    """A finite number of a file, as float.

    Raises:
        JsonFileError: it is none.
    """
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max:
        return float(value)
    raise JsonFileError(f"{where} = {shown(value)}; allowed: a finite number")


def checked_interval(ci95: Any, where: str) -> tuple[float, float] | None:
    """A pair of numbers, the lower one first, or None."""
    if ci95 is None:
        return None
    if not isinstance(ci95, list) or len(ci95) != 2:
        raise JsonFileError(f"{where} = {shown(ci95)}; allowed: [low, high] or null")
    low, high = checked_number(ci95[0], f"{where}[0]"), checked_number(ci95[1], f"{where}[1]")
    if low > high:
        raise JsonFileError(f"{where} = {[low, high]}; allowed: [low, high]; exchange them")
    return low, high


def checked_whole(value: Any, where: str) -> int:
    """A whole number; an integer of any length keeps all its digits."""
    if not checked_number(value, where).is_integer():
        raise JsonFileError(f"{where} = {shown(value)}; allowed: a whole number")
    return int(value)


def checked_text(value: Any, where: str) -> str:
    """A text that UTF-8 can write."""
    if not isinstance(value, str) or any("\ud800" <= c <= "\udfff" for c in value):
        raise JsonFileError(f"{where} = {shown(value)}; allowed: a text")
    return value


def checked_texts(value: Any, where: str) -> dict[str, str]:
    """An object of texts."""
    found = checked_mapping(value, where)
    return {checked_text(k, f"{where}: key"): checked_text(v, f"{where}.{key_shown(k)}") for k, v in found.items()}


def checked_mapping(value: Any, where: str) -> dict[str, Any]:
    """An object with any keys."""
    if not isinstance(value, dict):
        raise JsonFileError(f"{where} = {shown(value)}; allowed: an object {{...}}")
    return value


def checked_object(value: Any, where: str, keys: tuple[str, ...]) -> dict[str, Any]:
    """A JSON object that has these keys and no others.

    Raises:
        JsonFileError: it is none.
    """
    content = checked_mapping(value, where)
    for key in keys:
        if key not in content:
            raise JsonFileError(f"{where}: {key} is missing; needed: {', '.join(keys)}")
    for key in content:
        if key not in keys:
            raise JsonFileError(f"{where}: there is no key {shown(key)}; known: {', '.join(keys)}; remove it")
    return content


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object whose keys stand once each."""
    content = dict(pairs)
    if len(content) != len(pairs):
        [(twice, _)] = Counter(key for key, _ in pairs).most_common(1)
        raise JsonFileError(f"{key_shown(twice)} stands twice in one object; remove one")
    return content
