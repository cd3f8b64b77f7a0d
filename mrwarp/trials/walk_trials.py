"""Trials of section 6.4: three robots walking a measured distance, and standing with the calves held or not.

Walks run in one batch per robot and payload variant. MR_Go and MR_Go-SAL are the same asset; they share a batch and
differ by the current their devices may use (0 A keeps both effects of the gates away). Speeds and repetitions are
environments of the same batch.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
import warp as wp

from mrwarp.energy.power import JointLoad
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.paper import NAMES, ROBOTS, condition_name
from mrwarp.trials.power_meter import GaitTrace, MotionMeter, PowerMeter, TraceRecorder
from mrwarp.trials.walking import (
    PAYLOAD_VARIANT,
    Policy,
    act,
    foreign_device,
    make_env,
    same_starts,
    set_payload,
    task_devices,
)
from mrwarp.usd.robot import CALF_COLUMNS

ASSET_ROBOT = {"go1": "go1", "mr_go": "mr_go", "mr_go_sal": "mr_go"}
"""Robot variant of the asset."""


def robot_env(env: TaskCfg, robot: str, payload: int) -> TaskCfg:
    """The task of one of ``paper.ROBOTS``; Go1 has no device that would take a model."""
    asset = ASSET_ROBOT[robot]
    return replace(env, robot=asset, payload=payload, model=None if asset == "go1" else env.model)


STAND_SETTLE = 4.0
"""Time in which the targets are moved until the pose is the neutral one [s]."""

STAND_RATE = 3.0
"""Rate at which the targets follow the pose error [1/s]."""

STAND_STIFFER = 3.0
"""Factor on the gains: the walking gains stand, but under a load the robot sags until it squats."""

STAND_HOLD = 1.0
"""Time between switching the devices on and measuring [s]."""


@dataclass(frozen=True, kw_only=True)
class WalkCfg:
    """Which conditions are walked, and how far."""

    robots: tuple[str, ...] = ROBOTS
    """Of :data:`mrwarp.paper.ROBOTS`."""
    payloads: tuple[float, ...] = (0.0, 3.0)
    """Loads on the back [kg]; 0 is the asset's variant without payload, all others its payload with another mass."""
    speeds: tuple[float, ...] = (0.3, 0.5)
    """Commanded speeds [m/s]."""
    commanded: Mapping[tuple[str, float, float], float] = field(default_factory=dict)
    """Speed that is commanded instead [m/s], by robot, payload and speed of a condition, which keeps its name: where
    another robot's command took it to another speed, as ``paper.MEASURED_SPEED``."""
    trials: int = 3
    """Repetitions per condition, from random poses and gait phases."""
    distance: float = 30.0
    """Measured distance [m]."""
    warmup: float = 2.0
    """Walking before it [s]."""
    patience: float = 2.0
    """A trial fails when it takes this many times ``distance/speed``."""
    current: float = 1.5
    """Current the devices may use with SAL on [A]."""
    derate: Callable[[WalkEnv, Sequence[str]], None] | None = None
    """Change of the devices before the walk, given the environments and their robots in order; see ``mission``."""
    env: TaskCfg = field(default_factory=TaskCfg)
    """Actuator model, coupling and engine; robot, payload and currents are set here."""
    seed: int = 0
    """Seed of poses and phases."""

    def __post_init__(self) -> None:
        unknown = [robot for robot in self.robots if robot not in ROBOTS]
        if unknown or not self.robots:
            raise ValueError(f"robots = {unknown or self.robots}: choose from {', '.join(ROBOTS)}")
        if not self.payloads or min(self.payloads) < 0.0:
            raise ValueError(f"payloads = {self.payloads} kg must not be negative")
        if not self.speeds or min(self.speeds) <= 0.0:
            raise ValueError(f"speeds = {self.speeds} m/s must be positive")
        if self.commanded and not min(self.commanded.values()) > 0.0:
            raise ValueError(f"commanded = {dict(self.commanded)} m/s must be positive")
        if self.trials < 1:
            raise ValueError(f"trials = {self.trials} must be at least 1")
        for name in ("robots", "payloads", "speeds"):
            if len(set(getattr(self, name))) < len(getattr(self, name)):
                raise ValueError(f"{name} = {getattr(self, name)}: name each once")
        if not self.distance > 0.0 or self.warmup < 0.0:
            raise ValueError(f"distance = {self.distance} m must be positive and warmup = {self.warmup} s not negative")
        if self.current <= 0.0:
            raise ValueError(f"current = {self.current} A must be positive: SAL needs some")


