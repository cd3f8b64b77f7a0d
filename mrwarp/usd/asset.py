"""Robot and bench as USD: open a stage, pick variants, check every joint's drive; a model.json on the MR joints.

The files are edited by hand: what is missing, misspelt or out of range is refused by a message that says where.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd

from mrwarp.model_file import (
    HOLDING_NOTE,
    Effect,
    Model,
    ModelFileError,
    check_effects,
    load_model,
    not_known_note,
    silent_note,
)
from mrwarp.params import MrParams
from mrwarp.usd.open_stage import ASSETS, SCHEMA, AssetError, open_stage
from mrwarp.usd.record import LAW, PD, is_mr, plain, read_model, read_number, read_parameters
from mrwarp.usd.robot import MR_GO, CurrentShares, Layout
from mrwarp.usd.robot_layout import read_layout

COIL, COIL_NUMBER = "coil resistance", "coil_resistance"
"""A number of the device, as it is called in messages and in a model."""

ROBOT_SUFFIXES = (".usda", ".usdc", ".usd")
"""How a file of a robot of one's own ends."""


@dataclass(frozen=True, kw_only=True)
class JointActuator:
    """Drive of one joint: gains [N·m/rad, N·m·s/rad], motor torque limit [N·m], MR device (``None``: motor only)."""

    joint: str
    prim_path: str
    kp: float
    kd: float
    tau_limit: float
    mr: MrParams | None
    model: Model | None = None
    """The model that the device's numbers are of, see :mod:`mrwarp.usd.record`; None: numbers alone."""
    lost: str = ""
    """Why the prim's model cannot be read, if it cannot."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """Effects of the device's model."""
        return self.model.effects if self.model else ()

    @property
    def holding_measured(self) -> bool:
        """False where the holding law was neither measured nor stated: it follows from the sliding torque."""
        return self.model is None or self.model.holding_measured

    @property
    def not_known(self) -> tuple[str, ...]:
        """Numbers of the device that nobody measured or stated; nothing without a device."""
        if self.mr is None:
            return ()
        found = [name for name in (self.model.not_known if self.model else ()) if name != COIL]
        return (*([COIL] if self.mr.coil.coil_resistance == 0.0 else []), *found)

    @property
    def measured_current(self) -> tuple[float, float] | None:
        """Smallest and largest current that the device was measured with [A]; None: not known."""
        return self.model.fitted_on.current if self.model else None

    @property
    def is_paper_device(self) -> bool:
        """Whether the device is the paper's, number by number: sliding, holding and coil, without effects.

        The zeros of robot and bench are no part of it.
        """
        if self.mr is None or self.effects or self.lost:
            return False
        values, paper = self.mr.to_dict(), MrParams()
        names = [spec.name for spec in paper.specs() if spec.group in ("BoucWenParams", "HoldParams", "CoilParams")]
        zeros = ("q_neutral", "q_offset", "q_center")
        return all(values[name] == value for name, value in paper if name in names and name not in zeros)


@dataclass(frozen=True, kw_only=True)
class RobotAsset:
    """An opened, checked asset. ``actuators`` are in joint order; edits on ``stage`` never reach the file."""

    path: Path
    robot: str
    payload: float
    stage: Usd.Stage
    actuators: tuple[JointActuator, ...]
    layout: Layout = MR_GO
    """Trunk, legs, joints and neutral stance."""

    def __post_init__(self) -> None:
        masses(self)


