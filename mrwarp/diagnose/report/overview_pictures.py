"""Pictures of a diagnosis: small PNGs that a phone shows readably, in colours that colour-blind people distinguish."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import partial

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from mrwarp.diagnose.report.trace_pictures import DPI, MAKERS, STYLE, WIDTH
from mrwarp.diagnose.result import REGIMES, Diagnosis
from mrwarp.diagnose.verdict_text import axis_label, title
from mrwarp.recording.data import true_names
from mrwarp.sysid.report.pictures import AFTER, ALTERNATIVE, BEFORE, MEASURED, NOISE, OTHER, drawn
from mrwarp.sysid.report.words import both, capital, percent, short

TITLES = {
    "loops": "Torque loops, measured and simulated, where the baseline is worst",
    "accounting": "Where the baseline's mismatch goes",
    "evidence": "Mean mismatch along what the verdict is about",
    "gain": "Error of each trajectory and regime",
    "worst": "The two seconds with the largest mismatch",
    "variables": "Mean mismatch along each measured variable",
    "spectrum": "Mismatch by frequency, compared with white noise",
    "tried": "Mismatch that each effect alone takes away",
    "data": "The recording: ten seconds of it, and its loops",
}
"""All pictures, in the order of the report, each with its title: what is to be seen in it."""

NAMES = tuple(TITLES)

_TITLE_SIZE = 13.0
"""Size of a picture's title [pt]."""

_NAMED = 28
"""Most trajectories that are written by name."""


def draw(diagnosis: Diagnosis) -> tuple[dict[str, bytes], list[str]]:
    """All pictures that the diagnosis has data for, as PNG by name, in the order of the report, and notes.

    A note names a picture that could not be drawn, and why.
    """
    makers: dict[str, Callable[[Diagnosis], Figure | None]] = {"data": data_picture}
    if diagnosis.verdict is not None:
        makers |= {"tried": tried_picture, "gain": gain_picture, "accounting": accounting_picture}
        if diagnosis.traces is not None:
            makers |= MAKERS
    with matplotlib.rc_context(STYLE), warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="Glyph")  # a trajectory's name in letters that the font does not have
        bound = {name: partial(make, diagnosis) for name, make in makers.items()}
        return drawn(bound, TITLES, size=_TITLE_SIZE, dpi=DPI)


def accounting_picture(d: Diagnosis) -> Figure:
    """Where the baseline's mean squared mismatch goes."""
    a, named = d.accounting, true_names(both(title(c.name) for c in d.causes), d.recording.units)
    parts = [
        (
            a.named,
            capital(named) or "Named cause",
            AFTER,
            "white",
        ),
        (a.predictable, "Repeatable, cause unknown", OTHER, "black"),
        (a.noise, "Not repeatable", "#bdbdbd", "black"),
    ]
    full = d.account
    shares = (None,) * 3 if full is None else (full.named, full.repeatable, full.not_repeatable)
    figure = Figure(figsize=(WIDTH, 2.3), layout="constrained")
    ax = figure.subplots()
    begin = 0.0
    for (share, label, color, ink), interval in zip(parts, shares, strict=True):
        width = 100.0 * max(share, 0.0)
        label = f"{short(label, 48)}: {percent(share, 0)}"
        if interval is not None:
            label += f" ({100.0 * interval.ci95[0]:.0f} to {percent(interval.ci95[1], 0)})"
        ax.barh(0, width, left=begin, color=color, edgecolor="white", label=label)
        if width > 7.0:
            ax.text(begin + 0.5 * width, 0, f"{width:.0f} %", ha="center", va="center", color=ink, weight="bold")
        begin += width
    ax.set(xlim=(0, max(100.0, begin)), yticks=[], xlabel="share of the baseline's squared mismatch [%]")
    ax.grid(visible=False)
    ax.spines["left"].set_visible(False)
    figure.legend(loc="outside upper left", ncols=1, frameon=False)
    return figure


def gain_picture(d: Diagnosis) -> Figure | None:
    """RMSE of every trajectory and every regime, before and after."""
    rows = [(name, before, after if d.causes else before) for name, (before, after) in d.per_trajectory.items()]
    if not rows:
        return None
    rows.sort(key=lambda row: row[1])
    named, unit = len(rows) <= _NAMED, d.recording.units["torque"]
    regimes = [(name, *d.per_regime[name]) for name in REGIMES if name in d.per_regime]
    heights = [(0.25 if named else 4.0 / len(rows)) * len(rows) + 1.0]
    figure = Figure(figsize=(WIDTH, heights[0] + 0.42 * len(regimes) + 1.3), layout="constrained")
    heights += [0.42 * len(regimes) + 0.7] if regimes else []
    panels = figure.subplots(len(heights), 1, squeeze=False, height_ratios=heights)[:, 0]
    _dots(panels[0], rows, d)
    if named:
        panels[0].set_yticks(range(len(rows)), [short(name, 24) for name, *_ in rows], fontsize=10)
    else:
        panels[0].set_ylabel("trajectories, smallest mismatch at the bottom")
        panels[0].set_yticks([])
    panels[0].set_xlabel(f"RMSE [{unit}]")
    panels[0].set_xlim(left=0.0)
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper left", ncols=2, frameon=False)
    if regimes:
        _dots(panels[1], regimes, d)
        panels[1].set_yticks(range(len(regimes)), [name for name, *_ in regimes])
        panels[1].set(xlabel=f"RMSE per regime [{unit}]", ylim=(-0.6, len(regimes) - 0.4))
        panels[1].set_xlim(left=0.0)
    return figure


