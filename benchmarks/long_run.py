"""Hours of walking with pushes and resets: ``python -m benchmarks.long_run --minutes 20``.

The training task (random robots, pushes, noise, episodes of 20 s) is walked by the exported policy for as long as the
wall time lasts. Along the way memory and step time are noted: neither may grow, and no number may go wrong.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np
import torch

from mrwarp.enums import ACTUATORS, TERRAINS
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
from mrwarp.runtime import quiet_libraries

_STEPS = 250
"""Policy steps between two notes: 5 s of every robot."""
_SETTLING = 0.1
"""Part of the run before memory counts: allocators and caches fill."""


@dataclass
class LongRun:
    """Figures of a long run."""

    num_envs: int
    robot_hours: float = 0.0
    """Simulated time of all robots together [h]."""
    minutes: float = 0.0
    """Wall time [min]."""
    falls: int = 0
    episodes: int = 0
    broken: int = 0
    """Policy steps of an environment in which a number went wrong."""
    not_finite: int = 0
    """Observations, rewards and actions that are no numbers."""
    at: list[float] = field(default_factory=list)
    """Wall time of each note [s]."""
    memory: list[float] = field(default_factory=list)
    """Resident memory at each note [MiB]."""
    step_ms: list[float] = field(default_factory=list)
    """Time of a policy step, 5 % quantile since the note before: other work on the machine only adds [ms]."""

    @property
    def memory_growth(self) -> float:
        """Memory at the end over that after the first tenth, minus 1; medians of a tenth of the notes."""
        return _growth(self.memory[int(_SETTLING * len(self.memory)) :])

    @property
    def step_growth(self) -> float:
        """Growth of the time of a step."""
        return _growth(self.step_ms[int(_SETTLING * len(self.step_ms)) :])

    def faults(self, *, hours: float, memory: float = 0.02, step: float = 0.1) -> list[str]:
        """Faults of the run.

        Args:
            hours: Fewest robot hours.
            memory: Largest growth of memory.
            step: Largest growth of the step time; on a shared machine it scatters by some percent.
        """
        found = []
        if self.robot_hours < hours:
            found.append(f"{self.robot_hours:.2f} robot hours are fewer than {hours:g}")
        if self.broken or self.not_finite:
            found.append(f"{self.broken} broken steps, {self.not_finite} values that are no numbers")
        if self.memory_growth > memory:
            found.append(f"memory grew by {100 * self.memory_growth:.1f} %")
        if self.step_growth > step:
            found.append(f"a step takes {100 * self.step_growth:.1f} % longer than at the start")
        return found


def _growth(values: list[float]) -> float:
    if len(values) < 2:
        return 0.0
    size = max(1, len(values) // 10)
    return float(np.median(values[-size:]) / np.median(values[:size]) - 1.0)


def walk_long(policy: OnnxPolicy, cfg: TaskCfg, *, seconds: float) -> LongRun:
    """Walk for a wall time.

    Args:
        policy: Walking policy.
        cfg: Training task; its seed is that of all draws.
        seconds: Wall time [s].
    """
    torch.manual_seed(cfg.seed)
    env, num_envs = WalkEnv(cfg), cfg.num_envs
    out, obs, begun = LongRun(num_envs=num_envs), env.get_observations(), time.perf_counter()
    reported = begun
    while time.perf_counter() - begun < seconds:
        times = np.empty(_STEPS)
        for k in range(_STEPS):
            start = time.perf_counter()
            action = policy(obs)
            obs, reward, done, _ = env.step(action)
            times[k] = time.perf_counter() - start
            out.episodes += int(done.sum())
            out.falls += int(env.fallen.sum())
            out.broken += int(env.diverged.sum())
            for x in (action, reward, obs["actor"], obs["critic"]):
                out.not_finite += int((~torch.isfinite(x)).sum())
        now = time.perf_counter()
        out.robot_hours += num_envs * _STEPS * env.cfg.step_dt / 3600.0
        out.minutes = (now - begun) / 60.0
        out.at.append(now - begun)
        out.memory.append(_resident())
        out.step_ms.append(1e3 * float(np.quantile(times, 0.05)))
        if now - reported > 30.0:
            reported = now
            print(
                f"{out.minutes:5.1f} min, {out.robot_hours:6.2f} robot hours, {out.memory[-1]:.0f} MiB, "
                f"{out.step_ms[-1]:.2f} ms a step, {out.falls} falls",
                flush=True,
            )
    return out


def _resident() -> float:
    """Resident memory of this process [MiB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def draw(run: LongRun, path: Path) -> None:
    """Picture of memory and step time over the run."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 5.0), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    minutes = np.array(run.at) / 60.0
    panels[0].plot(minutes, run.memory)
    panels[0].set_ylabel("resident memory [MiB]")
    panels[0].set_ylim(0.0, 1.1 * max(run.memory))
    panels[0].set_title(f"{run.robot_hours:.1f} robot hours, {run.num_envs} robots, {run.falls} falls")
    panels[1].plot(minutes, run.step_ms)
    panels[1].set_ylabel("policy step, 5 % quantile [ms]")
    panels[1].set_xlabel("wall time [min]")
    panels[1].set_ylim(0.0, 1.5 * float(np.median(run.step_ms)))
    figure.savefig(path, dpi=120)


def main(argv: list[str] | None = None) -> int:
    """Walk; 0 when nothing grew and nothing went wrong."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.long_run", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=20.0, help="wall time (default: 20)")
    parser.add_argument("--hours", type=float, default=8.0, help="fewest robot hours (default: 8)")
    parser.add_argument("--num-envs", type=int, default=64, help="robots (default: 64)")
    parser.add_argument("--seed", type=int, default=0, help="of all draws (default: 0)")
    parser.add_argument("--actuator", choices=ACTUATORS, default="bouc_wen", help="torque model (default: bouc_wen)")
    parser.add_argument("--terrain", choices=TERRAINS, default="flat", help="ground (default: flat)")
    parser.add_argument("--policy", default=DEFAULT_POLICY, help="exported walking policy")
    parser.add_argument("--out", type=Path, default=Path("out/long_run"), help="folder (default: out/long_run)")
    args = parser.parse_args(argv)
    quiet_libraries(gpu=False)
    args.out.mkdir(parents=True, exist_ok=True)
    cfg = TaskCfg(
        num_envs=args.num_envs,
        seed=args.seed,
        actuator=args.actuator,
        terrain=args.terrain,
    )
    run = walk_long(OnnxPolicy(args.policy), cfg, seconds=60.0 * args.minutes)
    grown = {"memory_growth": run.memory_growth, "step_growth": run.step_growth}
    (args.out / "long_run.json").write_text(json.dumps({**asdict(run), **grown}, indent=1) + "\n")
    draw(run, args.out / "long_run.png")
    faults = run.faults(hours=args.hours)
    print(
        f"{run.robot_hours:.1f} robot hours in {run.minutes:.1f} min: memory {100 * run.memory_growth:+.2f} %, step "
        f"{100 * run.step_growth:+.1f} %, {run.falls} falls in {run.episodes} episodes, {run.broken} broken"
    )
    for fault in faults:
        print(fault)
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
