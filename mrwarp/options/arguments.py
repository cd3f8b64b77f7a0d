"""What the commands share of reading arguments: the parser, and types that refuse with value and what is allowed."""

from __future__ import annotations

import argparse
import math
import re
import shlex
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from mrwarp.params import with_unit

_NEGATIVE = re.compile(r"-(\d+\.?\d*|\.\d+)(e[+-]?\d+)?$|-(inf|infinity|nan)$", re.IGNORECASE)

LARGEST_SEED = 2**63 - 1
"""Largest seed that all random generators take."""


class Parser(argparse.ArgumentParser):
    """Refuses in one line, without the usage, and takes every negative number for a value, ``-1e-3`` too."""

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._negative_number_matcher = _NEGATIVE

    def error(self, message: str) -> NoReturn:
        """End with exit code 2."""
        self.exit(2, f"{self.prog}: {' '.join(message.split())}; see --help\n")


def typed(prog: str, argv: Sequence[str]) -> str:
    """The command line as it can be typed again; ``prog`` is a command such as ``mrwarp train``, or a script."""
    return f"{'python ' * prog.endswith('.py')}{prog} {shlex.join(argv)}"


def finite(text: str) -> float:
    """A finite number."""
    value = _number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} must be a finite number")
    return value


def positive(text: str) -> float:
    """A positive, finite number."""
    value = _number(text)
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"{text} must be a positive number")
    return value


def not_negative(text: str) -> float:
    """A finite number of at least 0."""
    value = _number(text)
    if not (math.isfinite(value) and value >= 0.0):
        raise argparse.ArgumentTypeError(f"{text} must be at least 0")
    return value


def within(low: float, high: float, unit: str) -> Callable[[str], float]:
    """Type of a number in a closed range."""

    def checked(text: str) -> float:
        value = _number(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text}; allowed: {low:g} to {high:g}{with_unit(unit)}")
        return value

    return checked


averaged = within(0.0, 60.0, "s")
"""Length of a moving average [s]; 0 is none."""

coil_current = within(0.0, 100.0, "A")
"""Coil current; what a robot's devices take is known when it is loaded, see ``mrwarp.usd.asset.check_currents``."""

speed = within(-5.0, 5.0, "m/s")
"""Commanded forward speed; quadrupeds of this size run at 3 to 5 m/s."""

force = within(-1e4, 1e4, "N")
"""Push on a robot of 15 kg; the paper's is 100 N."""


def whole(text: str) -> int:
    """A whole number of at least 0."""
    return _at_least(0, text)


def count(text: str) -> int:
    """A whole number of at least 1."""
    return _at_least(1, text)


def seed(text: str) -> int:
    """Seed of random draws."""
    value = _integer(text)
    if not 0 <= value <= LARGEST_SEED:
        raise argparse.ArgumentTypeError(f"{text}; allowed: a whole number from 0 to 2^63 - 1")
    return value


def _at_least(low: int, text: str) -> int:
    value = _integer(text)
    if value < low:
        raise argparse.ArgumentTypeError(f"{value} must be at least {low}")
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None


def _integer(text: str) -> int:
    try:
        return int(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number") from None
