"""The robot that was written against a second reading of its file: where they differ, and by how much."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from mrwarp.paper import GRAVITY
from mrwarp.robots.drives import Drive
from mrwarp.robots.foreign import NO_LIMITS, ForeignRobot, RobotFileError
from mrwarp.robots.guesses import Guess, Subject, some
from mrwarp.robots.second.second_reading import Reading, by_label, mujoco_reading, second_reading
from mrwarp.run_dir import one_line
from mrwarp.usd.robot import Layout

AGREES = 1e-5
"""Relative difference up to which two readings are one: the file that is written holds 7 digits."""

MATTERS = 1e-3
"""Relative difference from which on the import stops: no scale or CAD file is better, and no fault of a reading that
was seen was smaller than 9e-2."""

POSES = 4
"""Poses in addition to the neutral one, at random within the limits."""

SEED = 3
"""Of the poses."""


class Understood(Protocol):
    """A robot as the import has understood it: a :class:`~mrwarp.robots.legs.UnderstoodRobot`."""

    @property
    def robot(self) -> ForeignRobot:
        """Bodies and joints of the file."""
        ...

    @property
    def layout(self) -> Layout:
        """Driven joints and neutral stance."""
        ...

    @property
    def drives(self) -> Mapping[str, Drive]:
        """Drive of each joint."""
        ...

    @property
    def given_rotors(self) -> Collection[str]:
        """Joints whose rotor inertia the user gave."""
        ...


@dataclass(frozen=True, kw_only=True)
class Difference:
    """One number in which the written robot differs from the second reading."""

    what: str
    """Its name, and both values."""
    size: float
    """Relative."""


def checked(understood: Understood, model: mujoco.MjModel) -> Guess:
    """A note on how far a robot agrees with the second reading of its file.

    Args:
        understood: The robot.
        model: What was written of it, as the simulator loads it.

    Returns:
        The note, of what differs if anything does.

    Raises:
        RobotFileError: something differs by more than :data:`MATTERS`.
    """
    robot = understood.robot
    try:
        second = second_reading(robot)
    except Exception as error:  # the first reading could: MuJoCo's, USD's and XML's errors are of many types
        text = (
            f"the file could not be read a second time ({one_line(error)}): nothing but the import says these numbers"
        )
        return Guess(subject=Subject.SECOND, text=text)
    written = _written(robot, model)
    found = sorted(_differences(understood, written, second), key=lambda d: -d.size)
    worst = found[0].size if found else 0.0
    beyond = [d for d in found if d.size > AGREES]
    if beyond and worst > MATTERS:
        raise RobotFileError(
            f"{robot.path}: the robot that would be written differs from what {second.by} reads: {beyond[0].what} "
            f"({worst:.2g} of it){f', and {len(beyond) - 1} more' if beyond[1:] else ''}; nothing was written: report "
            "the file"
        )
    if beyond:
        more = f" and {len(beyond) - 3} more" if beyond[3:] else ""
        text = f"differs from what {second.by} reads: {'; '.join(d.what for d in beyond[:3])}{more}"
    else:
        text = (
            f"mass matrix, weight at {GRAVITY:g} m/s², limits and motors are what {second.by} reads, within "
            f"{worst:.0e}, both without what is not carried"
        )
    return Guess(subject=Subject.SECOND, text=text)


def _written(robot: ForeignRobot, model: mujoco.MjModel) -> Reading:
    names = by_label(model, [joint.name for joint in robot.joints])
    bare = ForeignRobot(**{**vars(robot), "replaced": {}})
    return mujoco_reading(model, bare, by="written", names=names, tilted=False)


def _differences(understood: Understood, written: Reading, second: Reading) -> Iterator[Difference]:
    """Joints, then dynamics at several poses, limits and motors."""
    robot = understood.robot
    gone = [name for name in second.joints if name not in written.joints and name not in robot.held]
    more = [name for name in written.joints if name not in second.joints]
    for names, text in ((gone, "is not in the written robot"), (more, "is not in the file")):
        if names:
            yield Difference(what=f"joint {some(names)} {text}", size=1.0)
    if gone or more:
        return
    yield from _dynamics(robot, understood.layout.neutral, written, second)
    for joint in robot.joints:
        name = joint.name
        own, other = joint.limits, second.limits[name]
        if other is not None and own is not None and other[0] < other[1] and other[1] - other[0] <= NO_LIMITS:
            size = float(np.abs(np.subtract(own, other)).max())
            yield Difference(what=f"limits of {name} {own} against {other}", size=size)
        rotor = second.armature.get(name, 0.0)
        if rotor > 0.0 and name not in understood.given_rotors:
            yield _number(f"rotor of {name} [kg·m²]", written.armature[name], rotor)
        drive = understood.drives.get(name)
        if drive is None:
            continue
        if drive.limit_from == "file" and name in second.torque:
            yield _number(f"torque limit of {name} [N·m]", drive.torque_limit, second.torque[name])
        if drive.gains_from == "file" and name in second.gains:
            yield _number(f"Kp of {name} [N·m/rad]", drive.kp, second.gains[name][0])
            if second.gains[name][1] > 0.0:  # else it is by rule
                yield _number(f"Kd of {name} [N·m·s/rad]", drive.kd, second.gains[name][1])


def _number(what: str, own: float, other: float) -> Difference:
    return Difference(what=f"{what} {own:.6g} against {other:.6g}", size=abs(own - other) / max(abs(other), 1e-12))


def _dynamics(
    robot: ForeignRobot, neutral: Mapping[str, float], written: Reading, second: Reading
) -> Iterator[Difference]:
    """The largest difference of the mass matrix, and of the weight, over all poses."""
    rng, first = np.random.default_rng(SEED), 6 if robot.floating else 0
    order = [*range(first), *(first + second.joints.index(name) for name in written.joints)]
    rows = [f"base {name}" for name in ("x", "y", "z", "about x", "about y", "about z")[:first]] + [*written.joints]
    turn = Rotation.from_rotvec([0.0, 0.0, robot.forward]).as_matrix()
    change = block_diag(*([turn, turn] if first else []), np.eye(len(written.joints)))
    worst: dict[str, Difference] = {}
    for k in range(POSES + 1):
        q = dict(neutral)
        if k:
            for joint in robot.joints:
                low, high = joint.limits or (-1.0, 1.0)
                q[joint.name] = float(rng.uniform(max(low, -np.pi), min(high, np.pi)))
        own, weight = written.dynamics(q)
        other, pull = second.dynamics({**robot.held, **q})
        other, pull = change.T @ other[np.ix_(order, order)] @ change, change.T @ pull[order]
        size = np.sqrt(np.maximum(np.diag(other), 1e-12))
        gap = np.abs(own - other) / np.outer(size, size)
        i, j = np.unravel_index(int(np.argmax(gap)), gap.shape)
        what = f"mass matrix at {rows[i]}, {rows[j]} {own[i, j]:.6g} against {other[i, j]:.6g}"
        found = [("matrix", Difference(what=what, size=float(gap[i, j])))]
        mass = sum(body.mass for body in robot.bodies)
        lost = np.abs(weight - pull) / (size * np.sqrt(mass) * GRAVITY)
        i = int(np.argmax(lost))
        what = f"weight at {rows[i]} {weight[i]:.6g} against {pull[i]:.6g} N·m"
        found.append(("weight", Difference(what=what, size=float(lost[i]))))
        for kind, difference in found:
            if kind not in worst or difference.size > worst[kind].size:
                worst[kind] = difference
    yield from worst.values()
