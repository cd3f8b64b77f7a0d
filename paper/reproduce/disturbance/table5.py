"""Table 5: training and SAL under the falling mass."""

from __future__ import annotations

import numpy as np

from mrwarp import paper
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Findings, compare
from paper.reproduce.disturbance import drop_trials
from paper.reproduce.disturbance.drop_trials import COLUMNS
from paper.reproduce.settings import over_seeds
from paper.reproduce.table2 import TRAINED
from paper.reproduce.verdicts import Claim, Measure, change
from paper.study.plan import AWARE, CONVENTIONAL

CONFIGURATIONS = {"A": (CONVENTIONAL, 0), "B": (CONVENTIONAL, 1), "C": (AWARE, 0), "D": (AWARE, 1)}
"""Training of table 2's configurations, and whether SAL is on."""


STRUCK = {
    "acceleration": ("mean |a_z - g|", "m/s^2", 3),
    "FR": ("FR calf motor torque", "N·m", 3),
    "RL": ("RL calf motor torque", "N·m", 3),
}
"""Columns of table 5, their units and digits."""


def table5(job: Job) -> Findings:
    """The falling mass by training, SAL off and on, both branches: means over 0.1 s from the contact on."""
    dropped = drop_trials.read(job)
    seeds, rows, claims = dropped.trained_seeds(), [], {}
    for drop in COLUMNS:
        found = {training: dropped.struck[f"{training}, {drop.name}"] for training in (CONVENTIONAL, AWARE)}
        means = {
            name: {q: float(np.nanmean(found[training][q][sal])) for q in STRUCK}
            for name, (training, sal) in CONFIGURATIONS.items()
        }
        for name, (training, sal) in CONFIGURATIONS.items():
            off, on = ("A", "B") if training == CONVENTIONAL else ("C", "D")
            for quantity, shown in STRUCK.items():
                ours = means[on][quantity] / means[off][quantity] - 1.0
                hardware = paper.TABLE_5[on][quantity].mean / paper.TABLE_5[off][quantity].mean - 1.0
                why = (
                    f"SAL changes it by {100.0 * ours:+.1f} % here and by {100.0 * hardware:+.1f} % on hardware, whose "
                    "contact and sensors differ."
                )
                condition, figures = f"{name}: {training}, SAL {'on' if sal else 'off'}{drop.column}", found[training]
                figure = over_seeds(figures[quantity][sal], seeds)
                rows.append(compare(condition, shown, paper.TABLE_5[name][quantity], figure, why))
        less = {q: {pair: means[pair[1]][q] < means[pair[0]][q] for pair in ("AB", "CD", "BD")} for q in STRUCK}
        claims |= {
            f"with SAL on, actuator-aware training lowers |a_z - g| (B to D){drop.column}": less["acceleration"]["BD"],
            f"and both motors' torque{drop.column}": less["FR"]["BD"] and less["RL"]["BD"],
            f"SAL lowers |a_z - g| of both{drop.column}": all(less["acceleration"][pair] for pair in ("AB", "CD")),
        }
    return Findings(
        rows=rows,
        claims=claims,
        notes=[
            "The paper's rows are hardware's: an estimate from its sensors, ours the simulated trunk's motion. The "
            f"mass meets the trunk through a pad of {drop_trials.STIFFNESS / 1e3:.1f} kN/m.",
            *drop_trials.lost(dropped.struck.values()),
        ],
    )


EXPERIMENTS = (Experiment(name="table5", compute=table5, needs=("drops",)),)

CLAIMS = (
    Claim(
        id="drop.deceleration/sal",
        place="Table 5",
        says="SAL lowers |a_z - g|, conventional, actuator-aware [%]",
        measure=change(
            "table5", "mean |a_z - g|", (TRAINED["A"], TRAINED["B"]), (TRAINED["C"], TRAINED["D"]), paired=True
        ),
        effect=True,
        why="By eq. 19 holding replaces what the motor gives up and no more; a brake that sticks nearly halves it.",
    ),
    Claim(
        id="drop.deceleration/training",
        place="Table 5",
        says="with SAL on, actuator-aware training lowers |a_z - g|; FR's; RL's motor torque [%]",
        measure=Measure(
            "table5",
            lambda found: [
                figure
                for quantity in ("mean |a_z - g|", "FR calf motor torque", "RL calf motor torque")
                for figure in change("table5", quantity, (TRAINED["B"], TRAINED["D"]))(found)
            ],
        ),
        effect=True,
        why="The policies of a training spread by more than the trainings differ.",
    ),
)
