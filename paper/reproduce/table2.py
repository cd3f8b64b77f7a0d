"""Table 2: what training with the device in the loop changes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from mrwarp import paper
from mrwarp.enums import Coupling
from mrwarp.paper import PaperValue
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import BRAKE, Comparison, Findings, compare, identified
from paper.reproduce.settings import (
    TRAININGS,
    networks,
    rollouts_time,
    study_files,
)
from paper.reproduce.verdicts import Claim, change, rows
from paper.study import paper_tables
from paper.study.paper_tables import LEAST, Change, PolicyRow, Table2, Table3
from paper.study.plan import BRAKE as BRAKE_POLICIES
from paper.study.rollouts import PLANT, EvaluationCfg

METRICS = {
    "v_x_rmse": ("v_x RMSE", "m/s", 4),
    "v_x_bias": ("v_x bias", "m/s", 4),
    "height": ("mean CoM height", "m", 4),
    "height_rmse": ("CoM-z RMSE", "m", 4),
    "tilt_rms": ("roll-pitch RMS", "deg", 3),
    "yaw_rate_rmse": ("yaw-rate RMSE", "rad/s", 4),
}
"""Title, unit and digits of the study's metrics."""


PARTNER = {"A": "C", "B": "D", "C": "A", "D": "B"}
"""Of table 2's configurations: the one with the other training."""


TRAINED = {
    "A": "A: conventional, SAL off",
    "B": "B: conventional, SAL on",
    "C": "C: pg_rlstm, SAL off",
    "D": "D: pg_rlstm, SAL on",
}
"""Configurations of tables 2 and 5, as their rows call them."""


def table2(job: Job) -> Findings:
    """Configurations A to D over the training seeds, and what the training lowers.

    By the paper's explicit torque, in training and evaluation; then by the brake constraint, in both.
    """
    table, brake = (
        paper_tables.table2(cfg, report=lambda share, k=k: job.report("rollouts", 0.5 * (k + share)))
        for k, cfg in enumerate(both(job))
    )
    rows = [
        row
        for table_of, suffix in ((table, ""), (brake, BRAKE))
        for name, found in table_of.rows.items()
        for row in metric_rows(
            f"{name}: {found.plant}, SAL {'on' if found.current else 'off'}{suffix}",
            found,
            paper.TABLE_2[name],
            lambda metric, name=name, table=table_of: _why_trained(table, name, metric),
        )
    ]
    changes = {(name, sal): change for name in ("rmse", "bias") for sal, change in getattr(table, name).items()}
    return Findings(
        rows=rows,
        **identified(
            *(
                (
                    f"training_lowers_{name}_{sal}",
                    f"actuator-aware training lowers the v_x {name} by at least {100.0 * LEAST[name]:.0f} %, SAL {sal}",
                    change.reduction >= LEAST[name],
                )
                for (name, sal), change in changes.items()
            )
        ),
        notes=[
            *(_said(name, sal, change) for (name, sal), change in changes.items()),
            *(f"SAL {sal}: {limit}." for sal, limit in table.limits().items()),
            fell(table),
            "As a brake that sticks:",
            *(_said(name, sal, found) for name in ("rmse", "bias") for sal, found in getattr(brake, name).items()),
            fell(brake),
        ],
    )  # fmt: skip


def metric_rows(
    condition: str, found: PolicyRow, theirs: Mapping[str, PaperValue], why: Callable[[str], str]
) -> list[Comparison]:
    """A row for each metric of the study that the paper gives; ``why`` says for a metric why they differ."""
    rows = []
    for metric in (metric for metric in METRICS if metric in theirs):
        spread, n = found.spread(metric), len(found.seeds[metric])
        ours = {"ours": spread["mean"], "sd": spread["sd"], "n": n}
        rows.append(compare(condition, METRICS[metric], theirs[metric], ours, why(metric)))
    return rows


def both(job: Job) -> tuple[EvaluationCfg, EvaluationCfg]:
    """How policies are rolled out: with the paper's explicit torque, and with the brake constraint."""
    settings = job.settings
    literal = EvaluationCfg(rollouts=settings.rollouts, seed=settings.seed, threads=settings.threads)
    return literal, replace(literal, folder=BRAKE_POLICIES, coupling=Coupling.CONSTRAINT)


def fell(table: Table2 | Table3) -> str:
    """How many rollouts ended in a fall, a sentence."""
    return f"{sum(row.fell for row in table.rows.values())} of all rollouts fell."


def _said(name: str, sal: str, change: Change) -> str:
    low, high = change.interval
    what = "RMSE" if name == "rmse" else "absolute bias"
    unsigned = f"; averaged over seeds without sign {-100.0 * change.by_seed:+.0f} %" if name == "bias" else ""
    return (
        f"v_x {what}, SAL {sal}: {change.first:.4f} to {change.second:.4f} m/s, {-100.0 * change.reduction:+.0f} % "
        f"(95 % interval of the difference over seeds {low:+.4f} to {high:+.4f} m/s, p = {change.p:.2g}){unsigned}."
    )


def _why_trained(table: Table2, name: str, metric: str) -> str:
    names = name, PARTNER[name]
    ours = [table.rows[n].spread(metric)["mean"] for n in names]
    theirs = [paper.TABLE_2[n][metric].mean for n in names]
    return (
        "Rewards, gains and training length are not the paper's, so levels differ; against the other training "
        f"({PARTNER[name]}) ours is {ours[0] - ours[1]:+.4f}, the paper's {theirs[0] - theirs[1]:+.4f}."
    )


EXPERIMENTS = (
    Experiment(
        name="table2",
        compute=table2,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(TRAININGS), *study_files(TRAININGS, folder=BRAKE_POLICIES), *networks((PLANT,))],
        seconds=rollouts_time,
    ),
)

CLAIMS = (
    Claim(
        id="training.tracking/rmse",
        place="Table 2",
        says="v_x RMSE of A, B, C, D [m/s]",
        measure=rows("table2", "v_x RMSE", *TRAINED.values()),
        why="Ours track more closely. Under eq. 19 row B equals row A by construction; only with a brake they differ.",
    ),
    Claim(
        id="training.tracking/change",
        place="Table 2",
        says="actuator-aware training lowers v_x RMSE, SAL off, on [%]",
        measure=change("table2", "v_x RMSE", (TRAINED["A"], TRAINED["C"]), (TRAINED["B"], TRAINED["D"])),
        effect=True,
        why="The gain is the bias that training on the heavier robot takes away; with a brake SAL on gives 92 %.",
    ),
    Claim(
        id="training.bias",
        place="Table 2",
        says="v_x bias of A, B, C, D [m/s]",
        measure=rows("table2", "v_x bias", *TRAINED.values()),
        why="The devices' mass and drag slow a policy down that does not know them; the paper's policies run too fast.",
    ),
    Claim(
        id="training.height",
        place="Table 2",
        says="mean height higher by actuator-aware training, SAL off, on [%]",
        measure=change("table2", "mean CoM height", (TRAINED["A"], TRAINED["C"]), (TRAINED["B"], TRAINED["D"])),
        effect=True,
        why="A percent, within the spread of our seeds.",
    ),
)
