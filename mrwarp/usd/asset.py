"""Robot and bench as USD: open a stage, pick variants, check every number, read and write the MR parameters.

The files are edited by hand: what is missing, misspelt or out of range is refused by a message that says where.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdUtils

from mrwarp.model_file import Effect
from mrwarp.params import MrParams, ParameterError, ParamSpec
from mrwarp.usd.open_stage import ASSETS, SCHEMA, AssetError
from mrwarp.usd.robot import JOINTS
from mrwarp.usd.stage_trial import open_stage

PREFIX = "newton:mr:"
"""Namespace of the MR parameters in USD."""

PD = {f"newton:{n}": MrParams.spec(s) for n, s in (("kp", "kp_base"), ("kd", "kd"), ("maxEffort", "tau_limit"))}
"""What is known about the attributes of a plain motor."""
_NUMBER_TYPES = {"double", "float", "int"}


@dataclass(frozen=True, kw_only=True)
class JointActuator:
    """What drives one joint: gains [N·m/rad, N·m·s/rad], motor torque limit [N·m], MR device (``None``: motor only).

    The device's ``effects`` are those of the model that was applied to the prim, see :mod:`mrwarp.usd.record`.
    """

    joint: str
    prim_path: str
    kp: float
    kd: float
    tau_limit: float
    mr: MrParams | None
    effects: tuple[Effect, ...] = ()
    lost: str = ""
    """Why the prim's effects cannot be read, if they cannot."""


@dataclass(frozen=True, kw_only=True)
class RobotAsset:
    """An opened, checked asset. ``actuators`` are in joint order; edits on ``stage`` never reach the file."""

    path: Path
    robot: str
    payload: int
    stage: Usd.Stage
    actuators: tuple[JointActuator, ...]

    def save(self, path: str | Path) -> None:
        """Write the asset, with its variant choice and the edits made on ``stage``, to a new, self-contained file."""
        merged = Sdf.Layer.CreateAnonymous(".usda")
        merged.TransferContent(self.stage.GetSessionLayer())
        UsdUtils.StitchLayers(merged, self.stage.GetRootLayer())
        if not merged.Export(str(path)):
            raise AssetError(f"{path}: cannot be written")


def is_mr(prim: Usd.Prim) -> bool:
    """Whether :data:`SCHEMA` is applied to a prim, directly or through what it inherits."""
    return SCHEMA in prim.GetPrimTypeInfo().GetAppliedAPISchemas()


def load_robot(
    path: str | Path | None = None, *, robot: str = "mr_go", payload: int = 0, allow_external: bool = False
) -> RobotAsset:
    """Open the quadruped with one choice of variants and check it.

    Args:
        path: USD file; ``None`` is ``mr_go.usda`` of :data:`ASSETS`.
        robot: variant ``robot``: ``mr_go`` (MR calves) or ``go1`` (PD motors only).
        payload: variant ``payload`` [kg]: 0 or 3. A file without variant sets, as flattening leaves it, has one choice.
        allow_external: accept references, payloads and sublayers outside the file's folder.

    Raises:
        AssetError: the file, a variant, a joint, an actuator or one of its numbers is not usable.
    """
    file = Path(path) if path is not None else ASSETS / "mr_go.usda"
    stage = open_stage(file, allow_external)
    for name, choice in (("robot", robot), ("payload", str(payload))):
        root, offered = stage.GetDefaultPrim(), variant_choices(stage, name)
        if choice not in offered:
            raise AssetError(f"{file}: {root.GetPath()}: no variant {name} = {choice!r}; allowed: {', '.join(offered)}")
        if root.GetVariantSets().HasVariantSet(name):
            root.GetVariantSet(name).SetVariantSelection(choice)
    return RobotAsset(path=file, robot=robot, payload=payload, stage=stage, actuators=_actuators(stage, file, JOINTS))


