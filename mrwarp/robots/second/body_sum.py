"""A tree of bodies from URDF or USD text alone, and its mass matrix and weight as sums over all bodies.

Nothing of it is the importers': each link keeps its own mass, joints that are fixed stay joints. It reads what MuJoCo's
compiler refuses.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from pxr import Usd, UsdGeom, UsdPhysics
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.paper import GRAVITY

GROUND = "world"
"""The link of a URDF that stands still, by convention."""


@dataclass(kw_only=True)
class Link:
    """A body with mass [kg], centre of mass [m] and inertia about it [kg·m²], in its frame."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray


@dataclass(kw_only=True)
class Tie:
    """A joint: hinge, slide or fixed, from a parent's frame to a child's."""

    name: str
    kind: str
    parent: str
    child: str
    before: RigidTransform
    after: RigidTransform
    """The child in the frame that turns."""
    axis: np.ndarray
    limits: tuple[float, float] | None = None
    torque: float | None = None
    """Limit of its motor [N·m]."""

    def place(self, q: float) -> RigidTransform:
        """The child in the parent's frame."""
        if self.kind == "fixed":
            return self.before * self.after
        way = self.axis * q
        moved = (
            RigidTransform.from_translation(way)
            if self.kind == "slide"
            else RigidTransform.from_rotation(Rotation.from_rotvec(way))
        )
        return self.before * moved * self.after

    def reversed(self) -> Tie:
        """Seen from the child."""
        swapped = {"parent": self.child, "child": self.parent, "before": self.after.inv(), "after": self.before.inv()}
        return Tie(**{**vars(self), **swapped, "axis": -self.axis})


