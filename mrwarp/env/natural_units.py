"""The walking task for a robot of another size: lengths, speeds, times, masses and torques in the robot's own units.

The task's numbers are those of the shipped robot. Another one gets them in proportion: lengths by its stance height,
times by the root of that (as a pendulum's), masses by its mass, torques by mass times length. Angles stay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from mrwarp.env.sim import robot_scene
from mrwarp.env.sim_model import Scene
from mrwarp.usd.asset import load_robot
from mrwarp.usd.robot import MASS, MR_GO, STAND_HEIGHT

if TYPE_CHECKING:
    from mrwarp.env.cfg import TaskCfg

FALL_COST = 1.0
"""Cost of a fall in the reward of a robot on one or two legs. At first it always falls, and the sum of
its rewards is negative then: without a cost, falling soon is best. Isaac Lab's H1 and G1 pay 4 (200/s in a step of
20 ms); with that, a G1 here learns to shuffle before it lifts a foot (docs/robot.md)."""


@dataclass(frozen=True, kw_only=True)
class Scales:
    """A robot's size relative to the shipped one's."""

    length: float = 1.0
    mass: float = 1.0

    @property
    def time(self) -> float:
        """Root of the length."""
        return math.sqrt(self.length)

    @property
    def speed(self) -> float:
        """Length by time."""
        return self.length / self.time

    @property
    def torque(self) -> float:
        """Mass times length, as gravity is the same."""
        return self.mass * self.length

    @property
    def power(self) -> float:
        """Torque by time."""
        return self.torque / self.time


def scales(scene: Scene) -> Scales:
    """Size of a scene's robot; 1 for the shipped one, with any load."""
    if scene.layout == MR_GO:
        return Scales()
    return Scales(length=scene.stand_height / STAND_HEIGHT, mass=float(scene.model.body_mass.sum()) / MASS)


def scales_of(robot: str, asset: str | None = None) -> Scales:
    """Size of a robot by its variant or file, as :func:`mrwarp.usd.asset.load_robot` takes them."""
    found = load_robot(asset, robot=robot)
    return Scales() if found.layout == MR_GO else scales(robot_scene(found))


def in_natural_units(cfg: TaskCfg, scene: Scene) -> TaskCfg:
    """The task with its numbers in proportion to the scene's robot; the same object for the shipped one."""
    from mrwarp.env.rewards import TERMS, weight  # brings torch, which a picture of a standing robot does without

    by = scales(scene)
    if by == Scales():
        return cfg
    rewards, commands, randomize = cfg.rewards, cfg.commands, cfg.randomize

    def times(values: tuple[float, float], factor: float) -> tuple[float, float]:
        return values[0] * factor, values[1] * factor

    return replace(
        cfg,
        gait_frequency=cfg.gait_frequency / by.time,
        fall_height=cfg.fall_height * by.length,
        fall_cost=cfg.fall_cost if scene.layout.legs[2:] else FALL_COST,
        rewards=replace(
            rewards,
            weights={name: weight(rewards, name) / term.scale(by) for name, term in TERMS.items()},
            target_height=rewards.target_height * by.length,
            velocity_width=rewards.velocity_width * by.speed**2,
            yaw_width=rewards.yaw_width / by.time**2,
            step_height=rewards.step_height * by.length,
        ),
        commands=replace(
            commands,
            v_x=times(commands.v_x, by.speed),
            v_y=times(commands.v_y, by.speed),
            yaw_rate=times(commands.yaw_rate, 1.0 / by.time),
        ),
        randomize=randomize
        and replace(
            randomize,
            added_mass=times(randomize.added_mass, by.mass),
            push_speed=randomize.push_speed * by.speed,
        ),
    )
