"""``mrwarp study``: train, collect and evaluate the policies of tables 2 and 3 and figure 5."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrwarp.options.arguments import Parser, count, not_negative, seed, whole
from mrwarp.run_dir import check_writable
from mrwarp.runtime import quiet_libraries

if TYPE_CHECKING:
    from mrwarp.study.paper_tables import EvaluationCfg, Row, Table2, Table3

UNITS = {
    "v_x_rmse": "m/s", "v_x_bias": "m/s", "height": "m", "height_rmse": "m", "tilt_rms": "deg",
    "yaw_rate_rmse": "rad/s",
}  # fmt: skip
"""Unit of each metric."""


def make_parser() -> argparse.ArgumentParser:
    """The options of ``mrwarp study``."""
    from mrwarp.commands.run_train import add_learning
    from mrwarp.enums import RANDOMIZATIONS, TERRAINS
    from mrwarp.study.plan import AWARE, CONVENTIONAL, MODELS, PLANTS, SEEDS, STUDY, TRAINABLE, StudyCfg

    default = StudyCfg()
    parser = Parser(
        prog="mrwarp study",
        description="Actuator-aware against conventional training (table 2), torque models in training (table 3), "
        "learning curves (figure 5).",
    )
    parts = parser.add_subparsers(dest="part", required=True, metavar="PART")
    train = parts.add_parser("train", help="train what is not finished; resumable, any number of processes at once")
    collect = parts.add_parser("collect", help="copy finished policies and their training records into a folder")
    for part in (train, collect):
        plants = "what to train on (default: tables 2 and 3); go1, mr_go, mr_go_sal* pay for power and carry loads"
        part.add_argument("--plants", nargs="+", choices=TRAINABLE, default=list(PLANTS), help=plants)
        envs = f"parallel environments (default: {default.num_envs})"
        part.add_argument("--num-envs", type=count, default=default.num_envs, help=envs)
        updates = f"PPO updates of every policy (default: {default.iterations})"
        part.add_argument("--iterations", type=count, default=default.iterations, help=updates)
        ground = f"ground of every training (default: {default.terrain})"
        part.add_argument("--terrain", choices=TERRAINS, default=default.terrain, help=ground)
        differs = "what differs between environments (default: friction and kicks, as in legged_gym)"
        part.add_argument("--randomize", choices=RANDOMIZATIONS, default=default.randomize, help=differs)
        price = f"price of a watt for go1, mr_go and mr_go_sal* [1/W] (default: {default.power_price:g})"
        part.add_argument("--power-price", type=not_negative, default=default.power_price, metavar="R", help=price)
        add_learning(part)
        part.add_argument(
            "--runs", type=Path, default=Path("runs/study"), help="folder of the runs (default: runs/study)"
        )
    begin = (
        "folder of policies or runs to begin with, e.g. policies/study; each training takes the one of its plant and "
        "seed, of a run also the critic"
    )
    train.add_argument("--start-from", type=Path, metavar="DIR", help=begin)
    where = "where policies and records go (default: runs/policies)"
    collect.add_argument("--out", type=Path, default=Path("runs/policies"), help=where)
    tables = {
        "table2": "conventional and actuator-aware policies, SAL off and on",
        "table3": "torque models in training",
        "causes": "which part of the plant makes a policy's velocity error",
    }
    for name, text in {**tables, "fig5": "learning curves"}.items():
        part = parts.add_parser(name, help=text)
        part.add_argument("--out", type=Path, default=Path("runs") / name, help=f"output folder (default: runs/{name})")
        part.add_argument(
            "--policies", type=Path, default=STUDY, help="policies and records (default: the shipped ones)"
        )
        if name == "causes":
            part.add_argument("--plants", nargs="+", choices=PLANTS, default=[CONVENTIONAL, AWARE], help="trainings")
            part.set_defaults(plant="bouc_wen", terrain="flat")
        elif name in tables:
            part.add_argument("--plant", choices=MODELS, default=AWARE, help=f"what all walk on (default: {AWARE})")
            ground = "ground that all walk on (default: flat); rough has 36 tiles, so take as many --rollouts"
            part.add_argument("--terrain", choices=TERRAINS, default="flat", help=ground)
        if name in tables:
            part.add_argument("--rollouts", type=count, default=3, help="rollouts per policy (default: 3)")
            part.add_argument("--seed", type=seed, default=0, help="seed of poses and gait phases (default: 0)")
        if name == "table2":
            part.add_argument("--aware", choices=MODELS, default=AWARE, help=f"aware policies (default: {AWARE})")
    for name, part in parts.choices.items():
        part.add_argument("--seeds", type=seed, nargs="+", default=list(SEEDS), metavar="S", help="training seeds")
        if name in ("train", *tables):
            part.add_argument("--threads", type=whole, default=0, help="CPU threads; 0 = all, the figures are the same")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a part.

    Returns:
        0 done, 1 when a training broke off or a target is missed, 2 on bad input, 130 when trainings are left: after
        Ctrl-C, or for the processes that are at them.
    """
    argv = sys.argv[1:] if argv is None else argv
    args = make_parser().parse_args(argv)
    quiet_libraries()
    from mrwarp.rl.checkpoint import CheckpointError
    from mrwarp.rl.policy import PolicyError
    from mrwarp.rl.trainer import TrainingError
    from mrwarp.study.curves import RecordError

    command = "mrwarp study " + shlex.join(argv)
    try:
        check_writable(args.runs if args.part == "train" else args.out)
        if args.part in ("train", "collect"):
            return _train(args) if args.part == "train" else _collect(args)
        return _figure5(args, command) if args.part == "fig5" else _table(args, command)
    except TrainingError as error:
        print(f"mrwarp study: {error}", file=sys.stderr)
        return 1
    except (PolicyError, RecordError, CheckpointError, ValueError, OSError) as error:
        print(f"mrwarp study: {error}", file=sys.stderr)
        return 2


