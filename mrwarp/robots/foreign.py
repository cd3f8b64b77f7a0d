"""A robot's file (MJCF, URDF, USD), read by Newton's importers, as bodies, joints and shapes."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import mujoco
import newton
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.run_dir import no_file, one_line
from mrwarp.runtime import silent

SUFFIXES = {".xml": "MJCF", ".urdf": "URDF", ".usd": "USD", ".usda": "USD", ".usdc": "USD"}
"""What a file holds, by how its name ends."""

FREE_LIMIT = 20.0 * math.pi
"""A joint whose limits are further apart counts as one without limits [rad]."""

SHAPES = {
    newton.GeoType.SPHERE: "sphere",
    newton.GeoType.CAPSULE: "capsule",
    newton.GeoType.CYLINDER: "cylinder",
    newton.GeoType.BOX: "box",
    newton.GeoType.MESH: "mesh",
}
"""Kinds of shapes that are taken over."""


class RobotFileError(ValueError):
    """A robot's file cannot be used; the message names file, place, value and remedy."""


@dataclass(kw_only=True)
class Body:
    """A rigid body."""

    name: str
    mass: float
    """[kg]"""
    com: np.ndarray
    """Centre of mass in its frame [m], shape (3,)."""
    inertia: np.ndarray
    """Inertia about the centre of mass in its frame [kg·m²], shape (3, 3)."""


@dataclass(kw_only=True)
class Joint:
    """A hinge between two bodies."""

    name: str
    parent: int
    child: int
    in_parent: RigidTransform
    """Joint frame in the parent's; the hinge turns about ``axis`` of it."""
    in_child: RigidTransform
    """Joint frame in the child's."""
    axis: np.ndarray
    """Unit vector, shape (3,)."""
    limits: tuple[float, float] | None
    """Lowest and highest angle [rad]; None: the file gives none."""
    armature: float
    """Rotor inertia at the joint [kg·m²]."""
    kp: float | None = None
    """Gain of the file's actuator [N·m/rad]; None: it has none."""
    kd: float | None = None
    """Damping of actuator and joint [N·m·s/rad]; None: it has none."""
    torque_limit: float | None = None
    """Of the file's actuator [N·m]; None: it has none."""
    home: float | None = None
    """Angle in the file's keyframe [rad]; None: it has no keyframe."""


@dataclass(kw_only=True)
class Shape:
    """A shape on a body."""

    kind: str
    """One of :data:`SHAPES`."""
    body: int
    pose: RigidTransform
    """In the body's frame."""
    size: np.ndarray
    """[m], shape (3,): radius; radius and half length along z; half extents; factors of a mesh."""
    collides: bool
    friction: float
    points: np.ndarray | None = None
    """Corners of a mesh [m], shape (N, 3)."""
    faces: np.ndarray | None = None
    """Triangles of a mesh, shape (F, 3)."""


@dataclass(kw_only=True)
class ForeignRobot:
    """What a file says."""

    path: Path
    name: str
    bodies: list[Body]
    joints: list[Joint]
    shapes: list[Shape]
    root: int
    """The body that floats, or that stands on the ground."""
    floating: bool
    notes: list[str] = field(default_factory=list)
    """What was left out."""

    def poses(self, q: dict[str, float]) -> list[RigidTransform]:
        """Every body in the frame of the root, at joint angles [rad]; a joint that is not named is at 0."""
        found: dict[int, RigidTransform] = {self.root: RigidTransform.identity()}
        for joint in self.joints:  # parents come first
            turn = RigidTransform.from_rotation(Rotation.from_rotvec(joint.axis * q.get(joint.name, 0.0)))
            found[joint.child] = found[joint.parent] * joint.in_parent * turn * joint.in_child.inv()
        return [found[i] for i in range(len(self.bodies))]


