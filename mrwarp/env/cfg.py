"""Configuration of the walking task. ``make_walk_cfg()`` builds a fresh object, ``dataclasses.replace`` a variant."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from mrwarp.actuator.mr_actuator import MrActuatorCfg
from mrwarp.enums import (
    ACTUATORS,
    LEARNED,
    RANDOMIZATIONS,
    TERRAINS,
    BackendKind,
    Coupling,
    HoldCurrent,
    ZStep,
)
from mrwarp.env.sim import SimCfg
from mrwarp.env.terrain import TerrainCfg
from mrwarp.model_file import Model
from mrwarp.nn.models import LstmState
from mrwarp.usd.robot import CURRENT_GROUPS, GAIT_FREQUENCY


@dataclass(frozen=True, kw_only=True)
class CommandCfg:
    """Velocity commands, drawn uniformly."""

    v_x: tuple[float, float] = (0.2, 0.6)
    """Forward speed [m/s]; the paper's 1.5 Hz gait reaches about 0.6 m/s (section 7)."""
    v_y: tuple[float, float] = (0.0, 0.0)
    """Lateral speed [m/s]."""
    yaw_rate: tuple[float, float] = (-0.2, 0.2)
    """Yaw rate [rad/s]."""
    period: float = 5.0
    """Time between new commands [s]."""


@dataclass(frozen=True, kw_only=True)
class NoiseCfg:
    """Half-widths of the uniform noise on the actor's observations; public quadruped practice."""

    gyro: float = 0.1
    """Angular velocity [rad/s]."""
    gravity: float = 0.03
    """Projected gravity [1]."""
    q: float = 0.01
    """Joint position [rad]."""
    qd: float = 0.5
    """Joint velocity [rad/s]."""


@dataclass(frozen=True, kw_only=True)
class RandomizeCfg:
    """What differs between environments during training. Ranges are multiplied or added as the names say."""

    friction: tuple[float, float] = (0.5, 1.1)
    """Sliding friction of ground and feet [1]."""
    added_mass: tuple[float, float] = (-0.5, 1.0)
    """Mass added to the trunk [kg]."""
    mr_scale: tuple[float, float] = (0.8, 1.2)
    """Factor on the device's B, K0, K1 and T_max, drawn per environment and joint at every reset."""
    gain_scale: tuple[float, float] = (0.9, 1.1)
    """Factor on the motor gains kp and kd, per environment and joint."""
    push_speed: float = 0.3
    """Largest horizontal velocity kick [m/s]."""
    push_interval: float = 6.0
    """Mean time between kicks [s]."""


def make_randomize_cfg(kind: str = "all") -> RandomizeCfg | None:
    """What differs between training environments.

    Args:
        kind: One of :data:`RANDOMIZATIONS`. ``all``: everything that :class:`RandomizeCfg` has. ``ground``: friction
            and kicks, what legged_gym, the common walking environments for Isaac Gym, randomises by default, and
            nothing of the robot. ``none``.

    Raises:
        ValueError: there is no such kind.
    """
    if kind not in RANDOMIZATIONS:
        raise ValueError(f"randomize = {kind!r} is unknown; choose from {', '.join(RANDOMIZATIONS)}")
    if kind == "none":
        return None
    if kind == "ground":
        return RandomizeCfg(added_mass=(0.0, 0.0), mr_scale=(1.0, 1.0), gain_scale=(1.0, 1.0))
    return RandomizeCfg()


