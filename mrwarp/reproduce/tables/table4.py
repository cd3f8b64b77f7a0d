"""Table 4: minimum height and peak downward velocity over the current, pushed (simulation) and hit (hardware)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mrwarp import paper
from mrwarp.params import BoucWenParams
from mrwarp.reproduce import drops, pushes, readings
from mrwarp.reproduce.experiment import Comparison, Experiment, Findings, Job, TextTable, over_seeds
from mrwarp.usd.robot import CURRENT_GROUPS
from mrwarp.viewing.impact_pictures import COLORS

TITLES = {"min_height": ("minimum height", "m"), "peak_down_velocity": ("peak downward velocity", "m/s")}
"""Columns of the table and their units."""

WANTED = 0.05
"""Largest relative difference of a predicted simulation cell that counts as reproduced."""


def compute(job: Job) -> Findings:
    """The adopted reading's rows, the drop's rows, and what every other reading gives."""
    found = pushes.read(job.folders["pushes"])
    place = found.place(readings.ADOPTED)
    cells, summary = found.cells[place], found.readings[place]
    rows = []
    for i, amps in enumerate(CURRENT_GROUPS):
        for cell, (title, unit) in TITLES.items():
            rows.append(
                Comparison(condition=f"push, {amps:g} A", quantity=title, unit=unit, digits=4,
                    paper=paper.TABLE_4["simulation"][amps][cell], **over_seeds(cells[cell][i], found.seeds()),
                    calibrated=amps == 0.0, why=_why(found, cell, amps))
            )  # fmt: skip
    dropped, seeds = drops.read(job.folders["drops"])
    for name, values in dropped.items():
        for i, amps in enumerate(CURRENT_GROUPS):
            for cell, (title, unit) in TITLES.items():
                rows.append(
                    Comparison(condition=f"drop of 10 kg, {amps:g} A, {name}", quantity=title, unit=unit, digits=4,
                        paper=paper.TABLE_4["hardware"][amps][cell], **over_seeds(values[cell][i], seeds),
                        why=_drop(values, cell))
                )  # fmt: skip
    _plot(found, dropped, seeds, job)
    within = [abs(value) <= WANTED for value in readings.predicted_off(summary)]
    return Findings(
        rows=rows,
        claims={
            f"the six predicted simulation cells lie within {100.0 * WANTED:.0f} % ({sum(within)} do)": all(within),
            "height rises and speed falls with every step of the current": summary["monotone"],
            f"of the {len(readings.CANDIDATES)} readings with eq. 14, the adopted one's 0 A row is nearest": (
                _by_level(found)[0]["reading"] == readings.ADOPTED.name
            ),
        },
        notes=[
            f"Adopted reading: {summary['reading']}. Push of {summary['duration']:.2f} s. Duration and gains, which "
            "the paper does not state, are chosen by the 0 A row alone; the largest difference of the six predicted "
            f"cells is {100.0 * summary['worst']:.1f} %. Policies walk with the gains that they were trained with, Kp "
            "20 and Kd 0.5, or near them; with the asset's Kp of 35 the calibrated push lowers the trunk to "
            f"{found.readings[found.place(readings.ASSET)]['min_height'][0]:.3f} m on average.",
            _level(found),
            _off(found, summary),
            _shape(found, place),
            _causes(found),
            _nearest(found),
            *_upright(found, place),
            *drops.lost(dropped.values()),
        ],
        tables=[table(found)],
        pictures={"table4.png": "Both figures over the current: ours (lines), the paper's (marks)"},
        figures={"readings": found.readings},
    )  # fmt: skip


def table(found: pushes.Pushes) -> TextTable:
    """Every reading's cells beside the paper's."""
    theirs = paper.TABLE_4["simulation"]

    def line(name: str, duration: str, heights: list[float], speeds: list[float], rest: list[str]) -> list[str]:
        return [name, duration, *(f"{h:.4f}" for h in heights), *(f"{v:.3f}" for v in speeds), *rest]

    head = ["reading", "push [s]", *(f"z {amps:g} A" for amps in CURRENT_GROUPS),
            *(f"v {amps:g} A" for amps in CURRENT_GROUPS), "z change", "v change", "worst", "monotone"]  # fmt: skip
    rows = [
        line("paper", "not stated", [theirs[a]["min_height"].mean for a in CURRENT_GROUPS],
             [theirs[a]["peak_down_velocity"].mean for a in CURRENT_GROUPS],
             [*(f"{paper.IMPACT_CHANGE[cell]['push']:+.1f} %" for cell in TITLES), "", "yes"])
    ]  # fmt: skip
    for entry in found.readings:
        change = entry["change"]
        rest = [f"{100.0 * change[cell]:+.1f} %" for cell in TITLES]
        rest += [f"{100.0 * entry['worst']:.0f} %", "yes" if entry["monotone"] else "no"]
        rows.append(
            line(entry["reading"], f"{entry['duration']:.2f}", entry["min_height"], entry["peak_down_velocity"], rest)
        )
    return TextTable(
        title="Readings of the simulated push: z [m], v [m/s]; durations calibrated on 0 A; worst of six predictions",
        head=head, rows=rows,
    )  # fmt: skip


def _by_level(found: pushes.Pushes) -> list[dict[str, Any]]:
    """The readings that the adopted one was chosen among, the one with the nearest 0 A row first."""
    names = {reading.name for reading in readings.CANDIDATES}
    return sorted((entry for entry in found.readings if entry["reading"] in names), key=readings.off_mismatch)


def _level(found: pushes.Pushes) -> str:
    """How near the 0 A rows are that the adopted reading was chosen by."""
    parts = [
        f"'{entry['reading']}' is off by "
        + " and ".join(f"{100.0 * value:+.1f} % ({title})"
                       for value, (title, _) in zip(entry["off_mismatch"], TITLES.values(), strict=True))
        for entry in _by_level(found)[:2]
    ]  # fmt: skip
    legs = " and ".join(readings.stance_legs(readings.ADOPTED.phases))
    return (
        f"Of the readings with eq. 14 these two have the nearest 0 A rows: {'; '.join(parts)}. Those with another "
        f"torque were not to choose from. The adopted one pushes while {legs} stand; the paper's figure 6(b) shows "
        f"{' and '.join(paper.FIGURE_6_PUSH)} loaded."
    )


def _upright(found: pushes.Pushes, place: int) -> list[str]:
    """What fell in the adopted reading, and how far off the cells are without; nothing if nothing fell."""
    down = np.any(found.trace["fell"], axis=0)
    if not down.any() or down.all():
        return readings.fallen(found.trace["fell"], "pushes")
    off = readings.predicted_off({cell: found.cells[place][cell][:, ~down].mean(axis=1) for cell in TITLES})
    return [
        f"{readings.fallen(found.trace['fell'], 'pushes')[0]} Without the {down.sum()} of {down.size} trials that fell "
        f"at some current, with the same push, {sum(abs(value) <= WANTED for value in off)} of the six predicted cells "
        f"lie within {100.0 * WANTED:.0f} %, and the largest difference is {100.0 * max(map(abs, off)):.1f} %."
    ]


def _why(found: pushes.Pushes, cell: str, amps: float) -> str:
    """What of the difference stands at 0 A already, and what the current leaves over."""
    entry = found.readings[found.place(readings.ADOPTED)]
    theirs, i = paper.TABLE_4["simulation"], CURRENT_GROUPS.index(amps)
    ours = np.array(entry[cell])
    off = ours[0] / theirs[0.0][cell].mean - 1.0
    if i == 0:
        return (
            f"Duration and gains are the least-squares compromise of both cells of this row, {100.0 * off:+.1f} % off "
            "here."
        )
    gain = ours[i] / ours[0] - 1.0
    wanted = theirs[amps][cell].mean / theirs[0.0][cell].mean - 1.0
    return (
        f"{100.0 * off:+.1f} % stand at 0 A already; the current changes it by {100.0 * gain:+.1f} %, in the paper by "
        f"{100.0 * wanted:+.1f} %."
    )


def _drop(values: dict[str, np.ndarray], cell: str) -> str:
    change = values[cell][-1].mean() / values[cell][0].mean() - 1.0
    theirs = paper.TABLE_4["hardware"]
    wanted = theirs[1.5][cell].mean / theirs[0.0][cell].mean - 1.0
    return (
        f"From 0 to 1.5 A ours changes by {100.0 * change:+.1f} %, the hardware by {100.0 * wanted:+.1f} %; the "
        "readings show what torque the device would need."
    )


def _off(found: pushes.Pushes, summary: dict[str, Any]) -> str:
    """What the paper's own 0 A row implies."""
    theirs = paper.TABLE_4["simulation"][0.0]
    drop = paper.TABLE_2["D"]["height"].mean - theirs["min_height"].mean
    bound, speed = readings.undamped_speed(drop), -theirs["peak_down_velocity"].mean
    stiff, little = (
        -found.readings[found.place(reading)]["peak_down_velocity"][0] for reading in (readings.BASE, readings.UNDAMPED)
    )
    return (
        f"The paper's 0 A row is nearly that of an undamped spring: pressed down by {drop:.3f} m with a lasting 100 N, "
        f"{paper.MASS['mr_go']:g} kg reach at most sqrt(F drop/2m) = {bound:.3f} m/s; the paper has {speed:.3f} m/s. "
        f"Motors with Kp 20, a Kd of 0.5 and the device's off-current drag leave {stiff:.3f} m/s here, a Kd of 0.1 "
        f"{little:.3f} m/s, and the adopted reading {-summary['peak_down_velocity'][0]:.3f} m/s."
    )


