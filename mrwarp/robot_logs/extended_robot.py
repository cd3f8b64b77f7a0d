"""The extended robot: its description with the corrections of a verdict, and the corrections as data."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from pxr import Usd

from mrwarp.robot_logs.robot_log import LogError
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.robots.drives import Choices
from mrwarp.robots.foreign import RobotFileError
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from mrwarp.robots.write_robot import save_checked, write_checked
from mrwarp.run_dir import plain, write_text
from mrwarp.runtime import silent
from mrwarp.usd.asset import ROBOT_SUFFIXES, RobotAsset, load_robot
from mrwarp.usd.open_stage import AssetError

SCHEMA = 1

WRITTEN = ("robot.xml", "robot.usda", "model.json")
"""Files that :func:`write_extended` may write."""

IN_USD = ("mass", "com", "armature", "kp", "kd", "friction", "damping", "strength", "limit")
"""Fields whose corrections robot.usda carries; of a robot's own USD file also of its devices, of an MJCF lengths."""


def write_extended(d: RobotDiagnosis, out: Path) -> tuple[list[str], list[str]]:
    """Write ``robot.xml`` or ``robot.usda`` (of a robot that walks both) and ``model.json``; returns names and notes.

    What a robot's file has no place for, such as a delay, stands in ``model.json`` alone.
    """
    change = {(p.field, p.index): float(x) for p, x in zip(d.parameters, d.theta, strict=True) if x}
    names, notes = [], []
    source = d.model.path
    if source.suffix in ROBOT_SUFFIXES or not source.suffix:
        names.append(_write_usd(d, change, out / "robot.usda"))
    else:
        names.append(_write_mjcf(d, change, out / "robot.xml"))
        try:
            with silent():
                robot = read_robot(out / "robot.xml")
                if robot.floating:
                    gains = {f: dict(zip(d.log.joints, _gains(d, f), strict=True)) for f in ("kp", "kd")}
                    understood = understand(robot, Choices(kp=gains["kp"], kd=gains["kd"]))
                    asset = write_checked(understood, out / "robot.usda", source=str(source))
                    for (field, k), x in change.items():
                        if field in ("strength", "limit"):
                            _correct_drive(asset, d, field, k, x)
                    _rub(asset.stage, d, change)
                    save_checked(asset.stage, out / "robot.usda")
                    names.append("robot.usda")
        except (RobotFileError, AssetError, ValueError) as error:
            notes.append(f"no robot.usda: {error}")
    if "robot.usda" in names:
        carried = (*IN_USD, *(("device", "coil", "coil_lag", "drag") if "robot.xml" not in names else ("length",)))
        absent = sorted({p.cause for p, x in zip(d.parameters, d.theta, strict=True) if x and p.field not in carried})
        if absent:
            notes.append(f"robot.usda has no place for {', '.join(absent)}: model.json has the numbers")
    write_text(out / "model.json", json.dumps(plain(_model(d)), indent=2, allow_nan=False) + "\n")
    return [*names, "model.json"], notes


def _gains(d: RobotDiagnosis, name: str) -> np.ndarray:
    """Kp or Kd of the log's joints with their corrections, shape (J,)."""
    more = np.zeros(len(d.log.joints))
    for p, x in zip(d.parameters, d.theta, strict=True):
        if p.field == name:
            more[p.index] += x
    return np.nan_to_num(getattr(d.log, name)) * (1.0 + more)


def _model(d: RobotDiagnosis) -> dict[str, Any]:
    rows = []
    for p, x in zip(d.parameters, d.theta, strict=True):
        if x:
            rows.append(
                {"cause": p.cause, "where": p.where, "name": p.name, "value": p.absolute(float(x)), "unit": p.unit}
            )
    return {
        "schema": SCHEMA,
        "kind": "robot_corrections",
        "robot": str(d.model.path),
        "log": str(d.log.path),
        "corrections": rows,
        "kp": dict(zip(d.log.joints, _gains(d, "kp"), strict=True)),
        "kd": dict(zip(d.log.joints, _gains(d, "kd"), strict=True)),
        "session": d.session,
    }


