"""Shapes of a leg that touch the ground: the file's own sphere, a sole, or a sphere that is put there; and wheels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import trimesh
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.robots.chains import GROUND_SHARE, chains
from mrwarp.robots.foreign import ForeignRobot, Joint, RobotFileError, Shape
from mrwarp.robots.guesses import Guess, Subject, some
from mrwarp.robots.stance import Foot
from mrwarp.robots.surfaces import SOLE, extremes, lowest, points_of, surface
from mrwarp.usd.robot import STAND_HEIGHT

FOOT_RADIUS = 0.02
"""Largest radius of a foot that is put onto a leg [m]."""

ROUND = 0.85
"""A body is a wheel if its outline about its axis is nowhere nearer than this share of the farthest: of a square it is
0.71, of a cylinder drawn with 8 corners 0.92."""

SECTORS = 12
"""Sectors about the axis in which a wheel's outline is looked at: each must hold a point of a mesh."""


def find_foot(robot: ForeignRobot, leg: Sequence[Joint], pose: Mapping[str, float]) -> Foot:
    """The sphere that touches the ground in a pose, standing or stretched: the lowest of them, else one put there.

    A mesh does not collide, so that a sole that is one gets a box of its bounds.

    Raises:
        RobotFileError: the leg ends without a shape.
    """
    body, poses = leg[-1].child, robot.poses(pose)
    low = lowest(robot, body, poses)
    own = [shape for shape in robot.shapes if shape.body == body and shape.collides]
    balls = [
        shape
        for shape in own
        if shape.kind == "sphere" and (poses[body] * shape.pose).translation[2] - shape.size[0] < low[2] + 0.01
    ]
    best = max(balls, key=lambda shape: shape.size[0], default=None)
    if best is not None and any(
        np.linalg.norm(ball.pose.translation - best.pose.translation) > best.size[0] + ball.size[0] for ball in balls
    ):
        best = None  # the corners of a sole
    if not any(shape.body == body for shape in robot.shapes):
        raise RobotFileError(
            f"{robot.path}: {robot.bodies[body].name} ends a leg and has no shape that says where its foot is; give it "
            "a collision sphere there, or leave --skip-meshes out"
        )
    if best is not None:
        return Foot(
            body=body, centre=best.pose.translation, radius=float(best.size[0]), friction=best.friction, shape=best
        )
    radius = min(FOOT_RADIUS, FOOT_RADIUS / STAND_HEIGHT * abs(float(low[2])))
    box = _sole_box(robot, body, poses[body], float(low[2]), radius)
    if box is not None:
        middle = np.array([*(poses[body] * box.pose).translation[:2], low[2] + radius])
    else:
        sole = [centre for centre, point in extremes(robot, body, poses) if point[2] < low[2] + SOLE]
        middle = np.array([*np.mean(sole or [low], axis=0)[:2], low[2] + radius])
    return Foot(
        body=body,
        centre=poses[body].inv().apply(middle),
        radius=radius,
        friction=max((shape.friction for shape in own), default=0.8),
        shape=None,
        sole=box is not None or any(shape.kind != "mesh" for shape in own),
        box=box,
    )


def _sole_box(robot: ForeignRobot, body: int, place: RigidTransform, low: float, radius: float) -> Shape | None:
    """A box of the part of a body's meshes that is on the ground, where that is wider than the foot's sphere.

    Args:
        robot: The robot.
        body: The foot.
        place: Of the foot in the root's frame.
        low: Height of its lowest point there [m].
        radius: Of the sphere that is put there otherwise [m].
    """
    own = [shape for shape in robot.shapes if shape.body == body]
    own = [shape for shape in own if shape.collides] or own
    there = [(place * shape.pose).apply(points_of(shape)) for shape in own]
    sole = [shape for shape, points in zip(own, there, strict=True) if points[:, 2].min() < low + SOLE]
    if not sole or any(shape.kind != "mesh" for shape in sole):
        return None
    points = np.concatenate(there)
    points = points[points[:, 2] < low + SOLE]
    if max(np.ptp(points[:, :2], axis=0)) <= 2.0 * radius:
        return None
    flat, sides = trimesh.bounds.oriented_bounds_2D(points[:, :2]) if _is_flat(points) else (np.eye(3), np.zeros(2))
    if min(sides) < 1e-4:  # an edge
        return None
    turn = np.linalg.inv(flat)  # from the rectangle, centred and along its axes, to the ground
    angle = float(np.arctan2(turn[1, 0], turn[0, 0]))
    half = 0.5 * np.array([*sides, 2.0 * SOLE])
    world = RigidTransform.from_components([*turn[:2, 2], low + half[2]], Rotation.from_rotvec([0.0, 0.0, angle]))
    return Shape(
        kind="box",
        body=body,
        pose=place.inv() * world,
        size=half,
        collides=True,
        friction=max(shape.friction for shape in sole),
    )


