"""NaN guard: names the first number that goes wrong in an environment and keeps the states that led to it.

Wrong are NaN and infinity anywhere in state, action, torque or reward, and a state beyond what a robot can do: such an
environment has *diverged*, its episode ends and it is counted. A joint beyond its limit and contacts that the engine
dropped are *warnings*: counted and named, and the episode goes on. All this runs on the device; the host reads it back
once per training update, by :meth:`NanGuard.take` and :meth:`NanGuard.warnings`.
"""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
import warp as wp

from mrwarp.env.nan_dump import KEPT, Column, Divergence
from mrwarp.env.sim import ActuatedSim, Sim
from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import record

MAX_SPEED, MAX_RATE, MAX_QD = 30.0, 200.0, 400.0
"""Trunk speed [m/s], trunk rate [rad/s] and joint speed [rad/s] beyond which the physics has blown up: ten times what
random actions reach in the first, four and three times in the others."""

MAX_HEIGHT, MAX_Q = 10.0, 4.0 * math.pi
"""Height of the trunk above or below the ground [m] and joint angle [rad] beyond which the physics has blown up."""

LIMIT_MARGIN = 0.25
"""How far a joint may press beyond its limit before a warning [rad]: limits are soft, and strong random actions
(3 times the action scale) reach 0.15."""


@wp.func_native("""
float* to = &wp::index(history, slot, env, 0);
int column = 1, wrong = 0, odd = 0;
for (int k = 0; k < table.shape[0]; ++k) {
    const wp::int64* entry = table.data + 4 * k;
    const char* row = (const char*)entry[0] + size_t(env) * entry[1];
    const int count = (int)entry[2];
    if (entry[3] == 8) for (int i = 0; i < count; ++i) to[column + i] = (float)((const double*)row)[i];
    else for (int i = 0; i < count; ++i) to[column + i] = ((const float*)row)[i];
    column += count;
}
for (int i = 0; i < column; ++i) {
    wrong |= (to[i] - to[i] != 0.0f) | (to[i] < sound.data[i]) | (to[i] > sound.data[column + i]);
    odd |= (to[i] < warn.data[i]) | (to[i] > warn.data[column + i]);
}
if (wrong) return -1;
if (odd) for (int i = 0; i < column; ++i) if (to[i] < warn.data[i] || to[i] > warn.data[column + i]) odd = i;
return odd;
""")
def keep_row(
    table: wp.array2d[wp.int64],
    sound: wp.array2d[float],
    warn: wp.array2d[float],
    env: int,
    history: wp.array3d[float],
    slot: int,
) -> int:
    """Copy an environment's state into its history, from column 1 on.

    Args:
        table: Address, bytes from one environment to the next, numbers, and bytes of a number of each array, (K, 4).
        sound: Least and largest value of each column of a sound state, shape (2, D).
        warn: The same of a state without a warning.
        env: Environment.
        history: Kept states, shape (N + 1, E, D).
        slot: Where to.

    Returns:
        -1 if a number is not finite or unsound, else the last column that is odd, or 0.
    """
    ...


@wp.kernel(enable_backward=False)
def guard_kernel(
    # parameters: 1 = end of a policy step; step [s]; bits that count as overflow; arrays to keep, shape (K, 4); bounds
    # of a sound state and of one without a warning, shape (2, D)
    last: int,
    dt: float,
    overflow_mask: int,
    table: wp.array2d[wp.int64],
    sound: wp.array2d[float],
    warn: wp.array2d[float],
    # in, shape (E, C)
    overflow_in: wp.array2d[int],
    # out, shapes (E,), (N + 1, E, D), five times (E,), (E, 2), (E, C)
    age_out: wp.array[int],
    history_out: wp.array3d[float],
    rows_out: wp.array[int],
    frozen_out: wp.array[int],
    diverged_out: wp.array[int],
    divergences_out: wp.array[int],
    warned_column_out: wp.array[int],
    warned_out: wp.array2d[int],
    overflow_seen_out: wp.array2d[int],
):
    """Add the state to the ring of the last N, and check it.

    A wrong state ends the ring, which is frozen until it is read. The last row of the history is where states go
    that are checked but not kept.
    """
    env = wp.tid()
    kept = history_out.shape[0] - 1
    frozen = frozen_out[env] > 0
    slot = rows_out[env] % kept
    if frozen:
        slot = kept
    history_out[slot, env, 0] = float(age_out[env]) * dt
    found = keep_row(table, sound, warn, env, history_out, slot)
    if found > 0:
        warned_column_out[env] = found
        warned_out[env, 0] = warned_out[env, 0] + 1
    dropped = int(0)
    for i in range(overflow_in.shape[1]):
        # counters and flags of the engine rise and stay: only a change is news
        now = overflow_in[env, i] & overflow_mask
        if now != overflow_seen_out[env, i]:
            dropped = 1
            overflow_seen_out[env, i] = now
    warned_out[env, 1] = warned_out[env, 1] + dropped

    if found < 0:
        if diverged_out[env] == 0:
            divergences_out[env] = divergences_out[env] + 1
        diverged_out[env] = 1
        frozen_out[env] = 1
    if last == 0:
        age_out[env] = age_out[env] + 1
    # at the end of a policy step the state is only checked: the next torque step keeps it
    if not frozen and (last == 0 or found < 0):
        rows_out[env] = rows_out[env] + 1


