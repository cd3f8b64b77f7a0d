"""Links on fixed joints: what they add to the body that bears them, against MuJoCo's own reading and by hand."""

from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics

from mrwarp.robots.foreign import ForeignRobot
from mrwarp.robots.read_robot import read_robot
from mrwarp.usd.converted import convert_stage


def jacobian_mass_matrix(robot: ForeignRobot, q: dict[str, float]) -> np.ndarray:
    """Of the joints alone, as the sum of the bodies' Jacobians."""
    poses, names = robot.poses(q), [joint.name for joint in robot.joints]
    matrix = np.zeros((len(names), len(names)))
    for k, body in enumerate(robot.bodies):
        linear, angular = np.zeros((3, len(names))), np.zeros((3, len(names)))
        for n, joint in enumerate(robot.joints):
            if k in robot.carried(joint):
                frame = poses[joint.parent] * joint.in_parent
                angular[:, n] = frame.rotation.apply(joint.axis)
                linear[:, n] = np.cross(angular[:, n], poses[k].apply(body.com) - frame.translation)
        turn = poses[k].rotation.as_matrix()
        matrix += body.mass * linear.T @ linear + angular.T @ turn @ body.inertia @ turn.T @ angular
    return matrix


@pytest.mark.parametrize("seed", range(8))
def test_random_trees_have_mujocos_mass_matrix(seed: int, tmp_path: Path, random_urdf: Callable[..., str]) -> None:
    """Newton's own merging is wrong by tens of percent on each of them."""
    rng = np.random.default_rng(seed)
    text = random_urdf(rng, held=seed % 2 == 0)
    (tmp_path / "tree.urdf").write_text(text)
    robot = read_robot(tmp_path / "tree.urdf", base="fixed")
    model = mujoco.MjModel.from_xml_string(text)
    data, matrix = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    names = [model.joint(j).name for j in range(model.njnt)]
    assert set(names) == {joint.name for joint in robot.joints} and names
    order = [[joint.name for joint in robot.joints].index(name) for name in names]
    data.qpos[:] = rng.uniform(-2.0, 2.0, model.nq)
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, matrix)
    own = jacobian_mass_matrix(robot, dict(zip(names, data.qpos, strict=True)))[np.ix_(order, order)]
    np.testing.assert_allclose(own, matrix, rtol=0, atol=1e-5 * np.abs(matrix).max())


def test_a_knee_with_a_toe_by_hand(shared_data: Path) -> None:
    """0.2 kg at the knee and 0.15 kg at the toe, 0.28 m below: 0.0013 + 2.5e-5 + 0.15·0.28² about the knee."""
    robot = read_robot(shared_data / "cases/fixed_joint_inertia/quad.urdf")
    knee = next(joint.child for joint in robot.joints if joint.name == "FL_knee")
    body = robot.bodies[knee]
    about_knee = body.inertia[1, 1] + body.mass * body.com @ body.com
    assert about_knee == pytest.approx(0.0013 + 2.5e-5 + 0.15 * 0.28**2, rel=1e-5)


def usd_pair(folder: Path, *, collapse: bool) -> Path:
    """Two bodies of 1 kg, 0.6 m from each other, on a fixed joint, which hang on a hinge of a held trunk."""
    stage = Usd.Stage.CreateNew(str(folder / "pair.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, "/pair").GetPrim()
    stage.SetDefaultPrim(root)
    UsdPhysics.ArticulationRootAPI.Apply(root)
    if collapse:
        scene = UsdPhysics.Scene.Define(stage, "/pair/scene").GetPrim()
        scene.CreateAttribute("newton:collapse_fixed_joints", Sdf.ValueTypeNames.Bool).Set(True)
    for name, x in (("trunk", 0.0), ("near", 0.0), ("far", 0.6)):
        form = UsdGeom.Xform.Define(stage, f"/pair/{name}")
        form.AddTranslateOp().Set(Gf.Vec3d(x, 0.0, 0.0))
        UsdPhysics.RigidBodyAPI.Apply(form.GetPrim())
        mass = UsdPhysics.MassAPI.Apply(form.GetPrim())
        mass.CreateMassAttr(1.0)
        mass.CreateDiagonalInertiaAttr(Gf.Vec3f(0.01))
    for kind, name, ends, x in (
        (UsdPhysics.FixedJoint, "held", ("", "trunk"), 0.0),
        (UsdPhysics.RevoluteJoint, "hinge", ("trunk", "near"), 0.0),
        (UsdPhysics.FixedJoint, "weld", ("near", "far"), 0.6),
    ):
        made = kind.Define(stage, f"/pair/{name}")
        if ends[0]:
            made.CreateBody0Rel().SetTargets([f"/pair/{ends[0]}"])
        made.CreateBody1Rel().SetTargets([f"/pair/{ends[1]}"])
        made.CreateLocalPos0Attr(Gf.Vec3f(x, 0.0, 0.0))
    UsdPhysics.RevoluteJoint(stage.GetPrimAtPath("/pair/hinge")).CreateAxisAttr("Y")
    stage.Save()
    return folder / "pair.usda"


@pytest.mark.parametrize("collapse", [False, True])
def test_usd_bodies_on_fixed_joints(collapse: bool, tmp_path: Path) -> None:
    """0.02 + 2·1·0.3² kg·m², also where the scene asks Newton to merge; the simulator loads the same."""
    path = usd_pair(tmp_path, collapse=collapse)
    robot = read_robot(path)
    (joint,) = robot.joints
    assert robot.bodies[robot.root].name == "trunk" and robot.bodies[robot.root].mass == pytest.approx(1.0)
    body = robot.bodies[joint.child]
    np.testing.assert_allclose(np.diag(body.inertia), [0.02, 0.2, 0.2], rtol=1e-6)
    _, model = convert_stage(Usd.Stage.Open(str(path)), ground=False)
    data, matrix = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, matrix)
    assert matrix[-1, -1] == pytest.approx(0.2 + 2.0 * 0.3**2, rel=1e-5)
