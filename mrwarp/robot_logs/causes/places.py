"""Places of a robot where a cause can be, and what is known of each: the sizes of causes follow from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.robot_logs.robot_log import RobotLog, reads_torque

Kind = Literal[
    "joint", "commands", "imu", "body", "body_axis", "trunk", "trunk_axis", "lean", "gyro", "robot", "foot", "pull"
]
"""Kinds of places, see :data:`PLACES`."""


PINION = 0.05
"""Way of a slide that is like one radian of a hinge [m]: the radius of a large pinion or belt wheel."""

SLIDING = {"rad": "m", "N·m": "N", "N·m/rad": "N/m", "N·m·s/rad": "N·s/m", "kg·m²": "kg"}
"""Units of a slide's numbers for those of a hinge's."""


def turns(model: ReplayModel) -> np.ndarray:
    """Length of each joint's coordinate that is like one radian, (J,): 1 rad of a hinge, :data:`PINION` of a slide."""
    return np.where(model.slides, PINION, 1.0)


@dataclass(frozen=True, kw_only=True)
class Place:
    """One place of a robot in its log."""

    model: ReplayModel
    log: RobotLog
    where: str
    """Its name in a result."""
    index: int
    """Column of the field that holds its change."""
    axis: str = ""
    """Name of the number, of a place with several; else empty."""

    @property
    def dof(self) -> int:
        """Address of the joint ``index`` among MuJoCo's degrees of freedom."""
        return int(self.model.v_adr[self.index])

    @property
    def turn(self) -> float:
        """See :func:`turns`."""
        return float(turns(self.model)[self.index])

    @cached_property
    def torque(self) -> float:
        """Torque that the drive of joint ``index`` gives at most, or at 0.6 rad of error [N·m]."""
        return torque_scale(self.model, self.log, self.index)

    @cached_property
    def inertia(self) -> float:
        """Inertia that the joint ``index`` moves [kg·m²]."""
        mj, v = self.model.model, self.dof
        return float(mj.dof_M0[v]) if hasattr(mj, "dof_M0") else float(1.0 / max(mj.dof_invweight0[v], 1e-6))

    @cached_property
    def weight(self) -> float:
        """Largest torque of gravity at joint ``index`` along the log of a robot that is held [N·m]."""
        return float(self.model.weight[self.index])

    @property
    def reads_torque(self) -> bool:
        """Whether the log reads the torque of joint ``index`` next to its command."""
        return any(
            reads_torque(self.log, run) and np.isfinite(run.joint["tau"][:, self.index]).all() for run in self.log.runs
        )

    @property
    def commanded(self) -> bool:
        """Whether the log has a command for the joint ``index``."""
        return any(
            bool(np.isfinite(run.joint[name][:, self.index]).any())
            for run in self.log.runs
            for name in ("q_des", "tau_ff")
            if name in run.joint
        )

    @cached_property
    def top_speed(self) -> float:
        """Speed that the joint ``index`` reaches in the log, but for a thousandth of the rows [rad/s]."""
        q = [(run.t, run.joint["q"][:, self.index]) for run in self.log.runs]
        return max([1e-3, *(float(np.quantile(np.abs(np.gradient(x, t)), 0.999)) for t, x in q)])

    @property
    def device(self) -> bool:
        """Whether the joint ``index`` has a magnetorheological device."""
        return self.index in self.model.devices.joint

    @property
    def mass(self) -> float:
        """Mass of the body ``index`` [kg]."""
        return float(self.model.model.body_mass[self.index])

    @property
    def link(self) -> Place:
        """The body whose axis it is, of a ``body_axis``."""
        return replace(self, index=self.index // 3)

    @property
    def reach(self) -> float:
        """Distance from the joint of the body ``index`` to the furthest of what hangs on it [m]."""
        return float(self.model.reach[self.index])

    @property
    def total(self) -> float:
        """Mass of the robot, without what stands still in a scene [kg]."""
        return float(self.model.model.body_subtreemass[self.model.trunk])

    @property
    def row(self) -> float:
        """Time between rows of the log [s]."""
        return float(np.median([run.dt for run in self.log.runs]))

    @cached_property
    def hidden_moment(self) -> float:
        """Static moment of the body ``index`` that makes less torque than the least friction [kg·m]."""
        joint = driver(self.model, self.index)
        return 0.005 * torque_scale(self.model, self.log, joint) / 9.81 if joint is not None else 0.0

    @cached_property
    def hidden_mass(self) -> float:
        """Mass of the body ``index`` that makes less torque than the least friction: drives hide it [kg]."""
        mj, body = self.model.model, self.index
        arm = max(float(np.linalg.norm(mj.body_ipos[body])), 0.3 * self.reach, 0.02)
        return self.hidden_moment / arm


class Places(NamedTuple):
    """Places of one kind."""

    of: Callable[[ReplayModel], list[tuple[str, int, str]]]
    """Name, column and axis of each place of a robot."""
    columns: Callable[[ReplayModel], int]
    """Columns of a field that is changed there."""


def _axes(axes: str, where: Callable[[ReplayModel], str]) -> Places:
    """One place by axis."""
    names = axes.split()
    return Places(lambda m: [(where(m), k, axis) for k, axis in enumerate(names)], lambda _: len(names))


def _robot(_: ReplayModel) -> str:
    return "robot"


def _trunk(m: ReplayModel) -> str:
    return m.body_name(m.trunk)


PLACES: dict[Kind, Places] = {
    "joint": Places(lambda m: [(name, j, "") for j, name in enumerate(m.joints)], lambda m: len(m.joints)),
    "commands": Places(lambda _: [("robot", 0, "")], lambda _: 1),
    "imu": Places(lambda _: [("imu", 1, "")], lambda _: 2),
    "body": Places(lambda m: [(m.body_name(b), b, "") for b in m.moving if b != m.trunk], lambda m: m.model.nbody),
    "body_axis": Places(
        lambda m: [(m.body_name(b), 3 * b + k, axis) for b in m.moving if b != m.trunk for k, axis in enumerate("xyz")],
        lambda m: 3 * m.model.nbody,
    ),
    "trunk": Places(lambda m: [(_trunk(m), m.trunk, "")], lambda m: m.model.nbody),
    "trunk_axis": _axes("x y z", _trunk),
    "lean": _axes("roll pitch", _robot),
    "gyro": _axes("x y z", _robot),
    "robot": Places(lambda _: [("robot", 0, "")], lambda _: 1),
    "foot": Places(
        lambda m: [(m.body_name(int(m.model.geom_bodyid[foot])), k, "") for k, foot in enumerate(m.feet)],
        lambda m: len(m.feet),
    ),
    "pull": _axes("x y", _trunk),
}
"""Kinds of places, in the order of the parameters. At each place its causes follow each other as in the catalogue."""


def driver(model: ReplayModel, body: int) -> int | None:
    """The log's joint that moves a body, or None."""
    first, count = int(model.model.body_jntadr[body]), int(model.model.body_jntnum[body])
    own = {int(model.model.jnt_dofadr[first + k]) for k in range(count)}
    return next((j for j, v in enumerate(model.v_adr.tolist()) if v in own), None)


def torque_scale(model: ReplayModel, log: RobotLog, j: int) -> float:
    """Torque that the joint's drive gives at most, or at 0.6 rad of error [N·m]; of a slide 0.6 :data:`PINION`."""
    if model.limited[j]:
        return float(model.model.actuator_forcerange[j, 1])
    if log.kp[j] > 0.0:
        return 0.6 * float(log.kp[j] * turns(model)[j])
    found = [
        np.nanquantile(np.abs(run.joint[c][:, j]), 0.99)
        for run in log.runs
        for c in ("tau_ff", "tau")
        if c in run.joint
    ]
    return float(np.nanmax(found)) if found else 10.0
