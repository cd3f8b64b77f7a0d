"""A robot of others as bodies, joints and shapes; URDF and USD as Newton's importers read them."""

from __future__ import annotations

import math
import warnings
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import newton
import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.run_dir import one_line
from mrwarp.runtime import silent

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

KINDS = {
    newton.JointType.REVOLUTE: "hinge",
    newton.JointType.PRISMATIC: "slide",
    newton.JointType.BALL: "ball",
    newton.JointType.FREE: "free",
}
"""Kinds of joints by the field's words; others keep Newton's."""


SCOPES = ("joints", "rails", "actuators", "legs", "materials")
"""Names in the written file that no body may have."""


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
    """What lies between two bodies."""

    name: str
    kind: str = "hinge"
    """``hinge``; others are read so that they can be named: ``slide``, ``ball`` and further ones."""
    parent: int
    child: int
    in_parent: RigidTransform
    """Joint frame in the parent's; the hinge turns about ``axis`` of it, a slide moves along it."""
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


@dataclass(frozen=True, kw_only=True)
class Coupling:
    """What ties bodies or joints together beside the tree."""

    text: str
    """Kind and names."""
    joints: tuple[str, ...] = ()
    """Joints that it ties; without them it ties nothing."""


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
    couplings: list[Coupling] = field(default_factory=list)
    """What makes it more than a tree."""
    notes: list[str] = field(default_factory=list)
    """What was left out."""

    @property
    def rails(self) -> list[str]:
        """Sliders between the ground and the first body that turns; nothing drives them."""
        found, ends = [], set() if self.floating else {self.root}
        for joint in self.joints:  # parents come first
            if joint.kind == "slide" and joint.parent in ends:
                found.append(joint.name)
                ends.add(joint.child)
        return found

    def poses(self, q: dict[str, float]) -> list[RigidTransform]:
        """Every body in the frame of the root, at joint angles [rad]; a joint that is not named is at 0.

        A body that no joint leads to is at the root.
        """
        found: dict[int, RigidTransform] = {self.root: RigidTransform.identity()}
        for joint in self.joints:  # parents come first
            moved = joint.axis * q.get(joint.name, 0.0)
            turn = (
                RigidTransform.from_translation(moved)
                if joint.kind == "slide"
                else RigidTransform.from_rotation(Rotation.from_rotvec(moved))
            )
            found[joint.child] = found[joint.parent] * joint.in_parent * turn * joint.in_child.inv()
        return [found.get(i, found[self.root]) for i in range(len(self.bodies))]

    def fixed(self, angles: Mapping[str, float]) -> ForeignRobot:
        """The robot with some joints held at angles [rad]: what they carried is part of the body before them."""
        bodies, joints, shapes = list(self.bodies), list(self.joints), list(self.shapes)
        for joint in [joint for joint in self.joints if joint.name in angles][::-1]:  # the outermost first
            turn = RigidTransform.from_rotation(Rotation.from_rotvec(joint.axis * angles[joint.name]))
            place = joint.in_parent * turn * joint.in_child.inv()
            bodies[joint.parent] = joined(bodies[joint.parent], bodies[joint.child], place)
            shapes = [
                replace(s, body=joint.parent, pose=place * s.pose) if s.body == joint.child else s for s in shapes
            ]
            joints = [
                replace(j, parent=joint.parent, in_parent=place * j.in_parent) if j.parent == joint.child else j
                for j in joints
                if j.name != joint.name
            ]
        left = [self.root, *(joint.child for joint in joints)]
        number = {body: k for k, body in enumerate(sorted(left))}
        return replace(
            self,
            root=number[self.root],
            bodies=[bodies[body] for body in number],
            joints=[replace(j, parent=number[j.parent], child=number[j.child]) for j in joints],
            shapes=[replace(s, body=number[s.body]) for s in shapes],
        )

    def check(self) -> None:
        """Refuse what cannot be simulated.

        Raises:
            RobotFileError: closed loops, joints other than hinges, or bodies without mass.
        """
        there = {joint.name for joint in self.joints}
        if tied := [c for c in self.couplings if set(c.joints) <= there]:
            more = f" (and {len(tied) - 1} more)" if tied[1:] else ""
            remedy = f"take it out there, or say --fix {tied[0].joints[0]}" if tied[0].joints else "open it there"
            raise RobotFileError(f"{self.path}: {tied[0].text}{more}; {remedy}: only trees of bodies are simulated")
        for joint in self.joints:
            if joint.kind != "hinge" and joint.name not in self.rails:
                raise RobotFileError(
                    f"{self.path}: joint {joint.name} is a {joint.kind} joint; only hinges, and rails that join the "
                    "ground, are simulated: weld it there"
                )
        for k, body in enumerate(self.bodies):
            if k == self.root and not self.floating:  # it stands still
                continue
            if not body.mass > 0.0 or not np.linalg.eigvalsh(body.inertia).min() > 0.0:
                raise RobotFileError(
                    f"{self.path}: body {body.name} has a mass of {body.mass:g} kg or no inertia; give it both there"
                )


def joined(parent: Body, child: Body, place: RigidTransform) -> Body:
    """Two bodies as one, the child at a place in the parent's frame: masses, moments and inertias added."""
    mass, turn = parent.mass + child.mass, place.rotation.as_matrix()
    if not mass > 0.0:
        return parent
    com = (parent.mass * parent.com + child.mass * place.apply(child.com)) / mass
    inertia = np.zeros((3, 3))
    for own, m, at in (
        (parent.inertia, parent.mass, parent.com),
        (turn @ child.inertia @ turn.T, child.mass, place.apply(child.com)),
    ):
        arm = at - com
        inertia += own + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return replace(parent, mass=mass, com=com, inertia=inertia)