def _write_mjcf(d: RobotDiagnosis, change: dict[tuple[str, int], float], path: Path) -> str:
    """The source with the corrections, as MJCF; bodies state what was compiled of them."""
    with silent():
        spec = mujoco.MjSpec.from_file(str(d.model.path))
    for name in ("meshdir", "texturedir"):
        own = getattr(spec, name)
        setattr(spec, name, os.path.relpath(d.model.path.resolve().parent / own, path.resolve().parent))
    bodies = {b.name: b for b in spec.bodies}
    for (field, k), x in change.items():
        if field in ("mass", "com"):
            _change_mass(d, bodies, field, k, x)
        elif field == "length":
            body, far = bodies[d.model.model.body(k).name], 1.0 + x / d.model.reach[k]
            for item in [*body.bodies, *body.geoms]:
                item.pos = np.array(item.pos) * far
        elif field in ("friction", "damping", "armature"):
            joint, v = spec.joint(d.log.joints[k]), d.model.v_adr[k]
            name = {"friction": "frictionloss"}.get(field, field)
            value = max(float(getattr(d.model.model, f"dof_{name}")[v]) + x, 0.0)
            setattr(joint, name, [value, 0.0, 0.0] if np.ndim(getattr(joint, name)) else value)
        elif field == "mu":
            for geom in spec.geoms:
                geom.friction = np.array(geom.friction) * [max(1.0 + x, 0.02), 1.0, 1.0]
    write_text(path, _xml(spec, path))
    return path.name


def _change_mass(d: RobotDiagnosis, bodies: dict, field: str, k: int, x: float) -> None:
    """Change the mass of body ``k`` by ``x``, or the trunk's centre of mass along axis ``k``."""
    mj, b = d.model.model, k if field == "mass" else d.model.trunk
    body = bodies[mj.body(b).name]
    if not body.explicitinertial:
        body.mass, body.ipos, body.iquat = mj.body_mass[b], mj.body_ipos[b], mj.body_iquat[b]
        body.inertia, body.fullinertia, body.explicitinertial = mj.body_inertia[b], [np.nan] * 6, True
    if field == "com":
        ipos = np.array(body.ipos)
        ipos[k] += x
        body.ipos = ipos
        return
    factor = max(mj.body_mass[b] + x, 1e-4) / mj.body_mass[b]
    body.mass = body.mass * factor
    body.inertia, body.fullinertia = np.array(body.inertia) * factor, np.array(body.fullinertia) * factor


def _xml(spec: mujoco.MjSpec, path: Path) -> str:
    """A robot as MJCF; where it cannot be compiled, most often for meshes that are not here, with the replay's shapes.

    Raises:
        LogError: MuJoCo cannot simulate it.
    """
    try:
        with silent():
            return spec.to_xml()
    except Exception:
        try:
            with silent():
                for geom in [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_MESH]:
                    spec.delete(geom)
                for mesh in list(spec.meshes):
                    spec.delete(mesh)
                spec.compile()
                return spec.to_xml()
        except Exception as error:
            raise LogError(f"{path}: the corrections leave no robot that MuJoCo can simulate ({error})") from None


