"""Impact trials: the same walking robots, at the same instant, hit in the same way; only the MR current differs.

Three impacts: the paper's 100 N downward push on the trunk (section 6.3, simulation), its guided 10 kg mass (hardware)
as a real body, and a push from any direction. All currents run in one batch as bit-equal copies of the same trials.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tensordict import TensorDict

from mrwarp.enums import HoldCurrent
from mrwarp.env.cfg import TaskCfg, make_play_cfg
from mrwarp.env.natural_units import Scales
from mrwarp.env.vec_env import WalkEnv
from mrwarp.kernels.ledger import COIL
from mrwarp.params import MrParams
from mrwarp.trials.falling_mass import FallingMass, MassCfg, add_mass
from mrwarp.trials.power_meter import leg_channels
from mrwarp.trials.walking import Policy, foreign_device
from mrwarp.usd.asset import load_robot
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS, MR_GO

FALL_HEIGHT = 0.10
"""Trunk height below which an impacted robot counts as fallen [m]: its belly is on the ground."""


class ImpactKind(enum.Enum):
    """How the robot is hit."""

    PUSH = "push"
    DROP = "drop"


@dataclass(frozen=True, kw_only=True)
class Variant:
    """One device setting under which every trial is repeated."""

    current: float
    """Current I_e [A]."""
    params: dict[str, float] = field(default_factory=dict)
    """MR parameters that differ from the asset from the impact's onset on, e.g. ``{"eps_e": 0.09}``."""
    duration: float | None = None
    """Duration of the push [s]; None takes the sweep's."""


@dataclass(frozen=True, kw_only=True)
class ImpactCfg:
    """One sweep of impact trials."""

    kind: ImpactKind = ImpactKind.PUSH
    """Push on the trunk, or the falling mass."""
    variants: tuple[Variant, ...] = tuple(Variant(current=current) for current in CURRENT_GROUPS)
    """Device settings; every trial is repeated with each. The first is the reference of the paired changes."""
    trials: int = 20
    """Trials per setting, at random gait phases."""
    speed: float = 0.5
    """Commanded forward speed [m/s]."""
    warmup: float = 3.0
    """Walking before the impact [s], without current in all copies so that they stay bit-equal."""
    window: float = 0.6
    """Time after the impact's onset over which minima are taken [s]."""
    force: tuple[float, float, float] = (0.0, 0.0, -100.0)
    """Push on the trunk [N], world frame; the paper's is 100 N downward."""
    duration: float = 0.2
    """Duration of the push [s]; not in the paper; table 4 calibrates its own on the 0 A row."""
    phases: tuple[float, float] | None = None
    """Gait phases at the push's onset, or when the mass should meet a robot at rest, evenly spread over the trials;
    None leaves them random. FL and RR stand in the first half of the clock, FR and RL in the second."""
    gains: tuple[float, float] | None = None
    """Kp [N·m/rad] and Kd [N·m·s/rad] of all motors; None keeps those of ``env``."""
    mass: MassCfg = field(default_factory=MassCfg)
    """The falling mass."""
    env: TaskCfg = field(default_factory=TaskCfg)
    """Robot, actuator and coupling."""
    seed: int = 0
    """Seed of initial poses and gait phases."""

    def __post_init__(self) -> None:
        if self.trials < 1:
            raise ValueError(f"trials = {self.trials} must be at least 1")
        if not self.variants:
            raise ValueError("variants = () must be at least one setting of the device")
        if not all(map(math.isfinite, (self.speed, *self.force))):
            raise ValueError(f"speed = {self.speed} m/s and force = {self.force} N must be finite")
        for duration in self.durations:
            if not 0.0 < duration <= self.window:
                raise ValueError(f"duration = {duration} s must lie in (0, window = {self.window} s]")
        if not all(0.0 <= current < math.inf for current in self.currents):
            raise ValueError(f"currents = {self.currents} A: must be finite, none below 0")
        for variant in self.variants:
            for name, value in variant.params.items():
                MrParams.spec(name).check(value, "impact variant")

    def scaled(self, by: Scales) -> ImpactCfg:
        """The impact scaled to a robot of another size: speeds, times, lengths and body weights in proportion."""
        if by == Scales():
            return self
        return replace(
            self,
            speed=round(self.speed * by.speed, 3),
            force=tuple(x * by.mass for x in self.force),
            duration=self.duration * by.time,
            window=self.window * by.time,
            mass=self.mass.scaled(by),
        )

    @property
    def durations(self) -> tuple[float, ...]:
        """Duration of the push in each setting [s]."""
        return tuple(self.duration if v.duration is None else v.duration for v in self.variants)

    @property
    def currents(self) -> tuple[float, ...]:
        """Current of each setting [A]."""
        return tuple(variant.current for variant in self.variants)


