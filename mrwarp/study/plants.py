"""The plants of the studies as configurations of the walking task."""

from __future__ import annotations

from dataclasses import replace

from mrwarp.enums import Coupling
from mrwarp.env.cfg import EnvCfg, make_walk_cfg
from mrwarp.resources import shipped_model
from mrwarp.study.plan import (
    AWARE,
    CONVENTIONAL,
    EXPLICIT,
    HEIGHT,
    LOAD,
    PAYING,
    POWER_PRICE,
    PUBLIC,
    RANDOMIZE,
    TRAINABLE,
)
from mrwarp.usd.robot import CURRENT_GROUPS, PUBLIC_GAINS


def plant_cfg(
    plant: str,
    *,
    num_envs: int = 64,
    terrain: str = "flat",
    threads: int = 0,
    randomize: str = RANDOMIZE,
    power_price: float = POWER_PRICE,
) -> EnvCfg:
    """The walking task on a plant.

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
    model = "none" if bare else "bouc_wen" if paying else AWARE if plant == PUBLIC else plant
    cfg = make_walk_cfg(
        num_envs=num_envs,
        robot="go1" if bare else "mr_go",
        actuator_model=model,
        actuator_file=shipped_model(model),
        sal=not (bare or plant == "mr_go"),
        terrain=terrain,
        threads=threads,
        randomize=randomize,
        coupling=Coupling.EXPLICIT if plant == EXPLICIT else Coupling.CONSTRAINT,
    )
    if plant == PUBLIC:
        return replace(cfg, gains=PUBLIC_GAINS, rewards=replace(cfg.rewards, height=HEIGHT))
    return _paying(cfg, power_price) if paying else cfg


def _paying(cfg: EnvCfg, power_price: float) -> EnvCfg:
    """The task with a price [1/W] on power and with loads; devices may use the current of tables 6 and 7."""
    return replace(
        cfg,
        rewards=replace(cfg.rewards, power=0.0 - power_price, height=HEIGHT),
        randomize=replace(cfg.randomize, added_mass=LOAD) if cfg.randomize else None,
        currents=(CURRENT_GROUPS[-1],),
    )
