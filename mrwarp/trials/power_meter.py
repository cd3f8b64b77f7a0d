"""Measurements of walking robots: sums of torque and motion per environment, and two strides of a calf as a series."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from mrwarp.energy.power import JointLoad
from mrwarp.env.vec_env import WalkEnv
from mrwarp.usd.robot import JOINTS, leg_of

BIN = 0.5
"""Width of the bins of the torque distributions [N·m]."""

RANGE = 40.0
"""Torques beyond this count into the outermost bins [N·m]; the calf's limit is 35.55."""

SHOWN = tuple(JOINTS.index(f"FR_{segment}") for segment in ("hip", "thigh", "calf"))
"""Joints whose torque distribution is kept, figure 8(c)."""

JOINT = "FR_calf"
"""The calf that is recorded, the paper's."""

STANCE = ("foot off the ground", "loaded, before it is held", "held", "loaded, after it was held")
"""States of the calf :data:`JOINT` while a torque step is counted, in the order of a stride."""

STANDING = 0.2
"""Speed below which a joint stands, so that a brake could hold what its motor holds [rad/s]: eps_hold of eq. 8."""

STRIDES = 2
"""Strides that are kept, the first after the warm-up."""

CHANNELS = ("f_foot", "q_des", "q", "qd", "tau_motor", "tau_mr", "current", "m_hold", "m_dyn")
"""Recorded quantities [N, rad, rad, rad/s, N·m, N·m, A, 1, 1]."""


def torque_of_bins() -> np.ndarray:
    """Torque |tau| at the middle of each bin of a distribution [N·m], shape (bins,)."""
    return np.abs((np.arange(round(2.0 * RANGE / BIN)) + 0.5) * BIN - RANGE)


