"""Mismatch against a variable: bin means with the band that noise alone would fill, and where it shows best.

An effect on the yield torque has the sign of the motion: along most variables its plain mean is zero. So a mismatch is
looked at as it is, along the motion, and along the torque, whichever lets more of it through.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from mrwarp.diagnose.result import Traces
from mrwarp.diagnose.verdict_text import axis_label, quantity

_BINS = 25
_LEAST = 20
"""Fewest samples of a bin."""
_WINDOW = 0.3
"""How long after a step of the current, or a reversal, is looked at [s]."""
_PREFER_PLAIN = 1.3
"""How much more a signed view must show to be taken instead of the plain one."""

_FINE_CELLS = 8192
"""Cells over the angle in which a repetition is looked for that is finer than the bins."""
_LINE = 0.1
"""Share of the mismatch's mean square that it must have; that of noise is a thousandth."""

_CELLS = (16, 12)
"""Cells along the first and the second variable."""
_LEAST_OF_CELL = 30
"""Fewest samples of a cell that is shown."""


@dataclass(frozen=True, kw_only=True)
class Axis:
    """Axis against which mismatch is drawn."""

    label: str
    """With its unit."""
    x: np.ndarray
    """Shape (N,); NaN where it does not apply."""
    signs: dict[str, np.ndarray]
    """Views: how the mismatch is turned, by what the turned one means. The first is the plain one."""
    logarithmic: bool = False


@dataclass(frozen=True)
class Profile:
    """Bin means; arrays of shape (B,)."""

    axis: Axis
    meaning: str
    """Meaning of a positive mismatch; empty for the plain one."""
    x: np.ndarray
    before: np.ndarray
    after: np.ndarray
    band: np.ndarray
    """Half-width of what the means would scatter by without any structure, 95 %."""
    share: float
    """Part of the baseline's mean square that the bins explain [1]."""
    left: float
    """Part of it that they still explain in the extension's mismatch [1]."""


def profile(axis: Axis, traces: Traces) -> Profile | None:
    """The view of an axis that shows most of the baseline's mismatch; None if the variable does not vary."""
    labels = _labels(axis)
    if labels is None:
        return None
    best: Profile | None = None
    for meaning in axis.signs:
        found = _profile(axis, meaning, labels, traces)
        if found is not None and (best is None or found.share > best.share * (1.0 if best.meaning else _PREFER_PLAIN)):
            best = found
    return best


def best_profile(axes: Iterable[Axis], traces: Traces) -> Profile | None:
    """The axis along which most of the baseline's mismatch lies and the extension takes most away."""
    found = [p for p in (profile(axis, traces) for axis in axes) if p is not None]
    return max(found, key=lambda p: p.share + max(0.0, p.share - p.left), default=None)


def axes_of(variable: str, traces: Traces, units: dict[str, str]) -> list[Axis]:
    """Signals for a variable of ``depends_on``; several for ``memory``, none for ``frequency``."""
    t, amps, torque = traces, units["current"], units["torque"]
    name, simulated = quantity("current", units), f"simulated {quantity('torque', units)}"
    views = _views(t)
    minutes = float(np.ptp(t.time)) > 180.0
    since = "time in the session" if t.one_clock else "time since the run began"
    plain: dict[str, tuple[np.ndarray, str]] = {
        "q": (t.q, axis_label("q", units)),
        "qd": (t.qd, axis_label("qd", units)),
        "qdd": (t.qdd, f"acceleration [{units['q']}/s²]"),
        "current": (t.current, axis_label("current", units)),
        "time": (t.time / 60.0, f"{since} [min]") if minutes else (t.time, f"{since} [s]"),
        "torque": (t.baseline, f"{simulated} [{torque}]"),
    }
    if variable in plain:
        x, label = plain[variable]
        axis = Axis(label=label, x=x, signs=views)
        fine = _fine_periods(t) if variable == "q" else 0.0
        return [axis, folded(axis, fine)] if fine else [axis]
    if variable != "memory":
        return []
    rate, loading, jump = _rate(t.current, t), _rate(t.baseline, t), _jumps(t)
    quick = {**views, "the change goes further than simulated": np.sign(loading)}
    found = [
        Axis(label=f"rate of the {name} [{amps}/s]", x=_clipped(rate), signs=views),
        Axis(label=f"rate of the {simulated} [{torque}/s]", x=_clipped(loading), signs=views),
        Axis(label="time since the last reversal [s]", x=_since(_reversals(t), t)[0], signs=quick, logarithmic=True),
    ]
    if (jump != 0.0).sum() < 3:
        return found
    since, last = _since(jump != 0.0, t)
    acts = np.where(last >= 0, np.sign(jump[last]), 0.0) * views["the device gives more than simulated"]
    step = {**views, "the step changes the torque more than simulated": acts}
    return [Axis(label=f"time since the last step of the {name} [s]", x=since, signs=step, logarithmic=True), *found]


