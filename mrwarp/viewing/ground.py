"""The ground of a scene with a height field, for pictures and the viewer: its heights, and its surface as triangles."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np


@dataclass(frozen=True, kw_only=True)
class Ground:
    """Heights on a grid centred on the world's origin, as the model holds them; flat outside."""

    heights: np.ndarray
    """[m], shape (rows along y, columns along x)."""
    half: tuple[float, float]
    """Half the extent along x and y [m]."""

    def height(self, points: np.ndarray) -> np.ndarray:
        """Height below points [m], shape (...), by bilinear interpolation.

        Args:
            points: x and y [m], shape (..., 2).
        """
        rows, columns = self.heights.shape
        x = np.clip((points[..., 0] / self.half[0] + 1.0) * 0.5 * (columns - 1), 0.0, columns - 1.0)
        y = np.clip((points[..., 1] / self.half[1] + 1.0) * 0.5 * (rows - 1), 0.0, rows - 1.0)
        i, j = np.minimum(y.astype(int), rows - 2), np.minimum(x.astype(int), columns - 2)
        u, v = x - j, y - i
        z = self.heights
        low, high = (1.0 - u) * z[i, j] + u * z[i, j + 1], (1.0 - u) * z[i + 1, j] + u * z[i + 1, j + 1]
        return (1.0 - v) * low + v * high

    def mesh(self) -> tuple[np.ndarray, np.ndarray]:
        """Vertices [m], shape (N, 3), and triangles, shape (2 (rows - 1) (columns - 1), 3), seen from above."""
        rows, columns = self.heights.shape
        x, y = np.linspace(-self.half[0], self.half[0], columns), np.linspace(-self.half[1], self.half[1], rows)
        vertices = np.stack([*np.meshgrid(x, y), self.heights], axis=-1).reshape(-1, 3)
        corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        near = np.stack([corner, corner + 1, corner + columns + 1], axis=1)
        far = np.stack([corner, corner + columns + 1, corner + columns], axis=1)
        return vertices.astype(np.float32), np.concatenate([near, far]).astype(np.uint32)


def ground_of(model: mujoco.MjModel) -> Ground | None:
    """The model's first height field; None if its ground is a plane."""
    fields = np.flatnonzero(model.geom_type == int(mujoco.mjtGeom.mjGEOM_HFIELD))
    if not len(fields):
        return None
    field = int(model.geom_dataid[fields[0]])
    rows, columns, start = (int(getattr(model, f"hfield_{name}")[field]) for name in ("nrow", "ncol", "adr"))
    half_x, half_y, top, _ = (float(size) for size in model.hfield_size[field])
    data = model.hfield_data[start : start + rows * columns].reshape(rows, columns)
    return Ground(heights=data * top + model.geom_pos[fields[0], 2], half=(half_x, half_y))


def trunk_height(ground: Ground | None, qpos: np.ndarray) -> np.ndarray:
    """Height of the trunk over the ground below it [m], shape (...), from positions, shape (..., nq)."""
    return qpos[..., 2] - (0.0 if ground is None else ground.height(qpos[..., :2]))
