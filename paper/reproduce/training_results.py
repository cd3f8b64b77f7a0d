"""Tables 2 and 3 and figure 5: what training with the device in the loop changes, and which torque model it needs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from mrwarp import paper
from mrwarp.enums import Coupling
from mrwarp.paper import PaperValue
from mrwarp.runtime import drawing
from paper.reproduce.cache import Job
from paper.reproduce.comparison import BRAKE, Comparison, Findings, TextTable, compare, identified
from paper.reproduce.settings import PLANT_TITLES
from paper.study import matched_training, paper_tables
from paper.study.paper_tables import LEAST, Change, PolicyRow, Table2, Table3
from paper.study.plan import AWARE, CONVENTIONAL, MODELS
from paper.study.plan import BRAKE as BRAKE_POLICIES
from paper.study.rollouts import EvaluationCfg

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

LEVEL = 0.05
"""Holm-corrected p-value below which two models are distinguished."""


def table2(job: Job) -> Findings:
    """Configurations A to D over the training seeds, and what the training lowers.

    By the paper's explicit torque, in training and evaluation; then by the brake constraint, in both.
    """
    table, brake = (
        paper_tables.table2(cfg, report=lambda share, k=k: job.report("rollouts", 0.5 * (k + share)))
        for k, cfg in enumerate(_both(job))
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
            _fell(table),
            "As a brake that sticks:",
            *(_said(name, sal, found) for name in ("rmse", "bias") for sal, found in getattr(brake, name).items()),
            _fell(brake),
        ],
    )  # fmt: skip


def table3(job: Job) -> Findings:
    """Metrics per torque model in training over the seeds; the ranking as found, with its statistical support.

    By the paper's explicit torque, then by the brake constraint, as table 2.
    """
    table, brake = (
        paper_tables.table3(cfg, report=lambda share, k=k: job.report("rollouts", 0.5 * (k + share)))
        for k, cfg in enumerate(_both(job))
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
            _fell(table),
        ],
        tables=[TextTable(title="Ranking, best first", head=["metric", "ours", "paper"], rows=ranking)],
    )


def fig5(job: Job) -> Findings:
    """Learning curves by the paper's torque: whether aware policies learn more slowly and end higher."""
    found = matched_training.figure5()
    with drawing("rewards.png"):
        matched_training.plot(found, job.out / "rewards.png")
    slow, plain = found[AWARE], found[CONVENTIONAL]
    quarter, last = slow.update <= 0.25 * slow.update[-1], slow.update >= 0.9 * slow.update[-1]
    early, late = ([float(curve.mean[part].mean()) for curve in (slow, plain)] for part in (quarter, last))
    return Findings(
        **identified(
            ("slower_at_first", "the actuator-aware training learns more slowly at first", early[0] < early[1]),
            ("ends_higher", "and ends at a higher reward", late[0] > late[1]),
        ),
        notes=[
            f"Reward per second, actuator-aware and conventional: {early[0]:.2f} and {early[1]:.2f} over the first "
            f"quarter, {late[0]:.2f} and {late[1]:.2f} over the last tenth of the updates."
        ],
        pictures={"rewards.png": "Reward over the trainings, mean and SD over the seeds"},
    )


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


def _both(job: Job) -> tuple[EvaluationCfg, EvaluationCfg]:
    """How policies are rolled out: with the paper's explicit torque, and with the brake constraint."""
    settings = job.settings
    literal = EvaluationCfg(rollouts=settings.rollouts, seed=settings.seed, threads=settings.threads)
    return literal, replace(literal, folder=BRAKE_POLICIES, coupling=Coupling.CONSTRAINT)


def _fell(table: Table2 | Table3) -> str:
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


def _why_model(table: Table3, metric: str) -> str:
    means = [abs(row.spread(metric)["mean"]) for row in table.rows.values()]
    theirs = [abs(row[metric].mean) for row in paper.TABLE_3.values()]
    return (
        "Rewards, gains and training length are not the paper's; over the four models ours spans "
        f"{min(means):.4f} to {max(means):.4f}, the paper's {min(theirs):.4f} to {max(theirs):.4f}."
    )