@dataclass(frozen=True, kw_only=True)
class WalkResult:
    """Results of one condition; n trials that covered the distance."""

    robot: str
    payload: float
    """[kg]"""
    command: float
    """[m/s]"""
    mass: float
    """Total mass [kg]."""
    joints: JointLoad
    """Shapes (n, J) and (n, M)."""
    trial: np.ndarray
    """Number of each trial among the repetitions, shape (n,); those that fell or were late are missing."""
    seconds: np.ndarray
    """Time over the distance [s], shape (n,)."""
    motion: dict[str, np.ndarray]
    """Figures of :class:`mrwarp.trials.power_meter.MotionMeter`, each of shape (n,)."""
    braking: np.ndarray
    """Mean squared motor torque [(N·m)^2] that a brake at the joint could bear, shape (n, J); see
    :class:`mrwarp.trials.power_meter.PowerMeter`."""
    hold: np.ndarray
    """Share of time with the holding gate open, shape (n, M)."""
    dynamic: np.ndarray
    """Share of time with the dynamic gate open, shape (n, M)."""
    switches: np.ndarray
    """Times per second that the gates of a device opened or closed [1/s], shape (n, M)."""
    counts: np.ndarray
    """Distribution of the FR motors' torques, see :class:`mrwarp.trials.power_meter.PowerMeter`, shape (3, bins)."""
    stance: np.ndarray
    """The FR calf's part of it by :data:`mrwarp.trials.power_meter.STANCE`, shape (4, bins); 0 without a device."""
    fell: int
    """Trials that fell."""
    late: int
    """Trials that did not cover the distance in time."""
    trace: GaitTrace
    """Two strides of the front-right calf at 200 Hz."""
    paper_device: bool = True
    """Whether the task's devices are the paper's: only then the paper's figures stand next to these, Go1's too."""

    @property
    def speed(self) -> np.ndarray:
        """Mean speed [m/s], shape (n,)."""
        return self.motion["speed"]

    @property
    def key(self) -> tuple[str, float, float]:
        """Robot, payload [kg] and commanded speed [m/s], as :data:`mrwarp.paper.TABLE_6` has its rows."""
        return self.robot, self.payload, self.command

    @property
    def cell(self) -> tuple[float, float]:
        """Payload [kg] and commanded speed [m/s]."""
        return self.payload, self.command

    @property
    def condition(self) -> str:
        """Payload and commanded speed as every table names them."""
        return condition_name(self.payload, self.command)


def walk(
    cfg: WalkCfg, policies: Mapping[str, Policy], report: Callable[[str, float], None] = lambda text, share: None
) -> list[WalkResult]:
    """Walk all conditions.

    ``report`` is called now and then with what is being walked and the share that is done.
    """
    assets: dict[str, list[str]] = {}
    for robot in cfg.robots:
        assets.setdefault(ASSET_ROBOT[robot], []).append(robot)
    batches = [(robots, payload) for robots in assets.values() for payload in cfg.payloads]
    results = []
    for k, (robots, payload) in enumerate(batches):
        text = f"{' and '.join(NAMES[robot] for robot in robots)}, {payload:g} kg"
        batch = WalkBatch(cfg, robots, payload, policies)
        results += batch.run(lambda share, k=k, text=text: report(text, (k + share) / len(batches)))
    order = {robot: i for i, robot in enumerate(cfg.robots)}
    return sorted(results, key=lambda r: (order[r.robot], r.payload, r.command))


