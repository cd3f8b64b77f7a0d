"""Table 4: minimum height and peak downward velocity over the current, pushed (simulation) and hit (hardware)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.runtime import drawing, panels
from mrwarp.usd.robot import CURRENT_GROUPS, GAIT_FREQUENCY, LEGS
from mrwarp.viewing.robot_pictures import COLORS
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Comparison, Findings, TextTable, compare
from paper.reproduce.disturbance import drop_trials, push_rule, two_knees
from paper.reproduce.disturbance.drop_trials import Drops
from paper.reproduce.disturbance.push_entries import policy_means
from paper.reproduce.disturbance.push_rule import DERIVED, JOINT, LITERAL, PAIR, SHORT, Pushes, PushResult
from paper.reproduce.settings import over_seeds
from paper.reproduce.verdicts import Claim, Measure, change, rows

TITLES = {"min_height": ("minimum height", "m", 4), "peak_down_velocity": ("peak downward velocity", "m/s", 4)}
"""Columns of the table, their units and digits."""

CURRENTS = CURRENT_GROUPS[1:]
"""Those above 0 A."""

STANCE = 0.5 / GAIT_FREQUENCY
"""Time in which the pair that stands at the onset stands [s]."""


def compute(job: Job) -> Findings:
    """Rows of the push and of the falling mass in both columns, and the effect of every current."""
    found, dropped = push_rule.read(job), drop_trials.read(job)
    shown = (LITERAL, JOINT, SHORT)
    rows = [row for amps in CURRENT_GROUPS for reading in shown for row in _pushed(found, reading, amps)]
    rows += [row for result in found.results for row in _effects(result)]
    for drop in drop_trials.DROPS:
        values = dropped.figures[drop.name]
        for i, amps in enumerate(CURRENT_GROUPS):
            for cell, quantity in TITLES.items():
                ours, theirs = over_seeds(values[cell][i], dropped.seeds()), paper.TABLE_4["hardware"][amps][cell]
                condition = f"drop of {paper.IMPACTOR['mass']:g} kg, {amps:g} A{drop.column}"
                rows.append(compare(condition, quantity, theirs, ours, _dropped(values, cell)))
    with drawing("table4.png"):
        _plot(found, dropped, job)
    zero = push_rule.chosen(found.zeros)
    wanted = push_rule.papers_zero()
    lowest = lowest_point(found.traces[LITERAL.name])
    return Findings(
        rows=rows,
        claims={
            f"height rises and speed falls with every step of the current, {reading.name}": found.of(reading).monotone
            for reading in shown
        },
        notes=[
            f"The push lasts {zero.duration:g} s by the rule. Its row of 0 A: drop {zero.drop:.3f} m, peak speed "
            f"{zero.speed:.3f} m/s, peak motor torque {zero.peak:.1f} N·m (the paper {wanted['drop']:.3f}, "
            f"{wanted['speed']:.3f}, {wanted['peak']:.1f}); it falls from {zero.onset:.3f} m, the paper's from "
            f"{push_rule.HEIGHT:.3f} m.",
            f"Without current the trunk is lowest {lowest['time']:.2f} s after the onset. By then the legs that swung "
            f"bear {100.0 * lowest['caught']:.0f} % of the feet's load. In {100.0 * lowest['later']:.0f} % of the "
            "pushes a later stance is lower.",
            f"The mass meets the trunk through a pad of {drop_trials.STIFFNESS / 1e3:.1f} kN/m.",
            *(
                f"{result.reading.name}: {result.fell} pushes felled a robot."
                for result in found.results
                if result.fell
            ),
            *drop_trials.lost(dropped.figures.values()),
        ],
        tables=[_zeros(found), _readings(found), _knees(), _falls(dropped), _bound(dropped)],
        reasons={
            "push.damping/height": (
                f"Ours falls less deep: when the trunk is lowest, {100.0 * lowest['caught']:.0f} % of the load is on "
                "the legs that swung at the onset."
            )
        },
        pictures={"table4.png": "Both figures over the current: ours (lines), the paper's (marks)"},
        figures={"duration": zero.duration},
    )


def lowest_point(trace: Mapping[str, np.ndarray]) -> dict[str, float]:
    """The lowest point without current: means over the pushes.

    Returns:
        ``time`` of it within the stance of the onset [s]; ``caught``, the share of the feet's load that is then on the
        legs that swung at the onset; ``later``, the share of the pushes whose height is lower after that stance.
    """
    height, foot = trace["height"][0], trace["f_foot"][0]
    stance = int((trace["t"] <= STANCE).sum())
    place = height[:, :stance].argmin(axis=1)
    load = foot[np.arange(len(foot)), place]
    swung = load[:, [k for k, leg in enumerate(LEGS) if leg not in PAIR]].sum()
    return {
        "time": float(trace["t"][place].mean()),
        "caught": float(swung / load.sum()),
        "later": float((height.argmin(axis=1) >= stance).mean()),
    }


def _pushed(found: Pushes, reading: push_rule.Reading, amps: float) -> list[Comparison]:
    """Both cells of a current."""
    why = (
        "The duration of the push was chosen by this row; our robots fall less deep, see the note."
        if amps == 0.0
        else "What the current changes against 0 A stands below."
    )
    return [
        compare(
            f"push, {amps:g} A{reading.column}",
            quantity,
            paper.TABLE_4["simulation"][amps][cell],
            over_seeds(found.of(reading).row(cell, amps)),
            why,
            calibrated=amps == 0.0,
        )
        for cell, quantity in TITLES.items()
    ]


def _effects(result: PushResult) -> list[Comparison]:
    """Changes by each current against 0 A, each policy against itself."""
    rows, theirs = [], paper.TABLE_4["simulation"]
    for amps in CURRENTS:
        for cell, (title, _, _) in TITLES.items():
            change = 100.0 * (theirs[amps][cell].mean / theirs[0.0][cell].mean - 1.0)
            rows.append(
                compare(
                    f"{amps:g} A against 0 A{result.reading.column}",
                    (f"change of {title}", "%", 1),
                    round(change, 1),
                    over_seeds(result.effect(cell, amps)),
                    "See the square of angle and drag.",
                )
            )
    return rows


def _dropped(values: dict[str, np.ndarray], cell: str) -> str:
    change = np.nanmean(values[cell][-1]) / np.nanmean(values[cell][0]) - 1.0
    return (
        f"From 0 to 1.5 A ours changes by {100.0 * change:+.1f} %, the hardware by "
        f"{paper.IMPACT_CHANGE[cell]['drop']:+.1f} %."
    )


def _zeros(found: Pushes) -> TextTable:
    """Rows that the duration was chosen among."""
    wanted = push_rule.papers_zero()
    rows = [
        [f"{z.duration:g}", f"{z.onset:.3f}", f"{z.drop:.3f}", f"{z.speed:.3f}", f"{z.peak:.1f}", f"{z.score:.3f}"]
        + [_with_sd(over_seeds(effects[cell])) for cell in TITLES]
        for z, effects in zip(found.zeros, found.durations, strict=True)
    ]
    theirs = [f"{push_rule.HEIGHT:.3f}", f"{wanted['drop']:.3f}", f"{wanted['speed']:.3f}", f"{wanted['peak']:.1f}"]
    return TextTable(
        title="The row of 0 A by the duration of the push; what 1.5 A change chooses nothing",
        head=[
            "push [s]",
            "onset [m]",
            "drop [m]",
            "speed [m/s]",
            "FL peak torque [N·m]",
            "score",
            "height at 1.5 A [%]",
            "speed [%]",
        ],
        rows=[["paper, not stated", *theirs, "", *(_papers(cell, CURRENTS[-1:]) for cell in TITLES)], *rows],
        id="zero",
    )


def _papers(cell: str, currents: Sequence[float], source: str = "simulation") -> str:
    """The paper's changes from 0 A [%]."""
    theirs = paper.TABLE_4[source]
    return ", ".join(f"{100.0 * (theirs[a][cell].mean / theirs[0.0][cell].mean - 1.0):+.1f}" for a in currents)