def _shape(found: pushes.Pushes, place: int) -> str:
    """What is left when the level at 0 A is the paper's: the effect of the current."""
    entry, theirs = found.readings[place], paper.TABLE_4["simulation"]
    parts = [
        f"{title} {100.0 * entry['change'][cell]:+.1f} % (the paper "
        f"{100.0 * (theirs[1.5][cell].mean / theirs[0.0][cell].mean - 1.0):+.1f} %)"
        for cell, (title, _) in TITLES.items()
    ]
    free = next(e for e in found.readings if e["reading"] == readings.UNWEAKENED.name)
    return (
        f"From 0 to 1.5 A: {', '.join(parts)}. Eq. 14 divides its torque by 1 + {BoucWenParams().alpha:.2f} |qd|; "
        f"without that the changes are {100.0 * free['change']['min_height']:+.1f} and "
        f"{100.0 * free['change']['peak_down_velocity']:+.1f} %, and the largest difference of the six cells "
        f"{100.0 * free['worst']:.1f} %."
    )


def _nearest(found: pushes.Pushes) -> str:
    """The reading with the smallest worst prediction, which is chosen by its result and therefore no prediction."""
    best = min(found.readings, key=lambda entry: entry["worst"])
    return (
        f"Of all readings '{best['reading']}' comes nearest (worst cell {100.0 * best['worst']:.1f} % off, height "
        f"{100.0 * best['change']['min_height']:+.1f} %, speed {100.0 * best['change']['peak_down_velocity']:+.1f} %); "
        "being chosen by its result, it predicts nothing."
    )


