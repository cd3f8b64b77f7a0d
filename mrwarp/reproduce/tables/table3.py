"""Table 3: the torque model that a policy was trained with, all evaluated on one plant."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.reproduce.experiment import Findings, Job, TextTable
from mrwarp.reproduce.policies import METRICS, PLANT_TITLES
from mrwarp.reproduce.tables.table2 import metric_rows
from mrwarp.study.paper_tables import Table3, table3
from mrwarp.study.plan import MODELS
from mrwarp.study.rollouts import EvaluationCfg

LEVEL = 0.05
"""Holm-corrected p-value below which two models are told apart."""


def compute(job: Job) -> Findings:
    """Metrics per model over three training seeds; the ranking as found, with its statistical support."""
    cfg = EvaluationCfg(rollouts=job.settings.rollouts, seed=job.settings.seed, threads=job.settings.threads)
    table = table3(cfg, report=lambda share: job.report("rollouts", share))
    titles = PLANT_TITLES
    rows = [
        row
        for model, found in table.rows.items()
        for row in metric_rows(
            titles[model], found, paper.TABLE_3[model], lambda metric, model=model: _why(table, model, metric)
        )
    ]
    apart = [pair for pair in table.pairs if pair.p < LEVEL]
    ranking = [
        [METRICS[metric][0], " < ".join(titles[model] for model in order),
         " < ".join(titles[model] for model in _papers(metric))]
        for metric, order in table.ranking.items()
    ]  # fmt: skip
    return Findings(
        rows=rows,
        claims={
            "PG-RLSTM is best in every metric": all(order[0] == "pg_rlstm" for order in table.ranking.values()),
            "MLP is worst in every metric": all(order[-1] == "mlp" for order in table.ranking.values()),
        },
        notes=[
            f"{len(apart)} of {len(table.pairs)} pairs of models differ at {100.0 * LEVEL:.0f} % (Welch over seeds, "
            "Holm within each metric)"
            + (": " + "; ".join(
                f"{titles[p.better]} before {titles[p.worse]} in {METRICS[p.metric][0]}, p = {p.p:.2g}"
                for p in apart) if apart else "") + ".",
            f"{sum(row.fell for row in table.rows.values())} of all rollouts fell.",
        ],
        tables=[TextTable(title="Ranking, best first", head=["metric", "ours", "paper"], rows=ranking)],
    )  # fmt: skip


def _papers(metric: str) -> list[str]:
    return sorted(MODELS, key=lambda model: abs(paper.TABLE_3[model][metric].mean))


def _why(table: Table3, model: str, metric: str) -> str:
    means = [abs(row.spread(metric)["mean"]) for row in table.rows.values()]
    theirs = [abs(row[metric].mean) for row in paper.TABLE_3.values()]
    return (
        "Rewards, gains and training length are not the paper's; over the four models ours spans "
        f"{min(means):.4f} to {max(means):.4f}, the paper's {min(theirs):.4f} to {max(theirs):.4f}."
    )