class PowerMeter:
    """Counts the torque steps of the environments that are switched on; one of ``env.substep_hooks``.

    Args:
        env: The environments.

    Attributes:
        on: Environments that are counted, bool, shape (E,); write it between policy steps.
        seconds: Counted time [s], shape (E,).
        braking: Mean of the squared motor torque where a brake at the joint could bear it instead, because the motor
            takes power from the joint or the joint stands (:data:`STANDING`) [(N·m)^2], shape (E, J).
        hold, dynamic: Share of that time with open gates, shape (E, M).
        counts: Torque steps by motor torque of the :data:`SHOWN` joints, shape (E, 3, bins).
        stance: The same of the calf :data:`JOINT` by :data:`STANCE`, shape (E, 4, bins); 0 where it has no device.
    """

    def __init__(self, env: WalkEnv) -> None:
        actuator, self._dt = env.actuator, env.sim.dt
        self._qd, self._tau, self._mr = env.qd, env.view(actuator.tau_motor), list(actuator.mr_joints)
        self._device = {name: env.view(getattr(actuator, name)) for name in ("tau_mr", "current", "m_hold", "m_dyn")}
        self._resistance, self._current_e = env.view(actuator.param("coil_resistance")), env.current_e
        zeros = functools.partial(torch.zeros, dtype=torch.float64, device=env.device)
        count = env.num_envs
        self.on = torch.zeros(count, dtype=torch.bool, device=env.device)
        self._steps = zeros(count)
        self._sums = {name: zeros(count, env.q.shape[1]) for name in ("square", "braking", "speed", "out", "in")}
        self._sums |= {
            name: zeros(count, len(self._mr)) for name in ("coil", "friction", "hold", "dynamic", "switches")
        }
        self.counts = zeros(count, len(SHOWN), round(2.0 * RANGE / BIN)).float()
        self.stance = zeros(count, len(STANCE), self.counts.shape[2]).float()
        joint = JOINTS.index(JOINT)
        self._slot = self._mr.index(joint) if joint in self._mr else None
        self._load, self._threshold = env.f_foot[:, leg_of(JOINT)], env.view(actuator.param("f_th"))
        self._was_held = torch.zeros_like(self.on)
        self._gates = torch.zeros_like(self._device["m_hold"])
        env.substep_hooks.append(self.count)

    @torch.no_grad()
    def count(self) -> None:
        """Add the torque step that has just been simulated: its torques over the motion that it ended with."""
        on = self.on.to(torch.float64).unsqueeze(1)
        power = self._tau * self._qd
        self._steps += on[:, 0]
        self._sums["square"] += on * self._tau.square()
        bearable = (power <= 0.0) | (self._qd.abs() < STANDING)
        self._sums["braking"] += on * bearable * self._tau.square()
        self._sums["speed"] += on * self._qd.abs()
        self._sums["out"] += on * power.clamp(min=0.0)
        self._sums["in"] += on * (-power).clamp(min=0.0)
        bins = ((self._tau[:, SHOWN] + RANGE) / BIN).long().clamp(0, self.counts.shape[2] - 1)
        self.counts.scatter_add_(2, bins.unsqueeze(2), on.float().unsqueeze(2).expand(-1, len(SHOWN), 1))
        if self._slot is not None:
            self._count_stance(bins[:, SHOWN.index(self._mr[self._slot])], self._slot)
        if self._mr:
            device = self._device
            self._sums["coil"] += torch.where(self.on[:, None], coil_loss(device["current"], self._resistance), 0.0)
            self._sums["friction"] += on * (-device["tau_mr"] * self._qd[:, self._mr])
            self._sums["hold"] += on * device["m_hold"]
            gates = device["m_hold"] + 2.0 * device["m_dyn"]
            self._sums["switches"] += on * (gates != self._gates)
            self._gates.copy_(gates)
            # without current the dynamic gate does nothing but keep the drag
            self._sums["dynamic"] += on * device["m_dyn"] * (self._current_e > 0.0).unsqueeze(1)

    def _count_stance(self, bins: torch.Tensor, slot: int) -> None:
        """Add the step of the calf :data:`JOINT`, whose torque lies in ``bins``, shape (E,)."""
        held = self._device["m_hold"][:, slot] > 0.0
        loaded = held | (self._load > self._threshold[:, slot])
        self._was_held = loaded & (self._was_held | held)
        part = loaded.long() + held.long() + 2 * (self._was_held & ~held).long()
        at = (part * self.stance.shape[2] + bins).unsqueeze(1)
        self.stance.view(len(part), -1).scatter_add_(1, at, self.on.float().unsqueeze(1))

    def clear(self) -> None:
        """Forget what was counted."""
        for total in (*self._sums.values(), self.counts, self.stance, self._steps):
            total.zero_()

    @property
    def seconds(self) -> np.ndarray:
        """Counted time [s], shape (E,)."""
        return self._steps.cpu().numpy() * self._dt

    def joint_load(self) -> JointLoad:
        """Means over the counted time, shapes (E, J) and (E, M)."""
        return JointLoad(
            torque_square=self._mean("square"),
            speed=self._mean("speed"),
            work_out=self._mean("out"),
            work_in=self._mean("in"),
            coil=self._mean("coil"),
            friction=self._mean("friction"),
        )

    @property
    def braking(self) -> np.ndarray:
        """Mean squared motor torque that a brake could bear [(N·m)^2], shape (E, J)."""
        return self._mean("braking")

    @property
    def hold(self) -> np.ndarray:
        """Share of the counted time with the holding gate open, shape (E, M)."""
        return self._mean("hold")

    @property
    def dynamic(self) -> np.ndarray:
        """Share of the counted time with the dynamic gate open and current to use, shape (E, M)."""
        return self._mean("dynamic")

    @property
    def switches(self) -> np.ndarray:
        """Times per second that a device's gates opened or closed [1/s], shape (E, M)."""
        return self._mean("switches") / self._dt

    def _mean(self, name: str) -> np.ndarray:
        return (self._sums[name] / self._steps.clamp(min=1.0).unsqueeze(1)).cpu().numpy()


def coil_loss(current: torch.Tensor, resistance: torch.Tensor) -> torch.Tensor:
    """Loss of coils [W] by current [A] and resistance [Ohm].

    NaN where a current flows through a coil whose resistance, 0, is not known.
    """
    known = torch.where(resistance > 0.0, resistance, torch.nan).to(torch.float64)
    return torch.where(current == 0.0, 0.0, known * current.square())


