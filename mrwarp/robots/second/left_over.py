"""Names of what a robot's file says and nobody reads: all its elements and attributes, less what the import takes."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path

from pxr import Sdf, Usd, UsdPhysics

NAMES = {"name", "class", "childclass", "rgba", "material", "group", "user", "model", "dclass"}
"""Attributes that say nothing of the machine."""

PLACES = {"pos", "quat", "axisangle", "xyaxes", "zaxis", "euler"}
LIMITED = {"ctrlrange", "ctrllimited", "forcerange", "forcelimited", "gear", "joint", "armature", "inheritrange"}

MJCF: Mapping[str, Collection[str] | None] = {
    **dict.fromkeys(("mujoco", "worldbody", "default", "actuator", "equality", "keyframe", "include", "freejoint")),
    **dict.fromkeys(("compiler", "asset", "visual", "statistic", "size", "light", "camera", "attach", "frame")),
    **dict.fromkeys(("texture", "mesh", "hfield", "map", "global", "quality", "headlight", "rgba", "scale", "skin")),
    **dict.fromkeys(("connect", "weld", "joint equality", "contact", "pair", "exclude", "tendon", "material")),
    "body": PLACES,
    "inertial": PLACES | {"mass", "diaginertia", "fullinertia"},
    "joint": {"type", "pos", "axis", "range", "limited", "ref", "armature", "actuatorfrcrange", "actuatorfrclimited"},
    "geom": PLACES
    | {"type", "size", "fromto", "mesh", "mass", "density", "friction", "contype", "conaffinity", "hfield", "fitscale"}
    | {"shellinertia"},
    "motor": LIMITED,
    "position": LIMITED | {"kp", "kv", "dampratio"},
    "general": LIMITED | {"gainprm", "biasprm", "gaintype", "biastype"},
    "dcmotor": LIMITED | {"motorconst", "resistance"},
    "velocity": LIMITED | {"kv"},
    "key": {"qpos"},
}
"""Attributes that are read, by element; None: all of them. Elements that are not here are not read at all."""

URDF: Mapping[str, Collection[str] | None] = {
    **dict.fromkeys(("robot", "link", "inertial", "mass", "inertia", "origin", "visual", "collision", "geometry")),
    **dict.fromkeys(
        ("box", "sphere", "cylinder", "capsule", "mesh", "material", "color", "texture", "parent", "child")
    ),
    **dict.fromkeys(("axis", "mimic", "mujoco", "compiler")),
    "joint": {"type"},
    "limit": {"lower", "upper", "effort"},
}

USD = (
    "xformOp", "physics:mass", "physics:centerOfMass", "physics:diagonalInertia", "physics:principalAxes",
    "physics:axis",
    "physics:density", "physics:localPos", "physics:localRot", "physics:lowerLimit", "physics:upperLimit",
    "physics:body", "physics:jointEnabled", "physics:collisionEnabled", "physics:rigidBodyEnabled",
    "physics:dynamicFriction", "physics:staticFriction", "physics:approximation", "physics:kinematicEnabled",
    "physics:excludeFromArticulation", "drive:angular:physics:stiffness", "drive:angular:physics:damping",
    "drive:angular:physics:maxForce", "newton:armature", "newton:targets", "newton:kp", "newton:kd",
    "newton:maxEffort", "newton:collapse_fixed_joints", "physxJoint:armature", "mjc:armature", "mr:", "mrwarp:",
    "primvars:", "inputs:", "outputs:", "info:", "material:", "ui:",
)  # fmt: skip
"""Beginnings of the names of attributes that are read, or that only draw."""

DRAWN = ("points", "face", "normals", "extent", "size", "radius", "height", "axis", "doubleSided", "orientation")
DRAWN = (*DRAWN, "subdivision", "visibility", "purpose", "corner", "crease", "hole", "triangle", "interpolate")
"""Attributes of USD's shapes without a prefix."""

SHOWN = 3
"""Names of an attribute's places that are shown."""


def left_over(path: Path, *, gains: Collection[str] = ()) -> str:
    """Attributes that are not carried, each with the first places where it stands; empty: none.

    Args:
        path: The robot's file.
        gains: Joints whose damping became a part of Kd.
    """
    if path.suffix.lower() in (".usd", ".usda", ".usdc"):
        found = _usd(Usd.Stage.Open(str(path)))
    else:
        root = ET.fromstring(path.read_bytes())
        found = _urdf(root) if root.tag == "robot" else _mjcf(path, root, gains)
    places: dict[str, list[str]] = {}
    for what, where in found:
        own = places.setdefault(what, [])
        if where and where not in own:
            own.append(where)
    return "; ".join(f"{what}{_some(own)}" for what, own in places.items())


def _some(names: list[str]) -> str:
    more = f" and {len(names) - SHOWN} more" if names[SHOWN:] else ""
    return f" ({', '.join(names[:SHOWN])}{more})" if names else ""


def _included(path: Path, root: ET.Element) -> Iterable[ET.Element]:
    """The file's root and those that it includes."""
    yield root
    for element in root.iter("include"):
        file = path.parent / element.get("file", "")
        if file.is_file():
            yield from _included(path, ET.fromstring(file.read_bytes()))


def _mjcf(path: Path, root: ET.Element, gains: Collection[str]) -> Iterator[tuple[str, str]]:
    """Unread elements, with all in them as one, and unread attributes."""

    def walk(element: ET.Element, where: str) -> Iterator[tuple[str, str]]:
        for child in element:
            tag = str(child.tag)
            name = child.get("name") or child.get("joint") or child.get("class") or where
            inside = element.tag in ("equality", "tendon", "contact", "asset")
            if tag not in MJCF and not inside:
                yield f"<{tag}>", "" if tag == name else name
                continue
            read = MJCF.get(tag)
            for attribute in sorted(set(child.attrib) - NAMES - set(child.attrib if read is None or inside else read)):
                if (tag, attribute) != ("joint", "damping") or name not in gains:
                    yield f"{tag} {attribute}", name
            yield from walk(child, name if tag in ("body", "default") else where)

    for part in _included(path, root):
        yield from walk(part, "")


def _urdf(root: ET.Element) -> Iterator[tuple[str, str]]:
    def walk(element: ET.Element, where: str) -> Iterator[tuple[str, str]]:
        for child in element:
            tag, name = str(child.tag), child.get("name") or where
            if tag not in URDF:
                yield f"<{tag}>", name
                continue
            read = URDF[tag]
            for attribute in sorted(set(child.attrib) - NAMES - set(child.attrib if read is None else read)):
                yield f"{tag} {attribute}", where if tag == "limit" else name
            yield from walk(child, name if tag in ("link", "joint") else where)

    yield from walk(root, "")


def _usd(stage: Usd.Stage) -> Iterator[tuple[str, str]]:
    for prim in stage.Traverse():
        for attribute in prim.GetAuthoredAttributes():
            name = attribute.GetName()
            drawn = ":" not in name and name.startswith(DRAWN)
            if not name.startswith(USD) and not drawn and attribute.GetTypeName() != Sdf.ValueTypeNames.Token:
                yield name, prim.GetName()
        if prim.IsA(UsdPhysics.Scene):
            yield "PhysicsScene", prim.GetName()