@dataclass(frozen=True, kw_only=True)
class RewardCfg:
    """Weights of the reward terms, per second; see ``rewards.py`` for the terms."""

    track_velocity: float = 2.0
    track_yaw: float = 0.5
    contact_clock: float = 1.5
    swing_height: float = -30.0
    height: float = -40.0
    tilt: float = -3.0
    bounce: float = -1.0
    roll_pitch_rate: float = -0.05
    posture: float = -0.15
    hip_posture: float = -1.0
    effort: float = -3e-4
    action_rate: float = -0.02
    joint_acceleration: float = -1e-7
    power: float = 0.0
    """Per watt of electrical power of motors and coils."""
    winding_resistance: float = 0.128
    """Phase resistance that the power is computed with [Ohm]; a public motor of this size has 0.105 to 0.13 (see
    ``ElectricalCfg``). Not the calibrated number: the calibration needs trained policies."""
    target_height: float = 0.32
    """Wanted trunk height [m]; the paper's policies walk at 0.328 to 0.334."""
    velocity_width: float = 0.04
    """Squared velocity error at which tracking falls to 1/e [(m/s)^2]."""
    yaw_width: float = 0.1
    """Squared yaw-rate error at which tracking falls to 1/e [(rad/s)^2]."""
    step_height: float = 0.06
    """Clearance of a swinging foot at mid swing [m]."""


@dataclass(frozen=True, kw_only=True)
class EnvCfg:
    """The walking task."""

    sim: SimCfg = field(default_factory=SimCfg)
    """Physics."""
    actuator: MrActuatorCfg = field(default_factory=MrActuatorCfg)
    """Choices of the MR joint's model."""
    actuator_model: str = "bouc_wen"
    """One of :data:`ACTUATORS`."""
    actuator_file: str | None = None
    """Trained network (.safetensors) of a learned ``actuator_model``; none for the others."""
    lstm_state: LstmState = LstmState.CARRIED
    """What the LSTM of a learned ``actuator_model`` begins each sample with."""
    window_capacity: float = 1.0
    """GPU threads for a learned torque as a share of all devices; if more gates are open they take several in turn.
    16 % are while walking."""
    model: Model | str | None = None
    """Identified joint with its effects (a model.json) for all MR joints; None keeps the asset's own."""
    robot: str = "mr_go"
    """Robot variant of the asset: ``mr_go`` or ``go1``."""
    payload: int = 0
    """Payload variant of the asset [kg]: 0 or 3."""
    asset: str | None = None
    """USD file; None takes ``assets/usd/mr_go.usda``."""
    gains: tuple[float, float] | None = None
    """Kp [N·m/rad] and Kd [N·m·s/rad] of all motors; None keeps the asset's. The low gain while holding stays."""
    currents: tuple[float, ...] = CURRENT_GROUPS
    """Fixed currents I_e over equal groups of environments [A], eq. 20."""
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
    fall_height: float = 0.16
    """The robot has fallen when its trunk is lower than this [m]."""
    fall_tilt: float = 0.9
    """Or when it leans further than this [rad]."""
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
    payload: int = 0,
    asset: str | None = None,
    actuator_model: str = "bouc_wen",
    actuator_file: str | None = None,
    model: Model | str | None = None,
    coupling: Coupling = Coupling.CONSTRAINT,
    hold_current: HoldCurrent = HoldCurrent.SUPPORT,
    z_step: ZStep = ZStep.EULER,
    sal: bool = True,
    lstm_state: LstmState = LstmState.CARRIED,
    backend: BackendKind | None = None,
    threads: int = 0,
    deterministic: bool = False,
    terrain: str = "flat",
    randomize: str = "all",
) -> EnvCfg:
    """The training task: MR joint and noise on; ``terrain`` of :data:`TERRAINS`, ``randomize`` of RANDOMIZATIONS.

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
        lstm_state=lstm_state,
        model=model,
        robot=robot,
        payload=payload,
        asset=asset,
        terrain=TerrainCfg() if terrain == "rough" else None,
        randomize=make_randomize_cfg(randomize),
        seed=seed,
    )


def make_play_cfg(cfg: EnvCfg) -> EnvCfg:
    """The same task for evaluation: nominal robot, no noise, no pushes, commands held, terrain of all levels."""
    terrain = replace(cfg.terrain, curriculum=False) if cfg.terrain else None
    commands = replace(cfg.commands, period=float("inf"))
    return replace(cfg, noise=None, randomize=None, commands=commands, terrain=terrain)
