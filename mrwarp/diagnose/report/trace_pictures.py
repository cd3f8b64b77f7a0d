"""Pictures of a diagnosis along its samples: evidence, loops, the worst stretch, variables, spectrum."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from scipy.signal import welch

from mrwarp.diagnose.report.mismatch_profile import (
    Profile,
    Surface,
    axes_of,
    best_profile,
    folded,
    is_extended,
    predicted,
    profile,
    surface,
)
from mrwarp.diagnose.result import Diagnosis, Traces
from mrwarp.diagnose.verdict_text import axis_label, title
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.dataset import of_commonest_rate, rms
from mrwarp.recording.data import session_clock, true_names
from mrwarp.sysid.report.pictures import AFTER, BEFORE, MEASURED, NOISE
from mrwarp.sysid.report.words import both, capital, short
from mrwarp.sysid.verdict import Cause

STYLE: dict[Any, Any] = {
    "font.size": 12.0,
    "axes.titlesize": 12.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 12.0,
    "legend.fontsize": 11.0,
    "legend.framealpha": 0.85,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "lines.linewidth": 1.6,
    "axes.axisbelow": True,
    "text.parse_math": False,
    "path.simplify_threshold": 0.5,
    "axes.formatter.limits": (-4, 5),
}
WIDTH = 6.4
"""Width of a figure [in]: fills a phone, and leaves its letters readable."""
DPI = 100
_WORST = 2.0
"""Length of the stretch that is shown in detail [s]."""
_LOOP, _CYCLES = 4.0, 2.0
"""Stretch of a trajectory that a loop shows: seconds, or cycles of its motion if these take longer."""
_POINTS = 4000
"""Most samples of a loop that are drawn."""


def evidence_picture(d: Diagnosis) -> Figure | None:
    """The baseline's mismatch against what the verdict blames, and what the extension leaves of it."""
    t, units = _traces(d), d.recording.units
    rows: list[tuple[Profile | None, str]] = []
    for cause in d.causes[:2]:
        law = CATALOGUE.get(cause.name)
        alone, name = t, true_names(title(cause.name), units)
        if cause.name in t.without:  # several causes: what this one takes away, not what the others do
            alone = replace(t, baseline=t.without[cause.name])
            name = f"{name}: the other causes in the model, without it and with it"
        axes = [axis for v in (law.depends_on if law else ()) for axis in axes_of(v, alone, units)]
        if periods := _periods(cause):
            axes = [folded(axes_of("q", alone, units)[0], periods)]
        rows.append((best_profile(axes, alone), name))
    plane = _plane(d)
    if d.unexplained is not None and plane is None:
        for name in d.unexplained.depends_on[:2]:
            rows.append((best_profile(axes_of(name, t, units), t), "not explained by any known effect"))
    if d.causes and is_extended(t):
        rows.append((profile(predicted(t, units), t), "does the mismatch follow what the cause predicts?"))
    if not rows and plane is None:
        variables = ("q", "qd", "qdd", "current", "time", "memory")
        axes = [axis for name in variables for axis in axes_of(name, t, units)]
        rows.append((best_profile(axes, t), "where the mismatch is largest: no more than noise"))
    shown = list(_merged((found, text) for found, text in rows if found is not None))[:4]
    if not shown and plane is None:
        return None
    ratios = [3.1] * len(shown) + [4.2] * (plane is not None)
    figure = Figure(figsize=(WIDTH, 0.5 + sum(ratios)), layout="constrained")
    panels = figure.subplots(len(ratios), 1, squeeze=False, height_ratios=ratios)[:, 0]
    if plane is not None:
        _surface_panel(figure, panels[-1], plane, units["torque"])
    for k, (ax, (found, text)) in enumerate(zip(panels, shown, strict=False)):
        _profile_panel(ax, found, d, legend=k == 0)
        ax.set_title(capital(text))
        if found.axis.label.startswith("what the named cause"):
            x = np.array([found.x.min(), found.x.max()])
            ax.plot(x, x, color=MEASURED, lw=1.0, ls=":", label="one to one")
            ax.legend(loc="upper left")
    return figure


