"""Types of options: numbers that refuse with value and range, lists of at least one value, flags, exclusive groups."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import FlagCreatePairsOff, create_mutex_group
from tyro.constructors import PrimitiveConstructorSpec

from mrwarp.params import with_unit

LARGEST_SEED = 2**63 - 1
"""Largest seed that all random generators take."""

CURRENTS = (0.0, 0.5, 1.0, 1.5)
"""Fixed currents I_e over groups of robots [A], eq. 20."""

Flag = FlagCreatePairsOff[bool]
"""An option without a value: ``--live`` alone, without ``--no-live``."""


def one(read: Callable[[str], Any], metavar: str, choices: Sequence[str] | None = None) -> PrimitiveConstructorSpec:
    """Type of an option with one value; ``read`` raises ValueError with value and what is allowed."""
    return PrimitiveConstructorSpec(
        nargs=1, metavar=metavar, instance_from_str=lambda words: read(words[0]), is_instance=lambda _: True,
        str_from_instance=lambda value: [_text(value)], choices=tuple(choices) if choices else None,
    )  # fmt: skip


def some(
    read: Callable[[str], Any],
    metavar: str,
    choices: Sequence[str] | None = None,
    *,
    least: int = 1,
    exactly: int | None = None,
) -> PrimitiveConstructorSpec:
    """Type of an option with several values, a tuple: of at least ``least``, or of ``exactly`` so many."""

    def instance(words: list[str]) -> tuple[Any, ...]:
        if len(words) < least:
            raise ValueError("expected at least one value")
        return tuple(read(word) for word in words)

    return PrimitiveConstructorSpec(
        nargs="*" if exactly is None else exactly,
        metavar=f"{metavar} [{metavar} ...]" if exactly is None else " ".join([metavar] * exactly),
        instance_from_str=instance,
        is_instance=lambda _: True,
        str_from_instance=lambda values: ["None"] if values is None else [_text(value) for value in values],
        choices=tuple(choices) if choices else None,
    )


def maybe_one(metavar: str) -> PrimitiveConstructorSpec:
    """Type of an option whose value may be left out; then it is empty."""

    def instance(words: list[str]) -> str:
        if len(words) > 1:
            raise ValueError(f"expected one value, not {' '.join(words)}")
        return words[0] if words else ""

    return PrimitiveConstructorSpec(
        nargs="*", metavar=f"[{metavar}]", instance_from_str=instance, is_instance=lambda _: True,
        str_from_instance=lambda value: [_text(value)],
    )  # fmt: skip


def one_of(choices: Sequence[str]) -> PrimitiveConstructorSpec:
    """Type of a choice."""
    return one(str, _braces(choices), choices)


def some_of(choices: Sequence[str]) -> PrimitiveConstructorSpec:
    """Type of several choices."""
    return some(str, _braces(choices), choices)


def exclusive(title: str, *, required: bool = False) -> object:
    """Group of options of which one excludes the others."""
    return create_mutex_group(required=required, title=title)


def _braces(choices: Sequence[str]) -> str:
    return "{" + ",".join(choices) + "}"


def _text(value: Any) -> str:
    """A default as it can be typed; of a shipped file its name."""
    if isinstance(value, Path) and value.is_absolute():
        return value.name
    return f"{value:g}" if isinstance(value, float) else str(value)


def finite(text: str) -> float:
    """A finite number."""
    value = number(text)
    if not math.isfinite(value):
        raise ValueError(f"{text} must be a finite number")
    return value


def positive(text: str) -> float:
    """A positive, finite number."""
    value = number(text)
    if not (math.isfinite(value) and value > 0.0):
        raise ValueError(f"{text} must be a positive number")
    return value


def not_negative(text: str) -> float:
    """A finite number of at least 0."""
    value = number(text)
    if not (math.isfinite(value) and value >= 0.0):
        raise ValueError(f"{text} must be at least 0")
    return value


def within(low: float, high: float, unit: str) -> Callable[[str], float]:
    """A number in a closed range."""

    def checked(text: str) -> float:
        value = number(text)
        if not low <= value <= high:
            raise ValueError(f"{text}; allowed: {low:g} to {high:g}{with_unit(unit)}")
        return value

    return checked


def whole(text: str, low: int = 0) -> int:
    """A whole number of at least ``low``."""
    value = integer(text)
    if value < low:
        raise ValueError(f"{value} must be at least {low}")
    return value


def count(text: str) -> int:
    """A whole number of at least 1."""
    return whole(text, 1)


def seed(text: str) -> int:
    """Seed of random draws."""
    value = integer(text)
    if not 0 <= value <= LARGEST_SEED:
        raise ValueError(f"{text}; allowed: a whole number from 0 to 2^63 - 1")
    return value


def number(text: str) -> float:
    """Any number."""
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a number") from None


def integer(text: str) -> int:
    """Any whole number."""
    try:
        return int(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a whole number") from None


coil_current = within(0.0, 100.0, "A")
"""Coil current; what a robot's devices take is known when it is loaded, see ``mrwarp.usd.asset.check_currents``."""

forward_speed = within(-5.0, 5.0, "m/s")
"""Commanded forward speed; quadrupeds of this size run at 3 to 5 m/s."""

FILE = one(Path, "FILE")
FOLDER = one(Path, "DIR")

File = Annotated[Path, FILE]
Folder = Annotated[Path, FOLDER]
Count = Annotated[int, one(count, "N")]
Whole = Annotated[int, one(whole, "N")]
Seed = Annotated[int, one(seed, "N")]
Positive = Annotated[float, one(positive, "X")]
NotNegative = Annotated[float, one(not_negative, "X")]
Averaged = Annotated[float, one(within(0.0, 60.0, "s"), "S")]
OptionalFile = Annotated[Path | None, FILE]
OptionalFolder = Annotated[Path | None, FOLDER]
OptionalText = Annotated[str | None, one(str, "TEXT")]