def read_robot(path: Path) -> ForeignRobot:
    """Read a robot's file: MJCF (.xml), URDF or USD. A URDF floats, unless its root link is called world.

    Raises:
        RobotFileError: it cannot be read, has no bodies, closed loops, joints other than hinges, or bodies without
            mass.
    """
    if not path.is_file():
        raise RobotFileError(f"{path}: {no_file(path, 'file')}; name an MJCF (.xml), URDF or USD file")
    if path.suffix.lower() not in SUFFIXES:
        raise RobotFileError(f"{path}: {path.suffix or 'no ending'} is not {', '.join(SUFFIXES)}; rename or convert it")
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    spec = None
    try:
        with silent(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            match SUFFIXES[path.suffix.lower()]:
                case "URDF":
                    builder.default_shape_cfg.density = 0.0  # a link without inertial has no mass there
                    fixed = '<link name="world"' in path.read_text(encoding="utf-8", errors="replace")
                    builder.add_urdf(str(path), floating=not fixed, collapse_fixed_joints=True)
                case "MJCF":
                    spec = mujoco.MjSpec.from_file(str(path))
                    builder.add_mjcf(str(path), collapse_fixed_joints=True)
                case _:
                    builder.add_usd(str(path), collapse_fixed_joints=True)
    except Exception as error:  # importers raise many types for a file that is no robot
        raise RobotFileError(f"{path}: Newton cannot read it ({one_line(error)}); correct it there") from None
    return _robot(path, builder, spec)


def _robot(path: Path, builder: newton.ModelBuilder, spec: mujoco.MjSpec | None) -> ForeignRobot:
    """The builder's content, checked."""
    if not builder.body_label:
        raise RobotFileError(f"{path}: there is no body that could move; is it a robot's file?")
    if closed := [i for i, kind in enumerate(builder.joint_type) if builder.joint_articulation[i] < 0 and kind]:
        names = ", ".join(_short(builder.joint_label[i]) for i in closed[:4])
        raise RobotFileError(f"{path}: {names} closes a loop of bodies; open it there: only trees are simulated")
    if count := len(spec.equalities) if spec else 0:
        raise RobotFileError(f"{path}: {count} equality constraints close loops of bodies; only trees are simulated")
    bodies = [_body(path, builder, i) for i in range(len(builder.body_label))]
    root, floating, joints = None, True, []
    for i, number in enumerate(builder.joint_type):
        kind = newton.JointType(number)
        parent, child, name = builder.joint_parent[i], builder.joint_child[i], _short(builder.joint_label[i])
        if parent < 0:
            if root is not None:
                raise RobotFileError(f"{path}: {bodies[root].name} and {bodies[child].name} are two trunks; remove one")
            root, floating = child, kind == newton.JointType.FREE
            if kind not in (newton.JointType.FREE, newton.JointType.FIXED):
                raise RobotFileError(
                    f"{path}: {name} joins the world by a {kind.name.lower()} joint; only floating robots are imported"
                )
        elif kind != newton.JointType.REVOLUTE:
            raise RobotFileError(f"{path}: joint {name} is a {kind.name.lower()} joint; only hinges are simulated")
        else:
            joints.append(_joint(builder, i, parent, child, name))
    if root is None:
        raise RobotFileError(f"{path}: no body is the root of the others; is it a robot's file?")
    if spec is not None:
        _actuators(spec, joints)
    shapes, notes = _shapes(builder)
    name = re.sub(r"\W", "_", path.stem)
    return ForeignRobot(
        path=path, name=name, bodies=bodies, joints=joints, shapes=shapes, root=root, floating=floating, notes=notes
    )


def _body(path: Path, builder: newton.ModelBuilder, i: int) -> Body:
    name, mass = _short(builder.body_label[i]), float(builder.body_mass[i])
    inertia = np.array(builder.body_inertia[i], dtype=float).reshape(3, 3)
    if not mass > 0.0 or not np.linalg.eigvalsh(inertia).min() > 0.0:
        raise RobotFileError(f"{path}: body {name} has a mass of {mass:g} kg or no inertia; give it both there")
    return Body(name=name, mass=mass, com=np.array(builder.body_com[i], dtype=float), inertia=inertia)


def _joint(builder: newton.ModelBuilder, i: int, parent: int, child: int, name: str) -> Joint:
    dof = builder.joint_qd_start[i]
    low, high = float(builder.joint_limit_lower[dof]), float(builder.joint_limit_upper[dof])
    effort, kp, kd = (
        float(values[dof]) for values in (builder.joint_effort_limit, builder.joint_target_ke, builder.joint_target_kd)
    )
    axis = np.array(builder.joint_axis[dof], dtype=float)
    return Joint(
        name=name,
        parent=parent,
        child=child,
        in_parent=_transform(builder.joint_X_p[i]),
        in_child=_transform(builder.joint_X_c[i]),
        axis=axis / np.linalg.norm(axis),
        limits=(low, high) if low < high and high - low <= FREE_LIMIT else None,
        armature=float(builder.joint_armature[dof]),
        kp=kp or None,
        kd=kd or None,
        torque_limit=effort if 0.0 < effort < 1e5 else None,
    )


def _actuators(spec: mujoco.MjSpec, joints: list[Joint]) -> None:
    """Take gains, torque limits and the first keyframe from an MJCF, which the importer leaves out in part."""
    model = spec.compile()
    by_name = {joint.name: joint for joint in joints}
    for k in range(model.nu):
        if model.actuator_trntype[k] != mujoco.mjtTrn.mjTRN_JOINT:
            continue
        joint = by_name.get(model.joint(model.actuator_trnid[k, 0]).name)
        if joint is None:
            continue
        gear, bias = abs(float(model.actuator_gear[k, 0])), model.actuator_biasprm[k]
        position = model.actuator_biastype[k] == mujoco.mjtBias.mjBIAS_AFFINE and bias[1] < 0.0
        if position:
            joint.kp, joint.kd = float(-bias[1]) * gear, float(-bias[2]) * gear or joint.kd
        if model.actuator_forcelimited[k]:
            joint.torque_limit = float(model.actuator_forcerange[k, 1]) * gear
        elif model.actuator_ctrllimited[k] and not position:
            joint.torque_limit = float(model.actuator_ctrlrange[k, 1] * model.actuator_gainprm[k, 0]) * gear
    for k in range(model.njnt):
        if (joint := by_name.get(model.joint(k).name)) is None:
            continue
        dof, address = model.jnt_dofadr[k], model.jnt_qposadr[k]
        joint.kd = (joint.kd or 0.0) + float(model.dof_damping[dof]) or None
        if joint.torque_limit is None and model.jnt_actfrclimited[k]:
            joint.torque_limit = float(model.jnt_actfrcrange[k, 1])
        if model.nkey:
            joint.home = float(model.key_qpos[0, address])


def _shapes(builder: newton.ModelBuilder) -> tuple[list[Shape], list[str]]:
    shapes, left_out = [], 0
    for i, number in enumerate(builder.shape_type):
        kind = newton.GeoType(number)
        flags = int(builder.shape_flags[i])
        collides, visible = bool(flags & newton.ShapeFlags.COLLIDE_SHAPES), bool(flags & newton.ShapeFlags.VISIBLE)
        if builder.shape_body[i] < 0 or not (collides or visible):
            continue
        if kind not in SHAPES:
            left_out += 1
            continue
        mesh: Any = builder.shape_source[i] if SHAPES[kind] == "mesh" else None
        shapes.append(
            Shape(
                kind=SHAPES[kind],
                body=builder.shape_body[i],
                pose=_transform(builder.shape_transform[i]),
                size=np.array(builder.shape_scale[i], dtype=float),
                collides=collides,
                friction=float(builder.shape_material_mu[i]),
                points=None if mesh is None else np.array(mesh.vertices, dtype=float) * builder.shape_scale[i],
                faces=None if mesh is None else np.array(mesh.indices).reshape(-1, 3),
            )
        )
    return shapes, [f"{left_out} shapes of other kinds were left out"] if left_out else []


def _transform(value: Any) -> RigidTransform:
    """A Warp transform: position, then quaternion with the real part last."""
    numbers = np.array(value, dtype=float)
    return RigidTransform.from_components(numbers[:3], Rotation.from_quat(numbers[3:]))


def _short(label: str) -> str:
    """A name that USD takes: the label's last part, other signs as underscores."""
    name = re.sub(r"\W", "_", label.rstrip("/").rpartition("/")[2])
    return f"_{name}" if name[:1].isdigit() else name
