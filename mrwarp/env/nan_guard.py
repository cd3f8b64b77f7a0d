"""NaN guard: names the first number that goes wrong in an environment and keeps the states that led to it.

Wrong are NaN and infinity anywhere in state, action, torque or reward, and a state beyond what a robot can do: such an
environment has *diverged*, its episode ends and it is counted. A joint beyond its limit and contacts that the engine
dropped are *warnings*: counted and named, and the episode goes on. All this runs on the device; the host reads it back
once per training update, by :meth:`NanGuard.take` and :meth:`NanGuard.warnings`.
"""

# pyright: reportArgumentType=false, reportCallIssue=false, reportIndexIssue=false, reportOperatorIssue=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import warp as wp

from mrwarp.actuator.mr_actuator import MrActuator
from mrwarp.env.nan_dump import KEPT, Column, Divergence
from mrwarp.env.sim import ActuatedSim, Sim
from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import Launch, record
from mrwarp.usd.robot import LEGS

MAX_SPEED, MAX_RATE, MAX_QD = 30.0, 200.0, 400.0
"""Trunk speed [m/s], trunk rate [rad/s] and joint speed [rad/s] beyond which the physics has blown up: ten times what
random actions reach in the first, four and three times in the others."""

MAX_HEIGHT, MAX_Q = 10.0, 4.0 * math.pi
"""Height of the trunk above or below the ground [m] and joint angle [rad] beyond which the physics has blown up."""

LIMIT_MARGIN = 0.25
"""How far a joint may press beyond its limit before a warning [rad]: limits are soft, and strong random actions
(3 times the action scale) reach 0.15."""

_COPY = """
const auto* from = (const decltype(values.data))((const char*)values.data + size_t(env) * values.strides[0]);
float* to = &wp::index(history, slot, env, column);
int wrong = 0;
for (int i = 0; i < values.shape[1]; ++i) {
    to[i] = (float)from[i];
    wrong |= to[i] - to[i] != 0.0f;  // what is no finite number
}
return wrong;
"""
_BEYOND = """
const float* state = &wp::index(history, slot, env, first);
int beyond = 0;
for (int i = 0; i < low.shape[0]; ++i) beyond |= (state[i] < low.data[i]) | (state[i] > high.data[i]);
return beyond;
"""


@wp.func_native(_COPY)
def copy_row(  # pyright: ignore[reportRedeclaration]
    values: wp.array2d[float], env: int, history: wp.array3d[float], slot: int, column: int
) -> int:
    """Copy the values of an environment, contiguous, into its history; 1 if one is not finite."""
    ...


@wp.func_native(_COPY)
def copy_row(  # noqa: F811 - Warp takes the one whose types fit
    values: wp.array2d[wp.float64], env: int, history: wp.array3d[float], slot: int, column: int
) -> int:
    """Copy the values of an environment in double precision; 1 if one is not finite."""
    ...


@wp.func_native(_BEYOND)
def beyond(
    low: wp.array[float], high: wp.array[float], env: int, history: wp.array3d[float], slot: int, first: int
) -> int:
    """1 if one of the columns from ``first`` on is out of its bounds; NaN is not."""
    ...


@wp.func
def keep_row(
    values: wp.array2d[Any], env: int, slot: int, column: int, wrong: int, history_out: wp.array3d[float]
) -> tuple[int, int]:
    """Copy the values of an environment into its history; the next column, and 1 if one so far is not finite."""
    return column + values.shape[1], wrong | copy_row(values, env, history_out, slot, column)


