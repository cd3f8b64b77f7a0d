"""Ground with heights: as the terrain made it, under the robots of a picture and of a recording."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from mrwarp.env.cfg import make_walk_cfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.trials.walking import make_env
from mrwarp.viewing import stream
from mrwarp.viewing.frames import FrameReader
from mrwarp.viewing.ground import Ground, ground_of, trunk_height
from mrwarp.viewing.robot_pictures import contact_sheet
from mrwarp.viewing.robot_view import RobotLogger
from mrwarp.viewing.side_view import SideView


@pytest.fixture(scope="module")
def rough() -> WalkEnv:
    """Four robots on four tiles of rough ground."""
    return make_env(make_walk_cfg(num_envs=4, terrain="rough"), 4, seed=2)


def test_heights_are_the_terrains(rough: WalkEnv) -> None:
    """Read back from the model: every grid point of the field, to float32; between them on the straight line."""
    assert rough.terrain is not None
    field, ground = rough.terrain.field, ground_of(rough.sim.scene.model)
    assert ground is not None
    rows, columns = field.heights.shape
    i, j = np.mgrid[0:rows:7, 0:columns:7]
    points = np.stack([j * field.cell - field.half[0], i * field.cell - field.half[1]], axis=-1)
    np.testing.assert_allclose(ground.height(points), field.heights[::7, ::7], atol=2e-6)
    slope = Ground(heights=np.array([[0.0, 1.0], [2.0, 3.0]]), half=(1.0, 1.0))  # 1.5 + x/2 + y
    np.testing.assert_allclose(slope.height(np.array([[0.0, 0.0], [0.5, -0.5], [9.0, 9.0]])), [1.5, 1.25, 3.0])


def test_mesh_lies_on_the_heights_and_faces_up() -> None:
    """Two triangles a cell: their area over the plane is that of the grid, and their normals point upwards."""
    heights = np.random.default_rng(0).uniform(size=(4, 6))
    vertices, triangles = Ground(heights=heights, half=(2.0, 1.0)).mesh()
    np.testing.assert_allclose(vertices[:, 2].reshape(4, 6), heights, atol=1e-7)
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert len(triangles) == 2 * 3 * 5 and area.min() > 0.0
    assert area.sum() == pytest.approx(8.0, rel=1e-6)


def test_a_plane_has_no_heights(walk: Any) -> None:
    """On flat ground the trunk's height is its z, and the picture's row draws the line itself."""
    assert ground_of(walk.env.sim.scene.model) is None and not SideView(walk.env.sim.scene).uneven
    np.testing.assert_array_equal(trunk_height(None, walk.frames.qpos), walk.frames.qpos[..., 2])


def test_robots_stand_on_the_drawn_ground(rough: WalkEnv, tmp_path: Path, read_rrd: Any) -> None:
    """Trunk heights are the task's own over the ground; recording and picture hold the surface below the robots."""
    ground = ground_of(rough.sim.scene.model)
    assert ground is not None and rough.terrain is not None
    assert len(set(rough.terrain.level.tolist())) == 4  # few robots are spread over the levels
    frames = FrameReader(rough.robot, range(4)).read(0.0, [0.5] * 4)
    np.testing.assert_allclose(trunk_height(ground, frames.qpos)[0], rough.height.numpy(), atol=0.02)
    relief = []
    for qpos in frames.qpos[0]:
        axis = Figure().add_subplot()
        moved = qpos + np.eye(len(qpos))[0]  # off the flat middle of a pyramid, which reaches 1 m
        SideView(rough.sim.scene).draw(axis, moved, np.zeros(4, dtype=int), np.zeros((4, 3)))
        line = np.asarray(axis.lines[0].get_ydata(), dtype=float)
        assert abs(line[len(line) // 2]) < 1e-9
        relief.append(float(np.ptp(line)))
    assert min(relief) >= 0.0 and max(relief) > 0.02
    contact_sheet(rough.sim.scene, frames, [0.0] * 4, tmp_path / "rough.png")
    target = stream.new_recording()
    stream.save_to(target, tmp_path / "rough.rrd")
    robots = RobotLogger(rough.sim.scene, [0.0] * 4, target)
    robots.log(frames)
    assert stream.close(target)
    assert all(robots.place(k)[1] == 0.0 for k in range(4))
    ((_, vertices),) = read_rrd(tmp_path / "rough.rrd").columns("/ground", "Mesh3D:vertex_positions", static=True)
    assert len(vertices) == ground.heights.size
