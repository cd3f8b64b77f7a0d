"""A robot from the side: parallel projection of its shapes, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Patch, Polygon
from mujoco import mjtGeom
from scipy.spatial import ConvexHull

from mrwarp.env.natural_units import scales
from mrwarp.env.sim_model import Scene
from mrwarp.viewing.frames import Gate
from mrwarp.viewing.shapes import GATE_COLORS, Part, Shape, body_poses, feet, ground_of, robot_shapes, rotate

FORCE_SCALE = 0.16 / 100.0
"""Length of a drawn foot force [m/N]: 100 N are 0.16 m."""

FORCE_COLOR, GROUND_COLOR, GROUND_EDGE = "#d6335c", "#e4e6e9", "#9aa0a8"
"""Foot forces, the ground and its surface."""

FORCE_ARROW = {"arrowstyle": "-|>", "color": FORCE_COLOR, "lw": 1.3, "mutation_scale": 7, "shrinkA": 0, "shrinkB": 0}

GROUND_DRAWN = 0.38
"""Ground with heights is drawn this far before and behind the trunk [m]."""


class SideView:
    """Draws robots of a scene from their right side, as parallel projections of their shapes.

    Args:
        scene: What is simulated.

    Attributes:
        unit: Size of the robot beside the shipped one's.
    """

    def __init__(self, scene: Scene) -> None:
        self.unit = scales(scene).length if scene.floating else 1.0
        self._model, self._shapes, self._ground = scene.model, robot_shapes(scene), ground_of(scene.model)
        self._trunk = next((s.body for s in self._shapes if s.part is Part.TRUNK), 1)
        self._feet = feet(scene, self._shapes)

    def draw(self, axis: Axes, qpos: np.ndarray, gate: np.ndarray, force: np.ndarray, *, x: float = 0.0) -> None:
        """Draw one robot with its trunk above ``x``, looking at its own right side whatever its heading.

        The ground, flat or with heights, is drawn in the plane of the trunk; it is at height 0 below the trunk.

        Args:
            axis: Axes in metres, equal aspect.
            qpos: Positions, shape (nq,).
            gate: Gates of its devices, shape (M,).
            force: Forces of the ground on its feet [N], shape (L, 3).
            x: Where to draw it [m].
        """
        pos, quat = body_poses(self._model, qpos)
        heading = rotate(quat[self._trunk], np.array([1.0, 0.0, 0.0]))
        yaw = np.arctan2(heading[1], heading[0])
        forward, right = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([np.sin(yaw), -np.cos(yaw), 0.0])
        origin = pos[self._trunk] * (1.0, 1.0, 0.0)
        if self._ground is not None:
            origin[2] = self._ground.height(origin[:2])

        def flat(points: np.ndarray) -> np.ndarray:
            """Points of the world in the drawing plane."""
            relative = points - origin
            return np.stack([relative @ forward + x, relative[..., 2]], axis=-1)

        if self._ground is None:
            axis.axhspan(-0.05, 0.0, color=GROUND_COLOR, zorder=0)
            axis.axhline(0.0, color=GROUND_EDGE, linewidth=0.8, zorder=1)
        else:
            along = np.linspace(-GROUND_DRAWN, GROUND_DRAWN, 61)
            height = self._ground.height(origin[:2] + along[:, None] * forward[:2]) - origin[2]
            axis.fill_between(along + x, height, -0.3, color=GROUND_COLOR, linewidth=0, zorder=0.5)
            axis.plot(along + x, height, color=GROUND_EDGE, linewidth=0.8, zorder=1)
        for shape in self._shapes:
            turn, centre = quat[shape.body], pos[shape.body] + rotate(quat[shape.body], shape.pos)
            depth = float((centre - origin) @ right)
            color = GATE_COLORS[Gate(int(gate[shape.device]))] if shape.device >= 0 else shape.part.value
            faded = 0.5 if depth < -0.03 else 0.0  # what lies behind the trunk fades towards the paper
            patch = _patch(shape, lambda points, c=centre, q=turn, s=shape: flat(c + rotate(q, rotate(s.quat, points))))
            edge = _fade(tuple(int(0.6 * c) for c in color), faded)
            patch.set(facecolor=_fade(color, faded), edgecolor=edge, linewidth=0.5, zorder=2.0 + depth)
            axis.add_patch(patch)
        for leg, foot in self._feet.items():
            if np.linalg.norm(force[leg]) < 5.0:
                continue
            start = flat(pos[foot.body] + rotate(quat[foot.body], foot.pos))
            end = start + FORCE_SCALE * np.array([force[leg] @ forward, force[leg][2]])
            axis.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=FORCE_ARROW, zorder=4.0)


def _patch(shape: Shape, flat: Callable[[np.ndarray], np.ndarray]) -> Patch:
    """Outline of a shape in the drawing plane; ``flat`` puts points of its own frame there."""
    if shape.kind == mjtGeom.mjGEOM_SPHERE:
        return Circle(tuple(flat(np.zeros(3))), shape.size[0])
    if shape.kind == mjtGeom.mjGEOM_BOX:
        corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * shape.size
        return _outline(flat(corners))
    radius, half = shape.size
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if shape.kind == mjtGeom.mjGEOM_CAPSULE:
        ends = flat(np.array([[0.0, 0.0, -half], [0.0, 0.0, half]]))
        return _outline((ends[:, None] + circle).reshape(-1, 2))
    rims = [np.pad(circle, ((0, 0), (0, 1)), constant_values=z) for z in (-half, half)]
    return _outline(flat(np.concatenate(rims)))


def _outline(points: np.ndarray) -> Polygon:
    """Convex hull of points in the plane."""
    return Polygon(points[ConvexHull(points).vertices])


def _fade(color: tuple[int, ...], share: float) -> tuple[float, ...]:
    """A colour mixed with white."""
    return tuple(c / 255.0 + (1.0 - c / 255.0) * share for c in color)
