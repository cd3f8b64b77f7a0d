"""A training, all of it: the task, how networks learn it, and how long.

Command lines are read from it, so that it loads no engine.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from tyro.conf import Fixed

from mrwarp.env.cfg import TaskCfg
from mrwarp.options import option_types as opt
from mrwarp.rl.ppo_cfg import PpoCfg


@dataclass(frozen=True, kw_only=True)
class RunCfg:
    """Length of a training, and its files."""

    out: opt.Folder = Path("runs/walk")
    """output folder: checkpoint, policy, curves and result"""
    iterations: opt.Count = 6000
    """most PPO updates"""
    no_gate: opt.Flag = False
    """run all iterations instead of stopping at the walking gate"""
    save_every: opt.NotNegative = 30.0
    """time between checkpoints [s]"""
    check_every: Fixed[float] = 20.0
    """Least time between two gate checks [s]."""
    check_below: Fixed[float] = 0.14
    """Gate checks begin when the training's own v_x RMSE falls below this [m/s]."""
    command: Fixed[str] = ""
    """Command line, for the record."""


@dataclass(frozen=True, kw_only=True)
class TrainCfg:
    """One training; ``task.seed`` is the seed of networks, exploration and environment.

    Example:
        >>> from mrwarp.env.cfg import TaskCfg
        >>> from mrwarp.rl.train_cfg import RunCfg, TrainCfg
        >>> TrainCfg(task=TaskCfg(num_envs=16), run=RunCfg(iterations=10)).task.episode_steps
        1000
    """

    task: TaskCfg = field(default_factory=TaskCfg)
    ppo: PpoCfg = field(default_factory=PpoCfg)
    run: RunCfg = field(default_factory=RunCfg)
