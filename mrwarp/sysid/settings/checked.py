"""A setting as a field of a dataclass: its range, what a higher value trades, and the data that set it."""

from __future__ import annotations

import ast
import inspect
import math
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from typing import Any

HAND = "by hand"
"""Origin of a number that no suite has set."""
RATES = "benchmarks.confusion and the public data sets"
"""Devices with known causes, and real ones: docs/diagnosis_rates.md."""


def setting(
    default: float | tuple[float, ...], low: float, high: float, *, fewer: str, more: str, by: str = HAND
) -> Any:
    """A field with its range.

    Args:
        default: The number, or a tuple of them; an integer where only whole numbers make sense.
        low: Least value.
        high: Largest value.
        fewer: What a higher value makes rarer.
        more: What a higher value makes more frequent, or costs.
        by: The suite, data or law that set the default.
    """
    return field(default=default, metadata={"low": low, "high": high, "fewer": fewer, "more": more, "by": by})


@dataclass(frozen=True, kw_only=True)
class Checked:
    """A group of settings; numbers outside their ranges are refused."""

    def __post_init__(self) -> None:
        """Check every number.

        Raises:
            ValueError: a setting is no number, no whole one where it has to be, outside its range, or a tuple of
                another length.
        """
        for f in fields(self):
            value, low, high = getattr(self, f.name), f.metadata["low"], f.metadata["high"]
            default: Any = f.default
            several = isinstance(default, tuple)
            like = default if several else (default,)
            given = value if several else (value,)
            whole = all(isinstance(x, int) for x in like)
            if not isinstance(given, tuple) or len(given) != len(like) or not all(_fits(x, f, whole) for x in given):
                kind = "whole number" if whole else "number"
                what = f"a tuple of {len(like)} {kind}s" if several else f"a {kind}"
                raise ValueError(
                    f"setting {type(self).__name__}.{f.name} is {value!r}: give {what} from {low:g} to {high:g}"
                )


def _fits(value: object, f: Any, whole: bool) -> bool:
    """Whether a number is of the right kind and in a field's range."""
    if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
        return False
    return math.isfinite(value) and f.metadata["low"] <= value <= f.metadata["high"]


@dataclass(frozen=True, kw_only=True)
class Described:
    """A setting in words."""

    name: str
    default: str
    range: str
    meaning: str
    """Its docstring; empty without one."""
    trades: str
    by: str


def described(group: type[Checked]) -> Iterator[Described]:
    """Every setting of a group, for the reference page."""
    body = ast.parse(textwrap.dedent(inspect.getsource(group))).body[0]
    assert isinstance(body, ast.ClassDef)
    texts = {
        field.target.id: " ".join(str(after.value.value).split())
        for field, after in zip(body.body, body.body[1:], strict=False)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name)
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
    }
    for f in fields(group):
        about = f.metadata
        values = f.default if isinstance(f.default, tuple) else (f.default,)
        yield Described(
            name=f.name,
            default=", ".join(f"{x:g}" for x in values),
            range=f"{about['low']:g} to {about['high']:g}",
            meaning=texts.get(f.name, ""),
            trades=f"fewer {about['fewer']}; more {about['more']}",
            by=about["by"],
        )
