"""Names of what a robot's file says and nobody reads: all its elements and attributes, less what the import takes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pxr import Usd

PLACES = {"pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"}
NAMED = {"name", "class"}
DRIVEN = NAMED | {"ctrlrange", "ctrllimited", "gear", "joint", "armature"}
LIMITED = DRIVEN | {"forcerange", "forcelimited"}
TIED = NAMED | {"active"}

MJCF: Mapping[str, Collection[str]] = {
    "mujoco": {"model"},
    **dict.fromkeys(("worldbody", "actuator", "equality", "keyframe", "asset", "contact"), ()),
    "default": {"class"},
    "include": {"file"},
    "asset/model": {"file", "name", "content_type"},
    "attach": {"model", "body", "frame", "prefix"},
    "frame": PLACES | {"name", "childclass"},
    "replicate": {"count", "sep", "offset", "euler"},
    "compiler": {
        *("alignfree", "angle", "assetdir", "autolimits", "balanceinertia", "boundinertia", "boundmass", "conflict"),
        *("coordinate", "discardvisual", "eulerseq", "fitaabb", "fusestatic", "inertiafromgeom", "inertiagrouprange"),
        *("meshdir", "saveinertial", "settotalmass", "strippath", "texturedir", "usethread"),
    },
    "body": PLACES | {"name", "childclass"},
    "inertial": PLACES | {"mass", "diaginertia", "fullinertia"},
    "freejoint": {"name", "align"},
    "joint": NAMED
    | {"type", "pos", "axis", "range", "limited", "ref", "armature", "damping", "actuatorfrcrange"}
    | {"actuatorfrclimited"},
    "geom": NAMED
    | PLACES
    | {"type", "size", "fromto", "mesh", "mass", "density", "friction", "contype", "conaffinity", "fitscale"}
    | {"shellinertia"},
    "mesh": NAMED
    | {"file", "scale", "refpos", "refquat", "inertia", "maxhullvert", "vertex", "face", "builtin", "params"},
    "contact/pair": {"name", "class", "geom1", "geom2"},
    "contact/exclude": {"name", "body1", "body2"},
    "equality/connect": TIED | {"body1", "body2", "site1", "site2", "anchor"},
    "equality/weld": TIED | {"body1", "body2", "site1", "site2", "anchor"},
    "equality/joint": TIED | {"joint1", "joint2"},
    "motor": LIMITED,
    "position": LIMITED | {"kp", "kv", "dampratio", "inheritrange"},
    "general": LIMITED | {"gainprm", "biasprm", "gaintype", "biastype", "inheritrange"},
    "dcmotor": DRIVEN | {"motorconst", "resistance"},
    "velocity": LIMITED | {"kv"},
    "key": {"name", "qpos"},
}
"""Attributes that are read, by element, after the element that holds it where that decides. What the import drops of
them it says itself, from the compiled model. Elements that are not here are not read at all."""

ASIDE = {
    *("<visual>", "<statistic>", "<size>", "<light>", "<camera>", "<skin>", "<material>", "<texture>", "material"),
    *("group", "rgba", "user", "robot version"),
    *("compiler passthrough", "compiler savecanonical", "compiler savecompiled"),
    *("mesh material", "mesh normal", "mesh texcoord", "mesh smoothnormal", "mesh content_type"),
}
"""Elements, attributes, and attributes of an element that draw, book memory or comment: named without their values."""

PARTLY: Mapping[str, tuple[str, Callable[[str], bool]]] = {
    "joint damping": ("beyond its linear term", lambda text: any(float(word) for word in text.split()[1:])),
    "geom friction": ("beyond sliding", lambda text: len(text.split()) > 1),
    "geom contype": ("as a mask", lambda text: text not in ("0", "1")),
    "geom conaffinity": ("as a mask", lambda text: text not in ("0", "1")),
}
"""Attributes of which a part is read: which is not, and whether a value has that part."""

URDF: Mapping[str, Collection[str]] = {
    **dict.fromkeys(("inertial", "geometry"), ()),
    **dict.fromkeys(("robot", "link", "visual", "collision"), {"name"}),
    **dict.fromkeys(("parent", "child"), {"link"}),
    "joint": {"name", "type"},
    "origin": {"xyz", "rpy"},
    "axis": {"xyz"},
    "mass": {"value"},
    "inertia": {"ixx", "ixy", "ixz", "iyy", "iyz", "izz"},
    "box": {"size"},
    "sphere": {"radius"},
    "cylinder": {"radius", "length"},
    "capsule": {"radius", "height"},
    "mesh": {"filename", "scale"},
    "limit": {"lower", "upper", "effort"},
    "mimic": {"joint"},
}
"""Attributes of URDF's elements that are read."""

