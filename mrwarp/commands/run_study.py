"""``mrwarp study``: train, collect and evaluate the policies of tables 2 and 3 and figure 5."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from mrwarp.options.command_line import CommandLine
from mrwarp.options.study_options import (
    Causes,
    Collect,
    Evaluation,
    Figure5,
    StudyTrain,
    Table2Options,
    Table3Options,
    Trained,
)
from mrwarp.rl.ppo_cfg import LearningCfg
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import ProgressLine
from mrwarp.study import curves, matched_training, paper_tables
from mrwarp.study.paper_tables import LEAST, STEPS, Row, Table2, Table3, causes
from mrwarp.study.plan import StudyCfg
from mrwarp.study.rollouts import EvaluationCfg

UNITS = {
    "v_x_rmse": "m/s", "v_x_bias": "m/s", "height": "m", "height_rmse": "m", "tilt_rms": "deg",
    "yaw_rate_rmse": "rad/s",
}  # fmt: skip
"""Unit of each metric."""


def run(options: StudyTrain | Collect | Table3Options | Causes | Figure5, line: CommandLine) -> int:
    """Run a part.

    Returns:
        0 done, 1 when a training broke off or a target is missed, 2 on bad input, 130 when trainings are left: after
        Ctrl-C, or for the processes that are at them.
    """
    check_writable(options.runs if isinstance(options, StudyTrain) else options.out)
    match options:
        case StudyTrain():
            return _train(options)
        case Collect():
            return _collect(options)
        case Figure5():
            return _figure5(options, line)
        case Causes():
            return _causes(options, line)
    return _table(options, line)


def make_study_cfg(options: Trained) -> StudyCfg:
    """What all trainings share."""
    return StudyCfg(
        num_envs=options.num_envs,
        iterations=options.iterations,
        terrain=options.terrain,
        seeds=options.seeds,
        plants=options.plants,
        randomize=options.randomize,
        start_from=options.start_from if isinstance(options, StudyTrain) else None,
        power_price=options.power_price,
        learning=LearningCfg(desired_kl=options.desired_kl, entropy=options.entropy),
    )


def _train(options: StudyTrain) -> int:
    if matched_training.train(make_study_cfg(options), options.runs, threads=options.threads):
        print(f"all finished in {options.runs}; 'mrwarp study collect' with the same choices takes the policies")
        return 0
    print("not all finished: the same command goes on")
    return 130


def _collect(options: Collect) -> int:
    written = matched_training.collect(make_study_cfg(options), options.runs, options.out)
    print(f"{len(written)} policies in {options.out}")
    for policy in written:
        if failed := matched_training.failed_conditions(policy.with_suffix(".json")):
            print(f"{policy.stem} did not pass the walking gate: {', '.join(failed)}")
    return 0


def _evaluation_cfg(options: Evaluation) -> EvaluationCfg:
    plant, terrain = (options.plant, options.terrain) if isinstance(options, Table3Options) else ("bouc_wen", "flat")
    return EvaluationCfg(
        folder=options.policies,
        seeds=options.seeds,
        rollouts=options.rollouts,
        seed=options.seed,
        threads=options.threads,
        plant=plant,
        terrain=terrain,
    )


def _table(options: Table3Options, line: CommandLine) -> int:
    cfg, progress, met = _evaluation_cfg(options), ProgressLine(sys.stdout), True
    report = _reporter(progress, line)
    if isinstance(options, Table2Options):
        table = paper_tables.table2(cfg, aware=options.aware, report=report)
        progress.done()
        lines, met = _print2(table)
    else:
        table = paper_tables.table3(cfg, report=report)
        progress.done()
        lines = _print3(table)
    print("\n".join(lines))
    content = {**figures(table), "evaluation": _evaluation(cfg)}
    write_result(options.out, content, seed=options.seed, command=str(line))
    print(f"\nfigures in {options.out}")
    return 0 if met else 1


def _reporter(progress: ProgressLine, line: CommandLine) -> Callable[[float], None]:
    return lambda share: progress(line.prog.rpartition(" ")[2], share)


def _causes(options: Causes, line: CommandLine) -> int:
    cfg = _evaluation_cfg(options)
    found = causes(cfg, options.plants, _reporter(ProgressLine(sys.stdout), line))
    print(_header())
    for item in found.values():
        for step, row in item.items():
            print(_line(step, row))
    rows = {plant: {step: _row(row) for step, row in item.items()} for plant, item in found.items()}
    content = {"rows": rows, "steps": STEPS, "units": UNITS, "evaluation": _evaluation(cfg)}
    write_result(options.out, content, seed=options.seed, command=str(line))
    print(f"\nfigures in {options.out}")
    return 0


def _figure5(options: Figure5, line: CommandLine) -> int:
    found = curves.figure5(options.policies, seeds=options.seeds)
    options.out.mkdir(parents=True, exist_ok=True)
    curves.plot(found, options.out / "fig5.png")
    content = {
        plant: {"update": c.update.tolist(), "mean": c.mean.tolist(), "sd": c.sd.tolist()} for plant, c in found.items()
    }
    for plant, curve in found.items():
        title = curves.TITLES.get(plant, plant)
        print(f"{title:20s} reward at the end {curve.mean[-1]:.2f} ± {curve.sd[-1]:.2f} per second")
    write_result(options.out, {"curves": content}, seed=options.seeds[0], command=str(line))
    print(f"\npicture and figures in {options.out}")
    return 0


def figures(table: Table2 | Table3) -> dict[str, Any]:
    """Everything a table found, as plain values."""
    found: dict[str, Any] = {"rows": {name: _row(row) for name, row in table.rows.items()}, "units": UNITS}
    for name in ("rmse", "bias", "ranking", "pairs"):
        if hasattr(table, name):
            value = getattr(table, name)
            found[name] = (
                [asdict(item) for item in value]
                if name == "pairs"
                else {key: list(v) if name == "ranking" else asdict(v) for key, v in value.items()}
            )
    return found


def _row(row: Row) -> dict[str, Any]:
    metrics = {
        m: {**row.spread(m), "seeds": row.seeds[m].tolist(), "rollouts": row.rollouts[m].tolist()} for m in UNITS
    }
    return {"training": row.plant, "current": row.current, "fell": row.fell, **metrics}


def _evaluation(cfg: EvaluationCfg) -> dict[str, Any]:
    return {**asdict(cfg), "folder": str(cfg.folder)}


def _line(name: str, row: Row) -> str:
    cells = "".join(f"{_cell(row, metric):>23s}" for metric in UNITS)
    return f"{name:13s} {row.plant:13s} {row.current:4g}{cells}" + (f"  fell {row.fell}" if row.fell else "")


def _cell(row: Row, metric: str) -> str:
    found = row.spread(metric)
    digits = 2 if metric == "tilt_rms" else 4
    return f"{found['mean']:.{digits}f} ± {found['sd']:.{digits}f}"


def _header() -> str:
    return f"{'':13s} {'training':13s} {'A':>4s}" + "".join(f"{f'{m} [{unit}]':>23s}" for m, unit in UNITS.items())


def _print2(table: Table2) -> tuple[list[str], bool]:
    lines, met = [_header(), *(_line(name, row) for name, row in table.rows.items())], True
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


def _print3(table: Table3) -> list[str]:
    lines = [_header(), *(_line(name, row) for name, row in table.rows.items())]
    for metric, order in table.ranking.items():
        pairs = [pair for pair in table.pairs if pair.metric == metric]
        sure = [f"{pair.better} < {pair.worse}" for pair in pairs if pair.p < 0.05]
        none = "not tested" if pairs and all(math.isnan(pair.p) for pair in pairs) else "no pair"
        lines.append(f"{metric}: {' < '.join(order)}; beyond chance (p < 0.05): {', '.join(sure) or none}")
    return lines
