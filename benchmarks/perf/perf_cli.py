"""``mrwarp perf``: what a step costs, part by part, and whether that got worse."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from typing import Any

from benchmarks.perf import gpu, measure
from benchmarks.perf.compare import compare, load_ratios
from benchmarks.perf.perf_cfg import GpuCfg, PerfCfg
from benchmarks.perf.pictures import breakdown_picture, cost_picture
from mrwarp.commands.run_benchmarks import Perf
from mrwarp.options.command_line import CommandLine
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import duration

Run = Callable[[Any, Callable[[str, float], None]], dict[str, Any]]
"""Measures with a policy, and reports the current measurement and the share that is done."""

_NAMES = ("name", "machine", "processor")


def run(options: Perf, line: CommandLine) -> int:
    """Time physics, joints, environment and training, walking; 0 done, 1 a ratio regressed (--compare), 2 bad input."""
    measured = _gpu(options) if options.device != "cpu" else _cpu(options)
    before = load_ratios(options.compare) if options.compare else {}
    policy = OnnxPolicy(options.policy)
    check_writable(options.out)
    progress = ProgressBar(sys.stderr)
    try:
        figures = measured(policy, progress)
    finally:
        progress.done()
    rows = compare(before, figures["ratios"])
    figures["date"] = date.today().isoformat()
    figures["compared"] = [{**vars(row), "regressed": row.regressed} for row in rows]
    options.out.mkdir(parents=True, exist_ok=True)
    if figures["walking"]:
        cost_picture(figures["walking"], options.out / "cost.png")
    if figures["walking"] and options.device == "cpu":
        breakdown_picture(figures["walking"], options.out / "breakdown.png")
    write_result(options.out, figures, seed=0, command=str(line))
    _print(figures)
    worse = [row for row in rows if row.regressed]
    for row in worse:
        print(f"REGRESSED {row.name}: {row.before:.3f} -> {row.now:.3f}, more than {row.tolerance:.0%} worse")
    if options.compare:
        print(f"{len(rows)} ratios compared with {options.compare}, {len(worse)} regressed")
    print(f"figures and pictures in {options.out}")
    return 1 if worse else 0


def _cpu(options: Perf) -> Run:
    """Measurements on this machine's cores.

    Raises:
        ValueError: an option is out of range.
    """
    rounds = PerfCfg.rounds if options.rounds is None else options.rounds
    cfg = PerfCfg(rounds=rounds, threads=options.threads, parts=options.parts, steps=options.steps)
    if options.quick:
        cfg = replace(cfg, num_envs=(64, 256), rounds=max(2, cfg.rounds // 2), updates=0)
    if options.num_envs:
        cfg = replace(cfg, num_envs=tuple(sorted(set(options.num_envs))))
    if options.mjwarp_up_to is not None:
        cfg = replace(cfg, mjwarp_up_to=options.mjwarp_up_to)
    parts = cfg.estimate()
    planned = ", ".join(f"{name} {duration(seconds)}" for name, seconds in parts.items())
    print(f"to measure: {planned}; about {duration(sum(parts.values()))} on two idle cores", flush=True)
    return lambda policy, progress: measure.run_all(cfg, policy, progress)


def _gpu(options: Perf) -> Run:
    """Measurements on a GPU.

    Raises:
        ValueError: an option is out of range, or there is no such device.
    """
    cfg = GpuCfg(
        device="cuda:0" if options.device == "cuda" else options.device,
        rounds=GpuCfg.rounds if options.rounds is None else options.rounds,
        steps=options.steps or GpuCfg.steps,
        parts=tuple(part for part in options.parts if part in GpuCfg.parts),
    )
    if options.quick:
        cfg = replace(cfg, num_envs=(4096,), rounds=max(2, cfg.rounds // 2), updates=0)
    if options.num_envs:
        cfg = replace(cfg, num_envs=tuple(sorted(set(options.num_envs))))
    if options.mjwarp_up_to is not None:
        cfg = replace(cfg, eager_up_to=options.mjwarp_up_to)
    return lambda policy, progress: gpu.run_all(cfg, policy, progress)


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