def _is_flat(points: np.ndarray) -> bool:
    """Whether points span a plane seen from above: three that are no line."""
    return len(points) > 2 and np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=1e-4) == 2


def foot_notes(robot: ForeignRobot, feet: Sequence[Foot]) -> list[Guess]:
    """Shapes that stand for feet that the file does not have as spheres."""
    notes = []
    boxed = [foot for foot in feet if foot.box is not None]
    if boxed:
        sizes = {_size(2e3 * foot.box.size) for foot in boxed if foot.box is not None}
        text = f"the sole of {_named(robot, boxed)} is a mesh: a box of its bounds bears the load"
        notes.append(Guess(subject=Subject.FEET, text=f"{text}, {', '.join(sorted(sizes))}"))
    put = [foot for foot in feet if foot.shape is None and foot.box is None]
    if put:
        sizes = ", ".join(sorted({f"{1e3 * foot.radius:.0f}" for foot in put}))
        bare = "" if all(foot.sole for foot in put) else ", which alone bears the load"
        text = f"no sphere below {_named(robot, put)}: one of {sizes} mm was put there{bare}"
        notes.append(Guess(subject=Subject.FEET, text=text))
    return notes


def _named(robot: ForeignRobot, feet: Sequence[Foot]) -> str:
    return some([robot.bodies[foot.body].name for foot in feet])


def _size(sides: np.ndarray) -> str:
    """Length and width [mm]."""
    return f"{max(sides[:2]):.0f} x {min(sides[:2]):.0f} mm"


def wheels(robot: ForeignRobot, poses: Sequence[Mapping[str, float]]) -> list[Joint]:
    """Last joints of chains without limits that carry a wheel to the ground, in one of some poses [rad]."""
    found = []
    for chain in chains(robot):
        joint = chain[-1]
        if joint.kind != "hinge" or joint.limits is not None:
            continue
        named = "wheel" in f"{joint.name} {robot.bodies[joint.child].name}".lower()
        if (named or _is_round(robot, joint)) and any(_on_ground(robot, joint, pose) for pose in poses):
            found.append(joint)
    return found


def _is_round(robot: ForeignRobot, joint: Joint) -> bool:
    """Whether the body that a joint carries is round about its axis."""
    points = joint.in_child.inv().apply(surface(robot, joint.child))
    across = points - np.outer(points @ joint.axis, joint.axis)
    first = np.cross(joint.axis, np.eye(3)[np.argmin(np.abs(joint.axis))])
    first /= np.linalg.norm(first)
    angles = np.arctan2(across @ np.cross(joint.axis, first), across @ first)
    sectors = np.floor((angles / (2.0 * np.pi) + 0.5) * SECTORS).astype(int) % SECTORS
    radius = np.linalg.norm(across, axis=1)
    outline = np.array([radius[sectors == k].max(initial=0.0) for k in range(SECTORS)])
    return bool(outline.min() >= ROUND * outline.max() > SOLE)


def _on_ground(robot: ForeignRobot, joint: Joint, pose: Mapping[str, float]) -> bool:
    """Whether what a joint carries is about as low as the robot."""
    poses = robot.poses(pose)
    lows = [lowest(robot, body, poses)[2] for body in range(len(robot.bodies))]
    depth = max(lows) - min(lows)
    return bool(lows[joint.child] < min(lows) + GROUND_SHARE * depth)


def with_soles(robot: ForeignRobot, feet: Sequence[Foot]) -> ForeignRobot:
    """The robot with the boxes of its soles."""
    return replace(robot, shapes=[*robot.shapes, *(foot.box for foot in feet if foot.box is not None)])
