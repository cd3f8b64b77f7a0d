"""The extended robot: its description with the corrections of a verdict, and the corrections as data."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from mrwarp.robot_logs.causes.cause import Cause
from mrwarp.robot_logs.causes.edits import MjcfEdit, UsdEdit
from mrwarp.robot_logs.causes.parameter import Parameter
from mrwarp.robot_logs.replay_model import read_spec
from mrwarp.robot_logs.robot_log import LogError
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.robots.drives import Choices
from mrwarp.robots.foreign import RobotFileError
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from mrwarp.robots.write_robot import save_checked, write_checked
from mrwarp.run_dir import plain, write_text
from mrwarp.runtime import silent
from mrwarp.usd.asset import ROBOT_SUFFIXES, load_robot
from mrwarp.usd.open_stage import AssetError

SCHEMA = 1

Corrections = list[tuple[Parameter, float]]
"""Changes of named causes."""

WRITTEN = ("robot.xml", "robot.usda", "model.json")
"""Files that :func:`write_extended` may write."""


def write_extended(d: RobotDiagnosis, out: Path) -> tuple[list[str], list[str]]:
    """Write ``robot.xml`` or ``robot.usda`` (of a robot that walks both) and ``model.json``; returns names and notes.

    What a robot's file has no place for, such as a delay, stands in ``model.json`` alone.
    """
    change = [(p, float(x)) for p, x in zip(d.parameters, d.theta, strict=True) if x]
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
                    edit = UsdEdit(asset=asset, robot=d.model)
                    for p, x in change:
                        own = p.declared
                        if own.usd is not None and own.mjcf is None and p.field not in gains:
                            own.usd(edit, p.index, x)
                    _rub(edit, change)
                    save_checked(asset.stage, out / "robot.usda")
                    names.append("robot.usda")
        except (RobotFileError, AssetError, ValueError) as error:
            notes.append(f"no robot.usda: {error}")
    if "robot.usda" in names:
        absent = sorted({p.cause for p, _ in change if not _in_usd(p.declared, from_mjcf="robot.xml" in names)})
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


def _in_usd(cause: Cause, *, from_mjcf: bool) -> bool:
    """Whether ``robot.usda`` has a cause's correction, made of an MJCF or of a robot's own USD file."""
    return bool(cause.usd or cause.rubs or (from_mjcf and cause.mjcf and cause.read_back))


def _write_mjcf(d: RobotDiagnosis, change: Corrections, path: Path) -> str:
    """The source with the corrections, as MJCF; bodies state what was compiled of them."""
    spec = read_spec(d.model.path)
    for name in ("meshdir", "texturedir"):
        own = getattr(spec, name)
        setattr(spec, name, os.path.relpath(d.model.path.resolve().parent / own, path.resolve().parent))
    edit = MjcfEdit(spec=spec, robot=d.model)
    for p, x in change:
        if p.declared.mjcf is not None:
            p.declared.mjcf(edit, p.index, x)
    write_text(path, _xml(spec, path))
    return path.name


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


def _write_usd(d: RobotDiagnosis, change: Corrections, path: Path) -> str:
    """The source's stage, flattened, with the corrections that its attributes hold."""
    source = d.model.path
    edit = UsdEdit(asset=load_robot(robot=str(source) if source.suffix else source.name), robot=d.model)
    for p, x in change:
        if p.declared.usd is not None:
            p.declared.usd(edit, p.index, x)
    _rub(edit, change)
    save_checked(edit.stage.Flatten(), path)
    return path.name


def _rub(edit: UsdEdit, change: Corrections) -> None:
    """Give the joints the dry friction and damping of the replay, with their corrections."""
    mj = edit.robot.model
    for j, v in enumerate(edit.robot.v_adr):
        degree = math.pi / 180.0 if mj.jnt_type[mj.dof_jntid[v]] == mujoco.mjtJoint.mjJNT_HINGE else 1.0
        for name, of, per in (("friction", "frictionloss", 1.0), ("damping", "damping", degree)):
            value = float(getattr(mj, f"dof_{of}")[v])
            value += sum(x for p, x in change if p.declared.rubs == of and p.index == j)
            edit.joint(j).GetAttribute(f"newton:{name}").Set(max(value, 0.0) * per)