def _with_sd(effect: Mapping[str, Any]) -> str:
    return f"{effect['ours']:+.1f} ± {effect['sd'] or 0.0:.1f}"


def _readings(found: Pushes) -> TextTable:
    """Both cells of table 4 by each reading."""
    theirs = paper.TABLE_4["simulation"]

    def ours(result: PushResult, cell: str) -> str:
        *lower, last = (over_seeds(result.effect(cell, amps)) for amps in CURRENTS)
        return ", ".join([*(f"{e['ours']:+.1f}" for e in lower), _with_sd(last)])

    level = [f"{push_rule.papers_zero()['drop']:.3f}", *(f"{abs(theirs[0.0][cell].mean):.3f}" for cell in TITLES)]
    rows = [["paper", *level, *(_papers(cell, CURRENTS) for cell in TITLES), "yes", ""]]
    for result in found.results:
        level = [f"{result.drop:.3f}", *(f"{abs(float(result.row(cell, 0.0).mean())):.3f}" for cell in TITLES)]
        effects = [ours(result, cell) for cell in TITLES]
        rows.append([result.reading.name, *level, *effects, "yes" if result.monotone else "no", str(result.fell)])
    return TextTable(
        title="Every reading; those with the angle itself or without drag at 0 A were found with table 4 in view",
        head=[
            "reading",
            "0 A: drop [m]",
            "height [m]",
            "speed [m/s]",
            "height at 0.5, 1, 1.5 A [%]",
            "speed [%]",
            "monotone",
            "fell",
        ],
        rows=rows,
        id="readings",
    )


