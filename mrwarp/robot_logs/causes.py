"""Faults of a robot's simulation: causes, their places, sizes that healthy robots have anyway."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import RobotLog

Field = Literal[
    "friction", "damping", "armature", "stribeck", "lag", "kp", "kd", "strength", "offset", "shift", "delay", "mass",
    "com", "tilt", "bias", "mu", "slope", "give", "limit", "length", "clock", "coil", "coil_lag", "device", "drag",
    "latency", "foot", "pull", "scale",
]  # fmt: skip
"""Array of a batch that a parameter is added to, see :class:`mrwarp.robot_logs.window_replay.ParameterBatch`."""

ORDINARY = ("coulomb_friction", "viscous_friction", "rotor_inertia", "command_delay")
"""Numbers that descriptions rarely know: fitted in every case, and named where the log excludes the description."""

NUISANCE = "nuisance"
"""Numbers of a healthy robot that are never a cause: where a joint settles in a session, how a fixed base stands, the
time from a drive's reading to its torque, torques of all drives against masses of all links where the trunk is held."""

FLOOR = ("ground_friction", "ground_stiffness")
"""Numbers of the floor and of the law of its contacts in every session. No description of a robot has them. They
are a cause where they lie beyond what floors differ by."""

OUTSIDE = ("soft_foot", "steady_pull")
"""Effects outside the catalogue. Untried, they would be blamed on a cause of it: a foot softer or stiffer than the
others, and a force that pulls the trunk sideways all the time. Reported as unexplained."""

SAME = {"coulomb_friction": "device_drag"}
"""Causes that no log distinguishes from another at the same place: the other is named, and they are its alternative."""

OWN_DELAY = 0.0005
"""Time after its row at which a command acts on any robot, half a cycle of a bus at 1 kHz, give or take as much [s]: it
is simulated, but is no part of a fault's size."""

TORQUE_SCALE = 0.1
"""Standard deviation of all drives' torque against all masses, of a robot that is held: nothing anchors
either there. A real Go2's legs droop 1.2 times as far as its description says."""

LARGEST_SCALE = 1.4
"""Factor within which it lies, either way: no joint of that Go2 droops more than 1.36 times as far. What is further off
is a fault of gains or motors."""

UNKNOWN_LATENCY = 0.002
"""Time from a drive's reading to its torque that no log distinguishes from a rotor's inertia, Kd times as large [s]."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """One number of one cause at one place."""

    cause: str
    where: str
    name: str
    """Name of the number in a result."""
    unit: str
    field: Field
    index: int
    """Column of the field."""
    step: float
    """Change by which the replay's derivative is taken."""
    spread: float
    """Standard deviation that a healthy robot has about its description; large for :data:`ORDINARY` causes."""
    least: float
    """Smallest size that counts as a fault."""
    fault: float
    """Standard deviation of faults."""
    lowest: float = -np.inf
    """Least change that a robot can have: friction and inertia do not turn negative."""
    highest: float = np.inf
    """Largest change: a limit that was never reached may lie anywhere above."""
    usual: tuple[float, float] = (0.0, 0.0)
    """Sizes that healthy robots have, lowest and highest."""
    always_free: bool = False
    """Whether it is fitted next to any cause though it may be one."""
    nominal: float = 0.0
    """Value that a change adds to; for ``kp``, ``kd`` and ``strength`` the change is relative to it."""

    @property
    def relative(self) -> bool:
        """Whether the change is a share of ``nominal``."""
        return self.field in ("kp", "kd", "strength", "mu", "limit", "coil", "device")

    @property
    def is_nuisance(self) -> bool:
        """Whether every session has its own, so that it is fitted next to any cause."""
        return self.always_free or self.cause in (NUISANCE, *FLOOR)

    def absolute(self, change: float) -> float:
        """Value in ``unit`` that a change makes."""
        if self.field in ("give", "foot"):
            return self.nominal / max(1.0 + change, 1.0 + self.lowest)
        return self.nominal * (1.0 + change) if self.relative else change


