"""Table 3: which torque model a training needs."""

from __future__ import annotations

from mrwarp import paper
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import BRAKE, Findings, TextTable, identified
from paper.reproduce.settings import (
    PLANT_TITLES,
    networks,
    rollouts_time,
    study_files,
)
from paper.reproduce.table2 import METRICS, both, fell, metric_rows
from paper.reproduce.verdicts import Claim, Measure, rows
from paper.study import paper_tables
from paper.study.paper_tables import Table3
from paper.study.plan import BRAKE as BRAKE_POLICIES
from paper.study.plan import MODELS
from paper.study.rollouts import PLANT

LEVEL = 0.05
"""Holm-corrected p-value below which two models are distinguished."""


def table3(job: Job) -> Findings:
    """Metrics per torque model in training over the seeds; the ranking as found, with its statistical support.

    By the paper's explicit torque, then by the brake constraint, as table 2.
    """
    table, brake = (
        paper_tables.table3(cfg, report=lambda share, k=k: job.report("rollouts", 0.5 * (k + share)))
        for k, cfg in enumerate(both(job))
    )
    titles = PLANT_TITLES
    rows = [
        row
        for of, suffix in ((table, ""), (brake, BRAKE))
        for model, found in of.rows.items()
        for row in metric_rows(
            titles[model] + suffix, found, paper.TABLE_3[model], lambda metric, table=of: _why_model(table, metric)
        )
    ]
    distinct = [pair for pair in table.pairs if pair.p < LEVEL]
    named = "; ".join(
        f"{titles[p.better]} before {titles[p.worse]} in {METRICS[p.metric][0]}, p = {p.p:.2g}" for p in distinct
    )
    ranking = []
    for metric, order in table.ranking.items():
        theirs = sorted(MODELS, key=lambda model, metric=metric: abs(paper.TABLE_3[model][metric].mean))
        ranking.append([METRICS[metric][0], *(" < ".join(titles[model] for model in best) for best in (order, theirs))])
    return Findings(
        rows=rows,
        **identified(
            (
                "pg_rlstm_best",
                "PG-RLSTM is best in every metric",
                all(order[0] == "pg_rlstm" for order in table.ranking.values()),
            ),
            (
                "mlp_worst",
                "MLP is worst in every metric",
                all(order[-1] == "mlp" for order in table.ranking.values()),
            ),
        ),
        notes=[
            f"{len(distinct)} of {len(table.pairs)} pairs of models differ at {100.0 * LEVEL:.0f} % (Welch over seeds, "
            f"Holm within each metric){f': {named}' if named else ''}.",
            fell(table),
        ],
        tables=[TextTable(title="Ranking, best first", head=["metric", "ours", "paper"], rows=ranking)],
    )


def _why_model(table: Table3, metric: str) -> str:
    means = [abs(row.spread(metric)["mean"]) for row in table.rows.values()]
    theirs = [abs(row[metric].mean) for row in paper.TABLE_3.values()]
    return (
        "Rewards, gains and training length are not the paper's; over the four models ours spans "
        f"{min(means):.4f} to {max(means):.4f}, the paper's {min(theirs):.4f} to {max(theirs):.4f}."
    )


def _by_model(quantity: str) -> Measure:
    return rows("table3", quantity, *PLANT_TITLES.values())


EXPERIMENTS = (
    Experiment(
        name="table3",
        compute=table3,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(MODELS), *study_files(MODELS, folder=BRAKE_POLICIES), *networks((PLANT,))],
        seconds=rollouts_time,
    ),
)

CLAIMS = (
    Claim(
        id="models.tracking",
        place="Table 3",
        says="v_x RMSE by MLP, Bouc-Wen, LSTM, PG-RLSTM in training [m/s]",
        measure=_by_model("v_x RMSE"),
        holds=(("table3", "pg_rlstm_best"), ("table3", "mlp_worst")),
        why="Five seeds resolve no difference between two models, in any metric.",
    ),
    Claim(
        id="models.lean",
        place="Table 3",
        says="roll-pitch RMS, same order [deg]",
        measure=_by_model("roll-pitch RMS"),
        why="By symmetric networks and a weight of −100 on the tilt, chosen with this row in view.",
    ),
    Claim(
        id="models.yaw",
        place="Table 3",
        says="yaw-rate RMSE, same order [rad/s]",
        measure=_by_model("yaw-rate RMSE"),
        why="Ours turns less; the paper names neither noise nor randomisation.",
    ),
)