class MotionMeter:
    """How trunks move against the command, over the policy steps that count.

    Args:
        env: The environments.
        command: v_x, v_y [m/s] and yaw rate [rad/s], shape (E, 3).
    """

    def __init__(self, env: WalkEnv, command: torch.Tensor) -> None:
        self._env, self._command = env, command.to(torch.float64)
        names = ("steps", "speed", "error_square", "height", "height_square", "tilt_square", "yaw_square")
        self._sums = {name: torch.zeros(env.num_envs, dtype=torch.float64, device=env.device) for name in names}

    @property
    def seconds(self) -> torch.Tensor:
        """Counted time [s], shape (E,)."""
        return self._sums["steps"] * self._env.cfg.step_dt

    @property
    def distance(self) -> torch.Tensor:
        """Way forward in that time [m], shape (E,)."""
        return self._sums["speed"] * self._env.cfg.step_dt

    def add(self, counted: torch.Tensor) -> None:
        """Add the policy step that has just been simulated, of these environments; bool, shape (E,)."""
        env = self._env
        roll = torch.atan2(-env.gravity[:, 1], -env.gravity[:, 2])
        pitch = torch.asin(env.gravity[:, 0].clamp(-1.0, 1.0))
        speed = env.body_velocity[:, 0].to(torch.float64)
        values = {
            "steps": torch.ones_like(speed),
            "speed": speed,
            "error_square": (speed - self._command[:, 0]).square(),
            "height": env.height.to(torch.float64),
            "height_square": (env.height.to(torch.float64) - env.cfg.rewards.target_height).square(),
            "tilt_square": roll.square() + pitch.square(),
            "yaw_square": (env.root_ang[:, 2] - self._command[:, 2]).square(),
        }
        for name, value in values.items():
            self._sums[name] += torch.where(counted, torch.nan_to_num(value), 0.0)

    def figures(self) -> dict[str, np.ndarray]:
        """Figures by name, shape (E,); NaN where nothing was counted.

        Returns:
            ``speed``, its ``v_x_bias`` and ``v_x_rmse`` about the command [m/s]; ``height`` of the trunk over the
            ground, the paper's proxy of the CoM's, its ``height_rmse`` about the rewarded one and ``height_sd`` about
            its own mean [m]; ``tilt_rms``, the root of mean roll^2 + pitch^2 [deg]; ``yaw_rate_rmse`` [rad/s].
        """
        steps = self._sums["steps"]
        mean = {name: (total / steps).cpu().numpy() for name, total in self._sums.items()}
        off = mean["height"] - self._env.cfg.rewards.target_height
        return {
            "speed": mean["speed"],
            "v_x_bias": mean["speed"] - self._command[:, 0].cpu().numpy(),
            "v_x_rmse": np.sqrt(mean["error_square"]),
            "height": mean["height"],
            "height_rmse": np.sqrt(mean["height_square"]),
            "height_sd": np.sqrt(np.maximum(mean["height_square"] - off**2, 0.0)),
            "tilt_rms": np.degrees(np.sqrt(mean["tilt_square"])),
            "yaw_rate_rmse": np.sqrt(mean["yaw_square"]),
        }


def leg_channels(env: WalkEnv) -> dict[str, torch.Tensor]:
    """:data:`CHANNELS` of the joint that is followed on each leg, as they are now, shape (E, L); 0 without a device."""
    device, scene = env.actuator, env.sim.scene
    followed = list(scene.watched)
    slots = [slot for slot, joint in enumerate(device.mr_joints) if joint in followed]
    legs = [followed.index(device.mr_joints[slot]) for slot in slots]
    motor = {"q_des": env.q_des, "q": env.q, "qd": env.qd, "tau_motor": env.view(device.tau_motor)}
    found = {"f_foot": env.f_foot, **{name: array[:, followed] for name, array in motor.items()}}
    for name in ("tau_mr", "current", "m_hold", "m_dyn"):
        found[name] = torch.zeros(env.num_envs, len(env.layout.legs), device=env.device)
        found[name][:, legs] = env.view(getattr(device, name))[:, slots]
    return found


@dataclass(frozen=True, kw_only=True)
class GaitTrace:
    """The recorded calf of one robot."""

    t: np.ndarray
    """Time [s], shape (T,)."""
    values: dict[str, np.ndarray]
    """Every channel of :data:`CHANNELS` by name, shape (T,)."""


class TraceRecorder:
    """Records the calf of some environments after every torque step; one of ``env.substep_hooks``.

    Args:
        env: The environments.
        shown: Which of them, by index.

    Attributes:
        on: Whether to record; it stops by itself after :data:`STRIDES`.
    """

    def __init__(self, env: WalkEnv, shown: Sequence[int]) -> None:
        self.on = False
        self._env, self._rows = env, torch.tensor(list(shown), device=env.device)
        self._length = round(STRIDES / env.cfg.gait_frequency / env.sim.dt)
        self._samples: list[dict[str, np.ndarray]] = []
        env.substep_hooks.append(self.count)

    def count(self) -> None:
        """Keep the torque step that has just been simulated."""
        if self.on and len(self._samples) < self._length:
            now, leg = leg_channels(self._env), leg_of(JOINT)
            self._samples.append({name: values[self._rows, leg].cpu().numpy() for name, values in now.items()})

    def trace(self, index: int) -> GaitTrace:
        """Recorded series of the ``index``-th shown environment."""
        values = {name: np.array([sample[name][index] for sample in self._samples]) for name in CHANNELS}
        return GaitTrace(t=np.arange(len(self._samples)) * self._env.sim.dt, values=values)
