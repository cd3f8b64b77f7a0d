"""A robot of others written as an asset: one USD file that every command takes and that can be edited by hand."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade, Vt
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.env.asset_trial import convert
from mrwarp.robots.foreign import Body, Joint, Shape
from mrwarp.robots.legs import Foot, UnderstoodRobot
from mrwarp.robots.second.compared import checked
from mrwarp.usd.asset import RobotAsset, load_robot
from mrwarp.usd.open_stage import AssetError
from mrwarp.usd.robot_layout import NO_LIMIT, WEIGHTLESS, add_note, write_layout

FRICTION_OF_CONSTRAINTS = {"mjc:solimpfriction": (0.9999, 0.9999, 0.001, 0.5, 2.0), "mjc:solreffriction": (0.01, 1.0)}
"""How stiff MuJoCo's dry friction is, which carries the brake of an MR device; see ``assets/usd/mr_go.usda``."""

ROUNDING = 1e-6
"""Share of a body's largest moment by which the other two exceed it together at least: flat bodies have none left, and
the 7 digits of the written numbers would take it below."""

TYPES = Sdf.ValueTypeNames


def write_checked(understood: UnderstoodRobot, path: Path, *, source: str) -> RobotAsset:
    """Write the asset once it can be loaded, converted and stood on its feet.

    Args:
        understood: The robot.
        path: File to write, .usda or .usdc; its folder exists.
        source: Where the robot comes from, for the file's documentation.

    Raises:
        AssetError: the robot cannot stand.
        RobotFileError: a second reading of its file says something else.
    """
    robot, layout = understood.robot, understood.layout
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    stage.GetRootLayer().documentation = (
        f"{robot.name}, imported from {source}.\n\nUnits: metres, kilograms, Z up. Joint limits and neutral angles in "
        "degrees, gains in radians.\nLegs, feet and gait stand in the scope 'legs', the neutral stance at the joints."
    )
    base = f"/{robot.name}"
    root = UsdGeom.Xform.Define(stage, base).GetPrim()
    stage.SetDefaultPrim(root)
    _apply(root, "PhysicsArticulationRootAPI", "NewtonArticulationRootAPI")
    _set(root, "newton:selfCollisionEnabled", TYPES.Bool, False)
    _place(root, RigidTransform.from_translation([0.0, 0.0, round(understood.height, 4)]))
    for leg, foot in zip(layout.legs, understood.feet, strict=True):
        _material(stage, f"{base}/materials/foot_{leg.name}", foot.friction)
    poses = robot.poses({})
    feet = {foot.body: (leg, foot) for leg, foot in zip(layout.legs, understood.feet, strict=True)}
    for k, body in enumerate(robot.bodies):
        weightless = k == robot.root and not robot.floating and not _is_solid(body)
        if weightless:  # it stands still: any mass does
            body = replace(body, mass=1.0, inertia=0.01 * np.eye(3))
        prim = UsdGeom.Xform.Define(stage, f"{base}/{body.name}").GetPrim()
        _apply(prim, "PhysicsRigidBodyAPI", "PhysicsMassAPI")
        _place(prim, poses[k])
        moments, axes = np.linalg.eigh(body.inertia)
        moments[:2] += 0.5 * max(0.0, (1.0 + ROUNDING) * moments[2] - moments[0] - moments[1])
        turn = Rotation.from_matrix(axes * np.sign(np.linalg.det(axes)))
        _set(prim, "physics:mass", TYPES.Float, body.mass)
        if weightless:
            _set(prim, WEIGHTLESS, TYPES.Bool, True)
        _set(prim, "physics:centerOfMass", TYPES.Point3f, Gf.Vec3f(*map(float, body.com)))
        _set(prim, "physics:diagonalInertia", TYPES.Float3, Gf.Vec3f(*map(float, moments)))
        _set(prim, "physics:principalAxes", TYPES.Quatf, Gf.Quatf(_quat(turn)))
        own = [shape for shape in robot.shapes if shape.body == k]
        leg, foot = feet.get(k, (None, None))
        for number, shape in enumerate(shape for shape in own if foot is None or shape is not foot.shape):
            _shape(stage, f"{base}/{body.name}/{body.name}_shape_{number}", shape)
        if leg is not None and foot is not None:
            _foot(stage, f"{base}/{body.name}/{leg.foot}", foot, f"{base}/materials/foot_{leg.name}")
    if not robot.floating:
        anchor = UsdPhysics.FixedJoint.Define(stage, f"{base}/anchor").GetPrim()
        anchor.CreateRelationship("physics:body1", False).SetTargets([f"{base}/{robot.bodies[robot.root].name}"])
    UsdGeom.Scope.Define(stage, f"{base}/joints")
    UsdGeom.Scope.Define(stage, f"{base}/actuators")
    for joint in [joint for joint in robot.joints if joint.name in robot.rails]:
        _joint(stage, f"{base}/rails", base, joint, robot.bodies[joint.parent].name, robot.bodies[joint.child].name)
    by_name = {joint.name: joint for joint in robot.joints}
    for name, drive in understood.drives.items():
        joint = by_name[name]
        _joint(stage, f"{base}/joints", base, joint, robot.bodies[joint.parent].name, robot.bodies[joint.child].name)
        motor = stage.DefinePrim(f"{base}/actuators/{name}", "NewtonActuator")
        _apply(motor, "NewtonPDControlAPI", "NewtonMaxEffortClampingAPI")
        motor.CreateRelationship("newton:targets", False).SetTargets([f"{base}/joints/{name}"])
        for attribute, value in (("kp", drive.kp), ("kd", drive.kd), ("maxEffort", drive.torque_limit)):
            _set(motor, f"newton:{attribute}", TYPES.Float, value)
    write_layout(stage, layout, understood.notes)
    return save_checked(stage.GetRootLayer(), path, lambda model: checked(understood, model).line)


