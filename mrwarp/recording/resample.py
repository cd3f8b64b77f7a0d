"""Time stamps as loggers write them, put on an even grid where that is honest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrwarp.recording.data import Repair, is_command

MAX_JITTER = 0.5
"""Largest deviation of a sampling interval from the median interval, as a share of it; above, it is resampled."""

FILLED_SAMPLES, FILLED_SECONDS = 5, 0.020
"""A gap of up to this many samples, or this long [s], is filled in; a longer one splits the trajectory."""

MAX_FILLED = 0.10
"""Largest share of samples that may be filled in where a regular clock lost them."""

_TICKS = 12
"""Fewest ticks of a coarse clock in a run: a line through n steps is off by up to 1.5/n² of its slope, here 1 %."""

_ON_TICK, _MOSTLY, _SOME = 0.1, 0.9, 0.02
"""A clock that loses samples leaves intervals of one, two, three ... of its own: how far they may be from whole
numbers, which share of them must be so near, and the least share of each kind. Two kinds alone are the logger's own."""

_FEW, _THINS = 12.0, 0.25
"""Number of longer intervals that losses at random would leave beyond the longest common kind from which their absence
says something, and the part of it below which the samples were not lost (once in 2000 recordings by chance)."""

_ALTERNATES = 0.5
"""Ratio of what neighbours predict wrongly of a sample, by the stamps over by an even clock, below which the stamps are
the times at which the samples were taken, although none is far from even: then they are put on a grid."""

_LATE = 0.6
"""Share of an interval by which two intervals in a row must be too long for a lost sample; less is jitter."""

_AGREE = 0.02
"""Share by which the interval from rounded numbers of intervals, which is exact for little jitter, may be off the one
from pairs of intervals, which bears any: a jitter of half an interval is rounded either way."""

_CLOCK = -0.15
"""Correlation of successive intervals (lag 1) below which a clock is behind them: -0.5 where stamps stray about a
clock, for a late one makes its next interval short; 0, to within 2/sqrt(N), where each interval is on its own."""

_TYPICAL = 45.0
"""Percentile of the intervals where the logger's own is looked for: of two that are as common, the shorter."""

_REPEATED, _ALWAYS, _TWICE = 25, 0.98, 0.3
"""Fewest rows of a drive that show how often each was written; share of them that must come as often; least share of
rows that only repeat another."""

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
        """The change made, or an empty string."""
        rate = 1.0 / float(np.mean(np.diff(self.columns["t"])))
        found = [f"{self.repeated} repeated rows left out"] if self.repeated else []
        if self.rounded:
            found.append(f"time stamps rounded to {self.rounded:.3g} s spread evenly at {rate:.4g} Hz")
        if self.moved:
            places = ", ".join(f"{t:.4g}" for t in self.at[:3]) + (", ..." if len(self.at) > 3 else "")
            filled = f", {self.filled} lost samples filled in" if self.filled else ""
            found.append(f"{self.moved} uneven intervals resampled at {rate:.4g} Hz{filled} (at {places} s)")
        return "; ".join(found)


def thinned(label: str, columns: dict[str, np.ndarray], rows: np.ndarray) -> tuple[np.ndarray, list[Repair]]:
    """Rows of a run without those that say again what the one before them says, and a note.

    A logger that writes faster than a drive sends writes each row several times, with the stamp of the drive, which is
    then the same, or with its own. Only where nearly all rows come as often are they left out.

    Args:
        label: Name of the run.
        columns: Columns of the file.
        rows: Rows of the run, shape (N,).
    """
    read = [x[rows] for name, x in columns.items() if name not in ("t", "temperature") and np.ptp(x[rows]) > 0.0]
    t = columns["t"][rows]
    if not read or len(rows) < 2 * _REPEATED:
        return rows, []
    news = np.any([np.diff(x) != 0.0 for x in read], axis=0)
    if np.mean(np.diff(t) == 0.0) > _SOME:
        stands = np.diff(t) == 0.0
        again = stands & ~news
        kept = np.concatenate([[True], ~again])
        if not again.any() or (stands & news).any() and np.mean(again) < _TWICE:
            return rows, []
        every = (len(rows) - 1) / max(int(kept.sum()) - 1, 1)
        text = f"every row stands in the file {every:.3g} times on average: one of each is used"
    else:
        at = np.flatnonzero(news) + 1
        every = int(np.median(np.diff(at))) if len(at) > _REPEATED else 1
        if every < 2:
            return rows, []
        phase = int(np.bincount(at % every).argmax())
        if np.mean(at % every == phase) < _ALWAYS:
            return rows, []
        kept = (np.arange(len(rows)) - phase) % every == 0
        text = f"all channels change every {every} rows only: the first of each {every} is used"
    count = int((~kept).sum())
    return rows[kept], [Repair(trajectory=label, kind="thinned", count=count, text=f"{text} ({count} are left out)")]


