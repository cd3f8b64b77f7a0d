"""A robot from the side: parallel projection of its shapes, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Patch, Polygon

from mrwarp.env.sim_model import Scene
from mrwarp.usd.robot import LEGS
from mrwarp.viewing.frames import Gate
from mrwarp.viewing.shapes import (
    GATE_COLORS,
    Color,
    Kind,
    Kinematics,
    Part,
    Shape,
    compose,
    ground_of,
    robot_shapes,
    rotate,
)

FORCE_SCALE = 0.16 / 100.0
"""Length of a drawn foot force [m/N]: 100 N are 0.16 m."""

FORCE_COLOR = "#d6335c"
"""Foot forces."""

GROUND_COLOR, GROUND_EDGE = "#e4e6e9", "#9aa0a8"
"""Ground and its surface."""

GROUND_DRAWN = 0.38
"""Ground with heights is drawn this far before and behind the trunk [m]."""


class SideView:
    """Draws robots of a scene from their right side, as parallel projections of their shapes.

    Args:
        scene: What is simulated.
    """

    def __init__(self, scene: Scene) -> None:
        self._kinematics = Kinematics(scene.model)
        self._shapes = robot_shapes(scene)
        self._trunk = next((s.body for s in self._shapes if s.part is Part.TRUNK), 1)
        self._feet = [next((s for s in self._shapes if s.name == f"{leg}_foot"), None) for leg in LEGS]
        self._ground = ground_of(scene.model)

    @property
    def uneven(self) -> bool:
        """Whether it draws the ground itself, because that has heights."""
        return self._ground is not None

    def draw(self, axis: Axes, qpos: np.ndarray, gate: np.ndarray, force: np.ndarray, *, x: float = 0.0) -> None:
        """Draw one robot with its trunk above ``x``, looking at its own right side whatever its heading.

        Ground with heights is drawn in the plane of the trunk, which is at height 0 below it.

        Args:
            axis: Axes in metres, equal aspect.
            qpos: Positions, shape (nq,).
            gate: Gates of its devices, shape (M,).
            force: Forces of the ground on its feet [N], shape (L, 3).
            x: Where to draw it [m].
        """
        pos, quat = self._kinematics(qpos)
        heading = rotate(quat[self._trunk], np.array([1.0, 0.0, 0.0]))
        yaw = np.arctan2(heading[1], heading[0])
        forward, right = np.array([np.cos(yaw), np.sin(yaw), 0.0]), np.array([np.sin(yaw), -np.cos(yaw), 0.0])
        origin = pos[self._trunk] * (1.0, 1.0, 0.0)
        if self._ground is not None:
            origin[2] = self._ground.height(origin[:2])

        def flat(points: np.ndarray) -> np.ndarray:
            relative = points - origin
            return np.stack([relative @ forward + x, relative[..., 2]], axis=-1)

        if self._ground is not None:
            along = np.linspace(-GROUND_DRAWN, GROUND_DRAWN, 61)
            height = self._ground.height(origin[:2] + along[:, None] * forward[:2]) - origin[2]
            axis.fill_between(along + x, height, -0.3, color=GROUND_COLOR, linewidth=0, zorder=0.5)
            axis.plot(along + x, height, color=GROUND_EDGE, linewidth=0.8, zorder=1)
        depth = {id(s): float((pos[s.body] + rotate(quat[s.body], s.pos) - origin) @ right) for s in self._shapes}
        for shape in sorted(self._shapes, key=lambda s: depth[id(s)]):
            centre = pos[shape.body] + rotate(quat[shape.body], shape.pos)
            color = GATE_COLORS[Gate(int(gate[shape.device]))] if shape.device >= 0 else shape.part.value
            # what lies behind the trunk fades towards the paper
            face = _fade(color, 0.5 if depth[id(shape)] < -0.03 else 0.0)
            edge = _fade(_darker(color), 0.5 if depth[id(shape)] < -0.03 else 0.0)
            for patch in _patches(shape, centre, compose(quat[shape.body], shape.quat), flat):
                patch.set(facecolor=face, edgecolor=edge, linewidth=0.5, zorder=2.0 + depth[id(shape)])
                axis.add_patch(patch)
        for leg, foot in enumerate(self._feet):
            if foot is None or leg >= len(force) or np.linalg.norm(force[leg]) < 5.0:
                continue
            start = flat(pos[foot.body] + rotate(quat[foot.body], foot.pos))
            end = start + FORCE_SCALE * np.array([force[leg] @ forward, force[leg][2]])
            arrow = {
                "arrowstyle": "-|>",
                "color": FORCE_COLOR,
                "lw": 1.3,
                "mutation_scale": 7,
                "shrinkA": 0,
                "shrinkB": 0,
            }
            axis.annotate("", xy=tuple(end), xytext=tuple(start), arrowprops=arrow, zorder=4.0)


def rgb(color: Color) -> tuple[float, float, float]:
    """A colour as matplotlib wants it, in [0, 1]."""
    return color[0] / 255.0, color[1] / 255.0, color[2] / 255.0


def _patches(
    shape: Shape, centre: np.ndarray, quat: np.ndarray, flat: Callable[[np.ndarray], np.ndarray]
) -> list[Patch]:
    """Outline of a shape in the drawing plane."""
    if shape.kind is Kind.SPHERE:
        return [Circle(tuple(flat(centre)), shape.size[0])]
    if shape.kind is Kind.BOX:
        corners = np.array([[i, j, k] for i in (-1, 1) for j in (-1, 1) for k in (-1, 1)]) * shape.size
        return [Polygon(_hull(flat(centre + rotate(quat, corners))))]
    radius, half = shape.size
    ends = flat(centre + rotate(quat, np.array([[0.0, 0.0, -half], [0.0, 0.0, half]])))
    angle = np.linspace(0.0, 2.0 * np.pi, 25)
    if shape.kind is Kind.CAPSULE:
        circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return [Polygon(_hull(np.concatenate([ends[0] + circle, ends[1] + circle])))]
    rim = radius * np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=1)
    sides = [flat(centre + rotate(quat, rim + [0.0, 0.0, z])) for z in (-half, half)]
    return [Polygon(_hull(np.concatenate(sides)))]


def _hull(points: np.ndarray) -> np.ndarray:
    """Convex hull of points in the plane, counter-clockwise (monotone chain)."""
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]

    def chain(rows: np.ndarray) -> list[np.ndarray]:
        kept: list[np.ndarray] = []
        for row in rows:
            while len(kept) > 1 and _turn(kept[-2], kept[-1], row) <= 0.0:
                kept.pop()
            kept.append(row)
        return kept[:-1]

    return np.array(chain(ordered) + chain(ordered[::-1]))


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _fade(color: Color, share: float) -> tuple[float, float, float]:
    """A colour mixed with white."""
    r, g, b = (c + (1.0 - c) * share for c in rgb(color))
    return r, g, b


def _darker(color: Color) -> Color:
    r, g, b = (int(0.6 * c) for c in color)
    return r, g, b
