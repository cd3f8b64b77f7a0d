"""Shapes: what is drawn is what MuJoCo collides, where MuJoCo has it."""

from typing import Any

import mujoco
import numpy as np
import pytest

from mrwarp.env.sim import robot_scene
from mrwarp.usd.asset import load_robot
from mrwarp.usd.robot import JOINTS, LEGS
from mrwarp.viewing.shapes import Kind, Kinematics, Part, body_names, compose, robot_shapes, rotate


def test_shapes_stand_where_mujoco_has_them(walk: Any) -> None:
    """For random poses every geom's centre and axis equal MuJoCo's forward kinematics to rounding."""
    scene = walk.env.sim.scene
    model = scene.model
    kinematics, data = Kinematics(model), mujoco.MjData(model)
    drawn = [g for g in range(model.ngeom) if model.geom_type[g] != mujoco.mjtGeom.mjGEOM_PLANE]
    shapes = robot_shapes(scene)[: len(drawn)]
    rng = np.random.default_rng(0)
    qpos = np.tile(model.qpos0, (5, 1)) + rng.uniform(-0.8, 0.8, (5, model.nq))
    pos, quat = kinematics(qpos)
    for row in range(5):
        data.qpos[:] = qpos[row]
        mujoco.mj_kinematics(model, data)
        for geom, shape in zip(drawn, shapes, strict=True):
            centre = pos[row, shape.body] + rotate(quat[row, shape.body], shape.pos)
            axis = rotate(compose(quat[row, shape.body], shape.quat), np.array([0.0, 0.0, 1.0]))
            np.testing.assert_allclose(centre, data.geom_xpos[geom], atol=1e-12)
            np.testing.assert_allclose(axis, data.geom_xmat[geom].reshape(3, 3)[:, 2], atol=1e-12)


def test_every_leg_shows_its_own_gate(walk: Any) -> None:
    """Of each leg the calf and the disc at the knee are gated by that leg's device; feet are not."""
    scene = walk.env.sim.scene
    names = body_names(scene.model)
    shapes = robot_shapes(scene)
    for device, leg in enumerate(LEGS):
        gated = [shape for shape in shapes if shape.device == device]
        assert {names[shape.body] for shape in gated} == {f"{leg}_calf"}
        assert sorted(shape.kind.value for shape in gated) == ["capsule", "cylinder"]
    assert [s.name for s in shapes if s.part is Part.FOOT] == [f"{leg}_foot" for leg in LEGS]


def test_names_are_the_robots(walk: Any) -> None:
    """Bodies carry the names of ``robot.JOINTS``; shapes of a body have different names."""
    names = body_names(walk.env.sim.scene.model)
    assert names == ("world", "trunk", *JOINTS)
    paths = [(shape.body, shape.name) for shape in robot_shapes(walk.env.sim.scene)]
    assert len(set(paths)) == len(paths)


@pytest.mark.parametrize(("robot", "payload", "discs", "payloads"), [("go1", 0, 0, 0), ("mr_go", 3, 4, 1)])
def test_variants_differ_in_what_they_carry(robot: str, payload: int, discs: int, payloads: int) -> None:
    """``go1`` shows no device, a payload of 3 kg shows as a box on the trunk."""
    scene = robot_scene(load_robot(robot=robot, payload=payload))
    shapes = robot_shapes(scene)
    names = body_names(scene.model)
    assert sum(shape.name == "mr_device" for shape in shapes) == discs
    assert sum(names[shape.body] == "payload" and shape.kind is Kind.BOX for shape in shapes) == payloads
    assert all((shape.device >= 0) == (shape.part is Part.GATED) for shape in shapes)
    assert {shape.device for shape in shapes} - {-1} == set(range(discs))


def test_rotate_equals_mujoco() -> None:
    """Rotation of random vectors by random quaternions against ``mju_rotVecQuat``."""
    rng = np.random.default_rng(1)
    for quat, vector in zip(rng.normal(size=(20, 4)), rng.normal(size=(20, 3)), strict=True):
        unit, expected = quat / np.linalg.norm(quat), np.empty(3)
        mujoco.mju_rotVecQuat(expected, vector, unit)
        np.testing.assert_allclose(rotate(unit, vector), expected, atol=1e-14)
