"""The stance of legs: solved where a file has none, and what it takes to hold it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from mrwarp.paper import GRAVITY
from mrwarp.robots.foreign import ForeignRobot, Joint, Shape

CROUCH, UPRIGHT = 0.73, 0.90
"""Share of its reach at which a leg stands where the file has no keyframe: that of the shipped robot; a biped's, whose
knee bears half the weight, that of Unitree's H1 (hip 0.4, knee 0.8 rad: 0.89) and G1 (0.31, 0.67 rad: 0.91) in public
policies; with feet that reach forwards a straight leg has 0.96."""

NEARLY_LEVEL, BENT = 0.003, (0.4, 0.95)
"""Grounds of legs that differ by less than this are one [m]; and how far a leg bends or stretches so that its foot is
on the common ground, as a share of its reach."""

PARALLEL = 0.9
"""Cosine from which on two axes of a leg count as parallel: they bend it in one plane."""


@dataclass(frozen=True, kw_only=True)
class Foot:
    """The contact with the ground: a sphere on a body of a leg, the first that reaches the ground."""

    body: int
    centre: np.ndarray
    """In the body's frame [m], shape (3,)."""
    radius: float
    """[m]"""
    friction: float
    shape: Shape | None
    """The file's own sphere; None: one was put where the leg is lowest."""
    sole: bool = False
    """Whether all shapes of the body, and of what it carries, bear the load."""
    box: Shape | None = None
    """The box that stands for a sole that is a mesh."""


class _Plane:
    """A leg as a chain that bends in a plane: joints about one axis, and others that turn the plane."""

    def __init__(self, robot: ForeignRobot, leg: Sequence[Joint], foot: Foot, stretched: Mapping[str, float]) -> None:
        self.robot, self.foot = robot, foot
        before = {joint.child: joint for joint in robot.joints}
        self.path: list[Joint] = []
        body = foot.body
        while body in before:
            self.path.insert(0, before[body])
            body = before[body].parent
        own = {joint.name for joint in leg}
        self.joints = [joint for joint in self.path if joint.name in own]
        self.before = {joint.name: joint.in_parent.as_matrix() for joint in self.path}
        poses = self.poses(stretched)
        axes = [(poses[j.parent] @ self.before[j.name])[:3, :3] @ j.axis for j in self.joints]
        parallel = [[abs(a @ b) > PARALLEL for b in axes] for a in axes]
        most = max(range(len(axes)), key=lambda k: (sum(parallel[k]), k))
        self.bends = [joint for joint, same in zip(self.joints, parallel[most], strict=True) if same]
        flat = axes[most] * (1.0, 1.0, 0.0)
        lateral = flat / np.linalg.norm(flat) if np.linalg.norm(flat) > 0.5 else np.array([0.0, 1.0, 0.0])
        self.lateral = lateral * (-1.0 if lateral[1] < -1e-6 else 1.0)
        self.forward = np.cross(self.lateral, [0.0, 0.0, 1.0])
        points = [*(self.point(poses, joint) for joint in self.bends), self.sole(poses)]
        self.hip = float(points[0][2])
        links = np.diff(points, axis=0)
        self.reach = float(np.linalg.norm(links - np.outer(links @ axes[most], axes[most]), axis=1).sum())
        self.offset = float((points[-1] - points[0]) @ self.lateral)
        self.up = poses[foot.body][2, :3]

    def poses(self, q: Mapping[str, float]) -> dict[int, np.ndarray]:
        """Of the leg's bodies as matrices; the other legs need not be followed."""
        return self.robot.matrices(q, self.path)

    def point(self, poses: Mapping[int, np.ndarray], joint: Joint) -> np.ndarray:
        """A joint's place [m]."""
        return poses[joint.parent][:3] @ self.before[joint.name][:, 3]

    def sole(self, poses: Mapping[int, np.ndarray]) -> np.ndarray:
        """The foot's place [m]."""
        return poses[self.foot.body][:3] @ np.append(self.foot.centre, 1.0)


def _shares(planes: Sequence[_Plane]) -> list[float]:
    """Share of its reach at which each leg stands, so that all stand on one ground though their hips be not level."""
    share = UPRIGHT if len(planes) == 2 else CROUCH
    grounds = [plane.hip - share * plane.reach for plane in planes]
    if np.ptp(grounds) <= NEARLY_LEVEL:
        return [share] * len(planes)
    return [float(np.clip((plane.hip - np.mean(grounds)) / plane.reach, *BENT)) for plane in planes]