USD_PRIMS = {
    *("", "Xform", "Scope", "Cube", "Sphere", "Capsule", "Cylinder", "Mesh", "Material"),
    *("PhysicsRevoluteJoint", "PhysicsPrismaticJoint", "PhysicsFixedJoint", "NewtonActuator"),
}
"""Types of prims that are read."""

USD = {
    *("xformOpOrder", "points", "faceVertexCounts", "faceVertexIndices", "size", "radius", "height", "axis", "extent"),
    *("orientation", "visibility", "purpose", "material:binding:physics"),
    *("physics:mass", "physics:centerOfMass", "physics:diagonalInertia", "physics:principalAxes", "physics:density"),
    *("physics:axis", "physics:localPos0", "physics:localPos1", "physics:localRot0", "physics:localRot1"),
    *("physics:lowerLimit", "physics:upperLimit", "physics:body0", "physics:body1", "physics:jointEnabled"),
    *("physics:collisionEnabled", "physics:rigidBodyEnabled", "physics:dynamicFriction", "physics:approximation"),
    *("physics:kinematicEnabled", "physics:excludeFromArticulation", "physics:simulationOwner"),
    *("drive:angular:physics:stiffness", "drive:angular:physics:damping", "drive:angular:physics:maxForce"),
    *("newton:armature", "newton:targets", "newton:kp", "newton:kd", "newton:maxEffort", "newton:mr:kp_base"),
    *("newton:mr:kd", "newton:mr:tau_limit", "physxJoint:armature", "mjc:armature", "mrwarp:neutral"),
}
"""Attributes and relations that are read."""

USD_ASIDE = ("primvars:", "inputs:", "outputs:", "info:", "ui:", "material:binding", "normals", "doubleSided")
USD_ASIDE = (*USD_ASIDE, "subdivision", "corner", "crease", "hole", "triangle", "interpolate", "faceVarying")
USD_ASIDE = (*USD_ASIDE, "Shader", "NodeGraph", "GeomSubset", "Camera", "SkelRoot", "DomeLight", "DistantLight")
USD_ASIDE = (*USD_ASIDE, "SphereLight", "RectLight", "DiskLight", "CylinderLight")
"""Beginnings of the names of attributes, relations and types of prims that only draw."""

SHOWN = 3
"""Names of an attribute's places that are shown."""

LETTERS = 40
"""Length of a value that is shown in full."""


class Unread(NamedTuple):
    """An element or attribute that is not read."""

    subject: str
    where: str = ""
    value: str = ""
    aside: bool = False
    """Whether it says nothing of the machine."""


def left_over(path: Path, *, damping: Mapping[str, float] | None = None) -> str:
    """Elements and attributes that are not carried, each with the first places where it stands; empty: none.

    Args:
        path: The robot's file.
        damping: Joints whose damping no drive takes over [N·m·s/rad].
    """
    found = [*_walked(path), *(Unread("joint damping", name, f"{x:.4g}") for name, x in (damping or {}).items())]
    places: dict[str, list[str]] = {}
    for unread in found:
        own = places.setdefault(unread.subject, [])
        text = unread.where if unread.aside else ": ".join(part for part in (unread.where, unread.value) if part)
        if text and text not in own:
            own.append(text)
    aside = dict.fromkeys(unread.subject for unread in found if unread.aside)
    texts = [f"{name}{_some(own)}" for name, own in places.items() if name not in aside]
    return "; ".join([*texts, *[f"and, of drawing, memory and comments: {', '.join(aside)}"] * bool(aside)])


