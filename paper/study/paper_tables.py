"""Tables 2 and 3: what actuator-aware training changes, and what the torque model in training changes (section 6.2).

:func:`causes` changes the plant step by step, to show where a policy's velocity error comes from.

Every policy is rolled out on the MR_Go plant at one command. The rollouts of a training seed are averaged first; means
and sample standard deviations are those of the seeds' averages, as in the paper.

At the end: the tables as plain values for ``result.json``, and as text.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from scipy import stats

from mrwarp.enums import ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.resources import policy_file
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.runtime import text_table
from mrwarp.trials.statistics import spread
from paper.study.plan import AWARE, CONVENTIONAL, MODELS, plant_cfg
from paper.study.rollouts import METRICS, EvaluationCfg, roll_out

CURRENT = 1.5
"""Current that the devices may use with SAL on [A], table 2."""

CONFIGURATIONS = {"A": (False, 0.0), "B": (False, CURRENT), "C": (True, 0.0), "D": (True, CURRENT)}
"""Table 2: whether the policy is actuator-aware, and the current its devices may use [A]."""

PAIRS = {"off": ("A", "C"), "on": ("B", "D")}
"""Configurations that are compared, with SAL ``off`` and ``on``: conventional and actuator-aware."""

LEAST = {"rmse": 0.30, "bias": 0.80}
"""Shares by which actuator-aware training must lower RMSE and absolute bias; the paper's are 0.306 and 0.395, and 0.835
and 0.874."""

RANKED = tuple(metric for metric in METRICS if metric != "height")
"""Metrics of table 3 in which less is better: of the bias each seed's absolute value, in both ranking and test."""

Report = Callable[[float], None]


@dataclass(frozen=True, kw_only=True)
class PolicyRow:
    """Policies of one training under one condition."""

    plant: str
    """Plant that they were trained on, one of :data:`paper.study.plan.PLANTS`."""
    current: float
    """Current that the devices may use [A]; 0 is SAL off."""
    seeds: dict[str, np.ndarray]
    """Average over its rollouts of each seed, by metric, shape (seeds,); see ``rollouts.METRICS`` for units."""
    rollouts: dict[str, np.ndarray]
    """The single rollouts, by metric, shape (seeds, rollouts)."""
    fell: int
    """Rollouts that fell."""

    def spread(self, metric: str) -> dict[str, float]:
        """Mean and sample standard deviation over the seeds' averages."""
        return spread(self.seeds[metric])

    @property
    def ripple(self) -> float:
        """v_x RMSE without each rollout's bias, mean over rollouts [m/s]: on flat ground the gait's oscillation."""
        square = self.rollouts["v_x_rmse"] ** 2 - self.rollouts["v_x_bias"] ** 2
        return float(np.nanmean(np.sqrt(np.maximum(square, 0.0))))


@dataclass(frozen=True, kw_only=True)
class Change:
    """How much lower a figure is with one training than with another."""

    first: float
    """Mean over seeds of the first, or its absolute value."""
    second: float
    """Mean over seeds of the second, or its absolute value."""
    reduction: float
    """1 - second/first."""
    by_seed: float
    """Reduction of the absolute values averaged over seeds, where signs cannot cancel."""
    interval: tuple[float, float]
    """95 % interval of the difference ``second`` - ``first`` (Welch, over seeds), in the figure's unit."""
    p: float
    """Two-sided p-value of that difference; NaN with one seed."""


@dataclass(frozen=True, kw_only=True)
class Table2:
    """Configurations A to D."""

    rows: dict[str, PolicyRow]
    """By configuration."""
    rmse: dict[str, Change]
    """RMSE of the aware against the conventional policies, with SAL ``off`` and ``on``."""
    bias: dict[str, Change]
    """Absolute value of the mean bias of the aware against the conventional policies, SAL ``off`` and ``on``."""

    def limits(self) -> dict[str, str]:
        """Bound of the reduction of the RMSE, SAL ``off`` and ``on``: how much of each RMSE is not bias."""
        found = {}
        for sal, (first, second) in PAIRS.items():
            plain, aware = self.rows[first], self.rows[second]
            most = 1.0 - plain.ripple / float(plain.seeds["v_x_rmse"].mean())
            found[sal] = (
                f"without bias the v_x RMSE is {plain.ripple:.4f} (conventional) and {aware.ripple:.4f} m/s (aware), "
                f"so that no bias at all and the conventional policies' oscillation would lower it by {most:.0%}"
            )
        return found


