"""Rollouts of many policies in one batch on one plant: velocity, height and attitude of each."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np
import torch

from mrwarp.enums import Coupling
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.runtime import one_torch_thread
from mrwarp.trials.power_meter import MotionMeter
from mrwarp.trials.walking import Policy, act, make_env, same_starts
from paper.study.plan import AWARE, SEEDS, STUDY, check_seeds

PLANT = AWARE
"""Torque model of the plant that all policies are evaluated on: the most accurate one."""

METRICS = {
    "v_x_rmse": "m/s",  # root of the mean squared error of the forward speed in the heading frame, every 20 ms
    "v_x_bias": "m/s",  # mean error of the forward speed, positive if too fast
    "height": "m",  # mean trunk height, the paper's proxy of the centre of mass
    "height_rmse": "m",  # about the height that the reward asks for
    "tilt_rms": "deg",  # root of mean roll^2 + pitch^2
    "yaw_rate_rmse": "rad/s",  # root of the mean squared yaw rate; the command is 0
}
"""Measured figures of a rollout and their units."""


class Meter(Protocol):
    """Measures rollouts, a call after every policy step."""

    def add(self, counted: torch.Tensor) -> None:
        """Add the policy step that has just been simulated, of these environments; bool, shape (E,)."""
        ...

    def figures(self) -> dict[str, np.ndarray]:
        """Figures by name, shape (E,)."""
        ...


@dataclass(frozen=True, kw_only=True)
class EvaluationCfg:
    """Which policies are rolled out, and how."""

    folder: Path = STUDY
    """Policies, as :func:`paper.study.matched_training.collect` leaves them."""
    seeds: tuple[int, ...] = SEEDS
    """Training seeds."""
    rollouts: int = 3
    """Rollouts per policy, from random poses and gait phases that are the same for every policy."""
    seed: int = 0
    """Seed of their poses and gait phases."""
    plant: str = PLANT
    """Plant that all policies walk on, one of :data:`paper.study.plan.PLANTS`."""
    coupling: Coupling = Coupling.EXPLICIT
    """How its devices act: the paper's torque, or a brake that sticks."""
    terrain: str = "flat"
    """Ground; on rough ground a multiple of 36 rollouts covers every level and kind equally."""
    speed: float = 0.5
    """Commanded speed [m/s]."""
    warmup: float = 2.0
    """Walking before the measurement [s]."""
    seconds: float = 20.0
    """Measured time [s]."""
    threads: int = 0
    """CPU threads of the physics; 0 = all. The figures are the same for any number."""

    def __post_init__(self) -> None:
        check_seeds(self.seeds)
        if self.rollouts < 1:
            raise ValueError(f"rollouts = {self.rollouts} must be at least 1")
        if not (self.seconds > 0.0 and self.warmup >= 0.0):
            raise ValueError(f"seconds = {self.seconds} must be positive and warmup = {self.warmup} not negative")


@dataclass(frozen=True, kw_only=True)
class Measured:
    """Figures of the rollouts of each policy; arrays of shape (policies, rollouts)."""

    figures: dict[str, np.ndarray]
    """By metric; up to the fall, or NaN if the rollout never began."""
    fell: np.ndarray
    """Whether the rollout fell, bool."""


@torch.no_grad()
@one_torch_thread()
def roll_out(
    cfg: EvaluationCfg,
    plant: TaskCfg,
    policies: Sequence[Policy],
    currents: Sequence[float],
    report: Callable[[float], None] | None = None,
    *,
    further: Callable[[WalkEnv], Meter] | None = None,
) -> Measured:
    """Roll policies out side by side.

    Args:
        cfg: How; its folder, seeds, plant, terrain and threads are the caller's business.
        plant: What they walk on; the nominal robot without noise.
        policies: One policy per row.
        currents: Current its devices may use [A]; 0 is SAL off. Same length.
        report: Called now and then with the share that is done.
        further: Makes a meter whose figures are added to those of :data:`METRICS`.
    """
    count = len(policies)
    env = make_env(plant, count * cfg.rollouts, cfg.seed)
    same_starts(env, cfg.rollouts, cfg.seed)
    env.current_e.copy_(torch.tensor(currents, dtype=torch.float32, device=env.device).repeat_interleave(cfg.rollouts))
    command = torch.zeros(env.num_envs, 3, device=env.device)
    command[:, 0] = cfg.speed
    env.set_command(command)
    obs, motion = env.get_observations(), MotionMeter(env, command)
    meters: list[Meter] = [motion, *([further(env)] if further else [])]
    going = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
    skip, steps = round(cfg.warmup / env.cfg.step_dt), round(cfg.seconds / env.cfg.step_dt)
    for step in range(skip + steps):
        obs, _, _, _ = env.step(act(policies, obs))
        env.set_command(command)
        going = going & ~env.fallen
        if step >= skip:
            for meter in meters:
                meter.add(going)
        if report and step % 100 == 99:
            report((step + 1) / (skip + steps))
    measured = motion.figures()
    kept = {name: measured[name] for name in METRICS}
    for meter in meters[1:]:
        kept |= meter.figures()
    fell = ~going.reshape(count, cfg.rollouts).cpu().numpy()
    return Measured(figures={name: values.reshape(count, cfg.rollouts) for name, values in kept.items()}, fell=fell)