@dataclass(kw_only=True)
class Tree:
    """Links on ties, from the root on."""

    links: dict[str, Link]
    ties: list[Tie]
    root: str
    placed: Rotation = field(default_factory=Rotation.identity)
    """The root in the world."""

    def __post_init__(self) -> None:
        """Sort the ties from the root on; those that lead away from it are turned round."""
        left, reached, found = list(self.ties), {self.root}, []
        while True:
            near = [tie for tie in left if (tie.parent in reached) != (tie.child in reached)]
            if not near:
                break
            tie = near[0]
            left.remove(tie)
            found.append(tie if tie.parent in reached else tie.reversed())
            reached.add(found[-1].child)
        self.ties = found

    def dynamics(self, q: Mapping[str, float], floating: bool, turn: Rotation) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix and weight, in the world's axes, with the root at the origin.

        Args:
            q: Angles [rad] and ways [m].
            floating: Whether six rows of the root come first: its velocity [m/s], then its rate [rad/s].
            turn: The root in the world.

        Returns:
            Shape (N, N), shape (N,).
        """
        moving = [tie for tie in self.ties if tie.kind != "fixed"]
        places = {self.root: RigidTransform.from_rotation(turn)}
        frames: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        above: dict[str, list[int]] = {self.root: []}
        for tie in self.ties:
            frame = places[tie.parent] * tie.before
            places[tie.child] = places[tie.parent] * tie.place(q.get(tie.name, 0.0))
            above[tie.child] = list(above[tie.parent])
            if tie.kind != "fixed":
                above[tie.child].append(moving.index(tie))
                frames[tie.name] = frame.rotation.apply(tie.axis), frame.translation
        first = 6 if floating else 0
        size = first + len(moving)
        matrix, weight = np.zeros((size, size)), np.zeros(size)
        for name, place in places.items():
            link = self.links.get(name)
            if link is None:
                continue
            com, linear, angular = place.apply(link.com), np.zeros((3, size)), np.zeros((3, size))
            if floating:
                linear[:, :3] = angular[:, 3:6] = np.eye(3)
                linear[:, 3:6] = np.array([np.cross(axis, com) for axis in np.eye(3)]).T
            for k in above[name]:
                axis, point = frames[moving[k].name]
                slides = moving[k].kind == "slide"
                linear[:, first + k] = axis if slides else np.cross(axis, com - point)
                angular[:, first + k] = 0.0 if slides else axis
            own = place.rotation.as_matrix()
            matrix += link.mass * linear.T @ linear + angular.T @ own @ link.inertia @ own.T @ angular
            weight += GRAVITY * link.mass * linear[2]
        return matrix, weight


def urdf_tree(root: ET.Element) -> Tree:
    """A URDF whose names and numbers were checked."""
    links = {}
    for element in root.iterfind("link"):
        inertial = element.find("inertial")
        if inertial is None:
            links[element.get("name", "")] = Link(mass=0.0, com=np.zeros(3), inertia=np.zeros((3, 3)))
            continue
        mass, own = inertial.find("mass"), inertial.find("inertia")
        read = {} if own is None else own.attrib
        a, b, c, d, e, f = (float(read.get(name, 0.0)) for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"))
        place = _origin(inertial)
        turn = place.rotation.as_matrix()
        links[element.get("name", "")] = Link(
            mass=0.0 if mass is None else float(mass.get("value", 0.0)),
            com=place.translation,
            inertia=turn @ np.array([[a, d, e], [d, b, f], [e, f, c]]) @ turn.T,
        )
    ties = [_urdf_tie(joint) for joint in root.iterfind("joint")]
    tops = {tie.parent for tie in ties} | set(links)
    (top,) = tops - {tie.child for tie in ties}
    on_top = [tie for tie in ties if tie.parent == top]
    if top == GROUND and len(on_top) == 1 and on_top[0].kind == "fixed":  # also where it floats: no part of the robot
        ties.remove(on_top[0])
        return Tree(links=links, ties=ties, root=on_top[0].child, placed=on_top[0].before.rotation)
    return Tree(links=links, ties=ties, root=top)


def _urdf_tie(joint: ET.Element) -> Tie:
    kind = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide"}.get(joint.get("type", ""), "fixed")
    axis, limit = joint.find("axis"), joint.find("limit")
    vector = np.array([float(x) for x in ("1 0 0" if axis is None else axis.get("xyz", "1 0 0")).split()])
    read = {} if limit is None else limit.attrib
    turns = joint.get("type") == "continuous" or limit is None
    return Tie(
        name=joint.get("name", ""),
        kind=kind,
        parent=joint.find("parent").get("link", ""),  # type: ignore[union-attr]
        child=joint.find("child").get("link", ""),  # type: ignore[union-attr]
        before=_origin(joint),
        after=RigidTransform.identity(),
        axis=vector / max(float(np.linalg.norm(vector)), 1e-12),
        limits=None if turns else (float(read.get("lower", 0.0)), float(read.get("upper", 0.0))),
        torque=float(read["effort"]) if "effort" in read else None,
    )


def _origin(element: ET.Element) -> RigidTransform:
    """Of a link's inertial or of a joint: roll, pitch and yaw about fixed axes."""
    origin = element.find("origin")
    read = {} if origin is None else origin.attrib
    xyz, rpy = ([float(x) for x in read.get(name, "0 0 0").split()] for name in ("xyz", "rpy"))
    return RigidTransform.from_components(xyz, Rotation.from_euler("xyz", rpy))


