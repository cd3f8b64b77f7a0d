"""Time stamps as loggers write them, put on an even grid where that is honest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import Akima1DInterpolator

MAX_JITTER = 0.5
"""Largest deviation of a sampling interval from the median interval, as a share of it; above, it is resampled."""

FILLED_SAMPLES, FILLED_SECONDS = 5, 0.020
"""A gap of up to this many samples, or this long [s], is filled in; a longer one splits the trajectory."""

MAX_FILLED = 0.10
"""Largest share of samples that may be filled in."""

_WHERE = 10
"""Most places that are named."""


class UnevenError(ValueError):
    """Time stamps that cannot be repaired honestly; ``row`` is where, counted from 0."""

    def __init__(self, problem: str, row: int) -> None:
        super().__init__(problem)
        self.row = row


@dataclass(frozen=True, kw_only=True)
class Piece:
    """A stretch without a long gap, evenly sampled."""

    columns: dict[str, np.ndarray]
    moved: int = 0
    """Intervals that were off the even grid."""
    filled: int = 0
    """Samples that were interpolated because they are missing."""
    rounded: float = 0.0
    """Resolution of the clock [s] where it is coarser than the sampling; 0 where it is not."""
    repeated: int = 0
    """Rows that stand twice in the file."""
    at: tuple[float, ...] = ()
    """Where [s], the first ten places."""

    def text(self) -> str:
        """What was done, or an empty string."""
        rate = 1.0 / float(np.mean(np.diff(self.columns["t"])))
        found = [f"{self.repeated} repeated rows left out"] if self.repeated else []
        if self.rounded:
            found.append(f"time stamps rounded to {self.rounded:.3g} s spread evenly at {rate:.5g} Hz")
        if self.moved:
            places = ", ".join(f"{t:.4g}" for t in self.at[:3]) + (", ..." if len(self.at) > 3 else "")
            found.append(
                f"{self.moved} uneven intervals resampled at {rate:.5g} Hz, {self.filled} lost samples filled in "
                f"(at {places} s)"
            )
        return "; ".join(found)


def even_pieces(columns: dict[str, np.ndarray]) -> tuple[list[Piece], list[tuple[float, float]]]:
    """Evenly sampled pieces of a run, and start and length [s] of the long gaps between them.

    A run whose intervals are all within :data:`MAX_JITTER` of the median is returned as it is.

    Raises:
        UnevenError: time goes back, one stamp stands at two different rows, or too much is missing.
    """
    t = columns["t"]
    if (np.diff(t) < 0.0).any():
        k = int(np.flatnonzero(np.diff(t) < 0.0)[0])
        raise UnevenError(_backwards(t, k), k + 1)
    same = np.flatnonzero(np.diff(t) == 0.0)
    twice = [k for k in same if all(x[k] == x[k + 1] for x in columns.values())]
    if twice:
        columns = {name: np.delete(x, np.array(twice) + 1) for name, x in columns.items()}
        t = columns["t"]
    step = np.diff(t)
    rounded, coarse = 0.0, float(np.mean(step == 0.0))
    if coarse > 0.05:  # a clock that ticks more slowly than the samples come
        rounded = float(step[step > 0.0].min())
    elif coarse > 0.0:
        k = int(np.flatnonzero(step == 0.0)[0])
        raise UnevenError(_backwards(t, k), k + 1 + int(sum(row <= k for row in twice)))
    odd = np.abs(step - np.median(step)) > MAX_JITTER * np.median(step)
    if rounded or odd.any():
        tick = rounded or _resolution(t)
        line = _line(t)
        if tick and np.abs(t - line).max() <= tick:
            rounded, t = tick, line
        elif rounded:
            t = _between_ticks(t)
        columns = {**columns, "t": t}
        step = np.diff(t)
        odd = np.abs(step - np.median(step)) > MAX_JITTER * np.median(step)
    repeated = {"rounded": rounded, "repeated": len(twice)}
    if not odd.any():
        return [Piece(columns=columns, **repeated)], []
    dt = _interval(step)
    cuts = np.flatnonzero(step > max((FILLED_SAMPLES + 1.5) * dt, FILLED_SECONDS + dt))
    bounds = [0, *(cuts + 1), len(t)]
    gaps = [(float(t[k]), float(step[k])) for k in cuts]
    pieces = []
    for first, last in zip(bounds[:-1], bounds[1:], strict=True):
        part = {name: x[first:last] for name, x in columns.items()}
        pieces.append(_on_grid(part, dt, odd[first : last - 1], first, **repeated))
        repeated["repeated"] = 0
    return pieces, gaps


def _on_grid(part: dict[str, np.ndarray], dt: float, odd: np.ndarray, row: int, **found: float) -> Piece:
    """A stretch without long gaps, interpolated where its intervals are uneven."""
    t = part["t"]
    if not odd.any():
        return Piece(columns=part, **found)  # pyright: ignore[reportArgumentType]
    count = max(round((t[-1] - t[0]) / dt), 1) + 1
    missing = max(count - len(t), 0)
    if missing > MAX_FILLED * count:
        raise UnevenError(
            f"uneven sampling: {100.0 * missing / count:.0f} % of the samples are missing, at most "
            f"{100.0 * MAX_FILLED:g} % are filled in; log at an even rate, or resample it yourself",
            row + int(np.flatnonzero(odd)[0]) + 1,
        )
    grid = np.linspace(t[0], t[-1], count)
    columns = {
        # local cubics, which hardly overshoot; steps of the control input stay between their levels
        name: grid if name == "t" else np.interp(grid, t, x) if name == "current" else Akima1DInterpolator(t, x)(grid)
        for name, x in part.items()
    }
    at = tuple(float(x) for x in t[:-1][odd][:_WHERE])
    return Piece(columns=columns, moved=int(odd.sum()), filled=missing, at=at, **found)  # pyright: ignore[reportArgumentType]


def _interval(step: np.ndarray) -> float:
    """The logger's own interval: a sample that came late and the next one count as two, a lost one as one more."""
    usual = step[step <= 2.5 * np.median(step)]
    dt = float(usual.mean())
    for _ in range(3):
        count = np.rint(usual / dt).sum()
        dt = float(usual.sum() / count) if count > 0 else dt
    return dt