def _causes(found: pushes.Pushes) -> str:
    """Which choice moves the effect of 1.5 A by how much, largest first."""
    base = found.readings[found.place(readings.BASE)]["change"]
    moved = sorted(
        ((entry["reading"], {cell: entry["change"][cell] - base[cell] for cell in TITLES}) for entry in found.readings),
        key=lambda item: -abs(item[1]["min_height"]),
    )
    text = "; ".join(
        f"{name}: {100.0 * by['min_height']:+.1f} and {100.0 * by['peak_down_velocity']:+.1f} points"
        for name, by in moved[:5]
    )
    return (
        f"The base reading's 1.5 A change height by {100.0 * base['min_height']:+.1f} % and speed by "
        f"{100.0 * base['peak_down_velocity']:+.1f} %. What moves these most: {text}."
    )


def _plot(found: pushes.Pushes, dropped: dict[str, dict[str, np.ndarray]], seeds: np.ndarray | None, job: Job) -> None:
    figure = Figure(figsize=(11, 4.8), layout="constrained")
    axes = figure.subplots(1, 2)
    x = list(CURRENT_GROUPS)
    for axis, (cell, (title, unit)) in zip(axes, TITLES.items(), strict=True):
        for k, entry in enumerate(found.readings):
            adopted = entry["reading"] == readings.ADOPTED.name
            axis.plot(x, entry[cell], color="#1f6fb4" if adopted else "0.8", linewidth=2.5 if adopted else 1.0,
                      zorder=2 if adopted else 1,
                      label="push, adopted" if adopted else "push, other readings" if k == len(found.readings) - 1
                      else None)  # fmt: skip
        for (name, values), color in zip(dropped.items(), (COLORS[2], COLORS[5]), strict=True):
            ours = [over_seeds(row, seeds) for row in values[cell]]
            axis.errorbar(x, [o["ours"] for o in ours], [o["sd"] or 0.0 for o in ours], color=color, linestyle="--",
                          capsize=3, label=f"drop, {name}")  # fmt: skip
        for source, marker, color in (("simulation", "s", "black"), ("hardware", "o", COLORS[3])):
            theirs = [paper.TABLE_4[source][amps][cell] for amps in x]
            axis.errorbar(x, [v.mean for v in theirs], [v.sd for v in theirs], fmt=marker, color=color, capsize=3,
                          label=f"paper, {source}")  # fmt: skip
        axis.set(xlabel="current [A]", ylabel=f"{title} [{unit}]")
        axis.grid(alpha=0.3)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=8, loc="outside lower center", ncols=6)
    figure.savefig(job.out / "table4.png", dpi=110)


EXPERIMENT = Experiment(name="table4", compute=compute, needs=("pushes", "drops"))