@dataclass(frozen=True, kw_only=True)
class ImpactTrace:
    """Time series of a sweep at 200 Hz from the impact's onset; C settings, N trials, T samples, L legs."""

    t: np.ndarray
    """Time since onset [s], shape (T,)."""
    legs: tuple[str, ...] = LEGS
    """Names of the legs; length L."""
    height: np.ndarray
    """Trunk height, the paper's proxy of the CoM height [m], shape (C, N, T)."""
    velocity: np.ndarray
    """Vertical trunk velocity [m/s], shape (C, N, T)."""
    tau_motor: np.ndarray
    """Motor torque of each leg's joint that is followed, the shipped robot's calf [N·m], shape (C, N, T, L)."""
    tau_mr: np.ndarray
    """Torque of its device [N·m], shape (C, N, T, L)."""
    current: np.ndarray
    """Coil current [A], shape (C, N, T, L)."""
    m_dyn: np.ndarray
    """Dynamic gate, shape (C, N, T, L)."""
    m_hold: np.ndarray
    """Holding gate, shape (C, N, T, L)."""
    f_foot: np.ndarray
    """Foot forces [N], shape (C, N, T, L)."""
    q: np.ndarray
    """Its angle [rad], shape (C, N, T, L)."""
    qd: np.ndarray
    """Its velocity [rad/s], shape (C, N, T, L)."""
    qpos: np.ndarray
    """MuJoCo positions of the first trial, shape (C, T, nq)."""
    ledger: np.ndarray
    """Energy by ledger entry summed over joints, at the end of the window [J], shape (C, N, entries)."""
    fell: np.ndarray
    """Whether the robot fell within the window, bool, shape (C, N)."""
    contact: np.ndarray
    """Time after the onset at which the mass met the trunk [s], NaN if it did not; 0 for a push; shape (C, N)."""


