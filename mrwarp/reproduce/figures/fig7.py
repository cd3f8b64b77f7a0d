"""Figure 7: mean calf motor torque over 0.1 s of the hardware impact, here of the falling mass."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from mrwarp import paper
from mrwarp.reproduce import drops
from mrwarp.reproduce.experiment import Findings, Job, compare, over_seeds
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS
from mrwarp.viewing.robot_pictures import COLORS


def compute(job: Job) -> Findings:
    """Torque of every calf by current; the paper states FR and RL, whose legs it hit in stance."""
    dropped = drops.read(job)
    found, seeds = dropped.figures, dropped.seeds()
    rows = []
    for name, values in found.items():
        for leg, theirs in paper.FIGURE_7.items():
            fall = values[leg][-1].mean() / values[leg][0].mean() - 1.0
            paired = theirs[1.5].mean / theirs[0.0].mean - 1.0
            why = (
                "The gains behind the hardware's torques are not stated; current changes ours by "
                f"{100.0 * fall:+.1f} %, the paper's by {100.0 * paired:+.1f} %."
            )
            for amps, cell in theirs.items():
                ours = over_seeds(values[leg][CURRENT_GROUPS.index(amps)], seeds)
                rows.append(compare(f"{leg}, {amps:g} A, {name}", ("calf motor torque", "N·m", 2), cell, ours, why))
    _plot(found, seeds, job)
    return Findings(
        rows=rows,
        claims={
            "1.5 A lower the torque of FR and RL": all(
                values[leg][-1].mean() < values[leg][0].mean() for values in found.values() for leg in paper.FIGURE_7
            )
        },
        notes=drops.lost(found.values()),
        pictures={"torque.png": "Mean calf motor torque over 0.1 s by leg and current; black: the paper's FR and RL"},
    )


def _plot(found: dict[str, dict[str, np.ndarray]], seeds: np.ndarray | None, job: Job) -> None:
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    axes = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
    width = 0.8 / len(CURRENT_GROUPS)
    for axis, (name, values) in zip(axes, found.items(), strict=True):
        for i, amps in enumerate(CURRENT_GROUPS):
            x = np.arange(len(LEGS)) + (i - 1.5) * width
            ours = [over_seeds(values[leg][i], seeds) for leg in LEGS]
            axis.bar(x, [o["ours"] for o in ours], width, color=COLORS[i], label=f"{amps:g} A",
                     yerr=[o["sd"] or 0.0 for o in ours], capsize=2)  # fmt: skip
            for leg, theirs in paper.FIGURE_7.items():
                if amps in theirs:
                    axis.errorbar(x[LEGS.index(leg)], theirs[amps].mean, theirs[amps].sd, color="black", marker="_",
                                  markersize=14, capsize=3)  # fmt: skip
        axis.set_xticks(range(len(LEGS)), LEGS)
        axis.set_title(name, fontsize=9)
        axis.grid(axis="y", alpha=0.3)
        axis.set_axisbelow(True)
    axes[0].set_ylabel("mean |calf motor torque| over 0.1 s [N·m]")
    axes[0].legend(fontsize=8)
    figure.savefig(job.out / "torque.png", dpi=110)