def parameters_of(model: ReplayModel, log: RobotLog) -> list[Parameter]:
    """All numbers that a log of this robot could speak of."""
    found: list[Parameter] = []

    def add(
        cause: str,
        where: str,
        name: str,
        unit: str,
        field: Field,
        index: int,
        *sizes: float,
        nominal: float = 0.0,
        **bounds: Any,
    ) -> None:
        own: dict[str, Any] = dict(zip(("step", "spread", "least", "fault"), map(float, sizes), strict=True))
        own["nominal"] = float(nominal)
        found.append(
            Parameter(cause=cause, where=where, name=name, unit=unit, field=field, index=index, **own, **bounds)
        )

    for j in range(len(model.joints)):
        _of_joint(add, model, log, j)
    # when in a row a command began to act no log says: up to the next row it is no delay of the robot. Its step is
    # short, for coils without lag read what a row commands until its last moment
    row = float(np.median([run.dt for run in log.runs]))
    # coils show it next to any cause; in the air inertias and gains would be traded for it
    sizes = (0.0005, 0.0007 + row, 0.0015, 0.02)
    usual = (0.0, row + OWN_DELAY)
    add("command_delay", "robot", "delay", "s", "delay", 0, *sizes, usual=usual, always_free=model.free)
    add(NUISANCE, "robot", "latency", "s", "latency", 0, 0.001, 0.0015, np.inf, 0.0, lowest=0.0)
    if model.free and any("quat" in run.base or "gyro" in run.base for run in log.runs):
        add("clock_shift", "imu", "shift", "s", "clock", 1, 0.003, 0.001, 0.002, 0.01)
    _of_links(add, model, log)
    if model.free:
        _on_feet(add, model)
    else:
        for k, axis in enumerate(("roll", "pitch")):
            add(NUISANCE, "robot", axis, "rad", "slope", k, 0.01, 0.02, np.inf, 0.0)
        bounds = {"lowest": 1.0 / LARGEST_SCALE - 1.0, "highest": LARGEST_SCALE - 1.0}
        add(NUISANCE, "robot", "torque_scale", "1", "scale", 0, 0.05, TORQUE_SCALE, np.inf, 0.0, **bounds)
    return found


def _of_joint(add: Callable[..., None], model: ReplayModel, log: RobotLog, j: int) -> None:
    """Numbers of a joint, its drive and its device."""
    mj, joint = model.model, model.joints[j]
    v = model.v_adr[j]
    scale = _torque_scale(model, log, j)
    inertia = float(mj.dof_M0[v]) if hasattr(mj, "dof_M0") else float(1.0 / max(mj.dof_invweight0[v], 1e-6))
    dry, wet = scale * np.array([0.01, 0.02, 0.005, 0.05]), scale * np.array([0.002, 0.006, 0.002, 0.02])
    slow = scale * np.array([0.01, 0.004, 0.01, 0.03])
    rotor = inertia * np.array([0.05, 0.5, 0.05, 2.0])
    rotor[2] = max(rotor[2], UNKNOWN_LATENCY * float(np.nan_to_num(log.kd[j])))
    bound = -float(mj.dof_frictionloss[v]), -float(mj.dof_damping[v]), -0.9 * float(mj.dof_armature[v])
    add("coulomb_friction", joint, "torque", "N·m", "friction", j, *dry, lowest=bound[0])
    add("viscous_friction", joint, "coefficient", "N·m·s/rad", "damping", j, *wet, lowest=bound[1])
    add("rotor_inertia", joint, "inertia", "kg·m²", "armature", j, *rotor, lowest=bound[2])
    add("stribeck", joint, "torque", "N·m", "stribeck", j, *slow, lowest=0.0)
    add("encoder_offset", joint, "angle", "rad", "offset", j, 0.005, 0.004, 0.010, 0.05)
    if log.kp[j] > 0.0:
        add(NUISANCE, joint, "angle", "rad", "shift", j, 0.004, 0.005, np.inf, 0.0)
        add("kp", joint, "gain", "N·m/rad", "kp", j, 0.05, 0.02, 0.04, 0.3, nominal=log.kp[j], lowest=-0.95)
    if log.kd[j] > 0.0:
        add("kd", joint, "gain", "N·m·s/rad", "kd", j, 0.05, 0.02, 0.05, 0.5, nominal=log.kd[j], lowest=-0.95)
        add("velocity_lag", joint, "time_constant", "s", "lag", j, 0.002, 0.001, 0.003, 0.006, lowest=0.0)
    add("motor_strength", joint, "factor", "1", "strength", j, 0.05, 0.02, 0.04, 0.2, nominal=1.0, lowest=-0.95)
    add("torque_limit", joint, "torque", "N·m", "limit", j, -0.1, 0.02, 0.05, 0.3, nominal=model.asked[j], highest=0.0)
    if j in model.devices.joint:
        _of_device(add, joint, j)


def _of_device(add: Callable[..., None], joint: str, j: int) -> None:
    """Numbers of the magnetorheological device of joint ``j``."""
    add("coil_dead", joint, "current_share", "1", "coil", j, 0.2, 0.02, 0.5, 1.0, nominal=1.0, lowest=-1.3, highest=0.0)
    add("coil_lag", joint, "time_constant", "s", "coil_lag", j, 0.004, 0.001, 0.003, 0.02, lowest=0.0)
    add("device_strength", joint, "factor", "1", "device", j, 0.1, 0.03, 0.06, 0.3, nominal=1.0, lowest=-0.95)
    # more drag than described is dry friction as any other: see SAME
    add("device_drag", joint, "torque", "N·m", "drag", j, -0.2, 0.05, 0.1, 0.5, highest=0.0)


