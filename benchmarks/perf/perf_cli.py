"""``mrwarp perf``: what a step costs, part by part, and whether that got worse."""

from __future__ import annotations

import argparse
import shlex
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

from benchmarks.perf.compare import CompareError, compare, load_ratios
from benchmarks.perf.perf_cfg import GpuCfg, PerfCfg
from mrwarp.options.arguments import Parser, count, whole
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.run_dir import check_writable, one_line, write_result
from mrwarp.runtime import quiet_libraries

Run = Callable[[Any, Callable[[str, float], None]], dict[str, Any]]
"""Measures with a policy, and tells what is measured and the share of it that is done."""

_NAMES = ("name", "machine", "processor")


def main(argv: list[str] | None = None) -> int:
    """Time physics, joints, environment and training, walking; 0 done, 1 a ratio regressed (--compare), 2 bad input."""
    argv = sys.argv[1:] if argv is None else argv
    default = PerfCfg()
    parser = Parser(prog="mrwarp perf", description=main.__doc__)
    add = parser.add_argument
    add("--out", type=Path, default=Path("runs/perf"), help="output folder (default: runs/perf)")
    counts = " ".join(map(str, default.num_envs))
    add("--num-envs", type=count, nargs="+", metavar="N", help=f"numbers of robots (default: {counts})")
    add("--rounds", type=count, help=f"turns of each variant (default: {default.rounds}; on a GPU {GpuCfg.rounds})")
    add("--parts", nargs="+", choices=default.parts, default=default.parts, help="what to measure (default: all)")
    add("--quick", action="store_true", help="64 and 256 robots, half of the turns, no training: one minute")
    add(
        "--steps", type=whole, default=0, metavar="N", help="policy steps per turn; 0 = about 640 robot steps (default)"
    )
    add("--mjwarp-up-to", type=whole, metavar="N", help="most robots on MuJoCo-Warp; on a GPU, on it without a graph")
    add("--threads", type=whole, default=0, help="CPU threads of the simulation; 0 = all (default)")
    add("--device", default="cpu", help="cpu (default), or a GPU such as cuda:0, which has figures of its own")
    add("--policy", type=Path, default=DEFAULT_POLICY, help=f"policy that walks (default: {DEFAULT_POLICY.name})")
    add("--compare", type=Path, metavar="FILE", help="earlier result; exit with 1 if a ratio got worse")
    args = parser.parse_args(argv)
    quiet_libraries()
    from benchmarks.perf.pictures import breakdown_picture, cost_picture
    from benchmarks.perf.walks import NotWalkingError
    from mrwarp.rl.policy import OnnxPolicy, PolicyError
    from mrwarp.runtime import ProgressLine

    try:
        run = _gpu(args) if args.device != "cpu" else _cpu(args)
        before = load_ratios(args.compare) if args.compare else {}
        policy = OnnxPolicy(args.policy)
        check_writable(args.out)
    except (PolicyError, CompareError, ValueError, OSError) as error:
        print(f"mrwarp perf: {one_line(error)}", file=sys.stderr)
        return 2
    progress = ProgressLine(sys.stderr)
    try:
        figures = run(policy, progress)
    except NotWalkingError as error:
        progress.done()
        print(f"mrwarp perf: {one_line(error)}", file=sys.stderr)
        return 1
    progress.done()
    rows = compare(before, figures["ratios"])
    figures["date"] = date.today().isoformat()
    figures["compared"] = [{**vars(row), "regressed": row.regressed} for row in rows]
    args.out.mkdir(parents=True, exist_ok=True)
    if figures["walking"]:
        cost_picture(figures["walking"], args.out / "cost.png")
    if figures["walking"] and args.device == "cpu":
        breakdown_picture(figures["walking"], args.out / "breakdown.png")
    write_result(args.out, figures, seed=0, command="mrwarp perf " + shlex.join(argv))
    _print(figures)
    worse = [row for row in rows if row.regressed]
    for row in worse:
        print(f"REGRESSED {row.name}: {row.before:.3f} -> {row.now:.3f}, more than {row.tolerance:.0%} worse")
    if args.compare:
        print(f"{len(rows)} ratios compared with {args.compare}, {len(worse)} regressed")
    print(f"figures and pictures in {args.out}")
    return 1 if worse else 0


def _cpu(args: argparse.Namespace) -> Run:
    """What to measure on this machine's cores.

    Raises:
        ValueError: an option is out of range.
    """
    from benchmarks.perf.measure import run_all

    cfg = PerfCfg(
        rounds=PerfCfg.rounds if args.rounds is None else args.rounds, threads=args.threads, parts=tuple(args.parts),
        steps=args.steps,
    )  # fmt: skip
    if args.quick:
        cfg = replace(cfg, num_envs=(64, 256), rounds=max(2, cfg.rounds // 2), updates=0)
    if args.num_envs:
        cfg = replace(cfg, num_envs=tuple(sorted(set(args.num_envs))))
    if args.mjwarp_up_to is not None:
        cfg = replace(cfg, mjwarp_up_to=args.mjwarp_up_to)
    return lambda policy, progress: run_all(cfg, policy, progress)


def _gpu(args: argparse.Namespace) -> Run:
    """What to measure on a GPU.

    Raises:
        ValueError: an option is out of range, or there is no such device.
    """
    from benchmarks.perf.gpu import run_all

    cfg = GpuCfg(
        device="cuda:0" if args.device == "cuda" else args.device,
        rounds=GpuCfg.rounds if args.rounds is None else args.rounds, steps=args.steps or GpuCfg.steps,
        parts=tuple(part for part in args.parts if part in GpuCfg.parts),
    )  # fmt: skip
    if args.quick:
        cfg = replace(cfg, num_envs=(4096,), rounds=max(2, cfg.rounds // 2), updates=0)
    if args.num_envs:
        cfg = replace(cfg, num_envs=tuple(sorted(set(args.num_envs))))
    if args.mjwarp_up_to is not None:
        cfg = replace(cfg, eager_up_to=args.mjwarp_up_to)
    return lambda policy, progress: run_all(cfg, policy, progress)


def _print(figures: dict[str, Any]) -> None:
    """The table."""
    print(f"\n{', '.join(str(figures['device'][key]) for key in _NAMES if key in figures['device'])}\n")
    print(f"{'cost in units of':34s} {'median':>7s} {'quartiles':>15s}  limit")
    for name, row in figures["ratios"].items():
        limit = row["limit"]
        mark = "" if limit is None else f"{limit:.3f} {'ok' if row['median'] <= limit else 'MISSED'}"
        print(f"{name:34s} {row['median']:7.3f} {row['low']:7.3f} {row['high']:7.3f}  {mark}")
    for row in figures.get("targets", []):
        mark = "ok" if row["met"] else "MISSED"
        print(f"{row['figure']}: {row['value']:.4g} {row['unit']} (target {row['limit']:.4g}) {mark}")
    if "microseconds_per_robot_and_step" in figures.get("joint", {}):
        for part, row in figures["joint"]["microseconds_per_robot_and_step"].items():
            print(f"gates, Bouc-Wen, hold of a robot, {part}: {row['median']:.3f} µs per step on one core")
    for number, row in figures.get("training", {}).items():
        print(f"training, {number} robots: {row['steps_per_second']:.0f} policy steps/s")