def _knees() -> TextTable:
    """The model of one degree of freedom, read in the same four ways."""
    rows = []
    for reading in push_rule.SQUARE:
        knees = two_knees.by_zero_row(raw=reading.raw, drag=not reading.free)
        zero, found = two_knees.fall(knees, 0.0), two_knees.changes(knees, CURRENTS)
        cells = [", ".join(f"{values[k]:+.1f}" for values in found) for k in range(3)]
        name = ("raw angle" if reading.raw else "neutral angle") + (", no drag at 0 A" if reading.free else "")
        rows.append(
            [name, f"{knees.kd:.2f}", f"{knees.duration:.2f}", f"{zero.height:.3f}", f"{zero.speed:.3f}", *cells]
        )
    return TextTable(
        title="One degree of freedom: 12.6 kg on two knees of Kp 20, damping and duration by the row of 0 A",
        head=[
            "reading",
            "Kd [N·m·s/rad]",
            "push [s]",
            "0 A: height [m]",
            "speed [m/s]",
            "height at 0.5, 1, 1.5 A [%]",
            "speed [%]",
            "peak motor torque [%]",
        ],
        rows=rows,
        id="knees",
    )


def _falls(dropped: Drops) -> TextTable:
    """Changes by current under the falling mass in every way to drop it, each policy against itself."""

    def change(values: np.ndarray, k: int) -> str:
        zero, now = (policy_means(values[place], dropped.policies) for place in (0, k))
        return _with_sd(over_seeds(100.0 * (now / zero - 1.0)))

    rows = []
    for drop in drop_trials.DROPS:
        values = dropped.figures[drop.name]
        cells = [", ".join(change(values[cell], k) for k in range(1, len(CURRENT_GROUPS))) for cell in TITLES]
        legs = [change(values[leg], len(CURRENT_GROUPS) - 1) for leg in paper.FIGURE_7]
        rows.append([drop.name, f"{abs(float(np.nanmean(values['peak_down_velocity'][0]))):.3f}", *cells, *legs])
    theirs = [f"{100.0 * (cells[1.5].mean / cells[0.0].mean - 1.0):+.1f}" for cells in paper.FIGURE_7.values()]
    level = f"{abs(paper.TABLE_4['hardware'][0.0]['peak_down_velocity'].mean):.3f}"
    papers = ["paper, hardware", level, *(_papers(cell, CURRENTS, "hardware") for cell in TITLES), *theirs]
    return TextTable(
        title="Falling mass with current, changes against 0 A",
        head=[
            "reading",
            "0 A: speed [m/s]",
            "height at 0.5, 1, 1.5 A [%]",
            "speed [%]",
            *(f"{leg}'s motor at 1.5 A [%]" for leg in paper.FIGURE_7),
        ],
        rows=[papers, *rows],
        id="falls",
    )


def _bound(dropped: Drops) -> TextTable:
    """Changes by a device of any torque after the hardware's impact."""
    rows = [
        [f"{torque:g}"]
        + [
            f"{100.0 * (np.nanmean(dropped.bound[q][k]) / np.nanmean(dropped.bound[q][0]) - 1.0):+.1f}"
            for q in (*TITLES, "acceleration", "FR", "RL")
        ]
        for k, torque in enumerate(drop_trials.BOUND, start=1)
    ]
    theirs = [paper.IMPACT_CHANGE[cell]["drop"] for cell in TITLES]
    c, d = paper.TABLE_5["C"], paper.TABLE_5["D"]
    theirs += [100.0 * (d[q].mean / c[q].mean - 1.0) for q in ("acceleration", "FR", "RL")]
    return TextTable(
        title="Falling mass on devices that slide at a torque, changes against none [%]",
        head=["sliding torque [N·m]", "minimum height", "peak speed", "|a_z - g|", "FR", "RL"],
        rows=[["paper, hardware", *(f"{value:+.1f}" for value in theirs)], *rows],
        id="bound",
    )


