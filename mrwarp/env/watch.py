"""Watch: names the first number that goes wrong in an environment and keeps the states that led to it.

Wrong are NaN and infinity anywhere in state, action, torque or reward, and a state beyond what a robot can do: such an
environment is *broken*, its episode ends and it is counted. A joint beyond its limit and contacts that the engine
dropped are *noticed*: counted and named, and the episode goes on. All this runs on the device; the host reads it back
once per training update, by :meth:`Watch.take` and :meth:`Watch.noticed`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import warp as wp

from mrwarp.actuator.mr_actuator import MrActuator
from mrwarp.env import watch_kernels
from mrwarp.env.broken import KEPT, Break, Column
from mrwarp.env.sim import ActuatedSim, Sim
from mrwarp.kernels.launch import record
from mrwarp.usd.robot import LEGS

MAX_SPEED, MAX_RATE, MAX_QD = 30.0, 200.0, 400.0
"""Trunk speed [m/s], trunk rate [rad/s] and joint speed [rad/s] beyond which the physics has blown up: ten times what
random actions reach in the first, four and three times in the others."""

MAX_HEIGHT, MAX_Q = 10.0, 4.0 * math.pi
"""Height of the trunk above or below the ground [m] and joint angle [rad] beyond which the physics has blown up."""

LIMIT_MARGIN = 0.25
"""How far a joint may press beyond its limit before it is noticed [rad]: limits are soft, and strong random actions
(3 times the action scale) reach 0.15."""


@dataclass(frozen=True, kw_only=True)
class Noticed:
    """What does not end an episode, over the whole run."""

    beyond_limit: int
    """Environments in which a joint was beyond its limit."""
    joint: str
    """One of those joints, the latest of the first such environment; empty without."""
    overflow: int
    """Environments in which the engine dropped contacts or constraint rows."""


class Watch:
    """Watches a robot's environments. Adds itself to the torque steps of ``robot``; launch ``check`` after them.

    Args:
        robot: The simulation.
        action: Actions in use, shape (E, A).

    Attributes:
        broken: 1 where a number went wrong since the launch of :meth:`clear`, int, shape (E,).
        breaks: Policy steps in which each environment broke, int, shape (E,).
        reward: Last rewards; write them before :attr:`check`, shape (E,).
        check: Launch that checks state and reward at the end of a policy step.
        columns: What is kept of a state.
    """

    def __init__(self, robot: ActuatedSim, action: torch.Tensor) -> None:
        sim, actuator = robot.sim, robot.actuator
        device, num_envs = sim.device, sim.num_envs
        self.columns = tuple(_columns(sim, actuator, action.shape[1]))
        size = len(self.columns)

        def ints(*shape: int, value: int = 0) -> wp.array:
            return wp.full(shape, value, dtype=int, device=device)

        self._action, self._reward = wp.from_torch(action), wp.zeros(num_envs, dtype=float, device=device)
        self._age, self._rows, self._cause = ints(num_envs), ints(num_envs), ints(num_envs, value=-1)
        self._history = wp.zeros((KEPT + 1, num_envs, size), dtype=float, device=device)
        self._broken, self._breaks = ints(num_envs), ints(num_envs)
        self._noticed_column, self._noticed = ints(num_envs, value=-1), ints(num_envs, 2)
        self.bounds, notice = _bounds(sim, self.columns)
        first = next(i for i, column in enumerate(self.columns) if column.quantity == "position")
        state = slice(first, first + sim.scene.model.nq + sim.scene.model.nv)
        bounds = [wp.array(row[state], dtype=float, device=device) for row in (*self.bounds, *notice)]
        overflow = sim.backend.overflow
        seen = ints(*overflow.shape)
        launches = [
            record(
                watch_kernels.watch_kernel,
                dim=num_envs,
                inputs=[
                    last, sim.dt, sim.backend.overflow_mask, *bounds, self._action, actuator.z, actuator.current,
                    actuator.tau, actuator.bound, sim.backend.field("qpos"), sim.backend.field("qvel"), sim.f_foot,
                    self._reward, overflow,
                ],
                outputs=[
                    self._age, self._history, self._rows, self._cause, self._broken, self._breaks,
                    self._noticed_column, self._noticed, seen,
                ],
                device=device,
            )
            for last in (0, 1)
        ]  # fmt: skip
        self._keep = (bounds, seen)
        robot.watchers.append(launches[0])
        self.check = launches[1]
        self.broken, self.breaks = wp.to_torch(self._broken), wp.to_torch(self._breaks)
        self.reward = wp.to_torch(self._reward)

    def clear(self, done: wp.array) -> wp.Launch:
        """What begins the next policy step, and a new episode where one is done.

        Args:
            done: Episodes that end, bool, shape (E,).
        """
        return record(
            watch_kernels.clear_kernel,
            dim=len(done),
            inputs=[done],
            outputs=[self._age, self._broken, self._reward],
            device=str(done.device),
        )

    def forget(self) -> None:
        """Begin anew in all environments, without history; the counts go on."""
        for array in (self._age, self._rows, self._broken, self._reward):
            array.zero_()
        self._cause.fill_(-1)

    def take(self) -> list[Break]:
        """First breaks of the environments since the last call, with their last states; reads the device back."""
        causes = self._cause.numpy()
        envs = np.flatnonzero(causes >= 0)
        if not len(envs):
            return []
        rows, size = self._rows.numpy(), len(self.columns)
        history = wp.to_torch(self._history)
        found = []
        for env in envs.tolist():
            states = history[:KEPT, env].cpu().numpy()
            count = int(rows[env])
            states = np.roll(states, -(count % KEPT), axis=0) if count >= KEPT else states[:count]
            cause = int(causes[env])
            found.append(
                Break(
                    env=env, column=cause % size, finite=cause >= size, columns=self.columns, states=states.copy(),
                    bounds=self.bounds,
                )
            )  # fmt: skip
        self._cause.fill_(-1)
        wp.to_torch(self._rows)[torch.from_numpy(envs).to(history.device)] = 0
        return found

    def noticed(self) -> Noticed:
        """What was noticed up to now; reads the device back."""
        counts, columns = self._noticed.numpy(), self._noticed_column.numpy()
        beyond = np.flatnonzero(counts[:, 0])
        return Noticed(
            beyond_limit=len(beyond),
            joint=self.columns[int(columns[beyond[0]])].part if len(beyond) else "",
            overflow=int((counts[:, 1] > 0).sum()),
        )


def _columns(sim: Sim, actuator: MrActuator, num_actions: int) -> list[Column]:
    """Names of the columns in the order in which the kernel writes them."""
    joints, scene = sim.scene.joints, sim.scene
    devices = [joints[i] for i in actuator.mr_joints]

    def each(quantity: str, parts: Sequence[str], unit: str) -> list[Column]:
        return [Column(quantity=quantity, part=part, unit=unit) for part in parts]

    position = [Column(quantity="position", part=f"coordinate {i}", unit="") for i in range(scene.model.nq)]
    velocity = [Column(quantity="velocity", part=f"degree of freedom {i}", unit="") for i in range(scene.model.nv)]
    if scene.floating:
        position[:3] = each("position", ("trunk x", "trunk y", "trunk z"), "m")
        position[3:7] = each("orientation", ("trunk w", "trunk x", "trunk y", "trunk z"), "")
        velocity[:3] = each("velocity", ("trunk x", "trunk y", "trunk z"), "m/s")
        velocity[3:6] = each("angular velocity", ("trunk x", "trunk y", "trunk z"), "rad/s")
    for joint, q, v in zip(joints, scene.q_adr, scene.v_adr, strict=True):
        position[q] = Column(quantity="position", part=joint, unit="rad")
        velocity[v] = Column(quantity="velocity", part=joint, unit="rad/s")
    actions = joints if num_actions == len(joints) else [str(i) for i in range(num_actions)]
    feet = LEGS if sim.f_foot.shape[1] == len(LEGS) else [str(i) for i in range(sim.f_foot.shape[1])]
    return [
        Column(quantity="time", part="", unit="s"),
        *each("action", actions, ""),
        *each("hysteresis state", devices, "rad"),
        *each("coil current", devices, "A"),
        *position,
        *velocity,
        *each("foot force", feet, "N"),
        *each("torque", joints, "N·m"),
        *each("brake bound", joints, "N·m"),
        Column(quantity="reward", part="", unit=""),
    ]


def _bounds(sim: Sim, columns: Sequence[Column]) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest value per column of a state that is not broken, and of one that is not noticed; (2, D) each."""
    largest = {"m/s": MAX_SPEED, "m": math.inf, "rad": MAX_Q, "rad/s": MAX_QD}
    bounds = np.full((2, len(columns)), np.inf)
    model, joints = sim.scene.model, sim.scene.joints
    ranges = {}
    for joint, adr in zip(joints, sim.scene.q_adr, strict=True):
        index = int(np.flatnonzero(model.jnt_qposadr == adr)[0])
        if model.jnt_limited[index]:
            ranges[joint] = model.jnt_range[index]
    for i, column in enumerate(columns):
        if column.quantity in ("position", "velocity"):
            bounds[1, i] = MAX_HEIGHT if column.part == "trunk z" and column.unit == "m" else largest.get(
                column.unit, math.inf
            )  # fmt: skip
        elif column.quantity == "angular velocity":
            bounds[1, i] = MAX_RATE
    bounds[0] = -bounds[1]
    notice = bounds.copy()
    for i, column in enumerate(columns):
        if column.quantity == "position" and column.part in ranges:
            low, high = ranges[column.part]
            notice[:, i] = low - LIMIT_MARGIN, high + LIMIT_MARGIN
    return bounds, notice
