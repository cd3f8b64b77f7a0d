"""Configuration of the walking task. ``make_walk_cfg()`` builds a fresh object, ``dataclasses.replace`` a variant."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from mrwarp.actuator.mr_actuator import MrActuatorCfg
from mrwarp.enums import (
    ACTUATORS,
    LEARNED,
    TERRAINS,
    BackendKind,
    Coupling,
    CurrentCommand,
    HoldCurrent,
    ResidualEngine,
    ZStep,
)
from mrwarp.env.commands import CommandCfg
from mrwarp.env.events import RandomizeCfg, make_randomize_cfg
from mrwarp.env.observations import NoiseCfg
from mrwarp.env.rewards import RewardCfg
from mrwarp.env.sim import SimCfg
from mrwarp.env.terrain import TerrainCfg
from mrwarp.model_file import Model
from mrwarp.nn.models import LstmState
from mrwarp.usd.robot import CURRENT_GROUPS, FALL_HEIGHT, GAIT_FREQUENCY


@dataclass(frozen=True, kw_only=True)
class EnvCfg:
    """The walking task, all of it; :func:`make_walk_cfg` makes one from what is mostly chosen.

    Example:
        >>> import dataclasses, mrwarp
        >>> cfg = dataclasses.replace(mrwarp.TaskCfg(num_envs=8), episode_seconds=5.0)
        >>> isinstance(cfg, mrwarp.EnvCfg), cfg.episode_steps
        (True, 250)
    """

    sim: SimCfg = field(default_factory=SimCfg)
    """Physics."""
    actuator: MrActuatorCfg = field(default_factory=MrActuatorCfg)
    """Choices of the MR joint's model."""
    actuator_model: str = "bouc_wen"
    """One of :data:`ACTUATORS`."""
    actuator_file: str | None = None
    """Trained network (.safetensors) of a learned ``actuator_model``; none for the others."""
    lstm_state: LstmState = LstmState.CARRIED
    """State with which the LSTM of a learned ``actuator_model`` begins each sample."""
    residual_engine: ResidualEngine = ResidualEngine.KERNELS
    """Backend that evaluates the network of a learned ``actuator_model``; torch is the slower one."""
    window_capacity: float = 1.0
    """GPU threads for a learned torque as a share of all devices; if more gates are open they take several in turn.
    16 % are while walking."""
    model: Model | str | None = None
    """Identified joint with its effects (a model.json) for all MR joints; None keeps the asset's own."""
    extrapolate: bool = False
    """Whether ``model``'s coils take more current than it was measured with, up to the asset's largest."""
    robot: str = "mr_go"
    """Robot variant of the asset: ``mr_go`` or ``go1``."""
    payload: float = 0
    """Mass on the back [kg]."""
    asset: str | None = None
    """USD file; None takes ``assets/usd/mr_go.usda``."""
    gains: tuple[float, float] | None = None
    """Kp [N·m/rad] and Kd [N·m·s/rad] of all motors; None keeps the asset's. The low gain while holding stays."""
    currents: tuple[float, ...] = CURRENT_GROUPS
    """Fixed currents I_e over equal groups of environments [A], eq. 20. The default stands for shares of the largest
    current that a device takes; ``env.cfg`` has the numbers."""
    current: CurrentCommand = CurrentCommand.FIXED
    """Source of the coils' command within that, see :mod:`mrwarp.env.commands`."""
    coil_lag: float | None = None
    """Time constant of all coils [s]; None keeps the devices' own."""
    hold_speed: float | None = None
    """Speed below which all devices may hold [rad/s], eps_hold of eq. 8; None keeps the devices' own."""
    decimation: int = 4
    """Torque steps per policy step: 200 Hz / 50 Hz."""
    episode_seconds: float = 20.0
    """Episode length [s]."""
    action_scale: float = 0.25
    """Joint target per action [rad]."""
    gait_frequency: float = GAIT_FREQUENCY
    """Stride frequency of the clock [Hz]."""
    commands: CommandCfg = field(default_factory=CommandCfg)
    terrain: TerrainCfg | None = None
    """Height field and its curriculum; None is flat ground."""
    noise: NoiseCfg | None = field(default_factory=NoiseCfg)
    """Observation noise; None for none."""
    randomize: RandomizeCfg | None = field(default_factory=RandomizeCfg)
    """Domain randomisation; None for the nominal robot."""
    rewards: RewardCfg = field(default_factory=RewardCfg)
    fall_height: float = FALL_HEIGHT
    """The robot has fallen when its trunk is lower than this [m]."""
    fall_tilt: float = 0.9
    """Or when it leans further than this [rad]."""
    fall_cost: float = 0.0
    """Cost of a fall in the reward, in addition to what is no longer earned."""
    seed: int = 0
    """Seed of every random draw of the environment."""

    def __post_init__(self) -> None:
        if self.actuator_model not in ACTUATORS:
            raise ValueError(f"actuator_model = {self.actuator_model!r} is unknown; choose from {', '.join(ACTUATORS)}")
        if (self.actuator_model in LEARNED) != (self.actuator_file is not None):
            need = "needs an actuator_file (--actuator-model FILE) from 'mrwarp learn'"
            raise ValueError(
                f"actuator_model = {self.actuator_model!r} "
                + (need if self.actuator_model in LEARNED else f"takes no actuator_file, got {self.actuator_file!r}")
            )
        if not self.currents or not all(0.0 <= current < math.inf for current in self.currents):
            raise ValueError(f"currents = {self.currents} must be at least one value, finite and none below 0 A")
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
        return self.sim.dt * self.decimation

    @property
    def episode_steps(self) -> int:
        """Policy steps per episode."""
        return round(self.episode_seconds / self.step_dt)