def usd_tree(stage: Usd.Stage) -> Tree | None:
    """A stage's bodies; None where a mass, its centre or an inertia follows from shapes."""
    cache, links, scales = UsdGeom.XformCache(), dict[str, Link](), dict[str, np.ndarray]()
    for prim in (prim for prim in stage.Traverse() if prim.HasAPI(UsdPhysics.RigidBodyAPI)):
        api = UsdPhysics.MassAPI(prim)
        mass, moments, com = (
            api.GetMassAttr().Get(),
            api.GetDiagonalInertiaAttr().Get(),
            api.GetCenterOfMassAttr().Get(),
        )
        written = com is not None and np.isfinite(com).all()
        solid = any(part.HasAPI(UsdPhysics.CollisionAPI) for part in Usd.PrimRange(prim))
        if not mass or not moments or not any(moments) or (solid and not written):
            return None
        _, scale = _placed(cache, prim)
        com, axes = np.array(com) * scale if written else np.zeros(3), api.GetPrincipalAxesAttr().Get()
        turn = _turn(axes).as_matrix()
        links[str(prim.GetPath())] = Link(mass=mass, com=com, inertia=turn @ np.diag(np.array(moments)) @ turn.T)
        scales[str(prim.GetPath())] = scale
    ties, held = [], ""
    for prim in (prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)):
        ends = [
            _body(stage, rel, links)
            for rel in (UsdPhysics.Joint(prim).GetBody0Rel(), UsdPhysics.Joint(prim).GetBody1Rel())
        ]
        if UsdPhysics.Joint(prim).GetJointEnabledAttr().Get() and any(ends):
            ties.append(_usd_tie(prim, ends[0], ends[1], scales))
            held = held or (next(end for end in ends if end) if not all(ends) else "")
    children = {tie.child for tie in ties if tie.parent}
    root = "" if held else next((name for name in links if name not in children), "")
    placed = Rotation.identity()
    if root:
        placed = _placed(cache, stage.GetPrimAtPath(root))[0].rotation
    return Tree(links=links, ties=ties, root=root, placed=placed)


def _body(stage: Usd.Stage, rel: Usd.Relationship, links: Mapping[str, Link]) -> str:
    """The body that a joint names, or that holds what it names; empty: the world."""
    for target in rel.GetTargets():
        prim = stage.GetPrimAtPath(target)
        while prim and str(prim.GetPath()) not in links:
            prim = prim.GetParent()
        return str(prim.GetPath()) if prim else ""
    return ""


def _usd_tie(prim: Usd.Prim, first: str, second: str, scales: Mapping[str, np.ndarray]) -> Tie:
    made, kind = UsdPhysics.Joint(prim), {"PhysicsRevoluteJoint": "hinge", "PhysicsPrismaticJoint": "slide"}
    ends = []
    for name, place, turn in (
        (first, made.GetLocalPos0Attr().Get(), made.GetLocalRot0Attr().Get()),
        (second, made.GetLocalPos1Attr().Get(), made.GetLocalRot1Attr().Get()),
    ):
        ends.append(RigidTransform.from_components(np.array(place) * scales.get(name, 1.0), _turn(turn)))
    own = kind.get(prim.GetTypeName(), "fixed")
    limits, token = None, "X"
    if own != "fixed":
        read = UsdPhysics.RevoluteJoint(prim) if own == "hinge" else UsdPhysics.PrismaticJoint(prim)
        low, high = read.GetLowerLimitAttr().Get(), read.GetUpperLimitAttr().Get()
        token = read.GetAxisAttr().Get() or "X"
        unit = math.radians(1.0) if own == "hinge" else 1.0
        limits = (low * unit, high * unit) if math.isfinite(low) and math.isfinite(high) else None
    return Tie(
        name=prim.GetName(),
        kind=own,
        parent=first,
        child=second,
        before=ends[0],
        after=ends[1].inv(),
        axis=np.eye(3)["XYZ".index(token)],
        limits=limits,
    )


def _turn(quat: object) -> Rotation:
    """A quaternion of USD's; one of zero length, which stands for none, is no turn."""
    if quat is None:
        return Rotation.identity()
    numbers = np.array([quat.GetReal(), *quat.GetImaginary()], dtype=float)  # type: ignore[attr-defined]
    return Rotation.from_quat(numbers, scalar_first=True) if np.linalg.norm(numbers) > 0.0 else Rotation.identity()


def _placed(cache: UsdGeom.XformCache, prim: Usd.Prim) -> tuple[RigidTransform, np.ndarray]:
    """A prim in the world, and its scale along its own axes, shape (3,)."""
    matrix = np.array(cache.GetLocalToWorldTransform(prim)).T  # USD's vectors are rows
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    return RigidTransform.from_components(matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3] / scale)), scale