def check_currents(actuators: Sequence[JointActuator], currents: Sequence[float]) -> None:
    """Refuse currents that the coils' controllers would cut down to their own maximum.

    Raises:
        AssetError: one is larger than a device's ``current_max``.
    """
    for a in actuators:
        if a.mr is not None and max(currents) > a.mr.coil.current_max:
            raise AssetError(
                f"--current {max(currents):g}: {a.joint} takes 0 to {a.mr.coil.current_max:g} A; give currents up to "
                "that, or an --asset with another current_max"
            )


def load_bench(path: str | Path | None = None, *, allow_external: bool = False) -> RobotAsset:
    """Open the one-joint torque bench (``mr_bench.usda``) and check it; raises as :func:`load_robot`."""
    file = Path(path) if path is not None else ASSETS / "mr_bench.usda"
    stage = open_stage(file, allow_external)
    found = _actuators(stage, file, ("bench_joint",))
    return RobotAsset(path=file, robot="bench", payload=0, stage=stage, actuators=found)


def read_parameters(prim: Usd.Prim, file: str | Path = "stage") -> MrParams:
    """Read and check the ``newton:mr:*`` attributes of one actuator prim.

    Raises:
        AssetError: an attribute is missing, misspelt, not a number or out of range.
    """
    where = f"{file}: {prim.GetPath()}"
    try:
        for attribute in prim.GetAuthoredPropertiesInNamespace(PREFIX.rstrip(":")):
            MrParams.spec(attribute.GetName().removeprefix(PREFIX), where)
        values = {spec.name: _number(prim, PREFIX + spec.name, spec, file) for spec in MrParams.specs()}
        return MrParams.from_dict(values, where)
    except ParameterError as error:
        raise AssetError(str(error).replace("MR parameter '", f"MR parameter '{PREFIX}")) from None


def write_parameters(prim: Usd.Prim, params: MrParams) -> None:
    """Author all parameters on an actuator prim, in double precision, at the stage's edit target.

    On the stage of a :class:`RobotAsset` that is the session layer: the file stays as it is (see ``RobotAsset.save``).

    Raises:
        AssetError: the prim is not an MR actuator.
    """
    if not is_mr(prim):
        raise AssetError(f"{prim.GetPath()}: {SCHEMA} is not applied; apply it, or choose variant robot = mr_go")
    for name, value in params:
        prim.CreateAttribute(PREFIX + name, Sdf.ValueTypeNames.Double, custom=False).Set(value)


def variant_choices(stage: Usd.Stage, name: str) -> list[str]:
    """The choices of variant set ``robot`` or ``payload``; without it (in a flattened file) the one that is there.

    Raises:
        AssetError: the set is there, but empty.
    """
    root = stage.GetDefaultPrim()
    if root.GetVariantSets().HasVariantSet(name):
        if names := root.GetVariantSet(name).GetVariantNames():
            return names
        file = stage.GetRootLayer().identifier
        raise AssetError(f"{file}: {root.GetPath()}: variant set {name!r} is empty; write its variants, or unlist it")
    if name == "robot":
        return ["mr_go" if any(is_mr(prim) for prim in stage.Traverse()) else "go1"]
    load = stage.GetAttributeAtPath(root.GetPath().AppendPath("payload.physics:mass"))
    return [f"{load.Get() or 0:g}" if load else "0"]


