"""Options of ``mrwarp reproduce``, its training of figure 4's models, and ``mrwarp sweep``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional

from mrwarp.options import option_types as opt

TITLES = {
    "fig4": "Figure 4: torque prediction",
    "fig5": "Figure 5: learning curves",
    "table2": "Table 2: actuator-aware training",
    "table3": "Table 3: actuator models in training",
    "table4": "Table 4: disturbance response",
    "sensitivity": "Section 3.2: sensitivity to the gates' thresholds",
    "fig6": "Figure 6: motor torque during the push",
    "fig7": "Figure 7: motor torque under the falling mass",
    "table5": "Table 5: training and SAL under the falling mass",
    "table6": "Table 6: cost of transport",
    "table7": "Table 7: support activation",
    "electrical": "Sensitivity of table 6 to the electrical numbers",
    "fig8": "Figure 8: stance support and torque relief",
    "fig9": "Figure 9: cost of transport",
    "fig10": "Figure 10: power and state of charge of the mission",
    "fig11": "Figure 11: temperatures of the mission",
}
"""Heading of each entry of the report in the paper's order, by its name on the command line; ``all`` means these."""

Policies = Annotated[tuple[Path, ...] | None, opt.some(Path, "P")]


@dataclass(frozen=True, kw_only=True)
class Reproduce:  # noqa: D101  (its docstring lists the titles)
    __doc__ = (
        "Tables and figures of the paper with our row beside each, as report.html and report.md.\n\n"
        + "\n".join(f"- {name}: {title}" for name, title in TITLES.items())
        + "\n\nOnly what changed since the last run into the same folder is made again. 'mrwarp reproduce fig4 "
        "--train' trains figure 4's models anew and has options of its own."
    )

    part: Positional[Annotated[tuple[str, ...], opt.some(str, "PART", (*TITLES, "all"))]]
    """tables and figures, or all"""
    out: opt.Folder = Path("runs/report")
    """output folder"""
    policy: Policies = None
    """policies of all robots, one per training seed"""
    policy_go1: Policies = None
    """of go1's walks alone"""
    policy_mr_go: Policies = None
    """of mr_go's walks alone"""
    policy_mr_go_sal: Policies = None
    """of mr_go_sal's walks alone"""
    policy_impacted: Policies = None
    """of pushes and falling masses alone, trained with the public gains (default: public_gains of the studies)"""
    policy_aware: Policies = None
    """of those with the asset's gains, and of walks without a price on power (default: the aware ones of table 2)"""
    policy_sticking: Policies = None
    """of MR_Go-SAL's walks on devices that stick (default: those trained with them)"""
    rollouts: opt.Count = 3
    """walks per policy and condition"""
    impacts: opt.Count = 12
    """impacts per policy and current"""
    distance: opt.Positive = 30.0
    """walk of table 6 [m]"""
    window: opt.Positive = 10.0
    """simulated walk of the mission [m]"""
    seed: opt.Seed = 0
    """seed of poses and gait phases"""
    threads: opt.Whole = 0
    """CPU threads; 0 = all, the figures are the same for any number"""


@dataclass(frozen=True, kw_only=True)
class TrainFigure4:
    """Train and evaluate the models of figure 4 at all strengths of the bench's effects."""

    out: opt.Folder
    """output folder; a stopped run goes on there"""
    strengths: Annotated[tuple[float, ...], opt.some(opt.number, "X")] = (1.0, 0.5, 2.0)
    """factors on the effects"""
    epochs: opt.Count = 80
    """most epochs per network"""
    windows_per_epoch: opt.Count = 65_536
    """training windows drawn per epoch"""
    samples: opt.Count = 665_442
    """samples of the fitting data"""
    trajectories: opt.Count = 120
    """trajectories of the fitting data"""
    seed: opt.Seed = 0
    """seed of the bench and of the training"""


@dataclass(frozen=True, kw_only=True)
class Sweep:
    """Run a command for every combination of a grid of its options.

    Each trial has a folder of its own; trials that are finished are not run again, trainings go on from their
    checkpoints. Example: mrwarp sweep --out runs/sweep --command train --grid seed=0,1,2 actuator=bouc_wen,pg_rlstm
    -- --iterations 300 --num-envs 64
    """

    arguments: Positional[Annotated[tuple[str, ...], opt.some(str, "ARGUMENT", least=0)]] = ()
    """after '--': options of the command, the same for all trials"""
    out: opt.Folder
    """output folder; the same call again goes on there"""
    command: Annotated[str, opt.one(str, "NAME")]
    """what to run, e.g. train, walk, impact, fit, diagnose, learn"""
    grid: Annotated[tuple[str, ...], opt.some(str, "OPTION=V,V")]
    """values of the command's options; a value of several words stands in quotes, a flag is on or off"""
    workers: Annotated[int | None, opt.one(opt.count, "N")] = None
    """trials at a time on this machine (default: cores / --cpus)"""
    cpus: opt.Count = 1
    """CPU threads of a trial"""
    gpus: opt.Whole = 0
    """GPUs of a trial, which sees them from cuda:0 on"""
    retries: opt.Whole = 2
    """new starts of a trial that is killed"""
    figure: Annotated[tuple[str, ...], opt.some(str, "NAME")] = ()
    """figures to compare, e.g. gate.v_x_rmse.0.5"""
    runner: Literal["local", "ray"] | None = None
    """local: processes of this machine; ray: Ray's workers (pip install 'mrwarp[sweep]') (default: local)"""
    address: Annotated[str | None, opt.one(str, "A")] = None
    """Ray cluster, e.g. auto or HOST:6379; its nodes must share --out"""