@dataclass(frozen=True, kw_only=True)
class Pair:
    """Two models compared on one metric."""

    metric: str
    better: str
    """Model with the lower mean over seeds (of the absolute values)."""
    worse: str
    difference: float
    """Worse minus better."""
    p: float
    """Two-sided p-value of Welch's test of that difference, Holm-corrected over the pairs of the metric; NaN with one
    seed."""


@dataclass(frozen=True, kw_only=True)
class Table3:
    """One row per torque model in training."""

    rows: dict[str, PolicyRow]
    """By model."""
    ranking: dict[str, tuple[str, ...]]
    """Models from best to worst, by metric; the mean height has none."""
    pairs: tuple[Pair, ...]
    """All pairs of models on all ranked metrics."""


def table2(cfg: EvaluationCfg | None = None, *, aware: str = AWARE, report: Report | None = None) -> Table2:
    """Roll conventional policies and those trained on the plant ``aware`` out, SAL off and on; see :func:`evaluate`."""
    cells = [(aware if is_aware else CONVENTIONAL, current) for is_aware, current in CONFIGURATIONS.values()]
    rows = dict(zip(CONFIGURATIONS, evaluate(cfg or EvaluationCfg(), cells, report), strict=True))
    rmse, bias = (
        {
            sal: change(rows[first].seeds[metric], rows[second].seeds[metric], absolute=metric == "v_x_bias")
            for sal, (first, second) in PAIRS.items()
        }
        for metric in ("v_x_rmse", "v_x_bias")
    )
    return Table2(rows=rows, rmse=rmse, bias=bias)


def table3(cfg: EvaluationCfg | None = None, *, models: Sequence[str] = MODELS, report: Report | None = None) -> Table3:
    """Roll the policies of every torque model out on one and the same plant, with SAL on, see :func:`evaluate`."""
    rows = evaluate(cfg or EvaluationCfg(), [(model, CURRENT) for model in models], report)
    by_model = dict(zip(models, rows, strict=True))
    ranking, pairs = {}, []
    for metric in RANKED:
        # mean over seeds of the absolute values; infinite, so last, without figures
        means = {model: float(np.abs(row.seeds[metric]).mean()) for model, row in by_model.items()}
        size = {model: math.inf if math.isnan(mean) else mean for model, mean in means.items()}
        ranking[metric] = tuple(sorted(models, key=size.__getitem__))
        pairs += _pairs(metric, by_model, size)
    return Table3(rows=by_model, ranking=ranking, pairs=tuple(pairs))


def evaluate(
    cfg: EvaluationCfg, cells: Sequence[tuple[str, float]], report: Report | None = None, *, env: TaskCfg | None = None
) -> list[PolicyRow]:
    """Roll out the policies of several trainings in one batch.

    Args:
        cfg: Which policies, and how they are rolled out.
        cells: Training plant, and current that the devices may use [A].
        report: Called with the share that is done.
        env: What they walk on; None takes the plant and terrain of ``cfg``.

    Returns:
        A row for each cell. A seed's average leaves out rollouts without figures.

    Raises:
        PolicyError: a policy is missing or unreadable.
    """
    names = dict.fromkeys(name for name, _ in cells)
    loaded = {(name, seed): OnnxPolicy(policy_file(cfg.folder, name, seed)) for name in names for seed in cfg.seeds}
    policies = [loaded[name, seed] for name, _ in cells for seed in cfg.seeds]
    currents = [current for _, current in cells for _ in cfg.seeds]
    env = env or plant_cfg(cfg.plant, terrain=cfg.terrain, threads=cfg.threads, coupling=cfg.coupling)
    found = roll_out(cfg, env, policies, currents, report)
    rows = []
    for k, (plant, current) in enumerate(cells):
        own = slice(k * len(cfg.seeds), (k + 1) * len(cfg.seeds))
        single = {metric: values[own] for metric, values in found.figures.items()}
        averages = {metric: np.nanmean(values, axis=1) for metric, values in single.items()}
        fell = int(found.fell[own].sum())
        rows.append(PolicyRow(plant=plant, current=current, seeds=averages, rollouts=single, fell=fell))
    return rows