def load_robot(path: str | Path | None = None, *, robot: str = "mr_go", payload: float = 0) -> RobotAsset:
    """Open the quadruped with one choice of variants and check it.

    Args:
        path: USD file; ``None`` is ``mr_go.usda`` of :data:`ASSETS`.
        robot: variant ``robot``: ``mr_go`` (MR calves) or ``go1`` (PD motors only); or a USD file in place of ``path``,
            such as ``mrwarp robot import`` writes, with its first variant.
        payload: mass on the back [kg]: that of a variant ``payload``, else the heaviest variant's body with this mass
            and its inertia in proportion; a robot's file without such a variant carries it in its trunk. A file without
            variant sets, as flattening leaves it, has one choice.

    Raises:
        AssetError: the file, a variant, a joint, an actuator or one of its numbers is not usable.
    """
    own = Path(robot).suffix in ROBOT_SUFFIXES
    if own and path is not None:
        raise AssetError(f"{path}: {robot} is a robot's file too; give one of --asset and --robot")
    file = Path(robot) if own else Path(path) if path is not None else ASSETS / "mr_go.usda"
    stage = open_stage(file)
    robot = variant_choices(stage, "robot")[0] if own else robot
    loads = variant_choices(stage, "payload")
    load = f"{payload:g}"
    if own and payload > 0.0 and loads == ["0"]:
        load = loads[0]
    elif load not in loads and payload > 0.0 and loads != ["0"]:
        load = max(loads, key=_kilograms)
    for name, choice in (("robot", robot), ("payload", load)):
        root, offered = stage.GetDefaultPrim(), variant_choices(stage, name)
        if choice not in offered:
            raise AssetError(f"{file}: {root.GetPath()}: no variant {name} = {choice!r}; allowed: {', '.join(offered)}")
        if root.GetVariantSets().HasVariantSet(name):
            root.GetVariantSet(name).SetVariantSelection(choice)
    layout = read_layout(stage, file)
    if load != f"{payload:g}":
        _weigh(stage, file, payload, layout.trunk if loads == ["0"] else None)
    found = _actuators(stage, file, layout.joints, layout.neutral)
    return RobotAsset(path=file, robot=robot, payload=payload, stage=stage, actuators=found, layout=layout)


def _kilograms(variant: str) -> float:
    """Mass of a payload variant [kg] by its name; a name that is no number counts as none."""
    try:
        return float(variant)
    except ValueError:
        return 0.0


def _weigh(stage: Usd.Stage, file: Path, mass: float, trunk: str | None) -> None:
    """Give the payload's body a mass [kg], or the trunk so much more; the inertia in proportion."""
    path = stage.GetDefaultPrim().GetPath().AppendPath(trunk or "payload")
    body = stage.GetPrimAtPath(path)
    own, inertia = (body.GetAttribute(f"physics:{name}") for name in ("mass", "diagonalInertia"))
    before = own.Get() if own else None
    if not before or before <= 0.0:
        raise AssetError(f"{file}: {path}: there is no body with physics:mass above 0; it carries the payload")
    mass += before if trunk else 0.0
    if inertia and inertia.Get() is not None:
        inertia.Set(inertia.Get() * (mass / before))
    own.Set(mass)


def most_current(actuators: Sequence[JointActuator]) -> float:
    """Largest current that a device takes [A]; infinite without devices."""
    return max((a.mr.coil.current_max for a in actuators if a.mr), default=math.inf)


def check_currents(actuators: Sequence[JointActuator], currents: Sequence[float]) -> None:
    """Refuse currents that the coils' controllers would cut down to their own maximum.

    A coil of 0 A next to others is a broken wire: it takes none, regardless of the others' currents.

    Raises:
        AssetError: one is larger than a device's ``current_max``.
    """
    devices = [a for a in actuators if a.mr is not None]
    alive = [a for a in devices if a.mr is not None and a.mr.coil.current_max > 0.0]
    for a in alive or devices:
        if a.mr is not None and max(currents) > a.mr.coil.current_max:
            raise AssetError(
                f"--current {max(currents):g}: {a.joint} takes 0 to {a.mr.coil.current_max:g} A; give currents up to "
                "that, or an --asset with another current_max ('mrwarp asset apply --extrapolate')"
            )


def taken_currents(
    actuators: Sequence[JointActuator], currents: Sequence[float], default: Sequence[float]
) -> tuple[float, ...]:
    """The currents to use, each once: a command's ``default`` stands for shares of the largest that the coils take.

    Raises:
        AssetError: others are larger than that, see :func:`check_currents`.
    """
    most = min((a.mr.coil.current_max for a in actuators if a.mr and a.mr.coil.current_max > 0.0), default=math.inf)
    currents = tuple(dict.fromkeys(currents))
    if currents == tuple(default) and most not in (max(currents), math.inf):
        currents = tuple(dict.fromkeys(CurrentShares(default).of(most)))
        print(f"note: shares of the devices' {most:g} A: {', '.join(f'{i:.4g}' for i in currents)} A")
    check_currents(actuators, currents)
    return currents


