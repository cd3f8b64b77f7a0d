"""Configuration of the walking task: each option once, with unit, default and reason; ``replace`` makes a variant.

Command lines are read from it, so that it loads no engine. What is ``Fixed`` is no option of a command.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Fixed, arg

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.enums import ACTUATORS, LEARNED, RANDOMIZATIONS, TERRAINS, CurrentCommand, LstmState, ResidualEngine
from mrwarp.env.config.mdp_cfg import (
    CommandCfg,
    NoiseCfg,
    RandomizeCfg,
    RewardCfg,
    TerrainCfg,
    make_randomize_cfg,
    make_terrain_cfg,
    read_rewards,
)
from mrwarp.env.config.sim_cfg import SimCfg
from mrwarp.options import option_types as opt
from mrwarp.resources import shipped_model
from mrwarp.usd.robot import CURRENT_GROUPS, FALL_HEIGHT, GAIT_FREQUENCY

if TYPE_CHECKING:
    from mrwarp.model_file import Model
else:
    Model = Any  # its module brings Warp


@dataclass(frozen=True, kw_only=True)
class PlantCfg(SimCfg, MrActuatorCfg, opt.RobotChoice):
    """The robot, its devices and the ground, and how they are simulated: what a policy acts on."""

    robot: opt.Robot = "mr_go"
    """robot variant of the USD asset (mr_go, go1), or a USD file of 'mrwarp robot import'"""
    payload: opt.Load = 0
    """mass on the back [kg]"""
    actuator: Annotated[str, opt.one_of(ACTUATORS)] = "bouc_wen"
    """torque model of the MR joint"""
    actuator_file: opt.OptionalText = None
    """trained network of --actuator mlp, lstm or pg_rlstm (default: the shipped one)"""
    currents: Annotated[tuple[float, ...], opt.some(opt.coil_current, "A"), arg(name="current")] = CURRENT_GROUPS
    """currents I_e that the devices may use [A], over equal groups of robots, eq. 20; the default stands for shares of
    the largest current that a device takes"""
    terrain: Annotated[TerrainCfg | None, opt.named(make_terrain_cfg, TERRAINS)] = None
    """ground: flat, or rough, with a curriculum in training and all its levels side by side else"""
    seed: opt.Seed = 0
    """seed of everything random"""

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.terrain, str):
            object.__setattr__(self, "terrain", make_terrain_cfg(self.terrain))
        if self.actuator not in ACTUATORS:
            raise ValueError(f"actuator = {self.actuator!r} is unknown; choose from {', '.join(ACTUATORS)}")
        if self.actuator in LEARNED and self.network is None:
            need = "needs an actuator_file (--actuator-file FILE) from 'mrwarp learn'"
            raise ValueError(f"actuator = {self.actuator!r} {need}")
        if self.actuator not in LEARNED and self.actuator_file is not None:
            raise ValueError(f"actuator = {self.actuator!r} takes no actuator_file, got {self.actuator_file!r}")
        if not self.currents or not all(0.0 <= current < math.inf for current in self.currents):
            raise ValueError(f"currents = {self.currents} must be at least one value, finite and none below 0 A")

    @property
    def network(self) -> str | None:
        """File of the network that ``actuator`` evaluates; None: it evaluates none."""
        return self.actuator_file or shipped_model(self.actuator)


@dataclass(frozen=True, kw_only=True)
class TaskCfg(PlantCfg):
    """The walking task, all of it. Ground and randomisation may also be given by their names.

    Example:
        >>> import dataclasses, mrwarp
        >>> cfg = dataclasses.replace(mrwarp.TaskCfg(num_envs=8, terrain="rough"), episode_seconds=5.0)
        >>> cfg.num_envs, cfg.terrain.levels, cfg.episode_steps
        (8, 6, 250)

    Raises:
        ValueError: a number is out of its range, or a name is unknown.
    """

    lstm_state: Fixed[LstmState] = LstmState.CARRIED
    """State with which the LSTM of a learned ``actuator`` begins each sample."""
    residual_engine: ResidualEngine = ResidualEngine.KERNELS
    """engine of a learned --actuator: our kernels, or torch on the same arrays, slower"""
    window_capacity: Fixed[float] = 1.0
    """GPU threads for a learned torque as a share of all devices; if more gates are open they take several in turn.
    16 % are while walking."""
    extrapolate: opt.Flag = False
    """let coils take more current than the recordings of --model held, up to the asset's largest"""
    gains: Fixed[tuple[float, float] | None] = None
    """Kp [N·m/rad] and Kd [N·m·s/rad] of all motors; None keeps the asset's. The low gain while holding stays."""
    current_by: CurrentCommand = CurrentCommand.FIXED
    """source of the coil currents within --current: the gates alone, a law at 50 Hz, or the policy, an action each"""
    coil_lag: opt.OptionalLag = None
    """time constant of the coils [s] (default: the devices' own)"""
    hold_speed: Annotated[float | None, opt.one(opt.positive, "W")] = None
    """speed below which a device may hold [rad/s], eps_hold of eq. 8 (default: the devices' own)"""
    decimation: Fixed[int] = 4
    """Torque steps per policy step: 200 Hz / 50 Hz."""
    episode_seconds: Fixed[float] = 20.0
    """Episode length [s]."""
    action_scale: Fixed[float] = 0.25
    """Joint target per action [rad]."""
    gait_frequency: Fixed[float] = GAIT_FREQUENCY
    """Stride frequency of the clock [Hz]."""
    commands: Fixed[CommandCfg] = field(default_factory=CommandCfg)
    """Velocities that are commanded."""
    noise: Fixed[NoiseCfg | None] = field(default_factory=NoiseCfg)
    """Observation noise; None for none."""
    randomize: Annotated[RandomizeCfg | None, opt.named(make_randomize_cfg, RANDOMIZATIONS)] = field(
        default_factory=RandomizeCfg
    )
    """differences between environments: friction, kicks, mass, gains and devices; friction and kicks; nothing"""
    rewards: Annotated[RewardCfg, opt.some_as_one(read_rewards, "TERM=WEIGHT"), arg(name="reward")] = field(
        default_factory=RewardCfg
    )
    """weights of reward terms in place of their own, such as tilt=-100; terms stand in mrwarp/env/rewards.py"""
    fall_height: Fixed[float] = FALL_HEIGHT
    """The robot has fallen when its trunk is lower than this [m]."""
    fall_tilt: Fixed[float] = 0.9
    """Or when it leans further than this [rad]."""
    fall_cost: Fixed[float] = 0.0
    """Cost of a fall in the reward, in addition to what is no longer earned."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if isinstance(self.randomize, str):
            object.__setattr__(self, "randomize", make_randomize_cfg(self.randomize))
        number = int | float  # a policy's file may say anything
        if self.coil_lag is not None and not (isinstance(self.coil_lag, number) and 0.0 <= self.coil_lag <= 10.0):
            raise ValueError(f"coil_lag = {self.coil_lag!r} s must lie in [0, 10]")
        speed = self.hold_speed
        if speed is not None and not (isinstance(speed, number) and 0.0 < speed < math.inf):
            raise ValueError(f"hold_speed = {speed!r} rad/s must be positive and finite")
        if self.gains is not None and not (self.gains[0] > 0.0 and self.gains[1] >= 0.0):
            raise ValueError(f"gains = {self.gains}: Kp must be positive and Kd not negative")
        if not 0.0 < self.window_capacity <= 1.0:
            raise ValueError(f"window_capacity = {self.window_capacity} must lie in (0, 1]")
        if self.decimation < 1:
            raise ValueError(f"decimation = {self.decimation} must be at least 1")

    @property
    def step_dt(self) -> float:
        """Policy step [s]."""
        return self.dt * self.decimation

    @property
    def episode_steps(self) -> int:
        """Policy steps per episode."""
        return round(self.episode_seconds / self.step_dt)


def make_play_cfg(cfg: TaskCfg) -> TaskCfg:
    """A task for evaluation: nominal robot, no noise, no pushes, commands held, terrain of all levels."""
    terrain = replace(cfg.terrain, curriculum=False) if cfg.terrain else None
    commands = replace(cfg.commands, period=float("inf"))
    return replace(cfg, noise=None, randomize=None, commands=commands, terrain=terrain)