def change(first: np.ndarray, second: np.ndarray, *, absolute: bool = False) -> Change:
    """Compare the seeds' averages of two trainings.

    Args:
        first: Of the first, shape (seeds,).
        second: Of the second, shape (seeds,).
        absolute: Compare the absolute values of the means. Each training's seeds are tested with the sign that makes
            their mean positive, so that interval and p-value are those of the difference of ``first`` and ``second``.
    """
    by_seed = 1.0 - float(np.abs(second).mean() / np.abs(first).mean())
    if absolute:
        first, second = (values * np.copysign(1.0, values.mean()) for values in (first, second))
    means = [float(values.mean()) for values in (first, second)]
    interval, p = (float("nan"), float("nan")), float("nan")
    if min(len(first), len(second)) > 1:
        interval, p = welch(second, first)
    return Change(
        first=means[0], second=means[1], reduction=1.0 - means[1] / means[0], by_seed=by_seed, interval=interval, p=p
    )


def welch(first: np.ndarray, second: np.ndarray) -> tuple[tuple[float, float], float]:
    """95 % interval of the difference of two means, first - second, and its two-sided p-value (Welch)."""
    test: Any = stats.ttest_ind(first, second, equal_var=False)
    bounds = test.confidence_interval(0.95)
    return (float(bounds.low), float(bounds.high)), float(test.pvalue)


def _pairs(metric: str, rows: dict[str, PolicyRow], size: dict[str, float]) -> list[Pair]:
    """All pairs of models, with Holm's correction."""
    found = []
    for first, second in combinations(rows, 2):
        better, worse = sorted((first, second), key=size.__getitem__)
        values = [np.abs(rows[name].seeds[metric]) for name in (better, worse)]
        p = welch(*values)[1] if len(values[0]) > 1 else float("nan")
        found.append((better, worse, size[worse] - size[better], p))
    corrected = holm([p for *_, p in found])
    return [
        Pair(metric=metric, better=better, worse=worse, difference=difference, p=p)
        for (better, worse, difference, _), p in zip(found, corrected, strict=True)
    ]


def holm(values: Sequence[float]) -> list[float]:
    """Holm's correction of p-values; NaN, where nothing could be tested, stays NaN and counts as a comparison."""
    corrected, running = [math.nan] * len(values), 0.0
    for place, index in enumerate(np.argsort(values)):  # NaN last
        if math.isnan(values[index]):
            break
        running = max(running, min(1.0, (len(values) - place) * values[index]))
        corrected[index] = running
    return corrected


STEPS = {
    "go1": "Go1",
    "mass": "MR_Go's masses, no devices",
    "drag": "with devices at 0 A: off-current drag (table 2 on this plant: SAL off)",
    "damping": f"SAL at {CURRENT:g} A, damping branch alone",
    "holding": f"SAL at {CURRENT:g} A, holding branch alone",
    "both": f"SAL at {CURRENT:g} A, both branches (table 2 on this plant: SAL on)",
}
"""Plants by name, in order, and what each is."""


def causes(cfg: EvaluationCfg, plants: Sequence[str], report: Report | None = None) -> dict[str, dict[str, PolicyRow]]:
    """Roll the policies of some trainings out on every plant, with the Bouc-Wen device on flat ground.

    As :func:`evaluate`, but that ``plant`` and ``terrain`` of ``cfg`` are not used.

    Returns:
        Rows by training plant and step of :data:`STEPS`.
    """
    rows: dict[str, dict[str, PolicyRow]] = {plant: {} for plant in plants}
    for k, step in enumerate(STEPS):
        env, current = _plant(step, cfg)
        for row in evaluate(cfg, [(plant, current) for plant in plants], env=env):
            rows[row.plant][step] = row
        if report:
            report((k + 1) / len(STEPS))
    return rows


