"""A robot's file, read: MJCF as MuJoCo compiles it, URDF and USD by Newton's importers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdPhysics

from mrwarp.robots.foreign import Coupling, ForeignRobot, Keyframe, RobotFileError, prim_names
from mrwarp.robots.guesses import Guess, Subject
from mrwarp.robots.mjcf import read_mjcf
from mrwarp.robots.newton_robot import add_stage, read_by_newton
from mrwarp.robots.urdf import Meshes, checked_urdf
from mrwarp.run_dir import no_file
from mrwarp.usd.open_stage import SCHEMA, keep_fixed_joints, open_stage

SUFFIXES = {".xml": "MJCF", ".mjcf": "MJCF", ".urdf": "URDF", ".usd": "USD", ".usda": "USD", ".usdc": "USD"}
"""Content of a file by the end of its name."""


def read_robot(path: Path, meshes: Meshes | None = None, base: str | None = None) -> ForeignRobot:
    """Read a robot's file. A URDF floats, unless its root link is called world.

    Args:
        path: The file.
        meshes: Where a URDF's meshes are, or that all are left out.
        base: One of :data:`BASES`, in place of what the file says.

    Raises:
        RobotFileError: it cannot be read, has no bodies, two trunks, or a planar base.
        AssetError: as USD it cannot be opened.
    """
    if not path.is_file():
        raise RobotFileError(f"{path}: {no_file(path, 'file')}; name an MJCF (.xml), URDF or USD file")
    kind = SUFFIXES.get(path.suffix.lower())
    if kind is None:
        remedy = (
            f"expand its macros: xacro {path.name} > robot.urdf" if "xacro" in path.suffix else "rename or convert it"
        )
        raise RobotFileError(f"{path}: {path.suffix or 'no ending'} is not {', '.join(SUFFIXES)}; {remedy}")
    meshes = meshes or Meshes()
    if kind == "USD":
        return _read_usd(path, base)
    is_urdf = kind == "URDF" or b"<robot" in path.read_bytes()[:4096]
    robot = _read_urdf(path, meshes, base) if is_urdf else read_mjcf(path, meshes.skip, base)
    robot.skip_meshes = meshes.skip
    if meshes.skip:
        text = "--skip-meshes left out all meshes, and with them soles and wheels that are meshes"
        robot.notes.append(Guess(subject=Subject.FEET, text=text))
    return robot


def _read_urdf(path: Path, meshes: Meshes, base: str | None) -> ForeignRobot:
    urdf = checked_urdf(path, meshes, base)

    def add(builder: Any) -> None:
        builder.default_shape_cfg.density = 0.0  # a link without inertial has no mass there
        # a root that is held is read as one that floats: else it is dropped with its mass
        builder.add_urdf(urdf.text, floating=urdf.base is not None)

    robot = read_by_newton(path, add, urdf.base).upright(urdf.mount)
    robot.base_said = "user" if base else "file" if urdf.base_said else ""
    robot.notes += urdf.notes
    pairs = [prim_names(pair) for pair in urdf.mimics.items()]
    robot.couplings += [Coupling(text=f"<mimic> ties {a} to {b}", joints=(a, b)) for a, b in pairs]
    return robot


def _read_usd(path: Path, base: str | None) -> ForeignRobot:
    """A USD file, with the gains of Newton's motors, also next to MR devices, and the stance of an imported robot."""
    stage = open_stage(path)
    if stage.HasAuthoredMetadata("upAxis") and (up := UsdGeom.GetStageUpAxis(stage)) != "Z":
        raise RobotFileError(f"{path}: upAxis is {up}; export it with Z up")
    for name, unit in (("metersPerUnit", "metres"), ("kilogramsPerUnit", "kilograms")):
        if stage.HasAuthoredMetadata(name) and (value := stage.GetMetadata(name)) != 1.0:
            raise RobotFileError(f"{path}: {name} is {value:g}; export it in {unit}")
    _refuse_no_numbers(path, stage)
    _refuse_loops(path, stage)
    motors = [prim for prim in stage.Traverse() if prim.GetTypeName() == "NewtonActuator"]
    _refuse_shared(path, motors)
    names = (("kp", "mr:kp_base"), ("kd", "mr:kd"), ("maxEffort", "mr:tau_limit"))
    drives = {
        prim_names([target.name])[0]: [
            next((v for name in pair if (v := motor.GetAttribute(f"newton:{name}").Get())), None) for pair in names
        ]
        for motor in motors
        for target in motor.GetRelationship("newton:targets").GetTargets()
    }
    homes = {
        prim_names([prim.GetName()])[0]: math.radians(angle)
        for prim in stage.Traverse()
        if prim.IsA(UsdPhysics.Joint) and (angle := prim.GetAttribute("mrwarp:neutral").Get()) is not None
    }
    devices = any(SCHEMA in motor.GetAppliedSchemas() for motor in motors)
    with Usd.EditContext(stage, stage.GetSessionLayer()):  # their numbers are known; Newton refuses other kinds
        for motor in motors:
            motor.SetActive(False)
        keep_fixed_joints(stage)
        if not any(prim.HasAPI(UsdPhysics.ArticulationRootAPI) for prim in stage.Traverse()):
            UsdPhysics.ArticulationRootAPI.Apply(stage.GetDefaultPrim())

    robot = read_by_newton(path, lambda builder: add_stage(builder, stage), base)
    for joint in robot.joints:
        kp, kd, limit = drives.get(joint.name, (None, None, None))
        joint.kp, joint.kd, joint.torque_limit = kp or joint.kp, kd or joint.kd, limit or joint.torque_limit
        joint.home = homes.get(joint.name)
    if homes:
        robot.keyframes = [Keyframe(name="mrwarp:neutral", angles=homes, lean=0.0)]
    if devices:
        text = "MR devices were left out: put them on with 'mrwarp robot fit-device'"
        robot.notes.append(Guess(subject=Subject.OMITTED, text=text))
    return robot