def _plot(found: Pushes, dropped: Drops, job: Job) -> None:
    figure, (axes,) = panels((11, 4.8), 1, 2)
    x = list(CURRENT_GROUPS)
    for axis, (cell, (title, unit, _)) in zip(axes, TITLES.items(), strict=True):
        for k, result in enumerate(found.results):
            style: dict[str, Any] = {"color": "0.8", "linewidth": 1.0, "zorder": 1}
            if result.reading in (LITERAL, JOINT):
                color = "#1f6fb4" if result.reading == LITERAL else "#2f7d4f"
                style = {"color": color, "linewidth": 2.0, "zorder": 2, "label": f"push, {result.reading.name}"}
            elif k == 2:
                style["label"] = "push, other readings"
            axis.plot(x, [result.row(cell, amps).mean() for amps in x], **style)
        for drop, color in zip(drop_trials.COLUMNS, (COLORS[2], COLORS[5]), strict=True):
            ours = [over_seeds(row, dropped.seeds()) for row in dropped.figures[drop.name][cell]]
            means, sds = [o["ours"] for o in ours], [o["sd"] or 0.0 for o in ours]
            axis.errorbar(x, means, sds, color=color, linestyle="--", capsize=3, label=f"drop, {drop.name}")
        for source, marker, color in (("simulation", "s", "black"), ("hardware", "o", COLORS[3])):
            theirs = [paper.TABLE_4[source][amps][cell] for amps in x]
            means, sds = [v.mean for v in theirs], [v.sd for v in theirs]
            axis.errorbar(x, means, sds, fmt=marker, color=color, capsize=3, label=f"paper, {source}")
        axis.set(xlabel="current [A]", ylabel=f"{title} [{unit}]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="outside lower center", ncols=4)
    figure.savefig(job.out / "table4.png", dpi=110)


PUSHED, DROPPED = f"push, {{}}{SHORT.column}", "drop of 10 kg, {}"
"""Conditions of rows with the paper's torque."""

AMPS = ("0 A", "0.5 A", "1 A", "1.5 A")


def _effect(quantity: str) -> Measure:
    """Change by each current against 0 A with the paper's torque."""
    return rows("table4", f"change of {quantity}", *(f"{a} A against 0 A{SHORT.column}" for a in ("0.5", "1", "1.5")))


EXPERIMENTS = (Experiment(name="table4", compute=compute, needs=("pushes", "drops")),)

CLAIMS = (
    Claim(
        id="push.damping/height",
        place="Table 4, simulation",
        says=f"minimum height, 0 to 1.5 A, push of {DERIVED:g} s [m]",
        measure=rows("table4", "minimum height", *(PUSHED.format(amps) for amps in AMPS)),
        why="Ours falls less deep.",
    ),
    Claim(
        id="push.damping/speed",
        place="Table 4, simulation",
        says="peak downward velocity, same order [m/s]",
        measure=rows("table4", "peak downward velocity", *(PUSHED.format(amps) for amps in AMPS)),
        why="Every step of the current lowers it, by less than the paper's: our robot falls less deep.",
    ),
    *(
        Claim(
            id=f"push.damping/{quantity.split()[-1]}_change",
            place="Table 4, simulation",
            says=f"0.5, 1, 1.5 A against 0 A: {quantity} [%]",
            measure=_effect(quantity),
            effect=True,
            why=why,
        )
        for quantity, why in (
            (
                "minimum height",
                "The paper's rows require eq. 14 with the angle itself and no drag at 0 A; section 4.2 keeps the drag.",
            ),
            (
                "peak downward velocity",
                "With the angle itself and no drag at 0 A the first 0.5 A have most of the effect in ours, too.",
            ),
        )
    ),
    Claim(
        id="drop.damping/height",
        place="Table 4, hardware",
        says="0 to 1.5 A: minimum height [%]",
        measure=change("table4", "minimum height", (DROPPED.format("0 A"), DROPPED.format("1.5 A")), paired=True),
        effect=True,
        why="It would take more than ten times eq. 14's torque: see the bound below table 4.",
    ),
    Claim(
        id="drop.damping/speed",
        place="Table 4, hardware",
        says="0 to 1.5 A: peak downward velocity [%]",
        measure=change(
            "table4",
            "peak downward velocity",
            (DROPPED.format("0 A"), DROPPED.format("1.5 A")),
            paired=True,
            absolute=True,
        ),
        effect=True,
        why="A brake that holds takes as much as the hardware; eq. 19 as it stands does not.",
    ),
)
