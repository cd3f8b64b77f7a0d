"""A training iteration split into collecting and learning."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.perf.timing import Spread
from mrwarp.env.cfg import TaskCfg
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer
from mrwarp.runtime import one_torch_thread


def measure(
    out: Path,
    *,
    num_envs: int,
    updates: int,
    threads: int = 0,
    device: str = "cpu",
    progress: Callable[[float], None] | None = None,
) -> dict[str, Any]:
    """The first updates of a training from scratch; the first two are not counted.

    Args:
        out: Folder for what a training writes.
        num_envs: Robots.
        updates: Counted updates.
        threads: CPU threads of the simulation; 0 = all.
        device: Warp device.
        progress: Called with the share that is done.

    Returns:
        Spread of ``collect`` and ``learn`` [s] and of ``learn_share``, and ``steps_per_second``.
    """
    env = TaskCfg(num_envs=num_envs, threads=threads, device=device)
    trainer = Trainer(TrainCfg(task=env, run=RunCfg(out=out, iterations=updates + 2, no_gate=True)))
    trainer.timed = True
    collect, learn = [], []
    with one_torch_thread():
        for k in range(updates + 2):
            trainer.update()
            last = trainer.progress.window[-1]
            if k >= 2:
                collect.append(1e-3 * last["collect_ms"])
                learn.append(1e-3 * last["learn_ms"])
            if progress is not None:
                progress((k + 1) / (updates + 2))
    steps = trainer.ppo_cfg["num_steps_per_env"] * num_envs
    spent = Spread.of(c + n for c, n in zip(collect, learn, strict=True))
    return {
        "collect": Spread.of(collect).plain(),
        "learn": Spread.of(learn).plain(),
        "learn_share": Spread.of(n / (c + n) for c, n in zip(collect, learn, strict=True)).plain(),
        "steps_per_second": steps / spent.median,
        "value_loss_finite": trainer.progress.window[-1]["value_loss"] < float("inf"),
    }
