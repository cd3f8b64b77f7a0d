"""A robot of others as bodies, joints and shapes, from any kind of file."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.robots.guesses import Guess

FREE_LIMIT = 20.0 * math.pi
"""Limits with a wider range are none of a joint: they are in degrees, or stand for no limits [rad]."""

NO_LIMITS = 1440.0
"""Limits with a wider range stand for no limits, as 1e10 does: two turns each way, were they in degrees."""

BASES = ("fixed", "free")
"""Whether a robot's root stands still or floats."""

SHAPES = ("sphere", "capsule", "cylinder", "box", "mesh")
"""Kinds of shapes that are taken over."""

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
    """Joint between two bodies."""

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
    """Angle in the file's first keyframe [rad]; None: it has no keyframe."""

    def place(self, q: float) -> RigidTransform:
        """The child in the parent's frame, at an angle [rad] or, of a slide, a way [m]."""
        moved = self.axis * q
        turn = (
            RigidTransform.from_translation(moved)
            if self.kind == "slide"
            else RigidTransform.from_rotation(Rotation.from_rotvec(moved))
        )
        return self.in_parent * turn * self.in_child.inv()

    @cached_property
    def _parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Shape (4, 4): the first, the second times sin(q) or the way, and the third times cos(q) make the matrix."""
        if self.kind == "slide":
            zero, one = (self.place(q).as_matrix() for q in (0.0, 1.0))
            return zero, one - zero, np.zeros((4, 4))
        zero, quarter, half = (self.place(q).as_matrix() for q in (0.0, 0.5 * math.pi, math.pi))
        middle = 0.5 * (zero + half)
        return middle, quarter - middle, 0.5 * (zero - half)

    def matrix(self, q: float) -> np.ndarray:
        """:meth:`place` as a homogeneous matrix, shape (4, 4), quickly where it is asked for many angles."""
        fixed, first, second = self._parts
        return fixed + q * first if self.kind == "slide" else fixed + math.sin(q) * first + math.cos(q) * second


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
    """Tie of bodies or joints in addition to the tree."""

    text: str
    """Kind and names."""
    joints: tuple[str, ...] = ()
    """Joints that it ties, or between the bodies that it ties."""
    loop: bool = False
    """Whether it ties bodies, as long as one of the joints moves; else joints, as long as all do."""

    def ties(self, there: Collection[str]) -> bool:
        """Whether it ties anything where only the joints ``there`` move."""
        held = [joint for joint in self.joints if joint not in there]
        return len(held) < len(self.joints) if self.loop and self.joints else not held

    @property
    def remedy(self) -> str:
        """Remedy for the user."""
        if not self.joints:
            return "open it there"
        if self.loop:
            return f"open it there, or hold its joints: --fix {' '.join(self.joints)}"
        return f"take it out there, or say --fix {self.joints[0]}"


@dataclass(frozen=True, kw_only=True)
class Keyframe:
    """A pose of the file, in which the robot need not stand."""

    name: str
    angles: Mapping[str, float]
    """[rad], by joint."""
    lean: float
    """How far the root leans from upright [rad]."""


@dataclass(kw_only=True)
class ForeignRobot:
    """Content of a file."""

    path: Path
    name: str
    bodies: list[Body]
    joints: list[Joint]
    shapes: list[Shape]
    root: int
    """The body that floats, or that stands on the ground."""
    floating: bool
    base_said: str
    """Who says whether the root floats: ``file``, ``user``, or nobody, which is an empty text."""
    couplings: list[Coupling] = field(default_factory=list)
    """Ties that make it more than a tree."""
    keyframes: list[Keyframe] = field(default_factory=list)
    """Poses of the file, first the one that is called a stance."""
    notes: list[Guess] = field(default_factory=list)
    """Parts left out."""
    held: dict[str, float] = field(default_factory=dict)
    """Angles of joints that are no joints any more [rad]."""
    replaced: dict[str, np.ndarray] = field(default_factory=dict)
    """Changes of inertias of bodies that no body has [kg·m²], shape (3, 3), in the file's frames."""
    forward: float = 0.0
    """How far the axis that was taken as forwards is turned about z from the file's x [rad]."""
    skip_meshes: bool = False
    """Whether it was read without its meshes."""

    @property
    def rails(self) -> list[str]:
        """Sliders between the ground and the first body that turns; nothing drives them."""
        found, ends = [], set() if self.floating else {self.root}
        for joint in self.joints:  # parents come first
            if joint.kind == "slide" and joint.parent in ends:
                found.append(joint.name)
                ends.add(joint.child)
        return found

    def matrices(self, q: Mapping[str, float], joints: Sequence[Joint] | None = None) -> dict[int, np.ndarray]:
        """:meth:`poses` of the root and of the bodies that joints lead to, as homogeneous matrices, shape (4, 4)."""
        found = {self.root: np.eye(4)}
        for joint in self.joints if joints is None else joints:  # parents come first
            found[joint.child] = found[joint.parent] @ joint.matrix(q.get(joint.name, 0.0))
        return found

    def poses(self, q: Mapping[str, float], joints: Sequence[Joint] | None = None) -> list[RigidTransform]:
        """Every body in the frame of the root, at joint angles [rad]; a joint that is not named is at 0.

        Bodies that no joint leads to, or none of ``joints`` where they are given, are at the root.
        """
        found = {body: RigidTransform.from_matrix(matrix) for body, matrix in self.matrices(q, joints).items()}
        return [found.get(i, found[self.root]) for i in range(len(self.bodies))]

    def carried(self, joint: Joint) -> set[int]:
        """Bodies that a joint carries."""
        found = {joint.child}
        for other in self.joints:  # parents come first
            if other.parent in found:
                found.add(other.child)
        return found

    def fixed(self, angles: Mapping[str, float]) -> ForeignRobot:
        """The robot with some joints held at angles [rad]: what they carried is part of the body before them."""
        bodies, joints, shapes = list(self.bodies), list(self.joints), list(self.shapes)
        for joint in [joint for joint in self.joints if joint.name in angles][::-1]:  # the outermost first
            place = joint.place(angles[joint.name])
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
            held=self.held | dict(angles),
            bodies=[bodies[body] for body in number],
            joints=[replace(j, parent=number[j.parent], child=number[j.child]) for j in joints],
            shapes=[replace(s, body=number[s.body]) for s in shapes],
        )

    def turned(self, turn: Rotation) -> ForeignRobot:
        """The robot with the root's axes turned: what lay along ``turn``'s x is forwards, along its z up."""
        back = RigidTransform.from_rotation(turn.inv())
        root = self.bodies[self.root]
        matrix = back.rotation.as_matrix()
        root = replace(root, com=matrix @ root.com, inertia=matrix @ root.inertia @ matrix.T)
        return replace(
            self,
            bodies=[root if k == self.root else body for k, body in enumerate(self.bodies)],
            joints=[replace(j, in_parent=back * j.in_parent) if j.parent == self.root else j for j in self.joints],
            shapes=[replace(s, pose=back * s.pose) if s.body == self.root else s for s in self.shapes],
        )

    def upright(self, placed: Rotation) -> ForeignRobot:
        """The robot with the world's axes for the root's, where the file places the root with its z not upwards."""
        return self if placed.as_matrix()[2, 2] > 1.0 - 1e-6 else self.turned(placed.inv())

    def check(self) -> None:
        """Refuse what cannot be simulated.

        Raises:
            RobotFileError: closed loops, joints other than hinges, or bodies without mass.
        """
        self._check_numbers()
        there = {joint.name for joint in self.joints}
        if tied := [coupling for coupling in self.couplings if coupling.ties(there)]:
            more = f" (and {len(tied) - 1} more)" if tied[1:] else ""
            raise RobotFileError(
                f"{self.path}: {tied[0].text}{more}; {tied[0].remedy}: only trees of bodies are simulated"
            )
        for joint in self.joints:
            if joint.kind != "hinge" and joint.name not in self.rails:
                raise RobotFileError(
                    f"{self.path}: joint {joint.name} is a {joint.kind} joint; only hinges, and rails that join the "
                    f"ground, are simulated: say --fix {joint.name}, or weld it there"
                )
        for k, body in enumerate(self.bodies):
            if k == self.root and not self.floating:  # it stands still
                continue
            moments = np.linalg.eigvalsh(body.inertia)
            three = ", ".join(f"{moment:.3g}" for moment in moments)
            if not body.mass > 0.0:
                raise RobotFileError(
                    f"{self.path}: body {body.name} has a mass of {body.mass:g} kg; give it a mass and an inertia there"
                )
            if not moments[0] > 0.0:
                raise RobotFileError(
                    f"{self.path}: body {body.name} of {body.mass:g} kg has the inertias {three} kg·m²; give it three "
                    "positive ones there"
                )
            if moments[2] > (1.0 + 1e-4) * (moments[0] + moments[1]):
                raise RobotFileError(
                    f"{self.path}: body {body.name} has the inertias {three} kg·m², which no body has; give it three "
                    "there of which none is larger than the sum of the others"
                )

    def _check_numbers(self) -> None:
        """Refuse masses, places and axes that are no numbers."""
        for body in self.bodies:
            if not np.isfinite([body.mass, *body.com, *body.inertia.ravel()]).all():
                raise RobotFileError(
                    f"{self.path}: body {body.name} has a mass, centre of mass or inertia that is no number; "
                    "correct it there"
                )
        for joint in self.joints:
            place = (*joint.in_parent.translation, *joint.in_child.translation, *joint.axis)
            if not np.isfinite(place).all() or not np.linalg.norm(joint.axis) > 0.5:
                raise RobotFileError(f"{self.path}: joint {joint.name} has no place or no axis; correct it there")


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
