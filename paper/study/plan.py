"""Which policies the studies of section 6.2 compare, on which plants they are trained, and where their files lie."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mrwarp.enums import (  # noqa: F401  (the names of the plants, declared where command lines can read them)
    AWARE,
    CONVENTIONAL,
    EXPLICIT,
    MODELS,
    PAYING,
    PLANTS,
    PUBLIC,
    TRAINABLE,
    USUAL_HEIGHT,
    Coupling,
    ZStep,
)
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import make_randomize_cfg, make_terrain_cfg
from mrwarp.resources import POLICIES, policy_file
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.usd.robot import CURRENT_GROUPS, PUBLIC_GAINS

SEEDS = (0, 1, 2, 3, 4)
"""Training seeds of every plant: three spread the saving of tables 6 and 7 by half of itself."""

POWER_PRICE = 0.002
"""Price of a watt of motors and coils for the robots of tables 6 and 7 [1/W]. The paper says of its reward terms only
that they were matched; what a price changes is in docs/paper_checks.md."""

HEIGHT = -300.0
"""Weight of the squared error of the trunk's height there: with the usual -40, a robot that pays for power walks with
straighter legs, and one with soft motors may sag."""

TILT = -100.0
"""Weight of the tilt in all trainings of the paper's tables: with the usual -3, a lean of 4 degrees costs 0.015 of a
reward of 4 and stays; with this, it costs half a unit."""

LOAD = (-0.5, 3.5)
"""Mass added to the trunk there [kg]: tables 6 and 7 are walked with 0 and 3 kg."""

SOFT = (PUBLIC, USUAL_HEIGHT)
"""Plants with the gains of the public description."""

WALKERS = {"go1": CONVENTIONAL, **dict.fromkeys(("mr_go", "mr_go_sal", EXPLICIT), "bouc_wen")}
"""The plants of tables 2 and 3 with whose policies the robots of tables 6 and 7 begin: they walk, and know no price."""

RANDOMIZE = "ground"
"""Randomisation between environments in the studies' trainings: the paper (section 6.2) lists what it matched between
policies and names no randomisation of robot or device, so it is what legged_gym randomises by default."""

STUDY = POLICIES / "study"
"""Shipped policies of the studies, trained with the paper's explicit torque, with their training records."""

BRAKE = POLICIES / "study_brake"
"""Shipped actuator-aware policies that were trained with the brake constraint, with their training records."""


@dataclass(frozen=True, kw_only=True)
class StudyCfg:
    """Choices that all trainings share: everything but plant and seed."""

    num_envs: int = 64
    """Parallel environments."""
    iterations: int = 800
    """PPO updates, the same for every policy."""
    terrain: str = "flat"
    """Ground and its curriculum."""
    randomize: str = RANDOMIZE
    """Randomisation between the environments, the same for every plant."""
    coupling: Coupling = Coupling.EXPLICIT
    """How the devices act: the paper's torque, or a brake that sticks; the robots of tables 6 and 7 have their own."""
    power_price: float = POWER_PRICE
    """Price of a watt [1/W]; only the robots of tables 6 and 7 pay it."""
    learning: PpoCfg = field(default_factory=PpoCfg)
    """How fast the networks learn."""
    start_from: Path | None = None
    """Folder of policies or of runs that the trainings begin with, each with that of its plant and seed; None draws
    networks."""
    seeds: tuple[int, ...] = SEEDS
    """Training seeds."""
    plants: tuple[str, ...] = field(default=PLANTS)
    """Which plants to train on."""

    def __post_init__(self) -> None:
        check_seeds(self.seeds)
        if unknown := [name for name in self.plants if name not in TRAINABLE]:
            raise ValueError(f"plants = {unknown}: choose from {', '.join(TRAINABLE)}")
        if self.iterations < 1:
            raise ValueError(f"iterations = {self.iterations} must be at least 1")
        if not 0.0 <= self.power_price < math.inf:
            raise ValueError(f"power_price = {self.power_price} 1/W must be finite and not negative")


def check_seeds(seeds: Sequence[int]) -> None:
    """Raise ValueError where a training seed is named twice: two of one training are one value, with no spread."""
    if not seeds or len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds = {tuple(seeds)}: name each training seed once, at least one")


def name(plant: str, seed: int) -> str:
    """Name of a policy's files, without ending."""
    return f"{plant}_seed{seed}"


def start_file(folder: Path, plant: str, seed: int) -> Path:
    """File that a training begins with: the checkpoint of its run there, with the critic, or else its policy.

    A robot that pays for power begins with :data:`WALKERS` where the folder has none of its own.
    """
    run = folder / name(plant, seed) / "checkpoint.pt"
    if plant in WALKERS and not run.is_file() and not (folder / f"{name(plant, seed)}.onnx").is_file():
        plant = WALKERS[plant]
    return run if run.is_file() else policy_file(folder, plant, seed)


def record_file(folder: Path, plant: str, seed: int) -> Path:
    """Its training record."""
    return folder / f"{name(plant, seed)}.json"


def plant_cfg(
    plant: str,
    *,
    num_envs: int = 64,
    terrain: str = "flat",
    threads: int = 0,
    randomize: str = RANDOMIZE,
    power_price: float = POWER_PRICE,
    coupling: Coupling = Coupling.EXPLICIT,
) -> TaskCfg:
    """The walking task on a plant, with the paper's Euler step.

    ``coupling``: how devices act (eqs. 6, 19, or a brake that sticks); those of ``PAYING`` act as their name says.

    Observations, actions, rewards, commands and randomisation are the same for all of ``plan.PLANTS``; for ``PUBLIC``
    but for the weight of the height; and for all of ``paper.ROBOTS`` and ``EXPLICIT``, which in addition pay
    ``power_price`` and carry loads.

    Raises:
        ValueError: there is no such plant, or no such randomisation.
    """
    if plant not in TRAINABLE:
        raise ValueError(f"plant = {plant!r}: choose from {', '.join(TRAINABLE)}")
    bare = plant in (CONVENTIONAL, "go1")
    paying = plant in PAYING
    model = "none" if bare else "bouc_wen" if paying else AWARE if plant in SOFT else plant
    cfg = TaskCfg(
        num_envs=num_envs,
        robot="go1" if bare else "mr_go",
        actuator=model,
        sal=not (bare or plant == "mr_go"),
        terrain=make_terrain_cfg(terrain),
        threads=threads,
        randomize=make_randomize_cfg(randomize),
        coupling=(Coupling.EXPLICIT if plant == EXPLICIT else Coupling.CONSTRAINT) if paying else coupling,
        z_step=ZStep.EULER,
    )
    cfg = replace(cfg, rewards=cfg.rewards.weighing(tilt=TILT))
    if plant in SOFT:
        soft = replace(cfg, gains=PUBLIC_GAINS)
        return replace(soft, rewards=cfg.rewards.weighing(height=HEIGHT)) if plant == PUBLIC else soft
    if not paying:
        return cfg
    return replace(
        cfg,
        rewards=cfg.rewards.weighing(power=0.0 - power_price, height=HEIGHT),
        randomize=replace(cfg.randomize, added_mass=LOAD) if cfg.randomize else None,
        currents=(CURRENT_GROUPS[-1],),
    )
