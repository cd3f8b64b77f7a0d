"""MR devices put onto joints of a robot's USD file."""

from __future__ import annotations

import fnmatch
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pxr import Sdf, Usd

from mrwarp.model_file import Model
from mrwarp.params import MrParams
from mrwarp.robots.write_robot import save_checked
from mrwarp.usd.asset import RobotAsset, load_robot
from mrwarp.usd.open_stage import SCHEMA, AssetError
from mrwarp.usd.record import LAW, PD, PREFIX, RECORD, record_text

MOTOR_SCHEMAS = ("NewtonPDControlAPI", "NewtonMaxEffortClampingAPI")

KP_LOW = 5.0 / 35.0
"""Share of Kp while the device holds: the paper's 5 of 35 N·m/rad (section 7)."""


def fit_device(
    file: Path,
    out: Path,
    patterns: Sequence[str],
    model: Model | None,
    *,
    remove: bool = False,
    extrapolate: bool = False,
) -> RobotAsset:
    """Change the drives of joints, write the file, and load it.

    Args:
        file: Robot with a layout of its own.
        out: File to write.
        patterns: Joints, by names that may hold * and ?.
        model: The device; None is the paper's.
        remove: Take devices off.
        extrapolate: As in :meth:`mrwarp.model_file.Model.to_params`.

    Raises:
        AssetError: the file cannot be used, or a pattern names no joint.
    """
    asset = load_robot(robot=str(file))
    names = [a.joint for a in asset.actuators]
    for pattern in patterns:
        if not fnmatch.filter(names, pattern):
            raise AssetError(f"{file}: no joint is called {pattern}; choose among {', '.join(names)}")
    layer = Sdf.Layer.OpenAsAnonymous(str(file))
    stage = Usd.Stage.Open(layer)
    for actuator in asset.actuators:
        if not any(fnmatch.fnmatchcase(actuator.joint, pattern) for pattern in patterns):
            continue
        prim = stage.GetPrimAtPath(actuator.prim_path)
        for name in [p.GetName() for p in prim.GetProperties() if p.GetName().startswith(PREFIX)] + [RECORD, *PD]:
            prim.RemoveProperty(name)
        for schema in (SCHEMA, *MOTOR_SCHEMAS):
            prim.RemoveAppliedSchema(schema)
        if remove:
            for schema in MOTOR_SCHEMAS:
                prim.AddAppliedSchema(schema)
            for name, value in zip(PD, (actuator.kp, actuator.kd, actuator.tau_limit), strict=True):
                prim.CreateAttribute(name, Sdf.ValueTypeNames.Float, custom=False).Set(value)
            continue
        own = MrParams()
        motor = replace(
            own.motor, kp_base=actuator.kp, kp_low=KP_LOW * actuator.kp, kd=actuator.kd, tau_limit=actuator.tau_limit
        )
        neutral = asset.layout.neutral[actuator.joint]
        own = replace(own, motor=motor, bouc_wen=replace(own.bouc_wen, q_neutral=neutral))
        params = own if model is None else model.to_params(own, extrapolate=extrapolate)
        prim.AddAppliedSchema(SCHEMA)
        for name, value in params:
            prim.CreateAttribute(PREFIX + name, Sdf.ValueTypeNames.Double, custom=False).Set(value)
        if model is not None:
            prim.CreateAttribute(RECORD, Sdf.ValueTypeNames.String).Set(record_text(model, params))
            if model.law is not None:
                prim.CreateAttribute(LAW, Sdf.ValueTypeNames.String, custom=False).Set(model.law.name)
    return save_checked(layer, out)