def _is_solid(body: Body) -> bool:
    """Whether a body has a mass, and an inertia that a body can have."""
    moments = np.linalg.eigvalsh(body.inertia)
    return body.mass > 0.0 and 0.0 < moments[0] and moments[2] <= moments[0] + moments[1]


def save_checked(layer: Sdf.Layer, path: Path, check: Callable[[mujoco.MjModel], str] | None = None) -> RobotAsset:
    """Write a layer next to its file, try it out, and only then let it take the file's place.

    Args:
        layer: The layer.
        path: Its file.
        check: Refuses the robot as it is simulated, or returns a note on it.
    """
    copy = path.with_name(f".{path.stem}-new{path.suffix}")
    try:
        layer.Export(str(copy))
        try:
            model = convert(load_robot(robot=str(copy)))
        except (AssetError, ValueError) as error:
            raise AssetError(str(error).replace(str(copy), str(path))) from None
        if check is not None:
            add_note(Usd.Stage.Open(layer), check(model))
            layer.Export(str(copy))
        os.replace(copy, path)
    finally:
        copy.unlink(missing_ok=True)
    return load_robot(robot=str(path))


def _joint(stage: Usd.Stage, scope: str, base: str, joint: Joint, parent: str, child: str) -> None:
    slides = joint.kind == "slide"
    schema = UsdPhysics.PrismaticJoint if slides else UsdPhysics.RevoluteJoint
    prim = schema.Define(stage, f"{scope}/{joint.name}").GetPrim()
    _apply(prim, "NewtonJointAPI")
    prim.CreateRelationship("physics:body0", False).SetTargets([f"{base}/{parent}"])
    prim.CreateRelationship("physics:body1", False).SetTargets([f"{base}/{child}"])
    axis, turn = _axis(joint.axis)
    _set(prim, "physics:axis", TYPES.Token, axis)
    for end, frame in (("0", joint.in_parent), ("1", joint.in_child)):
        _set(prim, f"physics:localPos{end}", TYPES.Point3f, Gf.Vec3f(*map(float, frame.translation)))
        _set(prim, f"physics:localRot{end}", TYPES.Quatf, Gf.Quatf(_quat(frame.rotation * turn)))
    low, high = joint.limits or (math.radians(-NO_LIMIT), math.radians(NO_LIMIT))
    _set(prim, "physics:lowerLimit", TYPES.Float, low if slides else math.degrees(low))
    _set(prim, "physics:upperLimit", TYPES.Float, high if slides else math.degrees(high))
    for name, value in (("armature", joint.armature), ("damping", 0.0), ("friction", 0.0)):
        _set(prim, f"newton:{name}", TYPES.Float, value)
    _set(prim, "mjc:solreflimit", TYPES.DoubleArray, Vt.DoubleArray([0.02, 1.0]))
    for name, values in FRICTION_OF_CONSTRAINTS.items():
        _set(prim, name, TYPES.DoubleArray, Vt.DoubleArray(list(values)))


