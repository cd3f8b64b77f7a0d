"""Rollouts of many policies in one batch on one plant: velocity, height and attitude of each (tables 2 and 3).

The rollouts of a training seed are averaged first, as in the paper. :func:`causes` changes the plant step by step, to
show where a policy's velocity error comes from.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch

from mrwarp.enums import Coupling, ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.resources import policy_file
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.runtime import one_torch_thread
from mrwarp.trials.power_meter import MotionMeter
from mrwarp.trials.walking import Policy, act, make_env, same_starts
from paper.study.plan import AWARE, CONVENTIONAL, SEEDS, STUDY, check_seeds, plant_cfg

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


Report = Callable[[float], None]

CURRENT = 1.5
"""Current that the devices may use with SAL on [A], table 2."""


@dataclass(frozen=True, kw_only=True)
class EvaluationCfg:
    """Which policies are rolled out, and how."""

    folder: Path = STUDY
    """Policies, as :func:`paper.study.matched_training.collect` leaves them; conventional ones, whose robot has no
    devices, may stand in :data:`STUDY` alone."""
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
    report: Report | None = None,
) -> Measured:
    """Roll policies out side by side.

    Args:
        cfg: How; its folder, seeds, plant and threads are the caller's business.
        plant: What they walk on; the nominal robot without noise.
        policies: One policy per row.
        currents: Current its devices may use [A]; 0 is SAL off. Same length.
        report: Called now and then with the share that is done.
    """
    count = len(policies)
    env = make_env(plant, count * cfg.rollouts, cfg.seed)
    same_starts(env, cfg.rollouts, cfg.seed)
    env.current_e.copy_(torch.tensor(currents, dtype=torch.float32, device=env.device).repeat_interleave(cfg.rollouts))
    command = torch.zeros(env.num_envs, 3, device=env.device)
    command[:, 0] = cfg.speed
    env.set_command(command)
    obs, motion = env.get_observations(), MotionMeter(env, command)
    going = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
    skip, steps = round(cfg.warmup / env.cfg.step_dt), round(cfg.seconds / env.cfg.step_dt)
    for step in range(skip + steps):
        obs, _, _, _ = env.step(act(policies, obs))
        env.set_command(command)
        going = going & ~env.fallen
        if step >= skip:
            motion.add(going)
        if report and step % 100 == 99:
            report((step + 1) / (skip + steps))
    measured = motion.figures()
    kept = {name: measured[name] for name in METRICS}
    fell = ~going.reshape(count, cfg.rollouts).cpu().numpy()
    return Measured(figures={name: values.reshape(count, cfg.rollouts) for name, values in kept.items()}, fell=fell)


@dataclass(frozen=True, kw_only=True)
class PolicyRow:
    """Policies of one training under one condition."""

    plant: str
    """Plant that they were trained on, one of :data:`paper.study.plan.PLANTS`."""
    current: float
    """Current that the devices may use [A]; 0 is SAL off."""
    seeds: dict[str, np.ndarray]
    """Average over its rollouts of each seed, by metric, shape (seeds,); see :data:`METRICS` for units."""
    rollouts: dict[str, np.ndarray]
    """The single rollouts, by metric, shape (seeds, rollouts)."""
    fell: int
    """Rollouts that fell."""


def evaluate(
    cfg: EvaluationCfg, cells: Sequence[tuple[str, float]], report: Report | None = None, *, env: TaskCfg | None = None
) -> list[PolicyRow]:
    """Roll out the policies of several trainings in one batch.

    Args:
        cfg: Which policies, and how they are rolled out.
        cells: Training plant, and current that the devices may use [A].
        report: Called with the share that is done.
        env: What they walk on; None takes the plant of ``cfg``.

    Returns:
        A row for each cell. A seed's average leaves out rollouts without figures.

    Raises:
        PolicyError: a policy is missing or unreadable.
    """
    loaded = {name: [OnnxPolicy(_file(cfg, name, seed)) for seed in cfg.seeds] for name, _ in cells}
    policies = [policy for name, _ in cells for policy in loaded[name]]
    currents = [current for _, current in cells for _ in cfg.seeds]
    env = env or plant_cfg(cfg.plant, threads=cfg.threads, coupling=cfg.coupling)
    found = roll_out(cfg, env, policies, currents, report)
    rows = []
    for k, (plant, current) in enumerate(cells):
        own = slice(k * len(cfg.seeds), (k + 1) * len(cfg.seeds))
        single = {metric: values[own] for metric, values in found.figures.items()}
        averages = {metric: np.nanmean(values, axis=1) for metric, values in single.items()}
        fell = int(found.fell[own].sum())
        rows.append(PolicyRow(plant=plant, current=current, seeds=averages, rollouts=single, fell=fell))
    return rows


def _file(cfg: EvaluationCfg, plant: str, seed: int) -> Path:
    own = policy_file(cfg.folder, plant, seed)
    return own if own.is_file() or plant != CONVENTIONAL else policy_file(STUDY, plant, seed)


STEPS = {
    "go1": "Go1",
    "mass": "MR_Go's masses, no devices",
    "drag": "and the devices' drag at 0 A",
    "damping": "and damping at 1.5 A",
    "holding": "and holding alone at 1.5 A",
    "both": "and both",
}
"""Plants, each one thing further from Go1 than the one before."""


def causes(cfg: EvaluationCfg, plants: Sequence[str], report: Report | None = None) -> dict[str, dict[str, PolicyRow]]:
    """Roll the policies of some trainings out on every plant, with the Bouc-Wen device, see :func:`evaluate`.

    Returns:
        Rows by training plant and step of :data:`STEPS`.
    """
    rows: dict[str, dict[str, PolicyRow]] = {plant: {} for plant in plants}
    for k, step in enumerate(STEPS):
        env, current = step_plant(step, cfg)
        for row in evaluate(cfg, [(plant, current) for plant in plants], env=env):
            rows[row.plant][step] = row
        if report:
            report((k + 1) / len(STEPS))
    return rows


def step_plant(step: str, cfg: EvaluationCfg) -> tuple[TaskCfg, float]:
    """The task on the plant of a step, and the current its devices may use [A]."""
    if step == "go1":
        return TaskCfg(robot="go1", actuator="none", sal=False, threads=cfg.threads), 0.0
    if step == "mass":
        return TaskCfg(actuator="none", sal=False, threads=cfg.threads), 0.0
    env = TaskCfg(z_step=ZStep.EULER, threads=cfg.threads, coupling=cfg.coupling)
    if step == "drag":
        return env, 0.0
    return replace(env, damping=step != "holding", holding=step != "damping"), CURRENT
