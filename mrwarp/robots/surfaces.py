"""Where the shapes of a robot's bodies reach: their lowest points, and points all over them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from mrwarp.robots.foreign import ForeignRobot, Shape

SOLE = 0.005
"""Shapes that reach this close to a foot's lowest point are its sole, and so are bodies to a leg's lowest [m]."""

_BALL = np.array([v for v in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(v)])
_BALL /= np.linalg.norm(_BALL, axis=1, keepdims=True)
_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
_RIM = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(len(_ANGLES))])
_UP = np.array([0.0, 0.0, 1.0])


def points_of(shape: Shape) -> np.ndarray:
    """Points all over a shape in its own frame [m], shape (N, 3); of a mesh its corners."""
    size = shape.size
    if shape.kind == "sphere":
        return _BALL * size[0]
    if shape.kind == "capsule":
        return np.concatenate([_BALL * size[0] + end * size[1] * _UP for end in (-1.0, 1.0)])
    if shape.kind == "cylinder":
        return np.concatenate([_RIM * size[0] + end * size[1] * _UP for end in (-1.0, 1.0)])
    if shape.kind == "box":
        return _CORNERS * size
    assert shape.points is not None
    return shape.points


def surface(robot: ForeignRobot, body: int) -> np.ndarray:
    """Points all over a body's shapes, those that collide if there are such, in its frame [m], shape (N, 3)."""
    own = [shape for shape in robot.shapes if shape.body == body]
    own = [shape for shape in own if shape.collides] or own
    return np.concatenate([np.zeros((0, 3)), *(shape.pose.apply(points_of(shape)) for shape in own)])


def lowest(robot: ForeignRobot, body: int, poses: Sequence[RigidTransform]) -> np.ndarray:
    """Lowest point of a body in the root's frame [m]: of what collides, else of all shapes, else its origin."""
    points = [poses[body].translation, *(point for _, point in extremes(robot, body, poses))]
    return min(points, key=lambda point: point[2])


def extremes(
    robot: ForeignRobot, body: int, poses: Sequence[RigidTransform], *, solid: bool = False
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Centre and lowest point of each of a body's shapes in the root's frame [m]; ``solid``: of what will collide."""
    shapes = [shape for shape in robot.shapes if shape.body == body and not (solid and shape.kind == "mesh")]
    for shape in [shape for shape in shapes if shape.collides] or ([] if solid else shapes):
        world = poses[body] * shape.pose
        low = world.apply(_extreme(shape, world.rotation.inv().apply([0.0, 0.0, -1.0])))
        yield world.translation, low


def _extreme(shape: Shape, down: np.ndarray) -> np.ndarray:
    """The shape's farthest point along a direction of its own frame [m], shape (3,)."""
    size = shape.size
    if shape.kind == "sphere":
        return down * size[0]
    if shape.kind == "capsule":
        return down * size[0] + np.array([0.0, 0.0, np.sign(down[2]) * size[1]])
    if shape.kind == "box":
        return np.sign(down) * size
    if shape.kind == "cylinder":
        flat = np.array([down[0], down[1], 0.0])
        return flat / max(float(np.linalg.norm(flat)), 1e-9) * size[0] + np.array([0, 0, np.sign(down[2]) * size[1]])
    assert shape.points is not None
    return shape.points[np.argmax(shape.points @ down)]