@dataclass(frozen=True, kw_only=True)
class Warnings:
    """Warnings that do not end an episode, over the whole run."""

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
        sim, num_envs, device = robot.sim, robot.sim.num_envs, s.action.device

        def ints(*shape: int, value: int = 0) -> torch.Tensor:
            return torch.full(shape, value, dtype=torch.int32, device=device)

        kept = _kept(robot, s)
        self.columns = (Column(quantity="time", part="", unit="s"), *(column for names, _ in kept for column in names))
        self.bounds, warn = _bounds(sim, self.columns)
        sound, warn = (torch.tensor(bounds, dtype=torch.float32, device=device) for bounds in (self.bounds, warn))
        # address, bytes from one environment to the next, numbers, bytes of a number
        table = torch.tensor(
            [[t.data_ptr(), t.stride(0) * t.element_size(), len(names), t.element_size()] for names, t in kept]
        ).to(device)
        self._state = s
        self._rows, self._frozen, self.divergences = ints(num_envs), ints(num_envs), ints(num_envs)
        self._warned_column, self._warned = ints(num_envs, value=-1), ints(num_envs, 2)
        self._history = torch.zeros(KEPT + 1, num_envs, len(self.columns), device=device)
        overflow = sim.backend.overflow
        seen = ints(*overflow.shape)
        self.keep, self.check = (
            record(
                guard_kernel,
                num_envs,
                [last, sim.dt, sim.backend.overflow_mask, table, sound, warn, overflow],
                [
                    *(s.torque_steps, self._history, self._rows, self._frozen, s.diverged, self.divergences),
                    *(self._warned_column, self._warned, seen),
                ],
            )
            for last in (0, 1)
        )

    def forget(self) -> None:
        """Reset all environments, without history; the counts go on."""
        for tensor in (self._state.torque_steps, self._rows, self._frozen, self._state.diverged, self._state.total):
            tensor.zero_()

    def take(self) -> list[Divergence]:
        """First divergences of the environments since the last call, with their last states; reads the device back."""
        found = []
        for env in self._frozen.nonzero()[:, 0].tolist():
            count = int(self._rows[env])
            states = self._history[:KEPT, env].cpu().numpy()
            states = np.roll(states, -(count % KEPT), axis=0) if count >= KEPT else states[:count].copy()
            found.append(Divergence(env=env, columns=self.columns, states=states, bounds=self.bounds))
            self._rows[env] = 0
        self._frozen.zero_()
        return found

    def warnings(self) -> Warnings:
        """The warnings up to now; reads the device back."""
        counts, columns = self._warned.cpu().numpy(), self._warned_column.cpu().numpy()
        beyond = np.flatnonzero(counts[:, 0])
        return Warnings(
            beyond_limit=len(beyond),
            joint=self.columns[int(columns[beyond[0]])].part if len(beyond) else "",
            overflow=int((counts[:, 1] > 0).sum()),
        )


def _kept(robot: ActuatedSim, s: WalkState) -> list[tuple[list[Column], torch.Tensor]]:
    """Stored part of a state: columns, and the array, shape (E, columns); qpos and qvel before the torques."""
    sim, scene, joints = robot.sim, robot.sim.scene, robot.sim.scene.joints
    z, tau, bound = (wp.to_torch(array) for array in (robot.actuator.z, robot.actuator.tau, robot.actuator.bound))
    devices = [joints[i] for i in robot.actuator.mr_joints]

    def each(quantity: str, parts: Sequence[str], unit: str) -> list[Column]:
        return [Column(quantity=quantity, part=part, unit=unit) for part in parts]

    position = each("position", [f"coordinate {i}" for i in range(scene.model.nq)], "")
    velocity = each("velocity", [f"degree of freedom {i}" for i in range(scene.model.nv)], "")
    if scene.floating:
        axes = [f"trunk {axis}" for axis in "xyz"]
        position[:7] = each("position", axes, "m") + each("orientation", ["trunk w", *axes], "")
        velocity[:6] = each("velocity", axes, "m/s") + each("angular velocity", axes, "rad/s")
    for joint, q, v in zip(joints, scene.q_adr, scene.v_adr, strict=True):
        position[q] = Column(quantity="position", part=joint, unit="rad")
        velocity[v] = Column(quantity="velocity", part=joint, unit="rad/s")
    names, count = scene.layout.leg_names, sim.f_foot.shape[1]
    feet = names if count == len(names) else [str(i) for i in range(count)]
    return [
        (each("action", joints, ""), s.action),
        (each("hysteresis state", devices, "rad"), z),
        (each("coil current", devices, "A"), s.current),
        (position, s.qpos),
        (velocity, s.qvel),
        (each("foot force", feet, "N"), s.f_foot),
        (each("torque", joints, "N·m"), tau),
        (each("brake bound", joints, "N·m"), bound),
        (each("reward", [""], ""), s.total),
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
