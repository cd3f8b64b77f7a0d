"""Table 5: the falling mass on robots with conventional and actuator-aware policies, SAL off and on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mrwarp import paper
from mrwarp.actuator.mr_actuator import HoldCurrent
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.reproduce import drops, readings, studied
from mrwarp.reproduce.ensemble import Ensemble
from mrwarp.reproduce.experiment import Comparison, Experiment, Findings, Job, over_seeds, seeds_of
from mrwarp.study.plan import AWARE, CONVENTIONAL
from mrwarp.trials.impact import ImpactCfg, ImpactKind, ImpactSweep, Variant

CONFIGURATIONS = {
    "A": (CONVENTIONAL, 0.0),
    "B": (CONVENTIONAL, 1.5),
    "C": (AWARE, 0.0),
    "D": (AWARE, 1.5),
}
"""Training and current of table 2's configurations; 0 A is SAL off."""

TITLES = {
    "acceleration": ("mean |a_z - g|", "m/s^2"), "FR": ("FR calf motor torque", "N·m"),
    "RL": ("RL calf motor torque", "N·m"),
}  # fmt: skip
"""Columns and their units."""


def compute(job: Job) -> Findings:
    """Means over 0.1 s from the contact on."""
    settings, rows = job.settings, []
    env = make_walk_cfg(hold_current=HoldCurrent.FIXED, threads=settings.threads)
    env = replace(env, actuator=replace(env.actuator, holding=False))
    currents = sorted({current for _, current in CONFIGURATIONS.values()})
    found: dict[tuple[str, float], dict[str, np.ndarray]] = {}
    seeds: np.ndarray | None = None
    for k, training in enumerate(dict.fromkeys(name for name, _ in CONFIGURATIONS.values())):
        job.report(training, k / 2.0)
        paths = studied.policies((training,))
        cfg = ImpactCfg(
            kind=ImpactKind.DROP, trials=len(paths) * settings.impacts, env=env, seed=settings.seed,
            phases=readings.FR_RL_STANCE,
            variants=tuple(Variant(current=current) for current in currents),
        )  # fmt: skip
        figures = drops.measured(ImpactSweep(cfg, Ensemble(paths)).run())
        seeds = seeds_of(np.arange(cfg.trials), len(paths))
        for i, current in enumerate(currents):
            found[training, current] = {name: values[i] for name, values in figures.items()}
    for name, cell in CONFIGURATIONS.items():
        for quantity, (title, unit) in TITLES.items():
            rows.append(
                Comparison(condition=f"{name}: {cell[0]}, SAL {'on' if cell[1] else 'off'}", quantity=title, unit=unit,
                    paper=paper.TABLE_5[name][quantity], **over_seeds(found[cell][quantity], seeds),
                    why=_why(found, cell, quantity))
            )  # fmt: skip

    def lower(quantity: str, first: str, second: str) -> bool:
        values = [found[CONFIGURATIONS[name]][quantity].mean() for name in (first, second)]
        return bool(values[1] < values[0])

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


def _why(found: dict[tuple[str, float], dict[str, np.ndarray]], cell: tuple[str, float], quantity: str) -> str:
    on, off = (found[cell[0], current][quantity].mean() for current in (1.5, 0.0))
    named = {value: name for name, value in CONFIGURATIONS.items()}
    theirs = [paper.TABLE_5[named[cell[0], current]][quantity].mean for current in (1.5, 0.0)]
    ours, hardware = on / off - 1.0, theirs[0] / theirs[1] - 1.0
    return (
        f"SAL changes it by {100.0 * ours:+.1f} % here and by {100.0 * hardware:+.1f} % on hardware, whose mass "
        "and sensors differ."
    )


EXPERIMENT = Experiment(
    name="table5", compute=compute,
    settings=("impacts", "seed"), files=lambda settings: studied.policies((CONVENTIONAL, AWARE)),
)  # fmt: skip