def _merged(rows: Iterable[tuple[Profile, str]]) -> Iterator[tuple[Profile, str]]:
    """Panels, those with identical curves as one that has all their titles."""
    panels: dict[tuple[str, bytes, bytes], tuple[Profile, list[str]]] = {}
    for found, text in rows:
        curves = found.axis.label, found.before.tobytes(), found.after.tobytes()
        panels.setdefault(curves, (found, []))[1].append(text)
    return ((found, both(texts)) for found, texts in panels.values())


def loops_picture(d: Diagnosis) -> Figure:
    """Measured and simulated torque over angle (left) and velocity (right): of the median and the worst trajectory."""
    t, units, runs = _traces(d), d.recording.units, d.recording.trajectories
    rmse = np.array([rms(t.torque[p] - t.baseline[p]) for p in t.parts])
    median, worst = int(np.argsort(rmse)[len(rmse) // 2]), int(np.argmax(rmse))
    chosen = [(median, "median")] * (worst != median) + [(worst, "worst")]
    figure = Figure(figsize=(WIDTH * 1.15, 2.75 * len(chosen) + 0.8), layout="constrained")
    panels = figure.subplots(len(chosen), 2, squeeze=False, sharey="row")
    for row, (k, text) in zip(panels, chosen, strict=True):
        part = _stretch(t, t.parts[k], max(_LOOP, _CYCLES * _period(t, t.parts[k])))
        some = slice(part.start, part.stop, max(1, (part.stop - part.start) // _POINTS))
        for ax, x, name in zip(row, (t.q, t.qd), ("q", "qd"), strict=True):
            _three(ax, x[some], t, some)
            ax.set_xlabel(axis_label(name, units))
        row[0].set_ylabel(axis_label("torque", units))
        row[0].set_title(f"{text} trajectory: {short(runs[k].id, 34)}")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside upper left", ncols=3, frameon=False)
    return figure


def worst_picture(d: Diagnosis) -> Figure:
    """The stretch with the largest mismatch: torque, mismatch, motion and current."""
    t, units = _traces(d), d.recording.units
    part = max((_stretch(t, p, _WORST) for p in t.parts), key=lambda p: float(np.mean((t.torque - t.baseline)[p] ** 2)))
    k = int(np.searchsorted(t.start, part.start, side="right")) - 1
    run = d.recording.trajectories[k]
    begins = session_clock(d.recording)
    clock = t.time[part] - (0.0 if begins is None else begins[k])
    figure = Figure(figsize=(WIDTH, 8.6), layout="constrained")
    panels = figure.subplots(4, 1, sharex=True, height_ratios=(3, 2, 2, 1.3))
    _three(panels[0], clock, t, part)
    panels[0].set_ylabel(axis_label("torque", units))
    panels[1].axhspan(-1.96 * t.noise_rms, 1.96 * t.noise_rms, color=NOISE, label="noise, 95 %")
    panels[1].plot(clock, (t.torque - t.baseline)[part], color=BEFORE, lw=1.1)
    if is_extended(t):
        panels[1].plot(clock, (t.torque - t.extended)[part], color=AFTER, lw=1.3, ls="--")
    panels[1].set_ylabel(f"mismatch [{units['torque']}]")
    handles, labels = (a + b for a, b in zip(*(p.get_legend_handles_labels() for p in panels[:2]), strict=True))
    figure.legend(handles, labels, loc="outside upper left", ncols=2, frameon=False)
    panels[2].plot(clock, t.qd[part], color=MEASURED, lw=1.3)
    panels[2].axhline(0.0, color=MEASURED, lw=0.6)
    panels[2].set_ylabel(axis_label("qd", units, "\n"))
    panels[3].plot(clock, t.current[part], color=MEASURED, lw=1.3)
    panels[3].set_ylabel(axis_label("current", units, "\n"))
    panels[3].set_xlabel(f"time from the start of {short(run.id, 30)} [s]")
    figure.align_ylabels(panels)
    return figure


def variables_picture(d: Diagnosis) -> Figure | None:
    """Mismatch against each variable, each in the view that shows most."""
    t, units = _traces(d), d.recording.units
    names = ("q", "qd", "qdd", "current", "time")
    axes = [axis for name in names for axis in axes_of(name, t, units)]
    if periods := next(filter(None, map(_periods, d.causes)), 0.0):
        axes[0] = folded(axes[0], periods)
    found = [p for axis in axes if (p := profile(axis, t)) is not None]
    if not found:
        return None
    figure = Figure(figsize=(WIDTH, 2.4 * len(found) + 0.4), layout="constrained")
    panels = figure.subplots(len(found), 1, squeeze=False, sharey=True)[:, 0]
    for k, (ax, p) in enumerate(zip(panels, found, strict=True)):
        _profile_panel(ax, p, d, legend=k == 0)
    return figure


def spectrum_picture(d: Diagnosis) -> Figure:
    """Amplitude spectral density of the mismatch before and after, and of the noise."""
    t, units = _traces(d), d.recording.units
    figure = Figure(figsize=(WIDTH, 3.9), layout="constrained")
    ax = figure.subplots()
    steps = np.array([run.dt for run in d.recording.trajectories])
    common = of_commonest_rate(steps, t.start)
    same, rate = [t.parts[k] for k in np.flatnonzero(common)], 1.0 / float(np.median(steps[common]))
    seen = np.ones(len(t.torque)) if t.counts is None else t.counts
    ax.plot(*_density(seen * (t.torque - t.baseline), same, rate), color=BEFORE, label="baseline")
    if is_extended(t):
        ax.plot(*_density(seen * (t.torque - t.extended), same, rate), color=AFTER, ls="--", label="with the extension")
    level = t.noise_rms / np.sqrt(0.5 * rate)
    ax.axhline(level, color="0.45", lw=1.4, ls=":", label="the noise, if it were white")
    ax.set(xlabel="frequency [Hz]", ylabel=f"mismatch [{units['torque']}/√Hz]")
    _logarithmic(ax, "x")
    _logarithmic(ax, "y")
    figure.legend(loc="outside upper left", ncols=1, frameon=False)
    return figure


MAKERS: dict[str, Callable[[Diagnosis], Figure | None]] = {
    "evidence": evidence_picture,
    "loops": loops_picture,
    "worst": worst_picture,
    "variables": variables_picture,
    "spectrum": spectrum_picture,
}
"""Each picture by its name."""


# --- parts ---


def _periods(cause: Cause) -> float:
    """How often a cause repeats along the angle, per 2π; 0 where it does not."""
    return next((v.value for name, v in cause.parameters.items() if name.startswith("periods")), 0.0)


def _plane(d: Diagnosis) -> Surface | None:
    """The plane of the first two variables that unexplained structure lies along, where it has two that span one."""
    names = [v for v in d.unexplained.depends_on if v in ("q", "qd", "qdd", "current", "time")] if d.unexplained else []
    if len(names) < 2:
        return None
    across, up = (axes_of(name, _traces(d), d.recording.units)[0] for name in names[:2])
    return surface(across, up, _traces(d))


def _surface_panel(figure: Figure, ax: Axes, s: Surface, unit: str) -> None:
    reach = float(np.nanquantile(np.abs(s.mean), 0.97))
    image = ax.pcolormesh(s.x, s.y, s.mean, cmap="PuOr_r", vmin=-reach, vmax=reach)
    ax.set(xlabel=s.across.label, ylabel=s.up.label)
    ax.set_title("Not explained by any known effect")
    ax.grid(visible=False)
    bar = figure.colorbar(image, ax=ax, extend="both", location="bottom", aspect=45.0)
    bar.set_label(f"mean mismatch [{unit}]" + (f", positive: {s.meaning}" if s.meaning else ""))


def _profile_panel(ax: Axes, p: Profile, d: Diagnosis, *, legend: bool) -> None:
    t = _traces(d)
    unit = d.recording.units["torque"]
    ax.fill_between(p.x, -p.band, p.band, color=NOISE, label="noise, 95 %", lw=0.0)
    ax.axhline(0.0, color=MEASURED, lw=0.6)
    extended = is_extended(t)
    ax.plot(p.x, p.before, color=BEFORE, marker="o", ms=4.5, label="baseline")
    if extended:
        ax.plot(p.x, p.after, color=AFTER, marker="s", ms=4.0, ls="--", label="with the extension")
    if p.axis.logarithmic:
        _logarithmic(ax, "x")
    ax.set_xlabel(p.axis.label + (f"\nup: {p.meaning}" if p.meaning else ""))
    ax.set_ylabel(f"mismatch [{unit}]")
    if legend:
        ax.legend(loc="lower left", bbox_to_anchor=(0.0, 1.08), ncols=3, frameon=False, borderaxespad=0.0)


def _three(ax: Axes, x: np.ndarray, t: Traces, part: slice) -> None:
    ax.plot(x, t.torque[part], color=MEASURED, lw=1.0, alpha=0.75, label="measured")
    ax.plot(x, t.baseline[part], color=BEFORE, lw=1.3, label="baseline")
    if is_extended(t):
        ax.plot(x, t.extended[part], color=AFTER, lw=1.3, ls="--", label="with the extension")


def _logarithmic(ax: Axes, which: str) -> None:
    """A logarithmic axis with plain numbers at 1, 2 and 5 of every decade."""
    ax.set(**{f"{which}scale": "log"})
    axis = ax.xaxis if which == "x" else ax.yaxis
    low, high = axis.get_view_interval()
    narrow = high < 100.0 * low
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if narrow else (1.0,), numticks=12))
    axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
    axis.set_minor_formatter(NullFormatter())


def _density(x: np.ndarray, parts: Sequence[slice], rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies and amplitude spectral density by Welch over all trajectories, averaged over a tenth of a decade."""
    size = max(32, min(int(np.median([p.stop - p.start for p in parts])) // 2, 1024))
    fitting = [p for p in parts if p.stop - p.start >= size]
    found = [welch(x[p], rate, nperseg=size, detrend="constant") for p in fitting]
    f, power = found[0][0][1:], np.mean([density[1:] for _, density in found], axis=0)
    band = np.unique(np.round(10.0 * np.log10(f / f[0])), return_inverse=True)[1]
    count = np.bincount(band)
    return np.bincount(band, weights=f) / count, np.sqrt(np.bincount(band, weights=power) / count)


def _period(t: Traces, part: slice) -> float:
    """Mean length of a cycle of a trajectory's motion [s]: two reversals beyond a tenth of its speed."""
    qd = t.qd[part]
    quick = np.sign(qd[np.abs(qd) > 0.1 * np.abs(qd).max()])
    turns = int(np.sum(quick[1:] != quick[:-1]))
    return 2.0 * float(t.time[part.stop - 1] - t.time[part.start]) / max(turns, 1)


def _stretch(t: Traces, part: slice, seconds: float) -> slice:
    """The stretch of a trajectory where the baseline is worst."""
    size = part.stop - part.start
    dt = float(t.time[part.stop - 1] - t.time[part.start]) / max(size - 1, 1)
    length = min(size, max(2, round(seconds / dt))) if dt > 0.0 else size
    total = np.concatenate([[0.0], np.cumsum((t.torque[part] - t.baseline[part]) ** 2)])
    first = part.start + int(np.argmax(total[length:] - total[:-length]))
    return slice(first, first + length)


def _traces(d: Diagnosis) -> Traces:
    assert d.traces is not None  # pictures of samples are drawn where there are samples
    return d.traces
