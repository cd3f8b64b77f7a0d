"""Motions of a virtual robot while it is logged: walk under a policy, stand, squat, move in the air."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
import torch
from scipy.spatial.transform import Rotation

from mrwarp.env.observations import QD_SCALE
from mrwarp.params import MrParams
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.robot_logs.virtual.described_robot import Description
from mrwarp.robot_logs.virtual.true_robot import Command
from mrwarp.usd.robot import STAND_HEIGHT

AIR = ("chirp", "slow", "steps")
"""Motions of a robot whose trunk is held; the others need the ground."""

WITH_DEVICES = ("walk", "stand")
"""Motions in which the devices have current: a brake that holds slow joints would keep a robot from squatting."""


@dataclass(frozen=True, kw_only=True)
class Readings:
    """The controller's inputs at a tick; L legs."""

    t: float
    """Since the motion began [s]."""
    q: np.ndarray
    qd: np.ndarray
    gyro: np.ndarray
    """[rad/s]."""
    gravity: np.ndarray
    """Direction of gravity in the trunk's frame [1]."""
    forces: np.ndarray
    """Of the feet [N], shape (L,)."""


class Motion(Protocol):
    """Targets over time."""

    def __call__(self, seen: Readings) -> np.ndarray:
        """Targets [rad], shape (J,)."""
        ...


class Walk:
    """A policy at commanded speeds; its observations are those of :mod:`mrwarp.env.observations`."""

    def __init__(
        self, d: Description, policy: OnnxPolicy, rng: np.random.Generator, speeds: tuple[float, float] | None
    ) -> None:
        assert d.layout is not None
        task = policy.description.get("task", {})
        self.policy, self.neutral = policy, d.neutral
        self.scale, self.period = float(task.get("action_scale", 0.25)), float(task.get("step_dt", 0.02))
        self.frequency = float(task.get("gait_frequency", 1.5)) / d.scales.time
        self.rng, self.turns = rng, 0.2 / d.scales.time
        self.speeds = speeds or (0.2 * d.scales.speed, 0.6 * d.scales.speed)
        self.action, self.next, self.turn = np.zeros(len(d.joints)), 0.0, 0.0
        self.command, self.phase = np.zeros(3), float(rng.uniform())

    def __call__(self, seen: Readings) -> np.ndarray:
        """Targets of the policy, held over its period."""
        if seen.t >= self.turn - 1e-9:
            self.turn += 4.0
            self.command = np.array([self.rng.uniform(*self.speeds), 0.0, self.rng.uniform(-self.turns, self.turns)])
        if seen.t >= self.next - 1e-9:
            angle = 2.0 * math.pi * (self.phase + self.frequency * self.next)
            obs = np.concatenate([
                seen.gyro, seen.gravity, self.command, seen.q - self.neutral, QD_SCALE * seen.qd, self.action,
                [math.sin(angle), math.cos(angle)],
            ])  # fmt: skip
            self.action = self.policy(torch.from_numpy(obs[None].astype(np.float32))).numpy()[0].astype(float)
            self.next += self.period
        return self.neutral + self.scale * self.action


class Pose:
    """Feet that stay where they stand while the trunk moves along a given path."""

    def __init__(self, d: Description, path: Callable[[float], np.ndarray]) -> None:
        self.path, self.neutral = path, d.neutral
        self.model = d.spec.compile()
        self.data = mujoco.MjData(self.model)
        ids = [self.model.joint(name).id for name in d.joints]
        self.q_adr, self.v_adr = self.model.jnt_qposadr[ids], self.model.jnt_dofadr[ids]
        self.feet = [self.model.geom(name).id for name in d.feet]
        self.q = d.neutral.copy()
        self.rest = self._points(d.neutral)
        self.height = -float(self.rest[:, 2].min())

    def _points(self, q: np.ndarray) -> np.ndarray:
        self.data.qpos[:] = 0.0
        self.data.qpos[3] = 1.0
        self.data.qpos[self.q_adr] = q
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        return self.data.geom_xpos[self.feet].copy()

    def __call__(self, seen: Readings) -> np.ndarray:
        """Inverse kinematics by damped steps from the last solution; ``path`` gives x, y, z [m], roll, pitch [rad]."""
        move = self.path(seen.t)
        wanted = Rotation.from_euler("xyz", [*move[3:], 0.0]).inv().apply(self.rest - move[:3])
        jac, rot = np.zeros((3, self.model.nv)), np.zeros((3, self.model.nv))
        for _ in range(3):
            miss = wanted - self._points(self.q)
            rows = []
            for foot in self.feet:
                mujoco.mj_jac(self.model, self.data, jac, rot, self.data.geom_xpos[foot], self.model.geom_bodyid[foot])
                rows.append(jac[:, self.v_adr].copy())
            a = np.concatenate(rows)
            # a weak pull to the neutral pose decides where a leg has more joints than the foot needs
            self.q += np.linalg.solve(
                a.T @ a + 1e-5 * np.eye(a.shape[1]), a.T @ miss.ravel() - 1e-6 * (self.q - self.neutral)
            )
        return self.q.copy()


