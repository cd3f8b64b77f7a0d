"""Table 2: conventional against actuator-aware training, SAL off and on."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mrwarp import paper
from mrwarp.paper import PaperValue
from mrwarp.reproduce.experiment import Comparison, Findings, Job, compare
from mrwarp.reproduce.policies import METRICS
from mrwarp.study.paper_tables import LEAST, Change, Row, Table2, table2
from mrwarp.study.rollouts import EvaluationCfg


def compute(job: Job) -> Findings:
    """Configurations A to D over three training seeds, and what the training lowers."""
    cfg = EvaluationCfg(rollouts=job.settings.rollouts, seed=job.settings.seed, threads=job.settings.threads)
    table = table2(cfg, report=lambda share: job.report("rollouts", share))
    rows = [
        row
        for name, found in table.rows.items()
        for row in metric_rows(
            f"{name}: {found.plant}, SAL {'on' if found.current else 'off'}",
            found,
            paper.TABLE_2[name],
            lambda metric, name=name: _why(table, name, metric),
        )
    ]
    changes = {"rmse": table.rmse, "bias": table.bias}
    return Findings(
        rows=rows,
        claims={
            f"actuator-aware training lowers the v_x {name} by at least {100.0 * LEAST[name]:.0f} %, SAL {sal}":
            change.reduction >= LEAST[name]
            for name, by_sal in changes.items() for sal, change in by_sal.items()
        },
        notes=[_said(name, sal, change) for name, by_sal in changes.items() for sal, change in by_sal.items()]
        + [f"SAL {sal}: {limit}." for sal, limit in table.limits().items()]
        + [f"{sum(row.fell for row in table.rows.values())} of all rollouts fell."],
    )  # fmt: skip


def metric_rows(
    condition: str, found: Row, theirs: Mapping[str, PaperValue], why: Callable[[str], str]
) -> list[Comparison]:
    """A row for each metric of the study that the paper gives.

    Args:
        condition: What was done.
        found: Ours.
        theirs: The paper's by metric.
        why: Why they differ, by metric.
    """
    rows = []
    for metric in (metric for metric in METRICS if metric in theirs):
        spread, n = found.spread(metric), len(found.seeds[metric])
        ours = {"ours": spread["mean"], "sd": spread["sd"], "n": n}
        rows.append(compare(condition, METRICS[metric], theirs[metric], ours, why(metric)))
    return rows


def _said(name: str, sal: str, change: Change) -> str:
    low, high = change.interval
    what = "RMSE" if name == "rmse" else "absolute bias"
    unsigned = f"; averaged over seeds without sign {-100.0 * change.by_seed:+.0f} %" if name == "bias" else ""
    return (
        f"v_x {what}, SAL {sal}: {change.first:.4f} to {change.second:.4f} m/s, {-100.0 * change.reduction:+.0f} % "
        f"(95 % interval of the difference over seeds {low:+.4f} to {high:+.4f} m/s, p = {change.p:.2g}){unsigned}."
    )


def _why(table: Table2, name: str, metric: str) -> str:
    partner = {"A": "C", "B": "D", "C": "A", "D": "B"}[name]
    ours = [table.rows[n].spread(metric)["mean"] for n in (name, partner)]
    theirs = [paper.TABLE_2[n][metric].mean for n in (name, partner)]
    return (
        "Rewards, gains and training length are not the paper's, so levels differ; against the other training "
        f"({partner}) ours is {ours[0] - ours[1]:+.4f}, the paper's {theirs[0] - theirs[1]:+.4f}."
    )