def _plant(step: str, cfg: EvaluationCfg) -> tuple[TaskCfg, float]:
    """The task on a plant, and the current its devices may use [A]."""
    if step == "go1":
        return TaskCfg(robot="go1", actuator="none", sal=False, threads=cfg.threads), 0.0
    if step == "mass":
        return TaskCfg(actuator="none", sal=False, threads=cfg.threads), 0.0
    env = TaskCfg(z_step=ZStep.EULER, threads=cfg.threads, coupling=cfg.coupling)
    if step == "drag":
        return env, 0.0
    return replace(env, damping=step != "holding", holding=step != "damping"), CURRENT


def plain_row(row: PolicyRow) -> dict[str, Any]:
    """Conditions, and every metric with its spread over the seeds, their averages and the single rollouts."""
    metrics = {
        m: {**row.spread(m), "seeds": row.seeds[m].tolist(), "rollouts": row.rollouts[m].tolist()} for m in METRICS
    }
    return {"training": row.plant, "current": row.current, "fell": row.fell, **metrics}


def figures(table: Table2 | Table3) -> dict[str, Any]:
    """Everything a table found."""
    rows = {"rows": {name: plain_row(row) for name, row in table.rows.items()}, "units": METRICS}
    if isinstance(table, Table3):
        return {**rows, "ranking": table.ranking, "pairs": [asdict(pair) for pair in table.pairs]}
    changes = {name: getattr(table, name) for name in ("rmse", "bias")}
    return rows | {name: {sal: asdict(change) for sal, change in found.items()} for name, found in changes.items()}


def row_lines(rows: Mapping[str, PolicyRow]) -> list[str]:
    """Metrics of each row, mean ± SD over the seeds."""

    def cell(row: PolicyRow, metric: str) -> str:
        found, digits = row.spread(metric), 2 if metric == "tilt_rms" else 4
        return f"{found['mean']:.{digits}f} ± {found['sd']:.{digits}f}"

    shown = [
        (
            name,
            row.plant,
            f"{row.current:g}",
            *(cell(row, metric) for metric in METRICS),
            f"fell {row.fell}" if row.fell else "",
        )
        for name, row in rows.items()
    ]
    return text_table(("", "training", "A", *(f"{m} [{unit}]" for m, unit in METRICS.items()), ""), shown, left=2)


def table2_lines(table: Table2) -> tuple[list[str], bool]:
    """Table 2, and whether actuator-aware training lowers RMSE and bias by :data:`LEAST`."""
    lines, met = row_lines(table.rows), True
    for sal in ("off", "on"):
        rmse, bias = table.rmse[sal], table.bias[sal]
        met = met and rmse.reduction >= LEAST["rmse"] and bias.reduction >= LEAST["bias"]
        lines.append(
            f"SAL {sal}: actuator-aware training lowers v_x RMSE by {rmse.reduction:.1%} (p = {rmse.p:.3f}, Welch over "
            f"seeds; asked for {LEAST['rmse']:.0%}), the absolute bias by {bias.reduction:.1%} (p = {bias.p:.3f}; "
            f"{LEAST['bias']:.0%}; averaged over seeds without sign {bias.by_seed:.1%})"
        )
        lines.append(f"SAL {sal}: {table.limits()[sal]}")
    return lines, met


def table3_lines(table: Table3) -> list[str]:
    """Table 3, and which models differ beyond chance."""
    lines = row_lines(table.rows)
    for metric, order in table.ranking.items():
        pairs = [pair for pair in table.pairs if pair.metric == metric]
        sure = [f"{pair.better} < {pair.worse}" for pair in pairs if pair.p < 0.05]
        none = "not tested" if pairs and all(math.isnan(pair.p) for pair in pairs) else "no pair"
        lines.append(f"{metric}: {' < '.join(order)}; beyond chance (p < 0.05): {', '.join(sure) or none}")
    return lines