def load_bench(path: str | Path | None = None) -> RobotAsset:
    """Open the one-joint torque bench (``mr_bench.usda``) and check it; raises as :func:`load_robot`."""
    file = Path(path) if path is not None else ASSETS / "mr_bench.usda"
    stage = open_stage(file)
    found = _actuators(stage, file, ("bench_joint",), {})
    return RobotAsset(path=file, robot="bench", payload=0, stage=stage, actuators=found)


def with_model(asset: RobotAsset, model: Model | str | Path, *, extrapolate: bool = False) -> RobotAsset:
    """The asset with the numbers and effects of a model on every MR joint, in place of its own.

    What the model does not hold (neutral angle, gates, motor) stays each joint's. ``extrapolate`` as in
    :meth:`mrwarp.model_file.Model.to_params`.

    Raises:
        ModelFileError: it cannot be used, or no joint of the asset has a device.
    """
    name = model.fitted_on.source if isinstance(model, Model) else str(model)
    model = model if isinstance(model, Model) else load_model(model)
    if not any(actuator.mr for actuator in asset.actuators):
        raise ModelFileError(f"{name}: robot {asset.robot!r} has no MR joint to take the model; leave the model out")
    model.check_joint()
    check_effects(model.effects, name)
    return replace(
        asset,
        actuators=tuple(
            a
            if a.mr is None
            else _mr_joint(a.joint, a.prim_path, model.to_params(a.mr, extrapolate=extrapolate), model)
            for a in asset.actuators
        ),
    )


def _mr_joint(joint: str, path: str, mr: MrParams, model: Model | None, lost: str = "") -> JointActuator:
    """A joint with a device, whose parameters hold the motor's gains too."""
    gains = {"kp": mr.motor.kp_base, "kd": mr.motor.kd, "tau_limit": mr.motor.tau_limit}
    return JointActuator(joint=joint, prim_path=path, mr=mr, model=model, lost=lost, **gains)


def not_known(actuators: Sequence[JointActuator]) -> list[str]:
    """Numbers that are not known of one device or another, for ``result.json``."""
    return list(dict.fromkeys(name for a in actuators for name in a.not_known))


def device_lines(actuators: Sequence[JointActuator]) -> Iterator[str]:
    """Notes for a user on the devices, a line each: effects that act or do not, what was not measured or stated."""
    joints_of: dict[str, list[str]] = {}
    for a in actuators:
        for line in _device_lines(a):
            joints_of.setdefault(line, []).append(a.joint)
    yield from (line.replace("{}", ", ".join(joints)) for line, joints in joints_of.items())


def _device_lines(a: JointActuator) -> Iterator[str]:
    """The lines of one device, with ``{}`` where the joint's name belongs; none of a motor."""
    if a.mr is not None and a.model is not None:
        if acting := [str(effect) for effect in a.effects if effect.acts]:
            yield f"effects on {{}}: {'; '.join(acting)}"
        if note := silent_note(a.effects):
            yield f"note: {note}"
        top = a.mr.coil.current_max
        if not a.holding_measured:
            torque = a.mr.hold.yield_torque(top)
            yield f"{HOLDING_NOTE}; {{}} yields at {torque:.3g} N·m with {top:.3g} A"
        if a.measured_current and top > a.measured_current[1]:
            yield f"warning: {{}} was measured up to {a.measured_current[1]:.4g} A; more is a guess"
    if note := not_known_note(a.not_known, "{}"):
        yield note


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