def _backwards(t: np.ndarray, k: int) -> str:
    return (
        f"time does not increase: {t[k + 1]:.9g} s after {t[k]:.9g} s; sort the rows, or give each run its own "
        "'trajectory' id"
    )


def _line(t: np.ndarray) -> np.ndarray:
    """The even grid nearest to the stamps."""
    index = np.arange(len(t))
    slope, first = np.polyfit(index, t - t[0], 1)
    return t[0] + first + slope * index


def _resolution(t: np.ndarray) -> float:
    """Tick of a clock whose intervals are all one of two neighbouring numbers of ticks; 0 where there is none."""
    step = np.diff(t)
    tick = float(step.min())
    for part in (1.0, 2.0):
        ratio = step * part / tick
        if np.abs(ratio - np.rint(ratio)).max() < 1e-3 * max(1.0, ratio.max()) and np.ptp(ratio) < 1.5:
            return tick / part
    return 0.0


def _between_ticks(t: np.ndarray) -> np.ndarray:
    """Stamps of a coarse clock, those of one tick spread evenly until the next."""
    ticks, first, count = np.unique(t, return_index=True, return_counts=True)
    length = np.append(np.diff(ticks), np.median(np.diff(ticks)))
    length = np.minimum(length, 1.5 * np.median(length / count) * count)  # a gap is no long sample
    within = np.arange(len(t)) - np.repeat(first, count)
    return np.repeat(ticks, count) + within * np.repeat(length / count, count)