def folded(angle: Axis, periods: float) -> Axis:
    """The angle within one period of what goes as ``sin(periods * q)``: no bin can alias with it."""
    period = 2.0 * np.pi / periods
    return replace(angle, label=f"{angle.label}, within one period of {period:.3g}", x=angle.x % period)


def _fine_periods(t: Traces) -> float:
    """Of a mismatch that repeats over the angle too often for the bins, how often, times 2 pi; 0 where none does."""
    q, left = t.q - t.q.min(), t.torque - t.extended
    seen = np.isfinite(left) if t.counts is None else t.counts
    reach, left = float(np.ptp(t.q)) or 1.0, left - left[seen].mean()
    cell = (q / reach * (_FINE_CELLS - 1)).astype(int)
    sums = np.bincount(cell[seen], weights=left[seen], minlength=_FINE_CELLS)
    power = np.abs(np.fft.rfft(sums, 4 * _FINE_CELLS)) ** 2
    power[:_BINS] = 0.0  # four bins to a period show it
    best = int(np.argmax(power[: 2 * _FINE_CELLS // 3]))
    share = 2.0 * power[best] / max(seen.sum() * float(left[seen] @ left[seen]), 1e-300)
    return 0.5 * np.pi * best / (reach * (1.0 - 1.0 / _FINE_CELLS)) if share > _LINE else 0.0


def predicted(traces: Traces, units: dict[str, str]) -> Axis:
    """Torque that the extension adds, as an axis: if it is the cause, the mismatch follows it one to one."""
    return Axis(
        label=f"what the named cause adds [{units['torque']}]",
        x=_clipped(traces.extended - traces.baseline),
        signs={"": np.ones(len(traces.torque))},
    )


def is_extended(traces: Traces) -> bool:
    """Whether the extension differs from the baseline."""
    return not np.allclose(traces.extended, traces.baseline, rtol=1e-6, atol=1e-9 * float(np.abs(traces.torque).max()))


def _views(t: Traces) -> dict[str, np.ndarray]:
    centre = float(np.median(t.baseline))
    return {
        "": np.ones(len(t.torque)),
        "the device resists more than simulated": np.sign(t.qd),
        "the device gives more than simulated": np.sign(t.baseline - centre),
    }


def _labels(axis: Axis) -> tuple[np.ndarray, np.ndarray] | None:
    """Bin of each sample (-1: none) and the bins' centres."""
    good = np.isfinite(axis.x)
    x = axis.x[good]
    if len(x) < 2 * _LEAST or np.ptp(x) <= 1e-9 * max(1e-300, float(np.abs(x).max())):
        return None
    values = np.unique(np.round(x / np.ptp(x), 6)) * np.ptp(x)
    if len(values) <= _BINS:
        edges = 0.5 * (values[1:] + values[:-1])
    elif axis.logarithmic:
        edges = np.geomspace(x[x > 0.0].min(), x.max(), _BINS + 1)[1:-1] if (x > 0.0).any() else np.zeros(0)
    else:
        share = np.linspace(0.0, 1.0, _BINS + 1)[1:-1]
        low, high = np.quantile(x, (0.002, 0.998))
        edges = 0.5 * (np.quantile(x, share) + low + share * (high - low))
    labels = np.full(len(axis.x), -1)
    labels[good] = np.searchsorted(np.sort(edges), x)
    count = np.bincount(labels[good], minlength=len(edges) + 1)
    centre = np.bincount(labels[good], weights=x, minlength=len(edges) + 1) / np.maximum(count, 1)
    keep = count >= _LEAST
    if keep.sum() < 2:
        return None
    number = np.where(keep, np.cumsum(keep) - 1, -1)
    labels[good] = number[labels[good]]
    return labels, centre[keep]


def _profile(axis: Axis, meaning: str, labels: tuple[np.ndarray, np.ndarray], t: Traces) -> Profile | None:
    (label, centre), sign = labels, axis.signs[meaning]
    good = (label >= 0) & (sign != 0.0)
    if t.counts is not None:
        good &= t.counts
    bins, runs = len(centre), len(t.start) - 1
    run = np.repeat(np.arange(runs), np.diff(t.start))
    cell = run[good] * bins + label[good]

    def sums(x: np.ndarray) -> np.ndarray:
        return np.bincount(cell, weights=x[good], minlength=runs * bins).reshape(runs, bins)

    count = sums(np.ones(len(sign)))
    total = count.sum(0)
    if (total < 2).any():
        return None
    before = sums(sign * (t.torque - t.baseline)).sum(0) / total
    rest = sums(sign * (t.torque - t.extended))
    after = rest.sum(0) / total
    band = _band(rest, count, after, _correlated_noise(t))
    seen = np.ones(len(sign)) if t.counts is None else t.counts
    mean_square = float(seen @ (t.torque - t.baseline) ** 2)
    error = (band / 1.96) ** 2

    def explained(mean: np.ndarray) -> float:
        return float((total * np.maximum(mean**2 - error, 0.0)).sum()) / max(mean_square, 1e-300)

    return Profile(axis, meaning, centre, before, after, band, explained(before), explained(after))


def _band(rest: np.ndarray, count: np.ndarray, mean: np.ndarray, noise: float) -> np.ndarray:
    """From the scatter between trajectories, which holds the sensor's offsets and slow noise; shape (B,).

    ``rest`` and ``count`` are sums and samples per trajectory and bin, shape (T, B), ``noise`` that of one sample.
    """
    weight = count / count.sum(0)
    own = np.divide(rest, count, out=np.zeros_like(rest), where=count > 0) - mean
    spread = (weight**2 * own**2).sum(0)
    used = (count > 0).sum(0)
    several = used >= 3
    alone = noise**2 / count.sum(0)
    if not several.any():  # along time a bin belongs to one trajectory: differences of neighbours give the scatter
        jumps = 0.5 * float(np.median(np.diff(mean) ** 2)) / 0.455 if len(mean) > 4 else 0.0
        return 1.96 * np.sqrt(np.maximum(alone, jumps) + 1e-30)
    # few trajectories give an uncertain scatter: draw it towards that of all bins
    each = np.where(several, spread * used / np.maximum(used - 1, 1), np.nan)
    typical = np.nanmedian(each / alone) * alone
    spread = np.where(several, (each * used + 4.0 * typical) / (used + 4.0), typical)
    return 1.96 * np.sqrt(np.maximum(spread, 1e-30))


def _correlated_noise(t: Traces) -> float:
    """Noise whose mean over n samples has the variance ``noise²/n``: its RMS times the root of samples per draw."""
    rest = t.torque - t.extended
    top, most = np.zeros(0), max(1, round(0.2 / _dt(t, t.parts[0])))
    for part in t.parts:
        r = rest[part] - rest[part].mean()
        lags = np.array([float(r[: len(r) - k] @ r[k:]) for k in range(min(most, len(r) - 1) + 1)])
        lags = np.pad(lags, (0, most + 1 - len(lags)))
        top = top + lags if len(top) else lags
    shape = top / max(float(top[0]), 1e-300)
    below = np.flatnonzero(shape < 0.05)
    return t.noise_rms * float(np.sqrt(1.0 + 2.0 * shape[1 : below[0] if len(below) else None].sum()))


def _dt(t: Traces, part: slice) -> float:
    return float(t.time[part.stop - 1] - t.time[part.start]) / max(part.stop - part.start - 1, 1) or 1.0


def _rate(x: np.ndarray, t: Traces) -> np.ndarray:
    return np.concatenate([np.gradient(x[part], _dt(t, part)) for part in t.parts])


def _clipped(x: np.ndarray) -> np.ndarray:
    """A variable without its rarest values, which would squeeze all others into one bin."""
    low, high = np.quantile(x, (0.002, 0.998))
    return np.where((x < low) | (x > high), np.nan, x) if high > low else x


def _jumps(t: Traces) -> np.ndarray:
    """Step of the current at each sample, 0 where there is none."""
    out = np.concatenate([np.diff(t.current[part], prepend=t.current[part.start]) for part in t.parts])
    limit = max(0.08 * float(np.ptp(t.current)), 8.0 * float(np.median(np.abs(out))))
    return np.where(np.abs(out) > limit, out, 0.0)


def _reversals(t: Traces) -> np.ndarray:
    out = np.zeros(len(t.qd), dtype=bool)
    limit = 0.02 * float(np.percentile(np.abs(t.qd), 95))
    for part in t.parts:
        moving = np.flatnonzero(np.abs(t.qd[part]) > limit)
        turned = moving[1:][np.diff(np.sign(t.qd[part][moving])) != 0.0]
        out[part.start + turned] = True
    return out


def _since(event: np.ndarray, t: Traces) -> tuple[np.ndarray, np.ndarray]:
    """Time since the last event [s], NaN before the first and after the window, and the sample of that event.

    The time at the event itself is a sample's interval; before the first event its sample is -1.
    """
    since, last = np.full(len(event), np.nan), np.full(len(event), -1)
    for part in t.parts:
        index = np.arange(part.start, part.stop)
        last[part] = np.maximum.accumulate(np.where(event[part], index, -1))
        passed = (index - last[part] + 1) * _dt(t, part)
        since[part] = np.where((last[part] >= 0) & (passed <= _WINDOW), passed, np.nan)
    return since, last


@dataclass(frozen=True)
class Surface:
    """Cell means of what the extension leaves."""

    across: Axis
    up: Axis
    x: np.ndarray
    """Edges of the cells along ``across``, shape (X + 1,)."""
    y: np.ndarray
    """Edges along ``up``, shape (Y + 1,)."""
    mean: np.ndarray
    """Shape (Y, X); NaN where there are too few samples."""
    meaning: str
    """Meaning of a positive mismatch; empty for the plain one."""


def surface(across: Axis, up: Axis, t: Traces) -> Surface | None:
    """The view over two variables in which the cells explain most; None where one of them does not vary."""
    x, y = _edges(across.x, _CELLS[0]), _edges(up.x, _CELLS[1])
    if len(x) < 4 or len(y) < 4:
        return None
    columns, rows = len(x) - 1, len(y) - 1
    inside = (across.x >= x[0]) & (across.x <= x[-1]) & (up.x >= y[0]) & (up.x <= y[-1])
    if t.counts is not None:
        inside &= t.counts
    column = np.clip(np.searchsorted(x, across.x[inside], side="right") - 1, 0, columns - 1)
    row = np.clip(np.searchsorted(y, up.x[inside], side="right") - 1, 0, rows - 1)
    cell = row * columns + column
    count = np.bincount(cell, minlength=rows * columns)
    mismatch = (t.torque - t.extended)[inside]
    best, most = None, -1.0
    for meaning, sign in across.signs.items():
        total = np.bincount(cell, weights=sign[inside] * mismatch, minlength=rows * columns)
        mean = np.where(count >= _LEAST_OF_CELL, total / np.maximum(count, 1), np.nan)
        share = float(np.nansum(count * mean**2))
        if share > most * (1.0 if best is not None and best.meaning else 1.3):
            best, most = Surface(across, up, x, y, mean.reshape(rows, columns), meaning), share
    return best if best is not None and np.isfinite(best.mean).sum() >= 12 else None


def _edges(x: np.ndarray, cells: int) -> np.ndarray:
    """Even edges over the bulk of a variable, or edges between its levels where it has few."""
    reach = float(np.ptp(x)) or 1.0
    levels = np.unique(np.round(x / reach, 3)) * reach
    if len(levels) <= cells:
        middle = 0.5 * (levels[1:] + levels[:-1])
        return np.concatenate([[float(x.min())], middle, [float(x.max())]]) if len(levels) > 2 else levels
    low, high = np.quantile(x, (0.005, 0.995))
    return np.linspace(float(low), float(high), cells + 1)
