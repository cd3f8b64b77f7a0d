"""Table 4: minimum height and peak downward velocity over the current, pushed (simulation) and hit (hardware)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from mrwarp import paper
from mrwarp.params import BoucWenParams
from mrwarp.reproduce import impacts
from mrwarp.reproduce.cache import Job
from mrwarp.reproduce.comparison import Comparison, Findings, TextTable, compare, over_seeds
from mrwarp.reproduce.impacts import Drops, Pushes, ReadingResult
from mrwarp.runtime import panels
from mrwarp.usd.robot import CURRENT_GROUPS
from mrwarp.viewing.robot_pictures import COLORS

TITLES = {"min_height": ("minimum height", "m", 4), "peak_down_velocity": ("peak downward velocity", "m/s", 4)}
"""Columns of the table, their units and digits."""

WANTED = 0.05
"""Largest relative difference of a predicted simulation cell that counts as reproduced."""


def compute(job: Job) -> Findings:
    """The adopted reading's rows, the drop's rows, and what every other reading gives."""
    found, dropped = impacts.read_pushes(job), impacts.read_drops(job)
    adopted = found.of(impacts.ADOPTED)
    rows = _rows(
        "push, {amps}", "simulation", adopted.cells, found.seeds(), lambda cell, i: _pushed(adopted, cell, i), True
    )
    for name, values in dropped.figures.items():
        why = {cell: _dropped(values, cell) for cell in TITLES}
        condition = f"drop of 10 kg, {{amps}}, {name}"
        rows += _rows(condition, "hardware", values, dropped.seeds(), lambda cell, i, why=why: why[cell])
    _plot(found, dropped, job)
    within = sum(abs(value) <= WANTED for value in impacts.predicted_off(adopted.means))
    return Findings(
        rows=rows,
        claims={
            f"the six predicted simulation cells lie within {100.0 * WANTED:.0f} % ({within} do)": within == 6,
            "height rises and speed falls with every step of the current": adopted.monotone,
            f"of the {len(impacts.CANDIDATES)} readings with eq. 14, the adopted one's 0 A row is nearest": (
                _by_level(found)[0] is adopted
            ),
        },
        notes=[*_readings(found), *_upright(found), *impacts.lost(dropped.figures.values())],
        tables=[table(found)],
        pictures={"table4.png": "Both figures over the current: ours (lines), the paper's (marks)"},
        figures={"readings": [reading.figures() for reading in found.readings]},
    )


def _rows(
    condition: str,
    source: str,
    cells: Mapping[str, np.ndarray],
    seeds: np.ndarray | None,
    why: Callable[[str, int], str],
    fitted: bool = False,
) -> list[Comparison]:
    """A row per current and column; with ``fitted`` that of 0 A was used to calibrate."""
    return [
        compare(
            condition.format(amps=f"{amps:g} A"),
            quantity,
            paper.TABLE_4[source][amps][cell],
            over_seeds(cells[cell][i], seeds),
            why(cell, i),
            calibrated=fitted and amps == 0.0,
        )
        for i, amps in enumerate(CURRENT_GROUPS)
        for cell, quantity in TITLES.items()
    ]


def _pushed(entry: ReadingResult, cell: str, i: int) -> str:
    """What of the difference stands at 0 A already, and what current number i leaves over."""
    theirs, ours = paper.TABLE_4["simulation"], entry.means[cell].astype(float)
    off = _percent(ours[0] / theirs[0.0][cell].mean - 1.0)
    if i == 0:
        return f"Duration and gains are the least-squares compromise of both cells of this row, {off} off here."
    gain, wanted = ours[i] / ours[0] - 1.0, theirs[CURRENT_GROUPS[i]][cell].mean / theirs[0.0][cell].mean - 1.0
    return (
        f"{off} stand at 0 A already; the current changes it by {_percent(gain)}, in the paper by {_percent(wanted)}."
    )


def _dropped(values: dict[str, np.ndarray], cell: str) -> str:
    change = values[cell][-1].mean() / values[cell][0].mean() - 1.0
    theirs = paper.TABLE_4["hardware"]
    wanted = theirs[1.5][cell].mean / theirs[0.0][cell].mean - 1.0
    return (
        f"From 0 to 1.5 A ours changes by {_percent(change)}, the hardware by {_percent(wanted)}; the readings show "
        "what torque the device would need."
    )


def table(found: Pushes) -> TextTable:
    """Every reading's cells beside the paper's."""
    theirs = paper.TABLE_4["simulation"]

    def line(name: str, duration: str, means: Mapping[str, Sequence[float] | np.ndarray], rest: list[str]) -> list[str]:
        heights, speeds = ([f"{x:.{n}f}" for x in means[cell]] for cell, n in zip(TITLES, (4, 3), strict=True))
        return [name, duration, *heights, *speeds, *rest]

    means = {cell: [theirs[amps][cell].mean for amps in CURRENT_GROUPS] for cell in TITLES}
    changes = [f"{paper.IMPACT_CHANGE[cell]['push']:+.1f} %" for cell in TITLES]
    rows = [line("paper", "not stated", means, [*changes, "", "yes"])]
    for entry in found.readings:
        rest = [_percent(entry.change[cell]) for cell in TITLES]
        rest += [f"{100.0 * entry.worst:.0f} %", "yes" if entry.monotone else "no"]
        rows.append(line(entry.reading, f"{entry.duration:.2f}", entry.means, rest))
    columns = [f"{symbol} {amps:g} A" for symbol in "zv" for amps in CURRENT_GROUPS]
    return TextTable(
        title="Readings of the simulated push: z [m], v [m/s]; durations calibrated on 0 A; worst of six predictions",
        head=["reading", "push [s]", *columns, "z change", "v change", "worst", "monotone"],
        rows=rows,
    )


def _by_level(found: Pushes) -> list[ReadingResult]:
    """The readings that the adopted one was chosen among, the one with the nearest 0 A row first."""
    candidates = [found.of(reading) for reading in impacts.CANDIDATES]
    return sorted(candidates, key=lambda entry: sum(value**2 for value in entry.off_mismatch))


def _readings(found: Pushes) -> list[str]:
    """How the adopted reading was chosen, and what the others tell about the level at 0 A and the effect of current."""
    adopted, theirs = found.of(impacts.ADOPTED), paper.TABLE_4["simulation"]
    nearest = []
    for entry in _by_level(found)[:2]:
        off = zip(entry.off_mismatch, TITLES.values(), strict=True)
        by = " and ".join(f"{_percent(value)} ({title})" for value, (title, *_) in off)
        nearest.append(f"'{entry.reading}' is off by {by}")
    # the paper's own 0 A row: nearly that of a spring without damping
    drop = paper.TABLE_2["D"]["height"].mean - theirs[0.0]["min_height"].mean
    bound, speed = impacts.undamped_speed(drop), -theirs[0.0]["peak_down_velocity"].mean
    stiff, little, ours = (
        -found.of(reading).means["peak_down_velocity"][0]
        for reading in (impacts.BASE, impacts.UNDAMPED, impacts.ADOPTED)
    )
    changes = [
        f"{title} {_percent(adopted.change[cell])} (the paper "
        f"{_percent(theirs[1.5][cell].mean / theirs[0.0][cell].mean - 1.0)})"
        for cell, (title, *_) in TITLES.items()
    ]
    free, base = found.of(impacts.UNWEAKENED), found.of(impacts.BASE).change
    best = min(found.readings, key=lambda entry: entry.worst)
    height, velocity = TITLES
    points = {e.reading: [100.0 * (e.change[cell] - base[cell]) for cell in TITLES] for e in found.readings}
    most = sorted(points, key=lambda name: -abs(points[name][0]))[:5]
    moved = [f"{name}: {points[name][0]:+.1f} and {points[name][1]:+.1f} points" for name in most]
    return [
        f"Adopted reading: {adopted.reading}. Push of {adopted.duration:.2f} s. Duration and gains, which "
        "the paper does not state, are chosen by the 0 A row alone; the largest difference of the six predicted "
        f"cells is {100.0 * adopted.worst:.1f} %. Policies walk with the gains that they were trained with, Kp "
        "20 and Kd 0.5, or near them; with the asset's Kp of 35 the calibrated push lowers the trunk to "
        f"{found.of(impacts.ASSET).means['min_height'][0]:.3f} m on average.",
        f"Of the readings with eq. 14 these two have the nearest 0 A rows: {'; '.join(nearest)}. Those with another "
        f"torque were not to choose from. The adopted one pushes while "
        f"{' and '.join(impacts.stance_legs(impacts.ADOPTED.phases))} stand; the paper's figure 6(b) shows "
        f"{' and '.join(paper.FIGURE_6_PUSH)} loaded.",
        f"The paper's 0 A row is nearly that of an undamped spring: pressed down by {drop:.3f} m with a lasting 100 N, "
        f"{paper.MASS['mr_go']:g} kg reach at most sqrt(F drop/2m) = {bound:.3f} m/s; the paper has {speed:.3f} m/s. "
        f"Motors with Kp 20, a Kd of 0.5 and the device's off-current drag leave {stiff:.3f} m/s here, a Kd of 0.1 "
        f"{little:.3f} m/s, and the adopted reading {ours:.3f} m/s.",
        f"From 0 to 1.5 A: {', '.join(changes)}. Eq. 14 divides its torque by 1 + {BoucWenParams().alpha:.2f} |qd|; "
        f"without that the changes are {100.0 * free.change[height]:+.1f} and {_percent(free.change[velocity])}, and "
        f"the largest difference of the six cells {100.0 * free.worst:.1f} %.",
        f"The base reading's 1.5 A change height by {_percent(base[height])} and speed by {_percent(base[velocity])}. "
        f"What moves these most: {'; '.join(moved)}.",
        f"Of all readings '{best.reading}' comes nearest (worst cell {100.0 * best.worst:.1f} % off, height "
        f"{_percent(best.change[height])}, speed {_percent(best.change[velocity])}); being chosen by its result, it "
        "predicts nothing.",
    ]


def _upright(found: Pushes) -> list[str]:
    """What fell in the adopted reading, and how far off the cells are without; nothing if nothing fell."""
    down, told = np.any(found.trace["fell"], axis=0), impacts.fallen(found.trace["fell"], "pushes")
    if not down.any() or down.all():
        return told
    cells = found.of(impacts.ADOPTED).cells
    off = impacts.predicted_off({cell: cells[cell][:, ~down].mean(axis=1) for cell in TITLES})
    return [
        f"{told[0]} Without the {down.sum()} of {down.size} trials that fell at some current, with the same push, "
        f"{sum(abs(value) <= WANTED for value in off)} of the six predicted cells lie within {100.0 * WANTED:.0f} %, "
        f"and the largest difference is {100.0 * max(map(abs, off)):.1f} %."
    ]


def _percent(share: float) -> str:
    return f"{100.0 * share:+.1f} %"


def _plot(found: Pushes, dropped: Drops, job: Job) -> None:
    figure, (axes,) = panels((11, 4.8), 1, 2)
    x = list(CURRENT_GROUPS)
    for axis, (cell, (title, unit, _)) in zip(axes, TITLES.items(), strict=True):
        for k, entry in enumerate(found.readings):
            if entry.reading == impacts.ADOPTED.name:
                style = {"color": "#1f6fb4", "linewidth": 2.5, "zorder": 2, "label": "push, adopted"}
            else:
                last = k == len(found.readings) - 1
                label = "push, other readings" if last else None
                style = {"color": "0.8", "linewidth": 1.0, "zorder": 1, "label": label}
            axis.plot(x, entry.means[cell], **style)
        for (name, values), color in zip(dropped.figures.items(), (COLORS[2], COLORS[5]), strict=True):
            ours = [over_seeds(row, dropped.seeds()) for row in values[cell]]
            means, sds = [o["ours"] for o in ours], [o["sd"] or 0.0 for o in ours]
            axis.errorbar(x, means, sds, color=color, linestyle="--", capsize=3, label=f"drop, {name}")
        for source, marker, color in (("simulation", "s", "black"), ("hardware", "o", COLORS[3])):
            theirs = [paper.TABLE_4[source][amps][cell] for amps in x]
            means, sds = [v.mean for v in theirs], [v.sd for v in theirs]
            axis.errorbar(x, means, sds, fmt=marker, color=color, capsize=3, label=f"paper, {source}")
        axis.set(xlabel="current [A]", ylabel=f"{title} [{unit}]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="outside lower center", ncols=6)
    figure.savefig(job.out / "table4.png", dpi=110)