def solve_stance(
    robot: ForeignRobot,
    legs: Sequence[Sequence[Joint]],
    feet: Sequence[Foot],
    pose: Mapping[str, float],
    stretched: Mapping[str, float],
    chosen: Mapping[str, float],
) -> dict[str, float]:
    """A stance: every foot below the first joint that bends its leg, at a share of the reach, see :data:`CROUCH`.

    Out of its plane the foot stays as far as stretched; a foot on ankles stays level. Knees point inwards, on bipeds
    forwards and on sprawling legs outwards, if they can.

    Args:
        robot: The robot.
        legs: Joints of each leg, from the trunk.
        feet: Of each leg.
        pose: Angles of all joints to begin with [rad].
        stretched: Angles with which the legs hang stretched [rad].
        chosen: Angles that the user gave [rad].
    """
    pose = dict(pose)
    planes = [_Plane(robot, leg, foot, stretched) for leg, foot in zip(legs, feet, strict=True)]
    for plane, share in zip(planes, _shares(planes), strict=True):
        free = [joint for joint in plane.joints if joint.name not in chosen]
        if not free:
            continue
        low = np.array([max(joint.limits[0] + 1e-3, -2.0) if joint.limits else -2.0 for joint in free])
        high = np.array([min(joint.limits[1] - 1e-3, 2.0) if joint.limits else 2.0 for joint in free])
        high = np.maximum(high, low + 1e-6)

        def angles(q: np.ndarray, free: Sequence[Joint] = free) -> dict[str, float]:
            return {**pose, **{joint.name: float(x) for joint, x in zip(free, q, strict=True)}}

        def miss(q: np.ndarray, plane: _Plane = plane, share: float = share) -> np.ndarray:
            poses = plane.poses(angles(q))
            away = (plane.sole(poses) - plane.point(poses, plane.bends[0])) / plane.reach
            up = poses[plane.foot.body][:3, :3] @ plane.up
            level = up[:2] if len(plane.bends) > 2 and plane.foot.shape is None else []
            side = away @ plane.lateral - plane.offset / plane.reach
            return np.array([away @ plane.forward, side, -away[2] - share, *(0.02 * q), *level])

        guess = dict(zip((joint.name for joint in plane.bends), (0.7, -1.4, 0.7), strict=False))
        bend = np.array([guess.get(joint.name, 0.0) for joint in free])
        results = [
            least_squares(miss, np.clip(start, low, high), bounds=(low, high))
            for start in (bend, -bend, 0.5 * (low + high))
        ]
        near = [result for result in results if result.cost < min(r.cost for r in results) + 1e-3]

        def knee(result: Any, plane: _Plane = plane) -> float:
            """How far the knee points to where it should [m]."""
            poses = plane.poses(angles(result.x))
            first = plane.point(poses, plane.joints[0])
            hip, middle = (plane.point(poses, joint) for joint in (plane.bends * 2)[:2])
            bent = middle - 0.5 * (hip + plane.sole(poses))
            if abs(plane.lateral[1]) < 0.7:  # a sprawling leg
                return float(bent[:2] @ hip[:2])
            return float(bent[0] * (-1.0 if first[0] > 0.05 * plane.reach else 1.0))

        found = max(near, key=knee)
        pose.update({joint.name: round(float(x), 3) + 0.0 for joint, x in zip(free, found.x, strict=True)})
    return pose


def standing_torques(robot: ForeignRobot, feet: Sequence[Foot], pose: Mapping[str, float]) -> dict[str, float]:
    """Torque of each joint that holds the stance [N·m], with the weight on all feet as evenly as balance allows."""
    poses = robot.poses(dict(pose))
    centres = np.array([place.apply(body.com) for place, body in zip(poses, robot.bodies, strict=True)])
    weights = GRAVITY * np.array([body.mass for body in robot.bodies])
    points = np.array([poses[foot.body].apply(foot.centre) for foot in feet])
    balance = np.stack([np.ones(len(points)), points[:, 0], points[:, 1]])
    wanted = np.array([weights.sum(), weights @ centres[:, 0], weights @ centres[:, 1]])
    even = np.full(len(points), weights.sum() / len(points))
    forces = even + np.linalg.lstsq(balance, wanted - balance @ even, rcond=None)[0]
    torques = {}
    for joint in robot.joints:
        carried = robot.carried(joint)
        frame = poses[joint.parent] * joint.in_parent
        moment = sum(np.cross(centres[b] - frame.translation, [0.0, 0.0, -weights[b]]) for b in carried)
        for foot, point, force in zip(feet, points, forces, strict=True):
            if foot.body in carried:
                moment = moment + np.cross(point - frame.translation, [0.0, 0.0, force])
        torques[joint.name] = float(abs(frame.rotation.apply(joint.axis) @ moment))
    return torques
