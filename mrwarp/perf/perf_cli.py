"""``mrwarp perf``: what a step costs, part by part, and whether that got worse."""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

from mrwarp.folder import check_writable
from mrwarp.quiet import quiet_libraries
from mrwarp.results import write_result


def main(argv: list[str] | None = None) -> int:
    """Time physics, joints, environment and training, walking; 0 done, 1 a ratio regressed (--compare), 2 bad input."""
    from mrwarp.evaluate.energy_cli import Progress
    from mrwarp.perf.compare import CompareError, compare, load_ratios
    from mrwarp.perf.measure import PerfCfg, run_all
    from mrwarp.perf.pictures import breakdown_picture, cost_picture
    from mrwarp.perf.walks import NotWalkingError
    from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy, PolicyError

    argv = sys.argv[1:] if argv is None else argv
    default = PerfCfg()
    parser = argparse.ArgumentParser(prog="mrwarp perf", description=main.__doc__)
    add = parser.add_argument
    add("--out", type=Path, default=Path("runs/perf"), help="output folder (default: runs/perf)")
    counts = " ".join(map(str, default.num_envs))
    add("--num-envs", type=int, nargs="+", metavar="N", help=f"numbers of robots (default: {counts})")
    add("--rounds", type=int, default=default.rounds, help=f"turns of each variant (default: {default.rounds})")
    add("--parts", nargs="+", choices=default.parts, default=default.parts, help="what to measure (default: all)")
    add("--quick", action="store_true", help="64 and 256 robots, half of the turns, no training: one minute")
    add("--steps", type=int, default=0, metavar="N", help="policy steps per turn; 0 = about 640 robot steps")
    add("--mjwarp-up-to", type=int, default=default.mjwarp_up_to, metavar="N", help="most robots on MuJoCo-Warp")
    add("--threads", type=int, default=0, help="CPU threads of the simulation; 0 = all")
    add("--device", default="cpu", help="only cpu for now: the GPU's figures need a machine with one")
    add("--policy", type=Path, default=DEFAULT_POLICY, help=f"policy that walks (default: {DEFAULT_POLICY.name})")
    add("--compare", type=Path, metavar="FILE", help="earlier result; exit with 1 if a ratio got worse")
    args = parser.parse_args(argv)
    quiet_libraries()
    try:
        if args.device != "cpu":
            raise ValueError(f"--device {args.device}: only cpu is benchmarked; leave it out")
        if args.threads < 0:
            raise ValueError(f"--threads {args.threads} must be 0 (all) or more")
        cfg = replace(
            default, rounds=args.rounds, threads=args.threads, parts=tuple(args.parts), steps=args.steps,
            mjwarp_up_to=args.mjwarp_up_to,
        )  # fmt: skip
        if args.quick:
            cfg = replace(cfg, num_envs=(64, 256), rounds=max(2, args.rounds // 2), updates=0)
        if args.num_envs:
            cfg = replace(cfg, num_envs=tuple(sorted(set(args.num_envs))))
        before = load_ratios(args.compare) if args.compare else {}
        policy = OnnxPolicy(args.policy)
        check_writable(args.out)
    except (PolicyError, CompareError, ValueError, OSError) as error:
        print(f"mrwarp perf: {error}", file=sys.stderr)
        return 2
    progress = Progress(sys.stderr)
    try:
        figures = run_all(cfg, policy, progress)
    except NotWalkingError as error:
        progress.done()
        print(f"mrwarp perf: {error}", file=sys.stderr)
        return 1
    progress.done()
    rows = compare(before, figures["ratios"])
    figures["date"] = date.today().isoformat()
    figures["compared"] = [{**vars(row), "regressed": row.regressed} for row in rows]
    args.out.mkdir(parents=True, exist_ok=True)
    if figures["walking"]:
        cost_picture(figures["walking"], args.out / "cost.png")
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


def _print(figures: dict[str, Any]) -> None:
    """The table."""
    print(f"\n{figures['device']['machine']}, {figures['device']['processor']}\n")
    print(f"{'cost in units of':34s} {'median':>7s} {'quartiles':>15s}  limit")
    for name, row in figures["ratios"].items():
        limit = row["limit"]
        mark = "" if limit is None else f"{limit:.3f} {'ok' if row['median'] <= limit else 'MISSED'}"
        print(f"{name:34s} {row['median']:7.3f} {row['low']:7.3f} {row['high']:7.3f}  {mark}")
    if "joint" in figures:
        for part, row in figures["joint"]["microseconds_per_robot_and_step"].items():
            print(f"gates, Bouc-Wen, hold of a robot, {part}: {row['median']:.3f} µs per step on one core")
    for count, row in figures.get("training", {}).items():
        print(f"training, {count} robots: {row['steps_per_second']:.0f} policy steps/s")
