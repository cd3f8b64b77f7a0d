"""Walking evaluation: roll a policy out, measure it, judge it by the walking gate, record how its calves move."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from mrwarp.enums import ZStep
from mrwarp.env.cfg import TaskCfg, make_play_cfg
from mrwarp.env.natural_units import Scales
from mrwarp.env.vec_env import WalkEnv
from mrwarp.kernels import ledger
from mrwarp.params import MrParams
from mrwarp.trials.gait_rules import PostureMeter, broken
from mrwarp.usd.asset import JointActuator, RobotAsset, device_lines, load_robot, with_model
from mrwarp.usd.robot import CALF_COLUMNS, DEFAULT_POSE

PAYLOAD_BODY = "payload"
"""Name of the payload's body in the asset."""

PAYLOAD_VARIANT = 3
"""Payload variant of the asset that has the body [kg]."""

CALF_MOTION_SPEEDS = (0.2, 0.3, 0.4, 0.5, 0.6)
"""Commanded forward speeds of recorded calf motion [m/s], one robot each."""

Policy = Callable[[TensorDict], torch.Tensor]
"""Observations to actions (E, 12), without exploration noise."""


@dataclass(frozen=True, kw_only=True)
class WalkingGate:
    """Meaning of "has learned to walk". The limits are the project's; sources stand next to them."""

    num_envs: int = 64
    """Environments, spread evenly over the four current groups."""
    speeds: tuple[float, ...] = (0.3, 0.5)
    """Commanded forward speeds [m/s], alternating over the environments."""
    warmup: float = 2.0
    """Time to get going from the stance, not measured except for falls [s]."""
    seconds: float = 20.0
    """Measured time [s]."""
    never_fell: float = 0.95
    """Smallest share of environments that never fall."""
    rmse_at: float = 0.5
    """Commanded speed at which the tracking error counts [m/s]."""
    rmse: float = 0.107
    """Largest v_x RMSE there [m/s]: the paper's conventional policy (table 2, A: 0.1062)."""
    rmse_aim: float = 0.071
    """Target [m/s]: the paper's actuator-aware policy with SAL (table 2, D: 0.0708)."""
    height: tuple[float, float] = (0.30, 0.35)
    """Mean trunk height [m]; the paper takes the root height for the CoM height (section 6.3)."""
    frequency: float = 1.5
    """Stride frequency [Hz], paper section 5.1."""
    frequency_tolerance: float = 0.1
    """Largest difference of the measured stride frequency [Hz]."""
    clock_match: float = 0.80
    """Smallest share of time in which a foot's contact is what the diagonal trot's clock wants."""

    def scaled(self, by: Scales) -> WalkingGate:
        """The gate of a robot of another size."""
        return (
            self
            if by == Scales()
            else replace(
                self,
                speeds=tuple(round(speed * by.speed, 3) for speed in self.speeds),
                rmse_at=round(self.rmse_at * by.speed, 3),
                rmse=round(self.rmse * by.speed, 4),
                rmse_aim=round(self.rmse_aim * by.speed, 4),
                height=(self.height[0] * by.length, self.height[1] * by.length),
                frequency=self.frequency / by.time,
            )
        )

    def judge(self, measured: dict[str, Any]) -> dict[str, bool]:
        """Each condition by name, True where it holds."""
        return {
            "never_fell": measured["never_fell"] >= self.never_fell,
            "rmse": measured["v_x_rmse"][f"{self.rmse_at:g}"] <= self.rmse,
            "height": self.height[0] <= measured["height"] <= self.height[1],
            "frequency": abs(measured["stride_frequency"] - self.frequency) <= self.frequency_tolerance,
            "clock_match": measured["clock_match"] >= self.clock_match,
        }