@wp.kernel
def guard_kernel(
    # parameters: 1 = end of a policy step; step [s]; bits that count as overflow; bounds of a sound
    # state, and of one without a warning, for the columns of qpos and qvel, shape (nq + nv,)
    last: int,
    dt: float,
    overflow_mask: int,
    low: wp.array[float],
    high: wp.array[float],
    warn_low: wp.array[float],
    warn_high: wp.array[float],
    # in, shapes (E, A), (E, M), (E, M) [A], (E, J) [N·m], (E, J) [N·m], (E, nq), (E, nv), (E, L) [N], (E,), (E, C)
    action_in: wp.array2d[float],
    z_in: wp.array2d[float],
    current_in: wp.array2d[float],
    tau_in: wp.array2d[float],
    bound_in: wp.array2d[float],
    qpos_in: wp.array2d[Any],
    qvel_in: wp.array2d[Any],
    f_foot_in: wp.array2d[float],
    reward_in: wp.array[float],
    overflow_in: wp.array2d[int],
    # out, shapes (E,), (N + 1, E, D), five times (E,), (E, 2), (E, C)
    age_out: wp.array[int],
    history_out: wp.array3d[float],
    rows_out: wp.array[int],
    cause_out: wp.array[int],
    diverged_out: wp.array[int],
    divergences_out: wp.array[int],
    warned_column_out: wp.array[int],
    warned_out: wp.array2d[int],
    overflow_seen_out: wp.array2d[int],
):
    """Add the state to the ring of the last N, unless the ring waits to be read; find the first wrong column.

    ``cause`` is -1, or the column that is no finite number, or D + the column that is beyond its bounds. The last row
    of the history is where states go that are checked but not kept.
    """
    env = wp.tid()
    kept = history_out.shape[0] - 1
    size = history_out.shape[2]
    frozen = cause_out[env] >= 0
    slot = rows_out[env] % kept
    if frozen:
        slot = kept
    history_out[slot, env, 0] = float(age_out[env]) * dt
    wrong = int(0)
    k = int(1)
    k, wrong = keep_row(action_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(z_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(current_in, env, slot, k, wrong, history_out)
    # qpos and qvel before the torques that follow from them
    first = k
    k, wrong = keep_row(qpos_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(qvel_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(f_foot_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(tau_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(bound_in, env, slot, k, wrong, history_out)
    history_out[slot, env, k] = reward_in[env]
    if reward_in[env] - reward_in[env] != 0.0:
        wrong = 1

    cause = int(-1)
    if wrong == 1:
        for i in range(size):
            if cause < 0 and not wp.isfinite(history_out[slot, env, i]):
                cause = i
    # what diverged is beyond the bounds of a warning too
    if cause < 0 and beyond(warn_low, warn_high, env, history_out, slot, first) == 1:
        for i in range(low.shape[0]):
            state = history_out[slot, env, first + i]
            if state < warn_low[i] or state > warn_high[i]:
                if state < low[i] or state > high[i]:
                    if cause < 0:
                        cause = size + first + i
                else:
                    warned_column_out[env] = first + i
                    warned_out[env, 0] = warned_out[env, 0] + 1
    dropped = int(0)
    for i in range(overflow_in.shape[1]):
        # counters and flags of the engine rise and stay: only a change is news
        now = overflow_in[env, i] & overflow_mask
        if now != overflow_seen_out[env, i]:
            dropped = 1
            overflow_seen_out[env, i] = now
    warned_out[env, 1] = warned_out[env, 1] + dropped

    if cause >= 0:
        if diverged_out[env] == 0:
            divergences_out[env] = divergences_out[env] + 1
        diverged_out[env] = 1
        if not frozen:
            cause_out[env] = cause
    if last == 0:
        age_out[env] = age_out[env] + 1
    # at the end of a policy step the state is only checked: the next torque step keeps it
    if not frozen and (last == 0 or cause >= 0):
        rows_out[env] = rows_out[env] + 1


@dataclass(frozen=True, kw_only=True)
class Warnings:
    """What does not end an episode, over the whole run."""

    beyond_limit: int
    """Environments in which a joint was beyond its limit."""
    joint: str
    """One of those joints, the latest of the first such environment; empty without."""
    overflow: int
    """Environments in which the engine dropped contacts or constraint rows."""


class NanGuard:
    """Guards the environments of a robot.

    Args:
        robot: The simulation.
        s: The task's arrays; ``s.diverged`` is set to 1 where a number goes wrong.

    Attributes:
        keep: Launch for every torque step between its torques and its physics: checks and keeps the state.
        check: Launch for the end of a policy step: checks state and reward.
        divergences: Policy steps in which each environment diverged, int, shape (E,).
        columns: What is kept of a state.
        bounds: Least and largest value of each column of a sound state, shape (2, D).
    """

    def __init__(self, robot: ActuatedSim, s: WalkState) -> None:
        sim, a, num_envs, device = robot.sim, robot.actuator, robot.sim.num_envs, robot.sim.device
        self.columns = tuple(_columns(sim, a, s.action.shape[1]))
        self.bounds, warn = _bounds(sim, self.columns)

        def ints(*shape: int, value: int = 0) -> torch.Tensor:
            return torch.full(shape, value, dtype=torch.int32, device=s.action.device)

        self._state = s
        self._rows, self._cause, self.divergences = ints(num_envs), ints(num_envs, value=-1), ints(num_envs)
        self._warned_column, self._warned = ints(num_envs, value=-1), ints(num_envs, 2)
        self._history = torch.zeros(KEPT + 1, num_envs, len(self.columns), device=s.action.device)
        first = next(i for i, column in enumerate(self.columns) if column.quantity == "position")
        state = slice(first, first + sim.scene.model.nq + sim.scene.model.nv)
        bounds = [wp.array(row[state], dtype=float, device=device) for row in (*self.bounds, *warn)]
        overflow = sim.backend.overflow
        seen = ints(*overflow.shape)

        def guard(last: int) -> Launch:
            return record(
                guard_kernel,
                num_envs,
                [
                    *(last, sim.dt, sim.backend.overflow_mask, *bounds, s.action, a.z, a.current, a.tau, a.bound),
                    *(s.qpos, s.qvel, s.f_foot, s.total, overflow),
                ],
                [
                    *(s.torque_steps, self._history, self._rows, self._cause, s.diverged, self.divergences),
                    *(self._warned_column, self._warned, seen),
                ],
            )

        self.keep, self.check = guard(0), guard(1)

    def forget(self) -> None:
        """Begin anew in all environments, without history; the counts go on."""
        for tensor in (self._state.torque_steps, self._rows, self._state.diverged, self._state.total):
            tensor.zero_()
        self._cause.fill_(-1)

    def take(self) -> list[Divergence]:
        """First divergences of the environments since the last call, with their last states; reads the device back."""
        found, size = [], len(self.columns)
        for env in (self._cause >= 0).nonzero()[:, 0].tolist():
            count, cause = int(self._rows[env]), int(self._cause[env])
            states = self._history[:KEPT, env].cpu().numpy()
            states = np.roll(states, -(count % KEPT), axis=0) if count >= KEPT else states[:count]
            columns, bounds = self.columns, self.bounds
            finite, column = divmod(cause, size)
            found.append(
                Divergence(
                    env=env, column=column, finite=bool(finite), columns=columns, states=states.copy(), bounds=bounds
                )
            )
            self._rows[env] = 0
        self._cause.fill_(-1)
        return found

    def warnings(self) -> Warnings:
        """What gave warnings up to now; reads the device back."""
        counts, columns = self._warned.cpu().numpy(), self._warned_column.cpu().numpy()
        beyond = np.flatnonzero(counts[:, 0])
        return Warnings(
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
    """Least and largest value per column of a sound state, and of one without a warning; shape (2, D) each."""
    model, largest = sim.scene.model, {"m/s": MAX_SPEED, "rad": MAX_Q, "rad/s": MAX_QD}
    bounds = np.full((2, len(columns)), np.inf)
    for i, column in enumerate(columns):
        if column.quantity in ("position", "velocity"):
            height = (column.part, column.unit) == ("trunk z", "m")
            bounds[1, i] = MAX_HEIGHT if height else largest.get(column.unit, math.inf)
        elif column.quantity == "angular velocity":
            bounds[1, i] = MAX_RATE
    bounds[0] = -bounds[1]
    warn = bounds.copy()
    for joint, adr in zip(sim.scene.joints, sim.scene.q_adr, strict=True):
        index = int(np.flatnonzero(model.jnt_qposadr == adr)[0])
        if model.jnt_limited[index]:
            i = next(i for i, c in enumerate(columns) if (c.quantity, c.part) == ("position", joint))
            warn[:, i] = model.jnt_range[index] + np.array([-LIMIT_MARGIN, LIMIT_MARGIN])
    return bounds, warn