class WalkBatch:
    """The trials of one asset variant: robots that share it x speeds x repetitions.

    Args:
        cfg: The conditions.
        robots: Robots of this batch; all have the same asset variant.
        payload: Load on the back [kg].
        policies: Policy of each robot.
    """

    def __init__(self, cfg: WalkCfg, robots: Sequence[str], payload: float, policies: Mapping[str, Policy]) -> None:
        self.cfg, self.payload = cfg, payload
        self.conditions = [(robot, speed) for robot in robots for speed in cfg.speeds]
        self._policies = [policies[robot] for robot, _ in self.conditions]
        variant = PAYLOAD_VARIANT if payload > 0.0 else 0
        env_cfg = replace(robot_env(cfg.env, robots[0], variant), seed=cfg.seed)
        count = len(self.conditions) * cfg.trials
        self.env = env = make_env(env_cfg, count, cfg.seed)
        if payload != variant:
            set_payload(env, np.full(count, payload))
        self.paper_device = not foreign_device(task_devices(cfg.env))
        self.mass = float(env.sim.scene.model.body_mass.sum()) - variant + payload
        sal = [robot == "mr_go_sal" for robot, _ in self.conditions]
        self._per_env(env.current_e, [cfg.current if on else 0.0 for on in sal])
        self.command = torch.zeros(count, 3, device=env.device)
        asked = (cfg.commanded.get((robot, payload, speed), speed) for robot, speed in self.conditions)
        self._per_env(self.command[:, 0], list(asked))
        if cfg.derate is not None:
            cfg.derate(env, robots)
        self.meter = PowerMeter(env)
        self.recorder = TraceRecorder(env, [i * cfg.trials for i in range(len(self.conditions))])

    def _per_env(self, array: torch.Tensor, values: Sequence[float]) -> None:
        array.copy_(torch.tensor(values, device=array.device).repeat_interleave(self.cfg.trials))

    @torch.no_grad()
    def run(self, report: Callable[[float], None] = lambda share: None) -> list[WalkResult]:
        """Walk until every trial has covered the distance, fallen or run out of time."""
        env, cfg, meter = self.env, self.cfg, self.meter
        dt, count = env.cfg.step_dt, env.num_envs
        env.restart()
        same_starts(env, self.cfg.trials, self.cfg.seed)
        env.set_command(self.command)
        meter.clear()
        motion = MotionMeter(env, self.command)
        fell = torch.zeros(count, dtype=torch.bool, device=env.device)
        late = torch.zeros_like(fell)
        going = ~fell
        skip = round(cfg.warmup / dt)
        patience = cfg.patience * cfg.distance / self.command[:, 0].to(torch.float64)
        most = skip + round(float(patience.max()) / dt)
        obs = env.get_observations()
        for step in range(most):
            meter.on.copy_(going & (step >= skip))
            self.recorder.on = step >= skip
            obs, _, _, _ = env.step(act(self._policies, obs))
            env.set_command(self.command)
            fell |= going & env.fallen
            if step >= skip:
                motion.add(going)
                going = going & ~fell & (motion.distance < cfg.distance)
                late |= going & (motion.seconds > patience - 0.5 * dt)
                going = going & ~late
            else:
                going = going & ~fell
            if step % 100 == 99:
                report(float((motion.distance / cfg.distance).clamp(max=1.0).mean()))
            if not bool(going.any()):
                break
        return list(self._results(motion, fell.cpu().numpy(), (late | going).cpu().numpy()))

    def _results(self, motion: MotionMeter, fell: np.ndarray, late: np.ndarray) -> Iterator[WalkResult]:
        meter, trials = self.meter, self.cfg.trials
        joints, seconds, figures = meter.joint_load(), motion.seconds.cpu().numpy(), motion.figures()
        for i, (robot, command) in enumerate(self.conditions):
            rows = np.arange(i * trials, (i + 1) * trials)
            done = rows[~fell[rows] & ~late[rows]]
            yield WalkResult(
                robot=robot,
                payload=self.payload,
                command=command,
                mass=self.mass,
                joints=joints[done],
                trial=done - rows[0],
                seconds=seconds[done],
                motion={name: values[done] for name, values in figures.items()},
                braking=meter.braking[done],
                hold=meter.hold[done],
                dynamic=meter.dynamic[done],
                switches=meter.switches[done],
                counts=meter.counts[done].sum(0).cpu().numpy(),
                stance=meter.stance[done].sum(0).cpu().numpy(),
                fell=int(fell[rows].sum()),
                late=int(late[rows].sum()),
                trace=self.recorder.trace(i),
                paper_device=self.paper_device,
            )


