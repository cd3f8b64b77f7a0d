"""Table 2: conventional against actuator-aware training, SAL off and on."""

from __future__ import annotations

from mrwarp import paper
from mrwarp.reproduce.experiment import Comparison, Findings, Job
from mrwarp.reproduce.policies import METRICS
from mrwarp.study.paper_tables import LEAST, Change, Table2, table2
from mrwarp.study.rollouts import EvaluationCfg


def compute(job: Job) -> Findings:
    """Configurations A to D over three training seeds, and what the training lowers."""
    cfg = EvaluationCfg(rollouts=job.settings.rollouts, seed=job.settings.seed, threads=job.settings.threads)
    table = table2(cfg, report=lambda share: job.report("rollouts", share))
    rows = [
        Comparison(condition=f"{name}: {row.plant}, SAL {'on' if row.current else 'off'}", quantity=title, unit=unit,
            paper=paper.TABLE_2[name][metric], ours=row.spread(metric)["mean"], sd=row.spread(metric)["sd"],
            n=len(cfg.seeds), digits=digits, why=_why(table, name, metric))
        for name, row in table.rows.items()
        for metric, (title, unit, digits) in METRICS.items() if metric in paper.TABLE_2[name]
    ]  # fmt: skip
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