class ImpactSweep:
    """Runs impact trials on one set of environments, built once.

    Args:
        cfg: The sweep.
        policy: The walking policy.

    Attributes:
        env: The environments; setting i, trial k is environment ``i*trials + k``.
        forces: Push on each trunk [N], world frame, shape (E, 3); may be changed before a run.
        foreign: How the devices differ from the paper's, see :func:`mrwarp.trials.walking.foreign_device`.
        watchers: Called after every torque step with the time relative to the impact's onset [s], e.g. to show it.
    """

    def __init__(self, cfg: ImpactCfg, policy: Policy) -> None:
        self.cfg, self.policy = cfg, policy
        env_cfg = make_play_cfg(cfg.env)
        env_cfg = replace(
            env_cfg,
            num_envs=cfg.trials * len(cfg.variants),
            currents=cfg.currents,
            seed=cfg.seed,
            gains=cfg.gains or env_cfg.gains,
            episode_seconds=1e6,
            fall_height=-1e3,
            fall_tilt=3.2,
        )
        drop = cfg.kind is ImpactKind.DROP
        layout = load_robot(env_cfg.asset, robot=env_cfg.robot).layout
        self.env = WalkEnv(env_cfg, edit=add_mass(cfg.mass, layout) if drop else None)
        self.mass = FallingMass(self.env, cfg.mass) if drop else None
        self.foreign = foreign_device(self.env.sim.scene.actuators)
        if layout != MR_GO:
            self.foreign = (
                f"note: {Path(env_cfg.robot).name} is not the paper's robot: the paper's figures are left out"
            )
        self.currents = self.env.current_e.clone()
        self.forces = np.tile(cfg.force, (self.env.num_envs, 1))
        self._command = torch.tensor([cfg.speed, 0.0, 0.0], device=self.env.device)
        names = dict.fromkeys(name for variant in cfg.variants for name in variant.params)
        self._params = {name: self.env.view(self.env.actuator.param(name)).clone() for name in names}
        self.watchers: list[Callable[[float], None]] = []
        self._time = 0.0
        self._walked_in: dict[str, torch.Tensor] | None = None

    def run(self, *, again: bool = False) -> ImpactTrace:
        """Walk in, hit, and record; ``again``: begin with robots that walked in before, here or by :meth:`begin_with`.

        Until the onset every robot has the asset's device without current, so that all copies of a trial are equal.
        """
        cfg, env, mass = self.cfg, self.env, self.mass
        env.substep_hooks.clear()
        if self.watchers:
            env.substep_hooks.append(self._notify)
        if again and self._walked_in is not None:
            self._set(current=False)
            env.load_state(self._walked_in)
        else:
            self.walk_in()
        obs = env.get_observations()
        if mass is not None:
            self._fall_until_contact(mass, obs)
            obs = env.get_observations()
        self._set(current=True)
        env.actuator.ledger.zero_()
        self._time = 0.0
        recorder = _Recorder(env)
        env.substep_hooks.append(recorder.sample)
        contact = torch.zeros(env.num_envs, device=env.device)
        if mass is not None:
            contact[~mass.touched] = float("nan")
            env.substep_hooks.append(lambda: self._meet(mass, contact, recorder))
        else:
            env.substep_hooks.append(self._push())
        self._walk(obs, cfg.window)
        env.substep_hooks.clear()
        if mass is None:
            env.sim.push(env.layout.trunk, np.zeros((env.num_envs, 3)))
        return recorder.trace(contact, len(cfg.variants))

    def begin_with(self, other: ImpactSweep) -> None:
        """Let ``run(again=True)`` begin with the robots that another sweep of the same trials walked in.

        The other may have a single setting, so that every trial walks in once. Its bits differ from those of an own
        walk by the rounding of a policy on a smaller batch.

        Raises:
            ValueError: the other sweep has not walked in, or has other trials.
        """
        walked, trials = other._walked_in, self.cfg.trials
        if walked is None or other.cfg.trials != trials:
            raise ValueError(f"begin_with: the other sweep must have walked in with {trials} trials")
        source = torch.arange(self.env.num_envs, device=self.env.device) % trials
        self.env.copy_envs(source, walked)
        self._walked_in = self.env.state()

    def _set(self, *, current: bool) -> None:
        """Give the robots their settings of the device; or the asset's without current, and hold the mass."""
        cfg, env = self.cfg, self.env
        if self.mass is not None and not current:
            self.mass.hold()
        if current:
            env.current_e.copy_(self.currents)
        else:
            env.current_e.zero_()
        for name, before in self._params.items():
            values = env.view(env.actuator.param(name))
            values.copy_(before)
            for i, variant in enumerate(cfg.variants):
                if current and name in variant.params:
                    values[i * cfg.trials : (i + 1) * cfg.trials] = variant.params[name]

    def walk_in(self) -> None:
        """Copies of the same robots just before they are hit, or before the mass is released over them."""
        cfg, env, mass = self.cfg, self.env, self.mass
        self._set(current=False)
        env.restart()
        source = torch.arange(env.num_envs, device=env.device) % cfg.trials
        if cfg.phases is not None:
            low, high = cfg.phases
            onset = low + (high - low) * (source + 0.5) / cfg.trials
            before = cfg.warmup + (self.fall_time if mass is not None else 0.0)
            env.phase.copy_((onset - before * env.cfg.gait_frequency).remainder(1.0))
        env.copy_envs(source)
        env.set_command(self._command)
        self._time = -cfg.warmup
        self._walk(env.get_observations(), cfg.warmup)
        self._walked_in = env.state()

    @property
    def fall_time(self) -> float:
        """Time from the mass' release to its contact with a trunk that stays where it is [s]."""
        return 2.0 * self.cfg.mass.drop / self.cfg.mass.contact_speed

    def _walk(self, obs: TensorDict, seconds: float) -> TensorDict:
        """Walk on from these observations with the command held; returns the last ones."""
        for _ in range(round(seconds / self.env.cfg.step_dt)):
            obs, _, _, _ = self.env.step(self.policy(obs))
            self.env.set_command(self._command)
        return obs

    def _notify(self) -> None:
        """Give the watchers the time; a torque step has passed."""
        self._time += self.env.sim.dt
        for watch in self.watchers:
            watch(self._time)

    def _push(self) -> Callable[[], None]:
        """Push the trunks from now on; the hook ends each push after its setting's duration."""
        sim, cfg = self.env.sim, self.cfg
        left = np.repeat([round(duration / sim.dt) for duration in cfg.durations], cfg.trials)
        force, trunk = self.forces, self.env.layout.trunk
        sim.push(trunk, force)

        def tick() -> None:
            left[:] -= 1
            if (left == 0).any():
                sim.push(trunk, np.where(left[:, None] > 0, force, 0.0))

        return tick

    def _meet(self, mass: FallingMass, contact: torch.Tensor, recorder: _Recorder) -> None:
        """Advance the mass and note when it meets each trunk."""
        before = mass.touched.clone()
        mass.update()
        contact[mass.touched & ~before] = len(recorder.rows["height"]) * self.env.sim.dt

    def _fall_until_contact(self, mass: FallingMass, obs: TensorDict) -> None:
        """Release the mass and walk on, still without current, until just before the first robot is touched."""
        mass.release()
        for _ in range(int(self.fall_time / self.env.cfg.step_dt) - 2):
            obs, _, _, _ = self.env.step(self.policy(obs))
            mass.update()