def _of_links(add: Callable[..., None], model: ReplayModel, log: RobotLog) -> None:
    """Masses of links, and on feet their lengths."""
    mj = model.model
    bodies = [b for b in model.moving if b != model.trunk]
    for b in bodies:
        mass = float(mj.body_mass[b])
        # a weight counts as friction does: where it makes less torque than the least friction, drives hide it
        joint = _driver(model, b)
        arm = max(float(np.linalg.norm(mj.body_ipos[b])), 0.3 * float(model.reach[b]), 0.02)
        hidden = 0.005 * _torque_scale(model, log, joint) / (9.81 * arm) if joint is not None else 0.0
        if mass > 0.02:
            add(
                "link_mass",
                model.body_name(b),
                "mass",
                "kg",
                "mass",
                b,
                0.05 * mass,
                0.02 * mass,
                max(0.05 * mass + 0.02, hidden),
                0.3 * mass + 0.1,
            )
            if model.free and model.reach[b] > 0.02:
                reach = model.reach[b]
                add("link_length", model.body_name(b), "length", "m", "length", b, 0.005, 0.002, 0.006, 0.1 * reach)


def _on_feet(add: Callable[..., None], model: ReplayModel) -> None:
    """Numbers of the trunk, its sensors and the ground, and what is outside the catalogue."""
    mj = model.model
    total = float(mj.body_mass.sum())
    trunk = total * np.array([0.02, 0.008, 0.015, 0.15])
    add("trunk_mass", model.body_name(model.trunk), "mass", "kg", "mass", model.trunk, *trunk)
    for k, axis in enumerate("xyz"):
        add("trunk_com", model.body_name(model.trunk), axis, "m", "com", k, 0.01, 0.004, 0.01, 0.04)
    for k, axis in enumerate(("roll", "pitch")):
        add("imu_tilt", "robot", axis, "rad", "tilt", k, 0.01, 0.005, 0.012, 0.04)
        # finished floors may lie 4 mm high at a distance of 1 m (DIN 18202, table 3, group 3)
        add("ground_slope", "robot", axis, "rad", "slope", k, 0.01, 0.005, 0.012, 0.06)
    for k, axis in enumerate("xyz"):
        add("gyro_bias", "robot", axis, "rad/s", "bias", k, 0.02, 0.01, 0.03, 0.1)
    mu = float(mj.geom_friction[list(model.feet), 0].max()) if model.feet else 0.8
    add("ground_friction", "robot", "coefficient", "1", "mu", 0, -0.1, 0.1, 0.1, 0.4, nominal=mu)
    # feet sink as far as the ground gives, and no two floors and laws of contact agree on it: one that bears them
    # where they touch is as usual as one into which they sink twice as deep
    add("ground_stiffness", "robot", "factor", "1", "give", 0, 0.2, 0.5, 1.0, 4.0, nominal=1.0, lowest=-0.95)
    for k, foot in enumerate(model.feet):
        body = model.body_name(int(mj.geom_bodyid[foot]))
        add("soft_foot", body, "factor", "1", "foot", k, 0.2, 0.3, 0.6, 4.0, nominal=1.0, lowest=-0.9)
    weight = 9.81 * total * np.array([0.02, 0.005, 0.02, 0.1])
    for k, axis in enumerate("xy"):
        add("steady_pull", model.body_name(model.trunk), axis, "N", "pull", k, *weight)


def _driver(model: ReplayModel, body: int) -> int | None:
    """The log's joint that moves a body, or None."""
    first, count = int(model.model.body_jntadr[body]), int(model.model.body_jntnum[body])
    own = {int(model.model.jnt_dofadr[first + k]) for k in range(count)}
    return next((j for j, v in enumerate(model.v_adr.tolist()) if v in own), None)


def _torque_scale(model: ReplayModel, log: RobotLog, j: int) -> float:
    """Torque that the joint's drive gives at most, or at 0.6 rad of error [N·m]."""
    if model.limited[j]:
        return float(model.model.actuator_forcerange[j, 1])
    if log.kp[j] > 0.0:
        return 0.6 * float(log.kp[j])
    found = [
        np.nanquantile(np.abs(run.joint[c][:, j]), 0.99)
        for run in log.runs
        for c in ("tau_ff", "tau")
        if c in run.joint
    ]
    return float(np.nanmax(found)) if found else 10.0
