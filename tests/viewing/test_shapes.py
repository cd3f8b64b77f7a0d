"""Drawn shapes are those that MuJoCo collides, at MuJoCo's places, on the terrain's ground."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import rerun as rr
from matplotlib.figure import Figure

from mrwarp.env.cfg import TaskCfg
from mrwarp.env.sim import robot_scene
from mrwarp.env.vec_env import WalkEnv
from mrwarp.trials.walking import make_env
from mrwarp.usd.asset import load_robot
from mrwarp.usd.robot import JOINTS, LEGS
from mrwarp.viewing import live_view
from mrwarp.viewing.frames import FrameReader
from mrwarp.viewing.robot_pictures import SideView, contact_sheet
from mrwarp.viewing.robot_view import RobotLogger, make_blueprint
from mrwarp.viewing.shapes import (
    Ground,
    Part,
    body_names,
    body_poses,
    ground_of,
    robot_shapes,
    rotate,
    trunk_height,
)


def test_shapes_stand_where_mujoco_has_them(walk: Any) -> None:
    """For random poses every geom's centre and axis equal MuJoCo's forward kinematics to rounding."""
    scene = walk.env.sim.scene
    model = scene.model
    data = mujoco.MjData(model)
    drawn = [g for g in range(model.ngeom) if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE]
    shapes = robot_shapes(scene)[: len(drawn)]
    rng = np.random.default_rng(0)
    qpos = np.tile(model.qpos0, (5, 1)) + rng.uniform(-0.8, 0.8, (5, model.nq))
    pos, quat = body_poses(model, qpos)
    for row in range(5):
        data.qpos[:] = qpos[row]
        mujoco.mj_kinematics(model, data)
        for geom, shape in zip(drawn, shapes, strict=True):
            centre = pos[row, shape.body] + rotate(quat[row, shape.body], shape.pos)
            axis = rotate(quat[row, shape.body], rotate(shape.quat, np.array([0.0, 0.0, 1.0])))
            np.testing.assert_allclose(centre, data.geom_xpos[geom], atol=1e-12)
            np.testing.assert_allclose(axis, data.geom_xmat[geom].reshape(3, 3)[:, 2], atol=1e-12)


def test_every_leg_shows_its_own_gate(walk: Any) -> None:
    """Of each leg the calf and the disc at the knee are gated by that leg's device; feet are not."""
    scene = walk.env.sim.scene
    names = body_names(scene)
    shapes = robot_shapes(scene)
    for device, leg in enumerate(LEGS):
        gated = [shape for shape in shapes if shape.device == device]
        assert {names[shape.body] for shape in gated} == {f"{leg}_calf"}
        assert {shape.kind for shape in gated} == {mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER}
    assert [s.name for s in shapes if s.part is Part.FOOT] == [f"{leg}_foot" for leg in LEGS]


def test_names_are_the_robots(walk: Any) -> None:
    """Bodies carry the names of ``robot.JOINTS``; shapes of a body have different names."""
    names = body_names(walk.env.sim.scene)
    assert names == ("world", "trunk", *JOINTS)
    paths = [(shape.body, shape.name) for shape in robot_shapes(walk.env.sim.scene)]
    assert len(set(paths)) == len(paths)


@pytest.mark.parametrize(("robot", "payload", "discs", "payloads"), [("go1", 0, 0, 0), ("mr_go", 3, 4, 1)])
def test_variants_differ_in_what_they_carry(robot: str, payload: int, discs: int, payloads: int) -> None:
    """``go1`` shows no device, a payload of 3 kg shows as a box on the trunk."""
    scene = robot_scene(load_robot(robot=robot, payload=payload))
    shapes = robot_shapes(scene)
    names = body_names(scene)
    assert sum(shape.name == "mr_device" for shape in shapes) == discs
    assert (
        sum(names[shape.body] == "payload" and shape.kind == mujoco.mjtGeom.mjGEOM_BOX for shape in shapes) == payloads
    )
    assert all((shape.device >= 0) == (shape.part is Part.GATED) for shape in shapes)
    assert {shape.device for shape in shapes} - {-1} == set(range(discs))


def test_rotate_equals_mujoco() -> None:
    """Rotation of random vectors by random quaternions against ``mju_rotVecQuat``."""
    rng = np.random.default_rng(1)
    for quat, vector in zip(rng.normal(size=(20, 4)), rng.normal(size=(20, 3)), strict=True):
        unit, expected = quat / np.linalg.norm(quat), np.empty(3)
        mujoco.mju_rotVecQuat(expected, vector, unit)
        np.testing.assert_allclose(rotate(unit, vector), expected, atol=1e-14)


@pytest.fixture(scope="module")
def rough() -> WalkEnv:
    """Four robots on four tiles of rough ground."""
    return make_env(TaskCfg(num_envs=4, terrain="rough"), 4, seed=2)


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
    """On flat ground the trunk's height is its z."""
    assert ground_of(walk.env.sim.scene.model) is None
    np.testing.assert_array_equal(trunk_height(None, walk.frames.qpos), walk.frames.qpos[..., 2])


def test_robots_stand_on_the_drawn_ground(rough: WalkEnv, tmp_path: Path, read_rrd: Any) -> None:
    """Trunk heights are the task's own over the ground; recording and picture hold the surface below the robots."""
    ground = ground_of(rough.sim.scene.model)
    assert ground is not None and rough.terrain is not None
    assert len(set(rough.arrays.level.tolist())) == 4  # few robots are spread over the levels
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
    target = rr.RecordingStream("test")
    target.save(tmp_path / "rough.rrd")
    robots = RobotLogger(rough.sim.scene, [0.0] * 4, target)
    target.send_blueprint(make_blueprint(robots))
    robots.log(frames)
    assert live_view.disconnect(target)
    assert all(robots.place(k)[1] == 0.0 for k in range(4))
    shown = read_rrd(tmp_path / "rough.rrd").blueprint("ViewContents:query")
    assert any("/ground" in expressions for expressions in shown)
    ((_, vertices),) = read_rrd(tmp_path / "rough.rrd").columns("/ground", "Mesh3D:vertex_positions", static=True)
    assert len(vertices) == ground.heights.size
