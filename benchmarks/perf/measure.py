"""All benchmarks in one run, and the ratios that are kept and compared."""

from __future__ import annotations

import os
import platform
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
import warp as wp

from benchmarks.perf import c_loop, training
from benchmarks.perf.perf_cfg import AIMED_AT, PerfCfg
from benchmarks.perf.timing import Spread, Times, interleave, ratio
from benchmarks.perf.walks import Walk
from mrwarp.trials.walking import Policy

PARTS = {
    "physics": "mujoco.batch, plain",
    "beside": "the same between other work",
    "joint": "joints, solver check, ledger",
    "task": "rewards, observations, resets",
}
"""Parts of a walking step, from the bottom of the picture to its top."""

BRACKETED = ("pd", "bouc_wen", "explicit", "lstm", "lstm_window")
"""Robots on ``mujoco.batch``, of :data:`benchmarks.perf.walks.VARIANTS`."""

LIMITS = {
    "bouc_wen/pd": 1.10,
    "env/plain": 1.0 / 0.70,
    "lstm env/plain": 1.0 / 0.60,
    "kernels/c": 1.5,
    "learn share": 1.0 / 3.0,
}
"""Targets of the ratios, by the name before ``@``: costs, so less is better."""

FEW = 64
"""Robots that get going from the stance; more begin as copies of them."""


def device() -> dict[str, Any]:
    """The machine that made the figures."""
    return {
        "machine": f"{os.cpu_count()}-core {platform.machine()} CPU",
        "processor": _processor(),
        "cuda": [str(found.name) for found in wp.get_cuda_devices()],
        "torch_threads": torch.get_num_threads(),
    }


def run_all(cfg: PerfCfg, policy: Policy, progress: Callable[[str, float], None]) -> dict[str, Any]:
    """Measure; figures, ratios by ``name @robots`` and the rows of the table.

    Args:
        cfg: What to measure.
        policy: Policy that walks the robots.
        progress: Called with what is measured and the share of it that is done.

    Raises:
        NotWalkingError: what was timed does not walk.
    """
    figures: dict[str, Any] = {"device": device(), "walking": {}, "ratios": {}}
    ratios: dict[str, Spread] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "walking" in cfg.parts:
            for count in cfg.num_envs:
                found, own = walking(cfg, count, policy, lambda s, n=count: progress(f"walking, {n} robots", s))
                figures["walking"][str(count)] = found
                ratios |= own
        if "joint" in cfg.parts:
            figures["joint"], own = joint(cfg, folder, lambda share: progress("joint, one core", share))
            ratios |= own
        if "training" in cfg.parts and cfg.updates:
            for count in [n for n in cfg.num_envs if n in AIMED_AT]:
                figures.setdefault("training", {})[str(count)] = found = training.measure(
                    folder / f"train{count}",
                    num_envs=count,
                    updates=cfg.updates,
                    threads=cfg.threads,
                    progress=lambda share, n=count: progress(f"training, {n} robots", share),
                )
                ratios[f"learn share @{count}"] = Spread(**found["learn_share"])
    figures["ratios"] = {name: {**value.plain(), "limit": limit_of(name)} for name, value in ratios.items()}
    return figures


def limit_of(name: str) -> float | None:
    """Limit of a ratio, or None."""
    base, _, count = name.partition(" @")
    return LIMITS.get(base) if not count or int(count) in AIMED_AT else None


def walking(
    cfg: PerfCfg, count: int, policy: Policy, progress: Callable[[float], None]
) -> tuple[dict[str, Any], dict[str, Spread]]:
    """Plain physics, plain motors, Bouc-Wen in both couplings, the LSTM residual, and MuJoCo-Warp, walking."""
    steps, rounds = cfg.turns(count)
    walks = {name: _walk(name, cfg, count, steps, policy) for name in BRACKETED}
    if count <= cfg.mjwarp_up_to:
        for name in ("mjwarp_eager", "mjwarp_captured"):
            few = max(1, steps // 5)
            walks[name] = Walk(name, policy, num_envs=count, steps=few, seconds=0.2, like=walks["bouc_wen"])
    turns = {"plain": walks["bouc_wen"].plain_turn, "pd_plain": walks["pd"].plain_turn}
    turns |= {name: walk.turn for name, walk in walks.items()}
    times = interleave(turns, rounds=rounds, progress=progress)
    checks = {name: walk.check() for name, walk in walks.items()}
    at = f" @{count}"
    ratios = {
        f"bouc_wen/pd{at}": ratio(times, "bouc_wen.robot", "pd.robot"),
        f"explicit/pd{at}": ratio(times, "explicit.robot", "pd.robot"),
        f"env/plain{at}": ratio(times, "bouc_wen.env", "plain.plain"),
        f"lstm env/plain{at}": ratio(times, "lstm.env", "plain.plain"),
        f"lstm window env/plain{at}": ratio(times, "lstm_window.env", "plain.plain"),
    }
    if "mjwarp_eager" in walks:
        ratios[f"mjwarp captured/eager{at}"] = ratio(times, "mjwarp_captured.robot", "mjwarp_eager.robot")
        ratios[f"mjwarp captured/mjbatch{at}"] = ratio(times, "mjwarp_captured.robot", "bouc_wen.robot")
    found = {
        "steps_per_turn": steps,
        "seconds": {part: Spread.of(values).plain() for part, values in times.items()},
        "breakdown": {name: breakdown(times, name) for name in BRACKETED},
        "checks": checks,
    }
    return found, ratios


def _walk(name: str, cfg: PerfCfg, count: int, steps: int, policy: Policy) -> Walk:
    """Robots that walk; many of them begin as copies of a few that do, to save the time of getting going."""
    few = Walk(name, policy, num_envs=min(count, FEW), threads=cfg.threads, steps=steps)
    if count <= FEW:
        return few
    return Walk(name, policy, num_envs=count, threads=cfg.threads, steps=steps, seconds=0.3, like=few)


def breakdown(times: Times, name: str) -> dict[str, float]:
    """Median seconds per policy step of :data:`PARTS`; plain physics is that of the robot's own kind."""
    plain = Spread.of(times["pd_plain.plain" if name in ("pd", "explicit") else "plain.plain"]).median
    physics, robot, env = (Spread.of(times[f"{name}.{part}"]).median for part in ("physics", "robot", "env"))
    return {"physics": plain, "beside": physics - plain, "joint": robot - physics, "task": env - robot}


def joint(cfg: PerfCfg, folder: Path, progress: Callable[[float], None]) -> tuple[dict[str, Any], dict[str, Spread]]:
    """Gates, coil, history, Bouc-Wen and hold of four calves on one core, and the same loop in C."""
    count = 256
    robot = c_loop.mixed_robots(count)
    try:
        loop = c_loop.CLoop(robot, folder)
    except c_loop.NoCompilerError as error:
        loop, skipped = None, str(error)
    else:
        skipped = ""
    difference = c_loop.largest_difference(robot, loop) if loop is not None else None
    times = interleave(c_loop.turns(robot, loop, repeat=100), rounds=2 * cfg.rounds, progress=progress)
    per_robot = {part: Spread.of(1e6 * t / count for t in values).plain() for part, values in times.items()}
    found = {
        "num_envs": count, "microseconds_per_robot_and_step": per_robot, "largest_difference": difference,
        "c_skipped": skipped,
    }  # fmt: skip
    return found, {"kernels/c": ratio(times, "kernels.step", "c.step")} if loop is not None else {}


def _processor() -> str:
    """Name of the processor, where Linux reports it."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.is_file() else []
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")