def standing_load(
    cfg: TaskCfg, *, load: float, hold: bool, seconds: float = 5.0, derate: Callable[[WalkEnv], None] | None = None
) -> tuple[JointLoad, dict[str, float]]:
    """Stand in the neutral pose and measure what the joints do with the calves held by motors or by devices.

    A standing controller knows the robot's weight: the targets are moved until the joints stand where they should,
    which leaves the motors with the static torques. Then they are fixed and, with ``hold``, the devices switched on.

    Args:
        cfg: The robot; its payload variant must offer the load.
        load: Mass on the back [kg].
        hold: Whether the devices hold.
        seconds: Measured time [s].
        derate: Change of the devices beforehand.

    Returns:
        The mean joint load, shapes (J,) and (M,), and ``height`` [m], ``hold`` share, ``drift`` of the calves [rad].
    """
    env = make_env(cfg, 1, 0)
    env.current_e.fill_(env.cfg.currents[-1])
    set_payload(env, np.array([load]))
    if derate is not None:
        derate(env)
    actuator, dt = env.actuator, env.cfg.step_dt
    # the low gain while holding stays
    for array in (actuator.kp, actuator.kd, actuator.param("kp_base"), actuator.param("kd")):
        env.view(array).mul_(STAND_STIFFER)
    allowed = env.current_e.clone()
    env.current_e.zero_()
    actions = _settle(env)
    if hold:
        env.current_e.copy_(allowed)
    meter = PowerMeter(env)
    calves = list(actuator.mr_joints) or list(CALF_COLUMNS)
    for step in range(round((STAND_HOLD + seconds) / dt)):
        meter.on.fill_(step * dt >= STAND_HOLD)
        if step == round(STAND_HOLD / dt):
            start = env.q[:, calves].clone()
        env.step(actions)
    drift = float((env.q[:, calves] - start).abs().max())
    found = {"height": float(env.root_pos[0, 2]), "hold": float(meter.hold.mean()) if meter.hold.size else 0.0}
    return meter.joint_load()[0], {**found, "drift": drift}


def _settle(env: WalkEnv) -> torch.Tensor:
    """Put the robot down in the neutral pose and return the actions that keep it there."""
    model = env.sim.scene.model
    qpos = torch.zeros(env.num_envs, model.nq, device=env.device)
    qpos[:, 2], qpos[:, 3] = env.sim.scene.stand_height, 1.0
    qpos[:, torch.from_numpy(env.sim.scene.q_adr).long()] = env.default_q
    everywhere = torch.ones(env.num_envs, dtype=torch.bool, device=env.device)
    env.robot.reset(wp.from_torch(everywhere), wp.from_torch(qpos), None)
    env.set_command(torch.zeros(env.num_envs, 3, device=env.device))
    actions = torch.zeros(env.num_envs, env.num_actions, device=env.device)
    for _ in range(round(STAND_SETTLE / env.cfg.step_dt)):
        actions += STAND_RATE * env.cfg.step_dt / env.cfg.action_scale * (env.default_q - env.q)
        env.step(actions)
    return actions