def _actuators(stage: Usd.Stage, file: Path, names: tuple[str, ...]) -> tuple[JointActuator, ...]:
    """Read the actuators of the named joints, in that order."""
    root = stage.GetDefaultPrim().GetPath()
    for name in names:
        prim = stage.GetPrimAtPath(f"{root}/joints/{name}")
        if not prim or prim.GetTypeName() != "PhysicsRevoluteJoint":
            raise AssetError(f"{file}: {root}/joints/{name}: revolute joint is missing; needed: {', '.join(names)}")
    found: dict[str, JointActuator] = {}
    for prim in stage.Traverse():
        if prim.GetTypeName() != "NewtonActuator":
            continue
        targets = prim.GetRelationship("newton:targets").GetTargets()
        joint = stage.GetPrimAtPath(targets[0]) if len(targets) == 1 else None
        if not joint or joint.GetPath().GetParentPath() != root.AppendChild("joints") or joint.GetName() not in names:
            raise AssetError(
                f"{file}: {prim.GetPath()}: newton:targets = {[str(t) for t in targets]} is not one joint; "
                f"allowed: one of {', '.join(names)} under {root}/joints"
            )
        if joint.GetName() in found:
            other = found[joint.GetName()].prim_path
            raise AssetError(f"{file}: {prim.GetPath()}: {joint.GetPath()} is driven by {other} already; remove one")
        found[joint.GetName()] = _actuator(prim, joint.GetName(), file)
    for name in names:
        if name not in found:
            where = f"{file}: {root}/actuators/{name}"
            raise AssetError(f"{where}: no NewtonActuator drives joint {name}; add one with newton:targets")
    return tuple(found[name] for name in names)


def _actuator(prim: Usd.Prim, joint: str, file: Path) -> JointActuator:
    """Read one actuator prim: MR drive, or PD with torque limit."""
    path, schemas = str(prim.GetPath()), prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    if is_mr(prim):
        mr = read_parameters(prim, file)
        kp, kd, limit = mr.motor.kp_base, mr.motor.kd, mr.motor.tau_limit
        effects, lost = _effects(prim, file)
        return JointActuator(
            joint=joint, prim_path=path, kp=kp, kd=kd, tau_limit=limit, mr=mr, effects=effects, lost=lost
        )
    if not {"NewtonPDControlAPI", "NewtonMaxEffortClampingAPI"} <= set(schemas):
        allowed = f"allowed: {SCHEMA}, or NewtonPDControlAPI with NewtonMaxEffortClampingAPI"
        raise AssetError(f"{file}: {path}: apiSchemas = {list(schemas)}; {allowed}")
    kp, kd, limit = (_number(prim, name, spec, file) for name, spec in PD.items())
    return JointActuator(joint=joint, prim_path=path, kp=kp, kd=kd, tau_limit=limit, mr=None)


def _effects(prim: Usd.Prim, file: Path) -> tuple[tuple[Effect, ...], str]:
    """Effects of the model that was applied to a prim, or why they cannot be read."""
    from mrwarp.usd.record import read_effects  # that file is built on this one

    try:
        return read_effects(prim, file), ""
    except AssetError as error:
        return (), str(error)


def _number(prim: Usd.Prim, name: str, spec: ParamSpec, file: str | Path) -> float:
    """The authored value of a numeric attribute, checked; a 32-bit value is read as its shortest decimal (23.7)."""
    attribute = prim.GetAttribute(name)
    where = f"{file}: {prim.GetPath()}"
    if not attribute or not attribute.HasAuthoredValue():
        raise AssetError(f"{where}: {name} is missing; {spec.allowed()}")
    opinion = next(s for s in attribute.GetPropertyStack() if s.HasDefaultValue() or s.HasInfo("timeSamples"))
    value: Any = opinion.default
    if opinion.HasInfo("timeSamples"):
        raise AssetError(f"{where}: {name} varies with time; author one value; {spec.allowed()}")
    # USD keeps a path or a list that stands in place of a number, whatever the attribute's type says
    if str(opinion.typeName) not in _NUMBER_TYPES or not isinstance(value, int | float):
        raise AssetError(f"{where}: {opinion.typeName} {name} = {value!r} is not a number; {spec.allowed()}")
    if str(opinion.typeName) == "float" and math.isfinite(value):
        value = float(str(np.float32(value)))
    try:
        return spec.check(value, where)
    except ParameterError:
        raise AssetError(f"{where}: {name} = {value:g} is out of range; {spec.allowed()}") from None
