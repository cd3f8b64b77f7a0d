"""Table 4: minimum height and peak downward velocity over the current, pushed (simulation) and hit (hardware)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.reproduce import impacts
from mrwarp.reproduce.cache import Job
from mrwarp.reproduce.comparison import Comparison, Findings, TextTable, compare, over_seeds
from mrwarp.reproduce.impacts import Drops, Pushes, PushResult
from mrwarp.runtime import drawing, panels
from mrwarp.usd.robot import CURRENT_GROUPS
from mrwarp.viewing.robot_pictures import COLORS

TITLES = {"min_height": ("minimum height", "m", 4), "peak_down_velocity": ("peak downward velocity", "m/s", 4)}
"""Columns of the table, their units and digits."""

WANTED = 0.05
"""Largest relative difference of a simulation cell above 0 A that counts as reproduced."""

SHOWN = 12
"""Cells of the grid that the report lists, the nearest first."""


def compute(job: Job) -> Findings:
    """The adopted reading's rows, the effect of the current against both references, and the drop's rows."""
    found, dropped = impacts.read_pushes(job), impacts.read_drops(job)
    adopted = found.readings[0]
    rows = [row for amps in CURRENT_GROUPS for row in _pushed(adopted, amps)]
    rows += [row for result in found.readings for row in _effects(result)]
    for name, values in dropped.figures.items():
        for i, amps in enumerate(CURRENT_GROUPS):
            for cell, quantity in TITLES.items():
                ours, theirs = over_seeds(values[cell][i], dropped.seeds()), paper.TABLE_4["hardware"][amps][cell]
                condition = f"drop of {paper.IMPACTOR['mass']:g} kg, {amps:g} A, {name}"
                rows.append(compare(condition, quantity, theirs, ours, _dropped(values, cell)))
    with drawing("table4.png"):
        _plot(found, dropped, job)
    off = {amps: _off(adopted, amps) for amps in CURRENT_GROUPS[1:]}
    within = sum(abs(value) <= WANTED for values in off.values() for value in values)
    return Findings(
        rows=rows,
        claims={
            f"the six simulation cells above 0 A lie within {100.0 * WANTED:.0f} % ({within} do)": within == 6,
            "height rises and speed falls with every step of the current": adopted.monotone,
        },
        notes=[
            f"Adopted by the rule: {adopted.reading.name}; push of {found.adopted.duration:.2f} s, knees opened by "
            f"{found.adopted.lift:.2f} rad. Its 0 A row: onset {found.adopted.onset:.3f} m, drop "
            f"{found.adopted.drop:.3f} m, peak speed {found.adopted.speed:.3f} m/s (the paper {impacts.START:.3f}, "
            f"{impacts.START - paper.TABLE_4['simulation'][0.0]['min_height'].mean:.3f}, "
            f"{-paper.TABLE_4['simulation'][0.0]['peak_down_velocity'].mean:.3f}).",
            *impacts.fallen(found.traces["eq. 14"]["fell"], "pushes"),
            *impacts.lost(dropped.figures.values()),
        ],
        tables=[_grid(found), _readings(found)],
        pictures={"table4.png": "Both figures over the current: ours (lines), the paper's (marks)"},
        figures={"adopted": adopted.reading.name, "duration": found.adopted.duration, "lift": found.adopted.lift},
    )


def _off(result: PushResult, amps: float) -> list[float]:
    """Relative differences of a row's two cells from the paper's."""
    theirs = paper.TABLE_4["simulation"][amps]
    return [float(result.row(cell, amps).mean()) / theirs[cell].mean - 1.0 for cell in TITLES]


def _pushed(adopted: PushResult, amps: float) -> list[Comparison]:
    """Both cells of a current; the row of 0 A chose the reading."""
    why = (
        "This row chose gains, stance, duration and what is on at 0 A, see the grid."
        if amps == 0.0
        else "What eq. 14 changes against 0 A stands below, beside what the paper's rows require."
    )
    return [
        compare(
            f"push, {amps:g} A",
            quantity,
            paper.TABLE_4["simulation"][amps][cell],
            over_seeds(adopted.row(cell, amps)),
            why,
            calibrated=amps == 0.0,
        )
        for cell, quantity in TITLES.items()
    ]


def _effects(result: PushResult) -> list[Comparison]:
    """What 1.5 A change against SAL off and against open gates at 0 A, each policy against itself."""
    rows = []
    for cell, (title, _, _) in TITLES.items():
        for name, place in (("SAL off", impacts.OFF), ("0 A, gates open", impacts.OPEN)):
            before, after = result.by_policy(cell, place), result.row(cell, 1.5)
            rows.append(
                compare(
                    f"1.5 A against {name}: {result.reading.name}",
                    (f"change of {title}", "%", 1),
                    paper.IMPACT_CHANGE[cell]["push"],
                    over_seeds(100.0 * (after / before - 1.0)),
                    "Eq. 14 has a part of the torque that the paper's rows require.",
                )
            )
    return rows


def _dropped(values: dict[str, np.ndarray], cell: str) -> str:
    change = values[cell][-1].mean() / values[cell][0].mean() - 1.0
    return (
        f"From 0 to 1.5 A ours changes by {100.0 * change:+.1f} %, the hardware by "
        f"{paper.IMPACT_CHANGE[cell]['drop']:+.1f} %."
    )


def _grid(found: Pushes) -> TextTable:
    """The nearest 0 A rows of the grid."""
    rows = [
        [cell.reading.name, f"{cell.duration:.2f}", f"{cell.onset:.3f}", f"{cell.drop:.3f}", f"{cell.speed:.3f}",
         f"{100.0 * cell.fell:.0f}", f"{cell.score:.4f}"]
        for cell in found.grid[:SHOWN]
    ]  # fmt: skip
    row = paper.TABLE_4["simulation"][0.0]
    theirs = [impacts.START, impacts.START - row["min_height"].mean, -row["peak_down_velocity"].mean]
    return TextTable(
        title=f"The grid's 0 A rows, {len(rows)} nearest of {len(found.grid)}, medians",
        head=["reading", "push [s]", "onset [m]", "drop [m]", "speed [m/s]", "fell [%]", "score"],
        rows=[["paper", "not stated", *(f"{value:.3f}" for value in theirs), "", ""], *rows],
    )


def _readings(found: Pushes) -> TextTable:
    """What each choice moves."""
    names = {"min_height": "height", "peak_down_velocity": "speed"}
    head = ["reading", "push [s]", "onset [m]", "0 A: height [m]", "speed [m/s]"]
    head += [f"{name}, against {of} [%]" for of in ("SAL off", "0 A with open gates") for name in names.values()]
    rows = []
    for result in found.readings:
        level = [abs(float(result.row(cell, 0.0).mean())) for cell in TITLES]
        changes = [result.change(cell, place) for place in (impacts.OFF, impacts.OPEN) for cell in TITLES]
        cells = [f"{np.median(result.onset):.3f}", *(f"{value:.3f}" for value in level)]
        cells += [f"{100.0 * change:+.1f}" for change in changes]
        cells += [f"{100.0 * result.worst:.0f} %", "yes" if result.monotone else "no", str(result.fell)]
        rows.append([result.reading.name, f"{result.duration:.2f}", *cells])
    changes = [f"{paper.IMPACT_CHANGE[cell]['push']:+.1f}" for cell in TITLES]
    level = [f"{abs(paper.TABLE_4['simulation'][0.0][cell].mean):.3f}" for cell in TITLES]
    return TextTable(
        title="What each choice moves: the adopted reading first, then those that differ in one",
        head=[*head, "worst of six cells", "monotone", "fell"],
        rows=[["paper", "", f"{impacts.START:.3f}", *level, *changes, *changes, "", "yes", ""], *rows],
    )


def _plot(found: Pushes, dropped: Drops, job: Job) -> None:
    figure, (axes,) = panels((11, 4.8), 1, 2)
    x = list(CURRENT_GROUPS)
    for axis, (cell, (title, unit, _)) in zip(axes, TITLES.items(), strict=True):
        for k, result in enumerate(found.readings):
            required = result.reading.torque == "required"
            style: dict[str, Any] = {"color": "0.8", "linewidth": 1.0, "zorder": 1}
            if k == 0:
                style = {"color": "#1f6fb4", "linewidth": 2.5, "zorder": 2, "label": "push, adopted"}
            elif required:
                style = {"color": "#2f7d4f", "linewidth": 2.0, "label": "push, the torque that the rows require"}
            elif k == 1:
                style["label"] = "push, other readings"
            axis.plot(x, [result.row(cell, amps).mean() for amps in x], **style)
        for (name, values), color in zip(dropped.figures.items(), (COLORS[2], COLORS[5], "0.5"), strict=False):
            ours = [over_seeds(row, dropped.seeds()) for row in values[cell]]
            means, sds = [o["ours"] for o in ours], [o["sd"] or 0.0 for o in ours]
            axis.errorbar(x, means, sds, color=color, linestyle="--", capsize=3, label=f"drop, {name}")
        for source, marker, color in (("simulation", "s", "black"), ("hardware", "o", COLORS[3])):
            theirs = [paper.TABLE_4[source][amps][cell] for amps in x]
            means, sds = [v.mean for v in theirs], [v.sd for v in theirs]
            axis.errorbar(x, means, sds, fmt=marker, color=color, capsize=3, label=f"paper, {source}")
        axis.set(xlabel="current [A]", ylabel=f"{title} [{unit}]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="outside lower center", ncols=4)
    figure.savefig(job.out / "table4.png", dpi=110)