def masses(asset: RobotAsset) -> dict[str, float]:
    """Mass of every body [kg].

    Raises:
        AssetError: a mass is missing, or a mass or an inertia is not that of a body.
    """
    found: dict[str, float] = {}
    for prim in asset.stage.Traverse():
        if "PhysicsRigidBodyAPI" not in prim.GetAppliedSchemas():
            continue
        attribute = prim.GetAttribute("physics:mass")
        value = plain(attribute) if attribute and attribute.HasAuthoredValue() else None
        if not isinstance(value, float) or not 0.0 < value < math.inf:
            text = "is missing" if value is None else f"= {value} is not a positive number"
            raise AssetError(f"{asset.path}: {prim.GetPath()}: physics:mass {text}; state a mass above 0 kg")
        inertia = prim.GetAttribute("physics:diagonalInertia").Get()
        if inertia is not None and not _is_inertia(inertia):  # Newton would quietly correct it
            raise AssetError(
                f"{asset.path}: {prim.GetPath()}: physics:diagonalInertia = {inertia} is no body's; "
                "state three numbers above 0 kg·m2, none larger than the sum of the others"
            )
        found[prim.GetName()] = value
    return found


def _is_inertia(value: Any) -> bool:
    """Whether a value, which USD may have let be of any type, holds principal inertias of a body."""
    try:
        numbers = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        return False
    return numbers.shape == (3,) and bool(numbers.min() > 0.0 and 2.0 * numbers.max() <= numbers.sum() * (1.0 + 1e-6))


def _actuators(
    stage: Usd.Stage, file: Path, names: tuple[str, ...], neutral: Mapping[str, float]
) -> tuple[JointActuator, ...]:
    """Read the actuators of the named joints, in that order; ``neutral`` angles [rad] must lie within limits."""
    root = stage.GetDefaultPrim().GetPath()
    for name in names:
        prim = stage.GetPrimAtPath(f"{root}/joints/{name}")
        if not prim or prim.GetTypeName() != "PhysicsRevoluteJoint":
            raise AssetError(f"{file}: {root}/joints/{name}: revolute joint is missing; needed: {', '.join(names)}")
        _check_limits(prim, file, neutral.get(name))
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


def _check_limits(prim: Usd.Prim, file: Path, neutral: float | None) -> None:
    """Refuse limits that are exchanged, or that leave out a leg's neutral stance."""
    low, high = (prim.GetAttribute(f"physics:{which}Limit").Get() for which in ("lower", "upper"))
    where = f"{file}: {prim.GetPath()}: physics:lowerLimit = {low}, physics:upperLimit = {high} deg"
    if not isinstance(low, float) or not isinstance(high, float) or not low < high:
        raise AssetError(f"{where}: the lower one must be a number below the upper one; exchange or correct them")
    if neutral is not None and not low - 1e-4 <= math.degrees(neutral) <= high + 1e-4:
        stance = f"{math.degrees(neutral):.4g} deg"
        raise AssetError(f"{where}: the neutral stance of {prim.GetName()}, {stance}, lies outside; widen them")


def _actuator(prim: Usd.Prim, joint: str, file: Path) -> JointActuator:
    """Read one actuator prim: MR drive, or PD with torque limit."""
    path, schemas = str(prim.GetPath()), prim.GetPrimTypeInfo().GetAppliedAPISchemas()
    if is_mr(prim):
        mr = read_parameters(prim, file)
        try:
            held = read_model(prim, file)
            if held.applied and COIL_NUMBER not in held.model.parameters:  # files of earlier versions: the paper's
                mr = mr.replace(**{COIL_NUMBER: 0.0})
            return _mr_joint(joint, path, mr, held.model if held.applied else None)
        except AssetError as error:
            if prim.GetAttribute(LAW).HasAuthoredValue():  # its numbers without it would be another device
                raise
            return _mr_joint(joint, path, mr, None, lost=str(error))
    if not {"NewtonPDControlAPI", "NewtonMaxEffortClampingAPI"} <= set(schemas):
        allowed = f"allowed: {SCHEMA}, or NewtonPDControlAPI with NewtonMaxEffortClampingAPI"
        raise AssetError(f"{file}: {path}: apiSchemas = {list(schemas)}; {allowed}")
    kp, kd, limit = (read_number(prim, name, spec, file) for name, spec in PD.items())
    return JointActuator(joint=joint, prim_path=path, kp=kp, kd=kd, tau_limit=limit, mr=None)
