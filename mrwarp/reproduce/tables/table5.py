"""Table 5: the falling mass on robots with conventional and actuator-aware policies, SAL off and on."""

from __future__ import annotations

import numpy as np

from mrwarp import paper
from mrwarp.reproduce import drops, pushes
from mrwarp.reproduce.experiment import Findings, Job, compare, over_seeds, seeds_of
from mrwarp.reproduce.policies import Ensemble, study_files
from mrwarp.study.plan import AWARE, CONVENTIONAL
from mrwarp.trials.impact import ImpactCfg, ImpactKind, ImpactSweep, Variant, fixed_current_env

CURRENTS = (0.0, 1.5)
"""With SAL off and on [A]."""

CONFIGURATIONS = {"A": (CONVENTIONAL, 0), "B": (CONVENTIONAL, 1), "C": (AWARE, 0), "D": (AWARE, 1)}
"""Training of table 2's configurations, and the place of their current in :data:`CURRENTS`."""

TITLES = {
    "acceleration": ("mean |a_z - g|", "m/s^2", 3),
    "FR": ("FR calf motor torque", "N·m", 3),
    "RL": ("RL calf motor torque", "N·m", 3),
}
"""Columns, their units and digits."""


def compute(job: Job) -> Findings:
    """Means over 0.1 s from the contact on."""
    settings, rows = job.settings, []
    found: dict[str, dict[str, np.ndarray]] = {}
    seeds: np.ndarray | None = None
    for k, training in enumerate((CONVENTIONAL, AWARE)):
        job.report(training, k / 2.0)
        paths = study_files((training,))
        cfg = ImpactCfg(
            kind=ImpactKind.DROP,
            trials=len(paths) * settings.impacts,
            env=fixed_current_env(threads=settings.threads),
            seed=settings.seed,
            phases=pushes.FR_RL_STANCE,
            variants=tuple(Variant(current=current) for current in CURRENTS),
        )
        found[training] = drops.measured(ImpactSweep(cfg, Ensemble(paths)).run())
        seeds = seeds_of(np.arange(cfg.trials), len(paths))
    means = {
        name: {q: found[training][q][sal].mean() for q in TITLES} for name, (training, sal) in CONFIGURATIONS.items()
    }
    for name, (training, sal) in CONFIGURATIONS.items():
        off, on = ("A", "B") if training == CONVENTIONAL else ("C", "D")
        for quantity, shown in TITLES.items():
            ours = means[on][quantity] / means[off][quantity] - 1.0
            hardware = paper.TABLE_5[on][quantity].mean / paper.TABLE_5[off][quantity].mean - 1.0
            condition = f"{name}: {training}, SAL {'on' if sal else 'off'}"
            why = (
                f"SAL changes it by {100.0 * ours:+.1f} % here and by {100.0 * hardware:+.1f} % on hardware, whose "
                "mass and sensors differ."
            )
            figures = over_seeds(found[training][quantity][sal], seeds)
            rows.append(compare(condition, shown, paper.TABLE_5[name][quantity], figures, why))

    def lower(quantity: str, first: str, second: str) -> bool:
        """Whether the second configuration lowers a quantity."""
        return bool(means[second][quantity] < means[first][quantity])

    return Findings(
        rows=rows,
        claims={
            "with SAL on, actuator-aware training lowers |a_z - g| (B to D)": lower("acceleration", "B", "D"),
            "and both motors' torque": lower("FR", "B", "D") and lower("RL", "B", "D"),
            "SAL lowers |a_z - g| of both": all(lower("acceleration", *pair) for pair in ("AB", "CD")),
        },
        notes=[
            "The paper's rows are hardware's: an estimate from its sensors, ours the simulated trunk's motion.",
            *drops.lost(found.values()),
        ],
    )
