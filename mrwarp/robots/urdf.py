"""A URDF before Newton reads it: what Newton would drop or rename in silence is refused, and meshes are found."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import unquote

import trimesh
from scipy.spatial.transform import Rotation

from mrwarp.robots.foreign import RobotFileError
from mrwarp.robots.guesses import Guess, Subject, some
from mrwarp.run_dir import one_line


@dataclass(frozen=True, kw_only=True)
class Meshes:
    """Where meshes are, or that they are left out."""

    packages: tuple[Path, ...] = ()
    """Folders that hold the packages of ``package://`` names."""
    skip: bool = False
    """Whether robots are read without their meshes."""


@dataclass(frozen=True, kw_only=True)
class Urdf:
    """A URDF that was checked."""

    text: str
    """XML whose meshes have absolute paths."""
    base: str | None
    """Whether its root floats or is held, one of :data:`BASES`; None: hinges or sliders join it to the link world."""
    base_said: bool
    """Whether the file says so, by such a link."""
    mount: Rotation
    """The root in the link world."""
    notes: list[Guess]
    """Notes on the base, and on what was left out."""
    mimics: dict[str, str]
    """Joints that follow another one, and which."""


GROUND = "world"
"""The link that stands still, by convention."""


def checked_urdf(path: Path, meshes: Meshes, base: str | None) -> Urdf:
    """Check names, tree, limits and meshes of a URDF.

    Args:
        path: The file.
        meshes: Where its meshes are, or that all are left out.
        base: One of :data:`BASES`, in place of what the file says.

    Raises:
        RobotFileError: it is no URDF; names are missing or stand twice; links are not one tree; limits are turned
            round; a mesh is not there or of a kind that is not read.
    """
    try:
        root = ET.fromstring(path.read_bytes())
    except (ET.ParseError, ValueError, LookupError) as error:  # also of unknown encodings
        raise RobotFileError(f"{path}: it is not XML ({one_line(error)}); correct it there") from None
    if root.tag != "robot":
        raise RobotFileError(f"{path}: its first element is <{root.tag}>, not <robot>; is it a robot's file?")
    if next((e for e in root.iter() if "xacro" in e.tag), None) is not None:
        raise RobotFileError(f"{path}: it holds xacro macros; expand them first: xacro {path.name} > robot.urdf")
    _check_numbers(path, root)
    notes = [Guess(subject=Subject.BASE, text=text) for text in _add_ground(root)]
    notes += [Guess(subject=Subject.OMITTED, text=text) for text in _without_idle_mimics(root)]
    said = _check_tree(path, root) == GROUND
    base, mount = _off_the_ground(path, root, base) if said else (base or "free", Rotation.identity())
    for limit in root.iterfind("joint[@type='continuous']/limit"):  # it has none there, but Newton would take them
        for which in ("lower", "upper"):
            limit.attrib.pop(which, None)
    for link in root.findall("link"):
        for kind in [e for e in link if meshes.skip and e.find("geometry/mesh") is not None]:
            link.remove(kind)
        for mesh in link.iter("mesh"):
            mesh.set("filename", str(_mesh(path, link.get("name", ""), mesh.get("filename") or "", meshes)))
    followed = {j.get("name", ""): j.find("mimic") for j in root.findall("joint")}
    return Urdf(
        text=ET.tostring(root, encoding="unicode"),
        base=base,
        base_said=said,
        mount=mount,
        notes=notes,
        mimics={name: mimic.get("joint", "") for name, mimic in followed.items() if mimic is not None},
    )


def _add_ground(root: ET.Element) -> list[str]:
    """Add the link that stands still, where a joint names it and the file lacks it; returns a note."""
    named = [joint for joint in root.iterfind("joint") for end in joint.iterfind("parent") if end.get("link") == GROUND]
    if not named or any(link.get("name") == GROUND for link in root.iterfind("link")):
        return []
    ET.SubElement(root, "link", name=GROUND)
    return [f"joint {named[0].get('name')} names a link {GROUND} that the file lacks: it was taken as the ground"]