def tried_picture(d: Diagnosis) -> Figure | None:
    """Gain of every effect of the catalogue on trajectories left out, alone on top of the baseline.

    Less than nothing is drawn as nothing: at size zero every effect is the baseline.
    """
    rows = sorted((t for t in d.tried if np.isfinite(t.gain)), key=lambda t: t.gain)
    if not rows:
        return None
    causes = {c.name for c in d.causes}
    others = {name for c in d.causes for name in c.alternatives} - causes
    figure = Figure(figsize=(WIDTH, 0.29 * len(rows) + 1.5), layout="constrained")
    ax = figure.subplots()
    for k, t in enumerate(rows):
        color = AFTER if t.name in causes else ALTERNATIVE if t.name in others else NOISE
        hatch, edge = ("///", MEASURED) if t.name in others else (None, "white")
        ax.barh(k, 100.0 * max(t.gain, 0.0), color=color, height=0.72, hatch=hatch, edgecolor=edge)
        if t.gain > 0.0 and np.isfinite(t.error):
            half = 1.96 * t.error  # no effect takes away less than nothing or more than all
            sides = [[100.0 * min(half, t.gain)], [100.0 * max(min(half, 1.0 - t.gain), 0.0)]]
            ax.errorbar(100.0 * t.gain, k, xerr=sides, fmt="none", elinewidth=1.1, ecolor="0.2", capsize=2.5)
    ax.set_yticks(range(len(rows)), [true_names(title(t.name), d.recording.units) for t in rows], fontsize=10.5)
    ax.axvline(0.0, color=MEASURED, lw=0.8)
    ax.set_xlabel("squared mismatch taken away [%]")
    ax.set_ylim(-0.7, len(rows) - 0.3)
    shown = [Patch(facecolor=AFTER, label="named")] * bool(causes)
    shown += [Patch(facecolor=ALTERNATIVE, edgecolor=MEASURED, hatch="///", label="alternative")] * bool(others)
    shown += [Patch(facecolor=NOISE, label="rejected")]
    figure.legend(handles=shown, loc="outside upper left", ncols=len(shown), frameon=False)
    reach = 100.0 * max(min(t.gain + 1.96 * (t.error if np.isfinite(t.error) else 0.0), 1.0) for t in rows)
    ax.set_xlim(-0.02 * max(reach, 1.0), 1.04 * max(reach, 1.0))
    return figure


def data_picture(d: Diagnosis) -> Figure | None:
    """Measured data: the longest trajectory's motion, current and torque, and the loops of all."""
    runs, units = d.recording.trajectories, d.recording.units
    if not runs:
        return None
    run = max(runs, key=lambda r: float(np.std(r.qd)) * len(r.t))
    end = int(np.searchsorted(run.t - run.t[0], 10.0, side="right"))
    figure = Figure(figsize=(WIDTH, 8.4), layout="constrained")
    grid = figure.add_gridspec(4, 1, height_ratios=(1, 1, 1, 2))
    above: Axes | None = None
    for row, name in enumerate(("q", "current", "torque")):
        ax = figure.add_subplot(grid[row], sharex=above)
        above = above or ax
        ax.plot(run.t[:end] - run.t[0], getattr(run, name)[:end], color=MEASURED, lw=1.1)
        ax.set_ylabel(axis_label(name, units, "\n"))
        if row < 2:
            ax.tick_params(labelbottom=False)
    ax.set_xlabel(f"time from the start of {short(run.id, 30)} [s]")
    ax = figure.add_subplot(grid[3])
    some = runs[:: -(-len(runs) // 40)]
    step = -(-sum(len(r.t) for r in some) // 20_000)
    for r in some:
        ax.plot(r.q[::step], r.torque[::step], ".", color=AFTER, ms=1.5, alpha=0.5)
    ax.set(xlabel=axis_label("q", units), ylabel=axis_label("torque", units))
    ax.set_title("all trajectories" if len(some) == len(runs) else f"{len(some)} of {len(runs)} trajectories")
    return figure


def _dots(ax: Axes, rows: Sequence[tuple[str, float, float]], d: Diagnosis) -> None:
    """Paired dots, one line per row."""
    y = np.arange(len(rows))
    before, after = np.array([r[1] for r in rows]), np.array([r[2] for r in rows])
    extended = not np.allclose(before, after, rtol=1e-9)
    if extended:
        ax.hlines(y, before, after, color="0.6", lw=1.2)
    ax.plot(before, y, "o", color=BEFORE, ms=5.5, label="baseline")
    if extended:
        ax.plot(after, y, "o", color=AFTER, ms=5.5, label="with the extension")
    if d.traces is not None and len(rows) > len(REGIMES):
        ax.axvline(d.traces.noise_rms, color="0.45", ls=":", lw=1.4, label="noise")
    ax.set_ylim(-0.7, len(rows) - 0.3)