def make_walk_cfg(
    *,
    num_envs: int = 64,
    device: str = "cpu",
    seed: int = 0,
    robot: str = "mr_go",
    payload: float = 0,
    asset: str | None = None,
    actuator_model: str = "bouc_wen",
    actuator_file: str | None = None,
    model: Model | str | None = None,
    extrapolate: bool = False,
    coupling: Coupling = Coupling.CONSTRAINT,
    hold_current: HoldCurrent = HoldCurrent.SUPPORT,
    z_step: ZStep = ZStep.EXACT,
    sal: bool = True,
    current: CurrentCommand = CurrentCommand.FIXED,
    coil_lag: float | None = None,
    hold_speed: float | None = None,
    lstm_state: LstmState = LstmState.CARRIED,
    residual_engine: ResidualEngine = ResidualEngine.KERNELS,
    backend: BackendKind | None = None,
    threads: int = 0,
    deterministic: bool = False,
    terrain: str = "flat",
    randomize: str = "all",
) -> EnvCfg:
    """The training task: MR joint and noise on; ``terrain`` of :data:`TERRAINS`, ``randomize`` of RANDOMIZATIONS.

    Example:
        >>> import mrwarp
        >>> mrwarp.TaskCfg(num_envs=64, model="model.json", terrain="rough").sim.num_envs
        64

    Raises:
        ValueError: a choice is unknown.
    """
    if terrain not in TERRAINS:
        raise ValueError(f"terrain = {terrain!r} is unknown; choose from {', '.join(TERRAINS)}")
    return EnvCfg(
        sim=SimCfg(num_envs=num_envs, device=device, backend=backend, threads=threads, deterministic=deterministic),
        actuator=MrActuatorCfg(coupling=coupling, hold_current=hold_current, z_step=z_step, sal=sal),
        actuator_model=actuator_model,
        actuator_file=actuator_file,
        current=current,
        coil_lag=coil_lag,
        hold_speed=hold_speed,
        lstm_state=lstm_state,
        residual_engine=residual_engine,
        model=model,
        extrapolate=extrapolate,
        robot=robot,
        payload=payload,
        asset=asset,
        terrain=TerrainCfg() if terrain == "rough" else None,
        randomize=make_randomize_cfg(randomize),
        seed=seed,
    )


def make_play_cfg(cfg: EnvCfg) -> EnvCfg:
    """A task for evaluation: nominal robot, no noise, no pushes, commands held, terrain of all levels."""
    terrain = replace(cfg.terrain, curriculum=False) if cfg.terrain else None
    commands = replace(cfg.commands, period=float("inf"))
    return replace(cfg, noise=None, randomize=None, commands=commands, terrain=terrain)