def _without_idle_mimics(root: ET.Element) -> list[str]:
    """Take <mimic> off joints that are fixed: they follow nothing; returns a note."""
    idle = [joint for joint in root.iterfind("joint[@type='fixed']") if joint.find("mimic") is not None]
    for joint in idle:
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
    names = some([joint.get("name", "") for joint in idle])
    return [f"<mimic> of {names} was left out: the joint is fixed"] if idle else []


def _off_the_ground(path: Path, root: ET.Element, base: str | None) -> tuple[str | None, Rotation]:
    """Take the ground off, and its one joint that is fixed or floating.

    Returns:
        Whether the root floats or is held, and its rotation in the ground; None: other joints lead to the ground,
        which stays.

    Raises:
        RobotFileError: the user lets a robot float which such joints join to the ground.
    """
    own = [joint for joint in root.iterfind("joint") for end in joint.iterfind("parent") if end.get("link") == GROUND]
    kinds = [joint.get("type") for joint in own]
    if kinds not in (["fixed"], ["floating"]):
        if base == "free":
            names = ", ".join(str(joint.get("name")) for joint in own)
            raise RobotFileError(
                f"{path}: --base free: {names} join the robot to the link {GROUND}, so that no base is left to float; "
                "leave --base out"
            )
        return None, Rotation.identity()
    angles = next((origin.get("rpy", "0 0 0") for origin in own[0].iterfind("origin")), "0 0 0")
    root.remove(own[0])
    root.remove(next(link for link in root.iterfind("link") if link.get("name") == GROUND))
    mount = Rotation.from_euler("xyz", [float(word) for word in angles.split()])
    return base or {"fixed": "fixed", "floating": "free"}[kinds[0] or ""], mount


TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
"""Types of joints of the format."""

NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), 1),
    "limit": dict.fromkeys(("lower", "upper", "effort", "velocity"), 1),
    "mesh": {"scale": 3},
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "height": 1},
}
"""How many numbers each attribute of an element holds; only limits may be infinite."""


def _check_numbers(path: Path, root: ET.Element) -> None:
    """Refuse what is no number, by link or joint, and types of joints that there are not."""
    for part in (*root.iterfind("link"), *root.iterfind("joint")):
        where = f"{path}: {part.tag} {part.get('name')}"
        if part.tag == "joint" and part.get("type") not in TYPES:
            raise RobotFileError(f"{where}: type {part.get('type') or 'is missing'}; write one of {', '.join(TYPES)}")
        for element in part.iter():
            for name, count in NUMBERS.get(element.tag, {}).items():
                text = element.get(name)
                if text is None:
                    continue
                try:
                    numbers = [float(word) for word in text.split()]
                except ValueError:
                    numbers = []
                finite = all(map(math.isfinite, numbers)) or (
                    element.tag == "limit" and not any(map(math.isnan, numbers))
                )
                if len(numbers) != count or not finite:
                    macro = f"; expand its macros: xacro {path.name} > robot.urdf" if "$" in text else ""
                    wanted = "a number" if count == 1 else f"{count} numbers"
                    raise RobotFileError(f'{where}: <{element.tag} {name}="{text[:40]}">: write {wanted}{macro}')