def _some(names: list[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if names[SHOWN:] else ""
    return f" ({', '.join(names[:SHOWN])}{more})" if names else ""


def _cut(text: str) -> str:
    text = " ".join(text.split())
    return text if len(text) <= LETTERS else f"{text[:LETTERS]}…"


def _walked(path: Path, main: Path | None = None) -> Iterator[Unread]:
    """All of a file, and of those that it includes or attaches.

    Args:
        path: The file.
        main: The file from whose folder names of included files count; None: its own.
    """
    if path.suffix.lower() in (".usd", ".usda", ".usdc"):
        yield from _usd(Usd.Stage.Open(str(path)))
        return
    root = ET.fromstring(path.read_bytes())
    yield from _element(root, root.tag, "", URDF if root.tag == "robot" else MJCF)
    folders = [compiler.get(name, "") for compiler in root.iter("compiler") for name in ("assetdir", "meshdir")]
    for element in (*root.iter("include"), *root.iterfind("asset/model")):
        own = [(main or path).parent / folder / element.get("file", "") for folder in ("", *folders)]
        if file := next((file for file in own if file.is_file()), None):
            yield from _walked(file, (main or path) if element.tag == "include" else None)


def _element(element: ET.Element, kind: str, where: str, read: Mapping[str, Collection[str]]) -> Iterator[Unread]:
    """Unread attributes of an element and of all in it; an unread element with all in it is one."""
    tag = str(element.tag)
    own = read.get(kind, read.get(tag))
    if own is None:
        name = element.get("name") or where
        pairs = (f"{key}={value}" for part in element.iter() for key, value in _parts(part, part is element))
        yield Unread(f"<{tag}>", "" if tag == name else name, _cut(" ".join(pairs)), f"<{tag}>" in ASIDE)
        return
    place = element.get("name") or element.get("joint") or element.get("class") or where
    if tag in ("limit", "origin", "axis", "mass", "inertia"):
        place = where
    for name, value in sorted(element.attrib.items()):
        subject = f"{tag} {name}"
        if name not in own:
            yield Unread(subject, place, _cut(value), bool(ASIDE & {name, subject}))
        elif subject in PARTLY and PARTLY[subject][1](value):
            yield Unread(f"{subject} {PARTLY[subject][0]}", place, _cut(value))
    inner = place if tag in ("body", "default", "link", "joint") else where
    for child in element:
        if isinstance(child.tag, str):  # else it is a comment
            yield from _element(child, f"{tag}/{child.tag}", inner, read)


def _parts(element: ET.Element, outer: bool) -> Iterator[tuple[str, str]]:
    """Attributes and text of an element that is not read; the outer one's name stands before them."""
    yield from ((key, value) for key, value in element.attrib.items() if not (outer and key == "name"))
    if text := (element.text or "").strip():
        yield str(element.tag), text


def _usd(stage: Usd.Stage) -> Iterator[Unread]:
    for prim in stage.Traverse():
        kind = str(prim.GetTypeName())
        if kind not in USD_PRIMS:
            yield Unread(f"<{kind}>", prim.GetName(), aside=kind in USD_ASIDE)
        if kind in USD_ASIDE:
            continue
        for unread in (*prim.GetAuthoredAttributes(), *prim.GetAuthoredRelationships()):
            name = unread.GetName()
            if name not in USD and not name.startswith("xformOp:"):
                yield Unread(name, prim.GetName(), _usd_value(unread), name.startswith(USD_ASIDE))


def _usd_value(part: Any) -> str:
    if isinstance(part, Usd.Relationship):
        return _cut(" ".join(target.name for target in part.GetTargets()))
    value = part.Get()
    return _cut(f"{value:.6g}" if isinstance(value, float) else str(value))