def prim_names(labels: Sequence[str]) -> list[str]:
    """Names that USD takes, each once: other signs become underscores, what is then the same gets a number."""
    names: list[str] = []
    for label in labels:
        name = prim_pattern(label.strip("/")) or "unnamed"
        name = f"_{name}" if not name.isidentifier() or name in SCOPES else name
        count = 2
        base = name
        while name in names:
            name, count = f"{base}_{count}", count + 1
        names.append(name)
    return names


def prim_pattern(pattern: str) -> str:
    """A name, which may hold * and ?, as :func:`prim_names` writes it."""
    return "".join(c if c in "*?" or f"_{c}".isidentifier() else "_" for c in pattern)


def read_by_newton(path: Path, add: Callable[[newton.ModelBuilder], Any]) -> ForeignRobot:
    """Read a URDF or USD file.

    Args:
        path: The file.
        add: Puts its content into a builder.

    Raises:
        RobotFileError: it cannot be read, has no bodies or two trunks, or joins the world by a joint.
    """
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    try:
        with silent(), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            add(builder)
    except Exception as error:  # importers raise many types for a file that is no robot
        raise RobotFileError(f"{path}: Newton cannot read it ({one_line(error)}); correct it there") from None
    return _robot(path, builder)


def _robot(path: Path, builder: newton.ModelBuilder) -> ForeignRobot:
    """The builder's content."""
    if not builder.body_label:
        raise RobotFileError(f"{path}: there is no body that could move; is it a robot's file?")
    bodies = [
        Body(
            name=name,
            mass=float(builder.body_mass[i]),
            com=np.array(builder.body_com[i], dtype=float),
            inertia=np.array(builder.body_inertia[i], dtype=float).reshape(3, 3),
        )
        for i, name in enumerate(_names(builder.body_label))
    ]
    names, labels = _names(builder.joint_label), [label.rpartition("/")[2] for label in builder.joint_label]
    root, floating, joints, couplings = None, True, [], []
    for i, number in enumerate(builder.joint_type):
        kind = newton.JointType(number)
        parent, child = builder.joint_parent[i], builder.joint_child[i]
        if builder.joint_articulation[i] < 0 and number:
            ends = " and ".join(bodies[k].name if k >= 0 else "the world" for k in (parent, child))
            couplings.append(Coupling(text=f"joint {labels[i]} closes a loop between {ends}"))
        elif parent < 0:
            if root is not None:
                raise RobotFileError(f"{path}: {bodies[root].name} and {bodies[child].name} are two trunks; remove one")
            root, floating = child, kind == newton.JointType.FREE
            if kind in (newton.JointType.REVOLUTE, newton.JointType.PRISMATIC):
                root = len(bodies)
                bodies.append(Body(name="base", mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3))))
                joints.append(_joint(builder, i, root, child, names[i]))
            elif kind not in (newton.JointType.FREE, newton.JointType.FIXED):
                raise RobotFileError(
                    f"{path}: {labels[i]} joins the world by a {KINDS.get(kind, kind.name.lower())} joint; "
                    "only floating robots, arms with a hinge there and legs on a rail are imported"
                )
        else:
            joints.append(_joint(builder, i, parent, child, names[i]))
    if root is None:
        raise RobotFileError(f"{path}: no body is the root of the others; is it a robot's file?")
    shapes, notes = _shapes(builder)
    return ForeignRobot(
        path=path,
        name=prim_names([path.stem])[0],
        bodies=bodies,
        joints=joints,
        shapes=shapes,
        root=root,
        floating=floating,
        couplings=couplings,
        notes=notes,
    )


def _names(labels: Sequence[str]) -> list[str]:
    """Names from Newton's labels, which are paths: the last part, or as much as tells them apart."""
    short = [label.rstrip("/").rpartition("/")[2] for label in labels]
    often = Counter(short)
    return prim_names([name if often[name] == 1 else label for name, label in zip(short, labels, strict=True)])


def _joint(builder: newton.ModelBuilder, i: int, parent: int, child: int, name: str) -> Joint:
    kind = newton.JointType(builder.joint_type[i])
    dof = min(builder.joint_qd_start[i], len(builder.joint_axis) - 1)
    low, high = float(builder.joint_limit_lower[dof]), float(builder.joint_limit_upper[dof])
    effort, kp, kd = (
        float(values[dof]) for values in (builder.joint_effort_limit, builder.joint_target_ke, builder.joint_target_kd)
    )
    axis = np.array(builder.joint_axis[dof], dtype=float)
    return Joint(
        name=name,
        kind=KINDS.get(kind, kind.name.lower()),
        parent=parent,
        child=child,
        in_parent=_transform(builder.joint_X_p[i]),
        in_child=_transform(builder.joint_X_c[i]),
        axis=axis / max(float(np.linalg.norm(axis)), 1e-9),
        limits=(low, high) if low < high and high - low <= FREE_LIMIT else None,
        armature=float(builder.joint_armature[dof]),
        kp=kp or None,
        kd=kd or None,
        torque_limit=effort if 0.0 < effort < 1e5 else None,
    )


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