def even_pieces(columns: dict[str, np.ndarray]) -> tuple[list[Piece], list[tuple[float, float]]]:
    """Evenly sampled pieces of a run, and start and length [s] of the long gaps between them.

    A run whose intervals are all within :data:`MAX_JITTER` of the median is returned as it is.

    Raises:
        UnevenError: time goes back or stands, one stamp stands at two different rows, or too much is missing.
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
        if (ticks := len(t) - int((step == 0.0).sum())) < _TICKS:
            raise UnevenError(
                f"time stands: {len(t)} rows have {ticks} different stamps, too few to show the rate; write t with "
                "more digits, or count it from the run's start",
                0,
            )
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
        if not _by_stamps(columns):
            return [Piece(columns=columns, **repeated)], []
        odd = np.abs(step - np.median(step)) > _ON_TICK * np.median(step)
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


def _by_stamps(columns: dict[str, np.ndarray]) -> bool:
    """Whether the motion is smooth over the stamps and rough over an even clock.

    Each sample is predicted by the cubic through its four neighbours; a stamp that is only written late makes no
    motion smoother.
    """
    t, x = columns["t"], columns.get("q", columns.get("qd"))
    step = np.diff(t)
    if x is None or len(t) < 5 or np.abs(step - np.median(step)).max() < _ON_TICK * np.median(step):
        return False
    even = np.arange(len(t), dtype=float)
    stamped, regular = (float(np.abs(_by_neighbours(clock, x) - x[2:-2]).mean()) for clock in (t, even))
    return stamped < _ALTERNATES * regular


def _by_neighbours(t: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Each sample by the cubic through two neighbours on both sides (Lagrange), shape (N - 4,)."""
    count, places = len(t) - 4, (0, 1, 3, 4)
    at, found = t[2:-2], np.zeros(count)
    for j in places:
        own = t[j : j + count]
        weights = [(at - t[m : m + count]) / (own - t[m : m + count]) for m in places if m != j]
        found += np.prod(weights, axis=0) * x[j : j + count]
    return found


def _on_grid(part: dict[str, np.ndarray], dt: float, odd: np.ndarray, row: int, **found: float) -> Piece:
    """A stretch without long gaps, interpolated where its intervals are uneven."""
    t = part["t"]
    if not odd.any():
        return Piece(columns=part, **found)  # pyright: ignore[reportArgumentType]
    count = max(round((t[-1] - t[0]) / dt), 1) + 1
    missing, intervals = max(count - len(t), 0), np.diff(t) / dt
    if missing and not _has_clock(intervals):
        count, missing = len(t), 0
    if missing > MAX_FILLED * count:
        if _loses(intervals):
            raise UnevenError(
                f"uneven sampling: {100.0 * missing / count:.0f} % of the samples are missing, at most "
                f"{100.0 * MAX_FILLED:g} % are filled in; log at an even rate, or resample it yourself",
                row + int(np.flatnonzero(odd)[0]) + 1,
            )
        count, missing = len(t), 0  # the intervals themselves differ: as many samples as were taken
    grid = np.linspace(t[0], t[-1], count)
    columns = {name: grid if name == "t" else _resampled(name, t, x, grid) for name, x in part.items()}
    at = tuple(float(x) for x in t[:-1][odd][:_WHERE])
    return Piece(columns=columns, moved=int(odd.sum()), filled=missing, at=at, **found)  # pyright: ignore[reportArgumentType]


def _resampled(name: str, t: np.ndarray, x: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """A column at other times: a commanded control input is that of the nearest sample, a measured one linear.

    All else goes by local cubics, which hardly overshoot. A command stays as it is from most samples to the next, and
    was never between two of its levels. It changed somewhere between the two samples that show it: halfway on average.
    Held until the stamp of the second, it would come half an interval late, and a coil's lag out as much too small.
    """
    if name != "current":
        from scipy.interpolate import Akima1DInterpolator  # an even clock does without

        return Akima1DInterpolator(t, x)(grid)
    if is_command(x):
        return x[np.searchsorted(0.5 * (t[1:] + t[:-1]), grid)]
    return np.interp(grid, t, x)


def _has_clock(intervals: np.ndarray) -> bool:
    """Whether an even clock is behind intervals, in those of the clock: only then a long one means lost samples."""
    off = intervals - np.rint(intervals)
    if float((np.abs(off) < _ON_TICK).mean()) > _MOSTLY:
        return True
    return min(float(np.corrcoef(x[:-1], x[1:])[0, 1]) for x in (intervals, off)) < _CLOCK


def _loses(intervals: np.ndarray) -> bool:
    """Whether intervals, in those of the clock, are whole numbers of more than two kinds: samples were lost.

    Losses one by one leave longer intervals, too. Where none are beyond a common kind, that kind is the logger's own.
    """
    whole = np.rint(intervals)
    kinds, counts = np.unique(whole[whole > 0.0], return_counts=True)
    on = np.abs(intervals - whole) < _ON_TICK
    common = kinds[counts > _SOME * len(intervals)]
    if float(on.mean()) < _MOSTLY or len(common) < 3:
        return False
    lost = 1.0 - len(whole) / float(whole.sum())
    expected = lost * np.count_nonzero(whole >= common[-1])
    return bool(expected < _FEW or np.count_nonzero(whole > common[-1]) > _THINS * expected)


def _interval(step: np.ndarray) -> float:
    """The logger's own interval: a sample that came late and the next one count as two, a lost one as one more."""
    dt = float(np.percentile(step, _TYPICAL, method="lower"))
    usual = step[step <= 2.5 * np.median(step)]
    rounded = float(usual.mean())
    for _ in range(3):
        count = np.rint(usual / rounded).sum()
        rounded = float(usual.sum() / count) if count > 0 else rounded
    usual = step[step <= 2.5 * dt]
    padded = np.pad(usual, 1, mode="edge")
    shorter = np.minimum(padded[:-2], padded[2:])
    for _ in range(3):  # an interval is long by a lost sample, or by a late one: then the next is short
        lost = np.floor((usual + shorter) / dt + 1.0 - _LATE) - np.maximum(np.rint(shorter / dt), 1.0) - 1.0
        dt = float(usual.sum() / (len(usual) + np.where(usual > 1.5 * dt, np.maximum(lost, 0.0), 0.0).sum()))
    return rounded if abs(rounded - dt) < _AGREE * dt else dt


def _backwards(t: np.ndarray, k: int) -> str:
    remedy = "remove one of these rows" if t[k + 1] == t[k] else "sort the rows"
    return (
        f"time does not increase: {t[k + 1]:.9g} s after {t[k]:.9g} s; {remedy}, or give each run its own "
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