def _write_usd(d: RobotDiagnosis, change: dict[tuple[str, int], float], path: Path) -> str:
    """The source's stage, flattened, with the corrections that its attributes hold."""
    source = d.model.path
    asset = load_robot(robot=str(source)) if source.suffix else load_robot(robot=source.name)
    stage, mj = asset.stage, d.model.model
    root = stage.GetDefaultPrim().GetPath()

    def scale(prim: Any, name: str, factor: float) -> None:
        attribute = prim.GetAttribute(name)
        attribute.Set(attribute.Get() * factor)

    for (field, k), x in change.items():
        if field in ("mass", "com"):
            b = k if field == "mass" else d.model.trunk
            body = stage.GetPrimAtPath(root.AppendChild(d.model.body_name(b)))
            if field == "com":
                center = body.GetAttribute("physics:centerOfMass")
                value = center.Get()
                value[k] += x
                center.Set(value)
                continue
            for name in ("physics:mass", "physics:diagonalInertia"):
                scale(body, name, max(mj.body_mass[b] + x, 1e-4) / mj.body_mass[b])
        elif field == "armature":
            armature = max(float(mj.dof_armature[d.model.v_adr[k]]) + x, 1e-5)
            _joint(stage, d.log.joints[k]).GetAttribute("newton:armature").Set(armature)
        elif field == "coil":
            _weaken_coil(asset, d.log.joints[k], max(1.0 + x, 0.0))
        elif field == "coil_lag":
            lag = _drive(asset, d.log.joints[k]).GetAttribute("newton:mr:coil_time_constant")
            lag.Set(lag.Get() + x)
        elif field in OF_DRIVES:
            _correct_drive(asset, d, field, k, x)
    _rub(stage, d, change)
    save_checked(stage.Flatten(), path)
    return path.name


OF_DRIVES = {
    "kp": ("kp", "kp_base"), "kd": ("kd",), "limit": ("maxEffort", "tau_limit"), "device": ("K1", "T_max"),
    "strength": ("kp", "kp_base", "kp_low", "kd", "maxEffort", "tau_limit"),
}  # fmt: skip
"""Attributes of a drive, by the field that changes them."""


def _correct_drive(asset: RobotAsset, d: RobotDiagnosis, field: str, j: int, x: float) -> None:
    """Change a drive's numbers by a factor, or its limit to a share of the most that the log asks for."""
    for attribute in _drive(asset, d.log.joints[j]).GetAttributes():
        if attribute.GetName().rpartition(":")[2] in OF_DRIVES[field]:
            whole = min(attribute.Get(), float(d.model.asked[j])) if field == "limit" else attribute.Get()
            attribute.Set(whole * (1.0 + x))


def _weaken_coil(asset: RobotAsset, joint: str, share: float) -> None:
    """A coil that gets a share of its current: the laws' numbers per ampere; without any the device holds nothing."""
    drive = _drive(asset, joint)
    factors = {"K1": share, "I1": share, **({"T_max": 0.0} if share < 0.05 else {"K": 1.0 / share})}
    for name, factor in factors.items():
        attribute = drive.GetAttribute(f"newton:mr:{name}")
        attribute.Set(max(attribute.Get() * factor, 1e-6) if name == "T_max" else attribute.Get() * factor)


def _rub(stage: Usd.Stage, d: RobotDiagnosis, change: dict[tuple[str, int], float]) -> None:
    """Give the joints the dry friction and damping of the replay, with their corrections."""
    mj = d.model.model
    for j, joint in enumerate(d.log.joints):
        v = d.model.v_adr[j]
        degree = math.pi / 180.0 if mj.jnt_type[mj.dof_jntid[v]] == mujoco.mjtJoint.mjJNT_HINGE else 1.0
        for field, of, per in (("friction", "frictionloss", 1.0), ("damping", "damping", degree)):
            value = float(getattr(mj, f"dof_{of}")[v]) + change.get((field, j), 0.0)
            value += change.get(("drag", j), 0.0) if field == "friction" else 0.0
            _joint(stage, joint).GetAttribute(f"newton:{field}").Set(max(value, 0.0) * per)


def _drive(asset: RobotAsset, joint: str) -> Usd.Prim:
    return asset.stage.GetPrimAtPath(next(a.prim_path for a in asset.actuators if a.joint == joint))


def _joint(stage: Usd.Stage, joint: str) -> Usd.Prim:
    return stage.GetPrimAtPath(stage.GetDefaultPrim().GetPath().AppendPath(f"joints/{joint}"))