class _Recorder:
    """Collects one sample of every series per torque step."""

    def __init__(self, env: WalkEnv) -> None:
        self.env = env
        self.rows: dict[str, list[torch.Tensor]] = {}
        self.fell = torch.zeros(env.num_envs, dtype=torch.bool, device=env.device)

    def sample(self) -> None:
        """Take one sample of everything."""
        env, legs = self.env, leg_channels(self.env)
        del legs["q_des"]
        trunk = {"height": env.root_pos[:, 2], "velocity": env.root_vel[:, 2]}
        for name, value in (trunk | legs | {"qpos": env.view(env.sim.backend.field("qpos"))}).items():
            self.rows.setdefault(name, []).append(value.clone())
        self.fell |= env.root_pos[:, 2] < FALL_HEIGHT * env.scales.length

    def trace(self, contact: torch.Tensor, settings: int) -> ImpactTrace:
        """Everything sampled so far, by setting and trial."""
        env = self.env
        found = {name: torch.stack(rows, dim=1) for name, rows in self.rows.items()}
        found |= {"ledger": _entries(env), "fell": self.fell, "contact": contact}
        split = {name: x.cpu().numpy().reshape(settings, -1, *x.shape[1:]) for name, x in found.items()}
        t = np.arange(1, split["height"].shape[2] + 1) * env.sim.dt
        return ImpactTrace(t=t, legs=env.layout.leg_names, **{**split, "qpos": split["qpos"][:, 0]})


def _entries(env: WalkEnv) -> torch.Tensor:
    """Energy by ledger entry, summed over joints [J], shape (E, entries); coils of unknown resistance took NaN."""
    entries, resistance = env.view(env.actuator.ledger).sum(1), env.view(env.actuator.param("coil_resistance"))
    entries[(resistance == 0.0).any(1) & (env.current_e > 0.0), int(COIL)] = torch.nan
    return entries


def body_extremes(trace: ImpactTrace) -> dict[str, np.ndarray]:
    """Both columns of table 4: ``min_height`` [m] and ``peak_down_velocity`` [m/s] of every trial, shape (C, N)."""
    return {"min_height": trace.height.min(axis=2), "peak_down_velocity": trace.velocity.min(axis=2)}


def fixed_current_env(*, holding: bool = False, **choices: Any) -> TaskCfg:
    """Task of an impact: devices take all the current; damping alone, or the holding branch too.

    Further ``choices`` are those of :func:`TaskCfg`.
    """
    env = TaskCfg(hold_current=HoldCurrent.FIXED, **choices)
    return replace(env, holding=holding)