def _axis(axis: np.ndarray) -> tuple[str, Rotation]:
    """USD's axis, and the turn of the joint frame that puts it there."""
    for k, name in enumerate("XYZ"):
        if axis[k] > 1.0 - 1e-6:
            return name, Rotation.identity()
    return "X", Rotation.align_vectors([axis], [[1.0, 0.0, 0.0]])[0]


def _shape(stage: Usd.Stage, path: str, shape: Shape) -> None:
    kinds = {"sphere": "Sphere", "capsule": "Capsule", "cylinder": "Cylinder", "box": "Cube", "mesh": "Mesh"}
    prim = stage.DefinePrim(path, kinds[shape.kind])
    size = [float(x) for x in shape.size]
    _place(prim, shape.pose, size if shape.kind == "box" else None)
    if shape.kind == "box":
        _set(prim, "size", TYPES.Double, 2.0)
    elif shape.kind == "mesh":
        assert shape.points is not None and shape.faces is not None
        mesh = UsdGeom.Mesh(prim)
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(shape.points.astype(np.float32)))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(shape.faces), 3, dtype=np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(shape.faces.astype(np.int32).ravel()))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    else:
        _set(prim, "radius", TYPES.Double, size[0])
        if shape.kind != "sphere":
            _set(prim, "axis", TYPES.Token, "Z")
            _set(prim, "height", TYPES.Double, 2.0 * size[1])
    if shape.collides and shape.kind != "mesh":
        _apply(prim, "PhysicsCollisionAPI", "NewtonCollisionAPI")
        _set(prim, "newton:contactGap", TYPES.Float, 0.0)


def _foot(stage: Usd.Stage, path: str, foot: Foot, material: str) -> None:
    prim = stage.DefinePrim(path, "Sphere")
    _place(prim, RigidTransform.from_translation(foot.centre))
    _set(prim, "radius", TYPES.Double, foot.radius)
    _apply(prim, "PhysicsCollisionAPI", "NewtonCollisionAPI", "MaterialBindingAPI")
    _set(prim, "newton:contactGap", TYPES.Float, 0.0)
    _set(prim, "mjc:priority", TYPES.Int, 1)  # its friction holds against any ground
    prim.CreateRelationship("material:binding:physics", False).SetTargets([material])


def _material(stage: Usd.Stage, path: str, friction: float) -> None:
    prim = UsdShade.Material.Define(stage, path).GetPrim()
    _apply(prim, "PhysicsMaterialAPI", "NewtonMaterialAPI")
    for name in ("staticFriction", "dynamicFriction"):
        _set(prim, f"physics:{name}", TYPES.Float, friction)
    _set(prim, "physics:restitution", TYPES.Float, 0.0)


def _place(prim: Usd.Prim, pose: RigidTransform, scale: list[float] | None = None) -> None:
    """Give a prim its pose, and a box its half extents."""
    xform = UsdGeom.Xformable(prim)
    xform.AddTranslateOp().Set(Gf.Vec3d(*map(float, pose.translation)))
    if pose.rotation.magnitude() > 1e-9:
        xform.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(_quat(pose.rotation))
    if scale is not None:
        xform.AddScaleOp().Set(Gf.Vec3f(*scale))


def _quat(rotation: Rotation) -> Gf.Quatd:
    x, y, z, w = (float(v) for v in rotation.as_quat(canonical=True))
    return Gf.Quatd(w, x, y, z)


def _apply(prim: Usd.Prim, *schemas: str) -> None:
    for schema in schemas:
        prim.AddAppliedSchema(schema)


def _set(prim: Usd.Prim, name: str, kind: Sdf.ValueTypeName, value: Any) -> None:
    prim.CreateAttribute(name, kind, custom=False).Set(value)