def _check_tree(path: Path, root: ET.Element) -> str:
    """The root link's name."""
    names = {kind: [e.get("name") or "" for e in root.findall(kind)] for kind in ("link", "joint")}
    for kind, own in names.items():
        if "" in own:
            raise RobotFileError(f"{path}: {kind} number {own.index('') + 1} has no name; give it one there")
        if twice := next((name for name, count in Counter(own).items() if count > 1), None):
            raise RobotFileError(f"{path}: two {kind}s are called {twice}; rename one there")
    if not names["link"]:
        raise RobotFileError(f"{path}: <robot> has no <link>; is it a robot's file?")
    before: dict[str, str] = {}
    for joint in root.findall("joint"):
        name = joint.get("name")
        for end in ("parent", "child"):
            found = joint.find(end)
            link = "" if found is None else found.get("link") or ""
            if link not in names["link"]:
                raise RobotFileError(
                    f"{path}: joint {name}: {end} {link or 'is missing'}: name a link that is there, or add it"
                )
            if end == "child":
                if link in before:
                    raise RobotFileError(
                        f"{path}: joints {before[link]} and {name} both lead to link {link}: a closed loop; open it "
                        "there: only trees of bodies are simulated"
                    )
                before[link] = str(name)
        limit = joint.find("limit")
        if limit is not None and joint.get("type") in ("revolute", "prismatic"):
            low, high = (float(limit.get(which) or 0.0) for which in ("lower", "upper"))
            if low > high:
                raise RobotFileError(f"{path}: joint {name}: lower {low:g} lies above upper {high:g}; swap them there")
    roots = [name for name in names["link"] if name not in before]
    if not roots:
        raise RobotFileError(f"{path}: every link has a link before it: a closed loop; open it there")
    if roots[1:]:
        raise RobotFileError(f"{path}: {roots[0]} and {roots[1]} are two trunks; join them there, or remove one")
    ends = {str(joint.find("child").get("link")): joint for joint in root.iterfind("joint")}  # type: ignore[union-attr]
    for name in names["link"]:
        seen: set[str] = set()
        while name in ends and name not in seen:
            seen.add(name)
            name = str(ends[name].find("parent").get("link"))  # type: ignore[union-attr]
        if name in seen:
            raise RobotFileError(f"{path}: link {name} comes after itself: a closed loop; open it there")
    for joint in root.iterfind("joint[mimic]"):
        followed = str(joint.find("mimic").get("joint"))  # type: ignore[union-attr]
        if followed not in names["joint"]:
            raise RobotFileError(
                f"{path}: joint {joint.get('name')}: <mimic> of {followed}, which is no joint; name one, or take it out"
            )
    return roots[0]


def _mesh(path: Path, link: str, name: str, meshes: Meshes) -> Path:
    """The file of a mesh."""
    where = f"{path}: link {link}: mesh {name}"
    if not name:
        raise RobotFileError(f"{path}: link {link}: a <mesh> without filename; name its file, or say --skip-meshes")
    if name.startswith(("http://", "https://")):
        raise RobotFileError(f"{where} lies on the network; put it next to the file, or say --skip-meshes")
    found = next((file for file in _places(path, name, meshes.packages) if file.is_file()), None)
    if found is None:
        package = unquote(name).partition("://")[2].partition("/")[0]
        remedy = f"--packages DIR with the folder that holds {package}, or " if "://" in name else ""
        raise RobotFileError(f"{where} is not there; put it there, or say {remedy}--skip-meshes")
    if found.suffix.lower().lstrip(".") not in (known := trimesh.available_formats()):
        more = "; pip install pycollada reads it" if found.suffix.lower() == ".dae" else ""
        usual = ", ".join(f".{kind}" for kind in ("stl", "obj", "ply", "glb") if kind in known)
        raise RobotFileError(f"{where} is none of {usual}{more}; convert it, or say --skip-meshes")
    return found.resolve()


def _places(path: Path, name: str, packages: Sequence[Path]) -> Iterator[Path]:
    """Where a mesh may be: a package next to the file, around it, or in one of the folders that were named."""
    scheme, there, rest = name.partition("://")
    if not there:
        yield path.parent / name
    elif scheme == "file":
        yield Path(unquote(rest))
    else:
        inner = unquote(rest).lstrip("/")  # package:///meshes names no package
        package, _, own = inner.partition("/")
        around = path.resolve().parents
        for folder in (*packages, *around):
            yield folder / inner
            if folder.name == package:
                yield folder / own
        yield from (folder / own for folder in around[:2])  # a package's folder of another name