def _refuse_shared(path: Path, motors: Sequence[Usd.Prim]) -> None:
    """Name motors that drive one joint: a joint has the numbers of one."""
    first: dict[Sdf.Path, str] = {}
    for motor in motors:
        for target in motor.GetRelationship("newton:targets").GetTargets():
            if target in first:
                raise RobotFileError(
                    f"{path}: joint {target.name} has the actuators {first[target]} and {motor.GetName()}; write one "
                    "in their place"
                )
            first[target] = motor.GetName()


def _refuse_no_numbers(path: Path, stage: Usd.Stage) -> None:
    """Name the attribute that is no number: Newton takes a default in its place, or the NaN."""
    for prim in stage.Traverse():
        for attribute in prim.GetAuthoredAttributes():
            if attribute.GetName().startswith(("physics:", "xformOp:", "drive:")):
                value = attribute.Get()
                numbers = np.array([value.real, *value.imaginary] if hasattr(value, "imaginary") else value).ravel()
                if numbers.dtype.kind == "f" and np.isnan(numbers).any():
                    raise RobotFileError(
                        f"{path}: {prim.GetPath()}: {attribute.GetName()} is no number; correct it there"
                    )


def _refuse_loops(path: Path, stage: Usd.Stage) -> None:
    """Name the joint that ties bodies which are tied already: Newton names none."""
    group: dict[str, str] = {}
    for prim in (prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Joint)):
        made = UsdPhysics.Joint(prim)
        ends = [str((rel.GetTargets() or [""])[0]) for rel in (made.GetBody0Rel(), made.GetBody1Rel())]
        if not made.GetJointEnabledAttr().Get():
            continue
        first, second = (group.setdefault(end, end) for end in ends)
        if first == second:
            between = " and ".join(end.rpartition("/")[2] or "the world" for end in ends)
            raise RobotFileError(
                f"{path}: joint {prim.GetName()} closes a loop between {between}; open it there: only trees of bodies "
                "are simulated"
            )
        group = {end: first if own == second else own for end, own in group.items()}