class Swing:
    """Every joint about its neutral pose, each with its own phase, within its range."""

    def __init__(self, d: Description, rng: np.random.Generator, seconds: float, kind: str) -> None:
        model = d.spec.compile()
        self.neutral, joints = d.neutral, len(d.joints)
        self.phase = rng.uniform(0.0, 1.0, joints)
        self.seconds, self.kind, self.rng = seconds, kind, rng
        self.room = np.full(joints, 0.35)
        for k, name in enumerate(d.joints):
            joint = model.joint(name)
            if model.jnt_limited[joint.id]:
                low, high = model.jnt_range[joint.id]
                self.room[k] = max(min(0.35, 0.8 * min(d.neutral[k] - low, high - d.neutral[k])), 0.02)
        self.target, self.next = np.zeros(joints), np.zeros(joints)

    def __call__(self, seen: Readings) -> np.ndarray:
        """Targets of a sweep, a triangle or steps."""
        t, fade = seen.t, min(seen.t / 1.0, 1.0)
        if self.kind == "steps":
            due = t >= self.next - 1e-9
            self.target = np.where(due, self.room * self.rng.uniform(-0.6, 0.6, len(self.room)), self.target)
            self.next = np.where(due, t + self.rng.uniform(0.3, 1.2, len(self.room)), self.next)
            return self.neutral + self.target
        if self.kind == "slow":
            return self.neutral + fade * self.room * (4.0 * np.abs((self.phase + 0.15 * t) % 1.0 - 0.5) - 1.0)
        # sweeps of 15 s: 0.2 to 3 Hz, smaller when quick
        low, high, sweep = 0.2, 3.0, min(15.0, self.seconds)
        x = t % sweep
        rate = math.log(high / low) / sweep
        cycles = low * (math.exp(rate * x) - 1.0) / rate
        size = 0.9 / (1.0 + low * math.exp(rate * x))
        return self.neutral + fade * self.room * size * np.sin(2.0 * np.pi * (self.phase + cycles))


def make_motion(
    name: str,
    d: Description,
    rng: np.random.Generator,
    seconds: float,
    policy: OnnxPolicy | None,
    speeds: tuple[float, float] | None,
) -> Motion:
    """A motion by its name."""
    if name == "walk":
        assert policy is not None
        return Walk(d, policy, rng, speeds)
    if name in AIR:
        return Swing(d, rng, seconds, name)
    return Pose(d, _path(name, rng, STAND_HEIGHT * d.scales.length))


def _path(name: str, rng: np.random.Generator, size: float) -> Callable[[float], np.ndarray]:
    """Movement of the trunk of a robot whose stance is ``size`` [m] high: x, y, z [m], roll, pitch [rad]."""
    phase = rng.uniform(0.0, 2.0 * np.pi, 5)

    def still(_: float) -> np.ndarray:
        return np.zeros(5)

    def squat(t: float) -> np.ndarray:
        depth = (
            min(t / 2.0, 1.0) * 0.25 * size * 0.5 * (1.0 - math.cos(2.0 * math.pi * (0.3 * t + 0.02 * t * t % 12.0)))
        )
        return np.array([0.0, 0.0, -depth, 0.0, 0.0])

    def lean(t: float) -> np.ndarray:
        fade = min(t / 2.0, 1.0)
        rates = np.array([0.23, 0.31, 0.17, 0.41, 0.37])
        return (
            fade
            * np.array([0.08 * size, 0.08 * size, 0.06 * size, 0.12, 0.12])
            * np.sin(2.0 * np.pi * rates * t + phase)
        )

    return {"stand": still, "squat": squat, "lean": lean}[name]


class Drives:
    """Gains and coil currents with the targets: gates of eqs. 5 and 8, gain of eq. 9, current by eq. 18 inverted."""

    def __init__(self, d: Description, current: float) -> None:
        self.d, self.current = d, current
        self.slot = np.array([x.joint for x in d.devices], dtype=int)
        self.leg = np.array([x.leg for x in d.devices], dtype=int)

    def __call__(self, q_des: np.ndarray, seen: Readings) -> Command:
        """The command for these targets."""
        d, m = self.d, len(self.slot)
        kp, coil, hold = d.kp.copy(), np.zeros(m), np.zeros(m, bool)
        for k, device in enumerate(d.devices):
            j, p = device.joint, device.params
            force = seen.forces[device.leg] if len(seen.forces) else 0.0
            coil[k], hold[k] = _gate(p, force, q_des[j] - seen.q[j], seen.qd[j], min(self.current, p.coil.current_max))
            if hold[k]:
                kp[j] = p.motor.kp_low
        return Command(q_des=q_des, kp=kp, kd=d.kd, coil=coil, hold=hold)


def _gate(p: MrParams, force: float, e: float, qd: float, limit: float) -> tuple[float, bool]:
    g, h = p.gate, p.hold
    if limit <= 0.0 or force <= g.f_th:
        return 0.0, False
    if abs(e) > g.eps_e and abs(qd) > g.eps_v and e * qd < 0.0:
        return limit, False
    if abs(qd) >= g.eps_hold:
        return 0.0, False
    wanted = h.safety_factor * abs((p.motor.kp_base - p.motor.kp_low) * e)
    amps = limit if wanted >= h.T_max else min(h.current_for(wanted), limit)
    return amps, True
