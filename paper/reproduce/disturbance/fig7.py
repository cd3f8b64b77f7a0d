"""Figure 7: motor torque under the falling mass."""

from __future__ import annotations

import numpy as np
from matplotlib.lines import Line2D

from mrwarp import paper
from mrwarp.runtime import drawing, panels
from mrwarp.trials.walk_pictures import PAPER_MARK
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS
from mrwarp.viewing.robot_pictures import COLORS
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Findings, compare
from paper.reproduce.disturbance import drop_trials
from paper.reproduce.disturbance.drop_trials import COLUMNS, DROPS
from paper.reproduce.settings import over_seeds
from paper.reproduce.verdicts import Claim, change

TORQUE = ("calf motor torque", "N·m", 2)
"""Quantity, unit and digits."""


def fig7(job: Job) -> Findings:
    """Mean calf motor torque over 0.1 s of the falling mass; the paper hit FR and RL in stance, and states those."""
    dropped = drop_trials.read(job)
    found, seeds = dropped.figures, dropped.seeds()
    rows, lower = [], {}
    for drop in DROPS:
        values = found[drop.name]
        for leg, theirs in paper.FIGURE_7.items():
            fall = np.nanmean(values[leg][-1]) / np.nanmean(values[leg][0]) - 1.0
            lower.setdefault(drop.column, []).append(bool(fall < 0.0))
            hardware = theirs[1.5].mean / theirs[0.0].mean - 1.0
            why = (
                "The gains behind the hardware's torques are not stated; current changes ours by "
                f"{100.0 * fall:+.1f} %, the paper's by {100.0 * hardware:+.1f} %."
            )
            for amps, cell in theirs.items():
                ours = over_seeds(values[leg][CURRENT_GROUPS.index(amps)], seeds)
                rows.append(compare(f"{leg}, {amps:g} A{drop.column}", TORQUE, cell, ours, why))
    with drawing("torque.png"):
        _plot_drop({drop.name: found[drop.name] for drop in COLUMNS}, seeds, job)
    return Findings(
        rows=rows,
        claims={f"1.5 A lower the torque of FR and RL{column}": all(each) for column, each in lower.items()},
        notes=drop_trials.lost(found.values()),
        pictures={
            "torque.png": "Mean calf motor torque over 0.1 s by leg and current; diamonds: the paper's FR and RL"
        },
    )


def _plot_drop(found: dict[str, dict[str, np.ndarray]], seeds: np.ndarray | None, job: Job) -> None:
    figure, (axes,) = panels((11, 4.2), 1, len(found), grid="y", sharey=True)
    width = 0.8 / len(CURRENT_GROUPS)
    for axis, (name, values) in zip(axes, found.items(), strict=True):
        for i, amps in enumerate(CURRENT_GROUPS):
            x = np.arange(len(LEGS)) + (i - 1.5) * width
            ours = [over_seeds(values[leg][i], seeds) for leg in LEGS]
            axis.bar(
                x,
                [o["ours"] for o in ours],
                width,
                color=COLORS[i],
                label=f"{amps:g} A",
                yerr=[o["sd"] or 0.0 for o in ours],
                capsize=2,
            )
            for leg, theirs in paper.FIGURE_7.items():
                if amps in theirs:
                    place = x[LEGS.index(leg)] + 0.25 * width
                    axis.errorbar(place, theirs[amps].mean, theirs[amps].sd, capsize=2, **PAPER_MARK)
        axis.set_xticks(range(len(LEGS)), LEGS)
        axis.set_title(name, fontsize=9)
    axes[0].set_ylabel("mean |calf motor torque| over 0.1 s [N·m]")
    handles, labels = axes[0].get_legend_handles_labels()
    handles, labels = [*handles, Line2D([], [], **PAPER_MARK)], [*labels, "paper, FR and RL"]
    figure.legend(handles, labels, loc="outside upper center", ncols=len(labels), fontsize=8)
    figure.savefig(job.out / "torque.png", dpi=110)


EXPERIMENTS = (Experiment(name="fig7", compute=fig7, needs=("drops",)),)

CLAIMS = (
    Claim(
        id="drop.motor_torque",
        place="Figure 7",
        says="0 to 1.5 A: mean motor torque over 0.1 s, FR, RL [%]",
        measure=change(
            "fig7", "calf motor torque", *((f"{leg}, 0 A", f"{leg}, 1.5 A") for leg in ("FR", "RL")), paired=True
        ),
        effect=True,
        why="Half of the paper's or less, within its wide spread. At least half of ours is by holding, not damping.",
    ),
)
