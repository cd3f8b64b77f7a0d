"""Interleaved timing: all variants run a little in each round, so that other load of the machine slows all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass

import numpy as np

Turn = Callable[[], Mapping[str, float]]
"""Runs a variant for a moment; returns seconds per step of each of its parts."""


@dataclass(frozen=True, kw_only=True)
class Spread:
    """A median and how sure it is."""

    median: float
    """Median over the rounds."""
    low: float
    """First quartile."""
    high: float
    """Third quartile."""
    error: float
    """Half-width of the median's 95 % interval, 1.57*(high - low)/sqrt(rounds) (McGill, Tukey and Larsen 1978)."""

    @classmethod
    def of(cls, values: Iterable[float]) -> Spread:
        """Of at least one value.

        Raises:
            ValueError: a value is no finite number, or there is none.
        """
        array = np.asarray(list(values), dtype=float)
        if not array.size or not np.isfinite(array).all():
            raise ValueError(f"need finite values, got {array}")
        low, median, high = np.quantile(array, (0.25, 0.5, 0.75))
        error = 1.57 * (high - low) / np.sqrt(array.size)
        return cls(median=float(median), low=float(low), high=float(high), error=float(error))

    def plain(self) -> dict[str, float]:
        """For JSON."""
        return asdict(self)


Times = dict[str, list[float]]
"""Seconds of each part by its name ``variant.part``, one value per round."""


def interleave(
    turns: Mapping[str, Turn], *, rounds: int, warmup: int = 1, progress: Callable[[float], None] | None = None
) -> Times:
    """Run all variants once per round: A B C, A B C, ...

    Args:
        turns: Variants by name.
        rounds: Counted rounds.
        warmup: Rounds before them.
        progress: Called with the share that is done.

    Returns:
        One value per part and round.
    """
    times: Times = {}
    for k in range(-warmup, rounds):
        for name, turn in turns.items():
            for part, seconds in turn().items():
                if k >= 0:
                    times.setdefault(f"{name}.{part}", []).append(seconds)
        if progress is not None:
            progress((k + 1 + warmup) / (rounds + warmup))
    return times


def ratio(times: Times, part: str, reference: str) -> Spread:
    """Cost of a part in units of another, compared round by round.

    Raises:
        KeyError: one of them was not measured.
    """
    return Spread.of(np.asarray(times[part]) / np.asarray(times[reference]))