class GateCheck:
    """The walking gate's own batch of environments, built once and used for every check.

    Args:
        cfg: The training task; evaluated as the nominal robot without noise, randomisation and pushes, with SAL
            on unless the task has it off.
        gate: The limits.
        seed: Seed of the initial poses and gait phases.
    """

    def __init__(self, cfg: TaskCfg, *, gate: WalkingGate | None = None, seed: int = 1000) -> None:
        gate = gate or WalkingGate()
        self.env = make_env(cfg, gate.num_envs, seed)
        self.gate = gate.scaled(self.env.scales)
        speeds = torch.tensor(self.gate.speeds, device=self.env.device)
        command = torch.zeros(self.gate.num_envs, 3, device=self.env.device)
        command[:, 0] = speeds.repeat(-(-self.gate.num_envs // len(speeds)))[: self.gate.num_envs]
        self.command = command

    def __call__(self, policy: Policy) -> dict[str, Any]:
        """Measure a policy: figures as in :func:`measure`, the verdicts, ``passed``, and ``rules_not_kept``.

        The last are rules of :mod:`mrwarp.trials.gait_rules`, by the name of the figure.
        """
        self.env.restart()
        measured = measure(self.env, policy, self.command, warmup=self.gate.warmup, seconds=self.gate.seconds)
        verdicts = self.gate.judge(measured)
        return {
            **measured,
            "conditions": verdicts,
            "passed": all(verdicts.values()),
            "rules_not_kept": broken(measured["posture"]),
        }


def task_devices(cfg: TaskCfg) -> tuple[JointActuator, ...]:
    """The joints of the task's MR_Go that carry a device, read from its files alone: no engine is loaded."""
    return devices_of(replace(cfg, robot="mr_go"))


def asset_of(cfg: TaskCfg) -> RobotAsset:
    """The task's robot with its devices."""
    asset = load_robot(cfg.asset, robot=cfg.robot)
    return asset if cfg.model is None else with_model(asset, cfg.model, extrapolate=cfg.extrapolate)


def devices_of(cfg: TaskCfg) -> tuple[JointActuator, ...]:
    """The joints of the task's robot that carry a device."""
    return tuple(actuator for actuator in asset_of(cfg).actuators if actuator.mr is not None)


def foreign_device(actuators: Sequence[JointActuator]) -> str:
    """How a robot's devices differ most from the paper's, as a line for the user; empty if they are the paper's.

    Figures of another device are not compared with the paper.
    """
    for joint in actuators:
        if joint.mr is None or joint.is_paper_device:
            continue
        paper, own = MrParams(), joint.mr
        unknown = {"q_offset": paper.bouc_wen.q_offset, "q_center": paper.bouc_wen.q_center}  # no part of a device
        if not own.coil.coil_resistance:
            unknown["coil_resistance"] = paper.coil.coil_resistance
        why = "its effects" if joint.effects else "a model that cannot be read" if joint.lost else ""
        why = largest_difference(own.replace(**unknown), paper) or why or "its coil resistance is not known"
        return f"note: {joint.joint} is not the paper's device ({why}): the paper's figures are left out"
    return ""


COMPARED_AT = (1.0, 0.3)
"""Speed [rad/s] and displacement [rad] at which the torques of two devices are compared: about those of a stance."""


def largest_difference(ours: MrParams, theirs: MrParams) -> str:
    """The number of the device whose difference changes the torque most, such as ``K1 985 instead of 10.4``.

    Each number of ours alone takes its place in theirs, at the largest current that either takes; beta and gamma
    together, for their sum bounds the hysteresis. Numbers that change no torque come last, by their ratio. Empty where
    none differs.
    """
    groups = ("BoucWenParams", "HoldParams", "CoilParams")
    own, other = ours.to_dict(), theirs.to_dict()
    names = [s.name for s in theirs.specs() if s.group in groups and s.name != "q_neutral"]
    current = max(ours.coil.current_max, theirs.coil.current_max)
    sliding, holding = torques_at(theirs, current)

    def felt(name: str) -> tuple[float, float]:
        together = ("beta", "gamma") if name in ("beta", "gamma") else (name,)
        changed = torques_at(theirs.replace(**{n: own[n] for n in together}), current)
        ratio = abs(own[name] - other[name]) / (abs(own[name]) + abs(other[name]))
        return max(abs(changed[0] - sliding), abs(changed[1] - holding)), ratio

    differing = [name for name in names if own[name] != other[name]]
    if not differing:
        return ""
    name = max(differing, key=felt)
    digits = next(n for n in range(3, 18) if f"{own[name]:.{n}g}" != f"{other[name]:.{n}g}")
    return f"{name} {own[name]:.{digits}g} instead of {other[name]:.{digits}g}"


def torques_at(mr: MrParams, current: float) -> tuple[float, float]:
    """Torque [N·m] of steady sliding at :data:`COMPARED_AT` and of the yield, with a current that the coil cuts."""
    speed, angle = COMPARED_AT
    p, current = mr.bouc_wen, min(current, mr.coil.current_max)
    loop = (p.K0 + p.K1 * current) * p.z_bound / (1.0 + p.alpha * speed)
    elastic = p.C * (angle - p.q_offset - p.q_center)
    return p.D + p.B * speed + elastic + p.I1 * current + loop, mr.hold.yield_torque(current)


def limit_note(devices: Sequence[JointActuator], current: float) -> Iterator[str]:
    """A line where devices take less than a current [A]."""
    limits = sorted({a.mr.coil.current_max for a in devices if a.mr is not None})
    if limits and limits[0] < current:
        own = " or ".join(f"{limit:g}" for limit in limits if limit < current)
        yield f"note: requested {current:g} A, limited to the devices' {own} A"


def device_notes(cfg: TaskCfg, current: float) -> Iterator[str]:
    """Notes for a user on the devices before a walk, a line each.

    ``current``: what the devices may use [A].
    """
    devices = task_devices(cfg)
    yield from device_lines(devices)
    yield from limit_note(devices, current)
    if note := foreign_device(devices):
        yield note


def lost_lines(rows: Sequence[Mapping[str, Any]], patience: float) -> list[str]:
    """Explains ``fell`` and ``late`` under a table whose ``rows`` count them; nothing where no trial was lost."""
    said = {
        "fell": "fell: trials in which the robot fell",
        "late": f"late: trials that had not covered the distance after {patience:g} times distance over command",
    }
    lost = [text for name, text in said.items() if any(row[name] for row in rows)]
    return [f"{'; '.join(lost)}. They are in no mean."] if lost else []


def make_env(cfg: TaskCfg, num_envs: int, seed: int) -> WalkEnv:
    """The task as evaluated: nominal robot, no noise, commands held, as many environments as asked for."""
    cfg = make_play_cfg(cfg)
    return WalkEnv(replace(cfg, num_envs=num_envs, seed=seed, episode_seconds=float(10**6)))


def act(policies: Sequence[Policy], obs: TensorDict) -> torch.Tensor:
    """Actions of policies that each drive an equal part of the environments, one after the other."""
    if all(policy is policies[0] for policy in policies):
        return policies[0](obs)
    parts = obs.split(len(obs) // len(policies))
    return torch.cat([policy(part) for policy, part in zip(policies, parts, strict=True)])


def set_payload(env: WalkEnv, mass: np.ndarray) -> None:
    """Give the payload's body a mass per environment [kg], shape (E,); its inertia goes in proportion.

    Raises:
        ValueError: a mass is negative, or the robot was built without the payload's body.
    """
    if np.any(mass < 0.0):
        raise ValueError(f"load = {mass.min():g} kg must not be negative")
    if env.cfg.payload == 0:
        if np.any(mass > 0.0):
            raise ValueError(f"load = {mass.max():g} kg needs the payload variant {PAYLOAD_VARIANT}")
        return
    # a body needs some mass: a gram is nothing to a robot of 12 kg
    env.sim.rescale_mass(PAYLOAD_BODY, np.maximum(mass, 1e-3))


def same_starts(env: WalkEnv, trials: int, seed: int) -> None:
    """Give every group of ``trials`` environments the same poses and phases: those of a batch with these alone.

    Random draws belong to an environment's place in its batch; without this, a robot or policy would start differently
    in other company.
    """
    start = make_env(env.task, trials, seed).state()
    source = torch.arange(env.num_envs, device=env.device) % trials
    state = env.state()
    for name, value in start.items():
        if name not in ("actuator/params", "actuator/effects_values", "privileged", "key"):
            state[name] = value if value.shape == state[name].shape else value[source]
    env.load_state(state)


@torch.no_grad()
def measure(env: WalkEnv, policy: Policy, command: torch.Tensor, *, warmup: float, seconds: float) -> dict[str, Any]:
    """Roll a policy out and measure how it walks.

    Args:
        env: Evaluation environments, just restarted.
        policy: The policy.
        command: v_x, v_y [m/s] and yaw rate [rad/s], shape (E, 3), held throughout.
        warmup: Time before measuring [s].
        seconds: Measured time [s].

    Returns:
        ``reward`` per second by the environment's weights, which is without exploration here; ``never_fell`` share;
        ``v_x_rmse`` and ``v_x_bias`` by commanded speed and ``v_x_rmse_by_current`` [m/s]; ``height`` mean trunk height
        above the ground [m]; ``stride_frequency`` [Hz]; ``clock_match`` share; ``hold_share`` and ``dynamic_share`` of
        time with open gates; ``work_mr`` and ``injected`` energy of the devices [J per env]; ``unsolved_steps``;
        ``posture`` at the quickest command, see :class:`~mrwarp.trials.gait_rules.PostureMeter`.
    """
    dt, posture = env.cfg.step_dt, PostureMeter(env)
    skip, steps = round(warmup / dt), round(seconds / dt)
    v_x, height, match, contact, hold, dynamic, reward = [], [], [], [], [], [], []
    fell = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)
    unsolved = int(env.sim.unsolved.numpy().sum())
    env.set_command(command)
    obs = env.get_observations()
    for step in range(skip + steps):
        obs, rewards, _, _ = env.step(policy(obs))
        env.set_command(command)
        fell |= env.fallen
        if step >= skip:
            reward.append(rewards.clone())
            v_x.append(env.body_velocity[:, 0].clone())
            height.append(env.height.clone())
            match.append(env.clock_match.float().mean(1))
            posture.add()
            contact.append(env.f_foot > env.contact_force)
            if env.actuator.mr_joints:
                hold.append(env.view(env.actuator.m_hold).mean(1))
                dynamic.append(env.view(env.actuator.m_dyn).mean(1))
    error = torch.stack(v_x) - command[:, 0]
    by_speed = {f"{round(speed, 3):g}": command[:, 0] == speed for speed in sorted(set(command[:, 0].tolist()))}
    by_current = {f"{amps:g}": env.current_e == amps for amps in sorted(set(env.current_e.tolist()))}
    entries = env.view(env.actuator.ledger)
    work_mr = entries[:, :, int(ledger.DYNAMIC) : int(ledger.DRAG) + 1].sum((1, 2))
    return {
        "reward": float(torch.stack(reward).mean()) / dt,
        "never_fell": float((~fell).float().mean()),
        "v_x_rmse": {name: _rms(error[:, mask]) for name, mask in by_speed.items()},
        "v_x_bias": {name: float(error[:, mask].mean()) for name, mask in by_speed.items()},
        "v_x_rmse_by_current": {name: _rms(error[:, mask]) for name, mask in by_current.items()},
        "height": float(torch.stack(height).mean()),
        "stride_frequency": stride_frequency(torch.stack(contact).cpu().numpy(), dt),
        "clock_match": float(torch.stack(match).mean()),
        "hold_share": float(torch.stack(hold).mean()) if hold else 0.0,
        "dynamic_share": float(torch.stack(dynamic).mean()) if dynamic else 0.0,
        "work_mr": float(work_mr.mean()),
        "injected": float(entries[:, :, int(ledger.INJECTED)].sum(1).mean()),
        "unsolved_steps": int(env.sim.unsolved.numpy().sum()) - unsolved,
        "duration": seconds,
        "num_envs": env.num_envs,
        "posture": posture.figures(command[:, 0] == command[:, 0].max()),
    }


def stride_frequency(contact: np.ndarray, dt: float) -> float:
    """Strongest frequency of the feet's contact signal [Hz], from its mean spectrum over feet and environments.

    ``contact`` of each foot, bool, shape (T, E, L), every ``dt`` [s].
    """
    signal = contact.astype(np.float64)
    signal = signal - signal.mean(axis=0)
    power = (np.abs(np.fft.rfft(signal, axis=0)) ** 2).mean(axis=(1, 2))
    return float(np.fft.rfftfreq(len(signal), dt)[np.argmax(power)])


def _rms(values: torch.Tensor) -> float:
    return float(values.square().mean().sqrt())


@torch.no_grad()
def calf_motion(actor: Policy, name: str, *, seconds: float, dt: float, seed: int = 0) -> list[np.ndarray]:
    """Calf angles of walking robots about the neutral stance [rad], each of shape (T,), for the virtual bench.

    The robots are the paper's, with its Euler step.

    Args:
        actor: The policy.
        name: What the policy is called in messages.
        seconds: Walking time that is recorded, after 2 s to get going [s].
        dt: Time between two values [s], a part of the control step.
        seed: Seed of the initial poses.

    Raises:
        ValueError: a robot fell.
    """
    env = make_env(TaskCfg(seed=seed, z_step=ZStep.EULER), len(CALF_MOTION_SPEEDS), seed)
    command = torch.zeros(env.num_envs, 3, device=env.device)
    command[:, 0] = torch.tensor(CALF_MOTION_SPEEDS, device=env.device)
    env.set_command(command)
    obs = env.get_observations()
    states, step_dt = [], env.cfg.step_dt
    skip = round(2.0 / step_dt)
    for step in range(skip + round(seconds / step_dt)):
        obs, _, done, _ = env.step(actor(obs))
        env.set_command(command)
        if bool(done.any()):
            raise ValueError(f"{name}: the robot fell after {step * step_dt:.1f} s; use a policy that walks")
        if step >= skip:
            states.append([x[:, list(CALF_COLUMNS)].flatten().cpu().numpy() for x in (env.q, env.qd)])
    q, qd = np.array(states).transpose(1, 2, 0)
    t = np.arange(q.shape[1]) * step_dt
    fine = np.arange((len(t) - 1) * round(step_dt / dt)) * dt
    from scipy.interpolate import CubicHermiteSpline  # `mrwarp play` does without

    return list(CubicHermiteSpline(t, q - DEFAULT_POSE["calf"], qd, axis=1)(fine))