def _study_cfg(args: argparse.Namespace) -> Any:
    from mrwarp.rl.ppo_cfg import LearningCfg
    from mrwarp.study.plan import StudyCfg

    return StudyCfg(
        num_envs=args.num_envs, iterations=args.iterations, terrain=args.terrain, seeds=tuple(args.seeds),
        plants=tuple(args.plants), randomize=args.randomize, start_from=getattr(args, "start_from", None),
        power_price=args.power_price, learning=LearningCfg(desired_kl=args.desired_kl, entropy=args.entropy),
    )  # fmt: skip


def _train(args: argparse.Namespace) -> int:
    from mrwarp.study.matched_training import train

    if train(_study_cfg(args), args.runs, threads=args.threads):
        print(f"all finished in {args.runs}; 'mrwarp study collect' with the same choices takes the policies")
        return 0
    print("not all finished: the same command goes on")
    return 130


def _collect(args: argparse.Namespace) -> int:
    from mrwarp.study.matched_training import collect, failed_conditions

    written = collect(_study_cfg(args), args.runs, args.out)
    print(f"{len(written)} policies in {args.out}")
    for policy in written:
        if failed := failed_conditions(policy.with_suffix(".json")):
            print(f"{policy.stem} did not pass the walking gate: {', '.join(failed)}")
    return 0


def _table(args: argparse.Namespace, command: str) -> int:
    from mrwarp.commands.energy_runs import Progress
    from mrwarp.run_dir import write_result
    from mrwarp.study import paper_tables as tables

    cfg = tables.EvaluationCfg(
        folder=args.policies, seeds=tuple(args.seeds), rollouts=args.rollouts, seed=args.seed, plant=args.plant,
        terrain=args.terrain, threads=args.threads,
    )  # fmt: skip
    progress = Progress(sys.stdout)

    def report(share: float) -> None:
        progress(args.part, share)

    if args.part == "causes":
        return _causes(args, cfg, report, command)
    if args.part == "table2":
        table = tables.table2(cfg, aware=args.aware, report=report)
        progress.done()
        lines, met = _print2(table)
    else:
        table = tables.table3(cfg, report=report)
        progress.done()
        lines, met = _print3(table), True
    print("\n".join(lines))
    write_result(args.out, {**figures(table), "evaluation": _evaluation(cfg)}, seed=args.seed, command=command)
    print(f"\nfigures in {args.out}")
    return 0 if met else 1


def _causes(args: argparse.Namespace, cfg: EvaluationCfg, report: Any, command: str) -> int:
    from mrwarp.run_dir import write_result
    from mrwarp.study.causes import STEPS, causes

    found = causes(cfg, args.plants, report)
    print(_header())
    for item in found.values():
        for step, row in item.rows.items():
            print(_line(step, row))
    rows = {plant: {step: _row(row) for step, row in item.rows.items()} for plant, item in found.items()}
    content = {"rows": rows, "steps": STEPS, "units": UNITS, "evaluation": _evaluation(cfg)}
    write_result(args.out, content, seed=args.seed, command=command)
    print(f"\nfigures in {args.out}")
    return 0


def _figure5(args: argparse.Namespace, command: str) -> int:
    from mrwarp.run_dir import write_result
    from mrwarp.study import curves

    found = curves.figure5(args.policies, seeds=args.seeds)
    args.out.mkdir(parents=True, exist_ok=True)
    curves.plot(found, args.out / "fig5.png")
    content = {
        plant: {"update": c.update.tolist(), "mean": c.mean.tolist(), "sd": c.sd.tolist()} for plant, c in found.items()
    }
    for plant, curve in found.items():
        title = curves.TITLES.get(plant, plant)
        print(f"{title:20s} reward at the end {curve.mean[-1]:.2f} ± {curve.sd[-1]:.2f} per second")
    write_result(args.out, {"curves": content}, seed=args.seeds[0], command=command)
    print(f"\npicture and figures in {args.out}")
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
    from mrwarp.study.paper_tables import LEAST

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
