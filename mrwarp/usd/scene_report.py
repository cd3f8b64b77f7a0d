"""Content of a USD asset, as text: joints and MR numbers, check of every variant, differences of two files."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pxr import Sdf, Usd

from mrwarp.params import MrParams
from mrwarp.usd.asset import RobotAsset, load_bench, load_robot, masses, variant_choices
from mrwarp.usd.open_stage import AssetError, open_stage
from mrwarp.usd.record import (
    LAW,
    PD,
    PREFIX,
    RECORD,
    PrimModel,
    authored_values,
    plain,
    read_model,
    record_difference,
    summary,
)
from mrwarp.usd.robot import MR_GO

if TYPE_CHECKING:
    from mujoco import MjModel

_UNITS = {
    "physics:lowerLimit": "deg",
    "physics:upperLimit": "deg",
    "physics:mass": "kg",
    "physics:diagonalInertia": "kg·m2",
    "physics:centerOfMass": "m",
    "newton:armature": "kg·m2",
    "newton:damping": "N·m·s/deg",
    "newton:friction": "N·m",
    "physics:localPos0": "m",
    "physics:localPos1": "m",
    "xformOp:translate": "m",
    "radius": "m",
    "height": "m",
}


def load_variants(file: Path, robot: str | None = None, payload: str | None = None) -> Iterator[RobotAsset]:
    """Load the asset in the given variants, ``None`` being all of them, ``mr_go`` first; the bench has one.

    Raises:
        AssetError: as :func:`mrwarp.usd.asset.load_robot`.
    """
    stage = open_stage(file)
    if stage.GetPrimAtPath(stage.GetDefaultPrim().GetPath().AppendPath("joints/bench_joint")):
        yield load_bench(file)
        return
    for name, chosen in (("robot", robot), ("payload", payload)):
        if chosen is not None and chosen not in (offered := variant_choices(stage, name)):
            raise AssetError(f"{name} = {chosen!r}; allowed: {', '.join(offered)}, the variants of {file}")
    robots = sorted(variant_choices(stage, "robot"), reverse=True) if robot is None else [robot]
    for name in robots:
        for load in sorted(variant_choices(stage, "payload")) if payload is None else [payload]:
            if not load.isdigit():
                raise AssetError(f"{file}: variant payload = {load!r} is not a whole number of kg; rename it")
            yield load_robot(file, robot=name, payload=int(load))


def label(asset: RobotAsset) -> str:
    """The variant choice as text; a robot with a layout of its own has none."""
    if asset.robot != "bench" and asset.layout != MR_GO:
        return str(asset.stage.GetDefaultPrim().GetName())
    return "bench" if asset.robot == "bench" else f"robot={asset.robot} payload={asset.payload:g}"


def check_asset(file: Path, convert: Callable[[RobotAsset], MjModel]) -> Iterator[str]:
    """Load and convert every variant; yields a line for each that is usable, and where numbers left their model.

    ``convert`` builds the MuJoCo model of an asset; any error it raises is about the file.

    Raises:
        AssetError: the first thing that is wrong.
    """
    notes: dict[str, dict[str, None]] = {}
    for asset in load_variants(file):
        for joint, held in models(asset).items():
            notes.setdefault(held.note(), {})[joint] = None
        total, devices = sum(masses(asset).values()), sum(a.mr is not None for a in asset.actuators)
        try:
            model = convert(asset)
        except AssetError:
            raise
        except Exception as error:  # any error of Newton and MuJoCo is about this file
            reason = " ".join(str(error).split()) or type(error).__name__
            raise AssetError(f"{file}: {label(asset)}: Newton cannot convert it: {reason}") from error
        yield (
            f"ok  {label(asset):24s} {len(asset.actuators)} joints, {devices} MR devices, {total:.7g} kg, "
            f"{model.nv} degrees of freedom in MuJoCo"
        )
    yield from (f"note  {', '.join(joints)}: {note}" for note, joints in notes.items() if note)


def models(asset: RobotAsset) -> dict[str, PrimModel]:
    """The model that each MR joint holds.

    Raises:
        AssetError: a record is unusable.
    """
    devices = [a for a in asset.actuators if a.mr is not None]
    return {a.joint: read_model(asset.stage.GetPrimAtPath(a.prim_path), asset.path) for a in devices}


def show_asset(asset: RobotAsset, full: bool = False) -> Iterator[str]:
    """Bodies, joints and MR numbers; a device whose numbers stand above already lists what differs.

    With ``full`` every number of every device is listed.
    """
    yield f"{min(str(asset.path), os.path.relpath(asset.path), key=len)}: {label(asset)}   (* differs from the default)"
    yield "\nbodies"
    bodies = masses(asset)
    for name, value in bodies.items():
        yield f"  {name:14s} {value:10.7g} kg"
    yield f"  {'total':14s} {sum(bodies.values()):10.7g} kg"
    yield "\njoints"
    first: dict[str, tuple[str, ...]] = {}
    origin: list[str] = []
    model, held = "", models(asset)
    for actuator in asset.actuators:
        prim = asset.stage.GetPrimAtPath(actuator.prim_path)
        kind = "MR + motor" if actuator.mr else "motor"
        given = zip(("kp", "kd", "limit"), (actuator.kp, actuator.kd, actuator.tau_limit), PD.values(), strict=True)
        gains = ", ".join(f"{name} {value:g} {spec.unit}" for name, value, spec in given)
        yield f"  {actuator.joint:12s} {kind:11s} {actuator.prim_path:26s} {gains}"
        if actuator.mr is None:
            continue
        lines = ["device: the paper's"] if actuator.is_paper_device else list(held[actuator.joint].lines())
        if lines != origin or full:
            yield from (f"    {line}" for line in lines or ["model: none"])
        rows = {spec.name: _row(prim, actuator.mr, spec.name, held[actuator.joint]) for spec in MrParams.specs()}
        listed = [name for name in rows if full or rows[name] != first.get(name)]
        if first and not full:
            yield f"    MR numbers as {model}{', except:' if listed else ''}"
        for name in listed:
            yield "    " + "  ".join(rows[name])
        if not first:
            first, model, origin = rows, actuator.joint, lines


def authored_at(item: Usd.Property) -> str:
    """Where the value of a property stands: ``class MRDevice``, or ``FL_calf in robot=mr_go``; with a foreign file."""
    spec = next(authored_values(item))
    path = spec.path.GetPrimPath()
    holder = spec.layer.GetPrimAtPath(path)
    text = f"{'class ' if holder.specifier == Sdf.SpecifierClass else ''}{path.StripAllVariantSelections().name}"
    sets = [p.GetVariantSelection() for p in path.GetPrefixes() if p.IsPrimVariantSelectionPath()]
    text += "".join(f" in {name}={choice}" for name, choice in sets)
    root = item.GetStage().GetRootLayer()
    return text if spec.layer == root else f"{text} in {spec.layer.GetDisplayName()}"


def unit_of(attribute: str) -> str:
    """Unit of an actuator's number."""
    return PD[attribute].unit if attribute in PD else MrParams.spec(attribute.removeprefix(PREFIX)).unit


def value_text(attribute: str, value: Any) -> str:
    """The value of an actuator's attribute with its unit; of a record, where the model comes from."""
    if attribute == RECORD:
        return summary(value)
    if attribute == LAW:
        return str(value)
    return "none" if value is None else f"{value:.10g} {unit_of(attribute)}"


def _row(prim: Usd.Prim, params: MrParams, name: str, held: PrimModel) -> tuple[str, ...]:
    """One MR number as text: name, value, unit, default, where it stands, source."""
    spec, value = MrParams.spec(name), params.to_dict()[name]
    mark = " " if value == spec.default else "*"
    where = authored_at(prim.GetAttribute(PREFIX + name))
    source = spec.source if mark == " " else f"this file (default: {spec.source})"
    if name in held.changed:
        source = f"this file; {held.changed[name]:.10g} when the model was applied"
    elif held.applied and name in held.applied.parameters:
        ci95 = held.applied.parameters[name].ci95
        source = f"model; 95 % interval {ci95[0]:.4g} to {ci95[1]:.4g}" if ci95 else "model; no interval"
    number = f"{mark} {value:<15.10g}"
    return f"{name:19s}", number, f"{spec.unit:12s}", f"default {spec.default:<15.10g}", f"{where:24s}", source


def diff_assets(a: Path, b: Path) -> list[str]:
    """Every number, relation and prim of the variants that differs, one line each; empty when there is none.

    Where a prim is of another kind, what only one kind has is left out.

    Raises:
        AssetError: a file is not usable.
    """
    left = {label(asset): _contents(asset) for asset in load_variants(a)}
    right = {label(asset): _contents(asset) for asset in load_variants(b)}
    lines = [f"variant {name}: only in {a if name in left else b}" for name in sorted(left.keys() ^ right.keys())]
    shared = [name for name in left if name in right]
    found: dict[str, list[str]] = {}
    for name in shared:
        for key in sorted(left[name] | right[name]):
            old, new = left[name].get(key), right[name].get(key)
            other_kind = left[name].get((key[0], "")) != right[name].get((key[0], ""))
            if old != new and not (other_kind and key[1] and None in (old, new)):
                line = _difference(*key, old, new)
                if key[1] == RECORD:
                    line = f"{key[0]} {RECORD}: {record_difference(old, new, (f'{a}: {key[0]}', f'{b}: {key[0]}'))}"
                found.setdefault(line, []).append(name)
    for line, names in found.items():
        lines.append(line if len(names) == len(shared) else f"{line}   [{'; '.join(names)}]")
    return lines


def _contents(asset: RobotAsset) -> dict[tuple[str, str], Any]:
    """Value of every authored property of the composed robot, by prim path below the root and property name."""
    root = asset.stage.GetDefaultPrim().GetPath()
    masses(asset)
    found: dict[tuple[str, str], Any] = {}
    for prim in asset.stage.Traverse():
        where = str(prim.GetPath().MakeRelativePath(root))
        found[where, ""] = f"{prim.GetTypeName()} {', '.join(sorted(prim.GetAppliedSchemas()))}".strip()
        found.update({(where, item.GetName()): plain(item) for item in prim.GetAuthoredProperties()})
    return found


def _difference(where: str, name: str, old: Any, new: Any) -> str:
    """One line of a difference: place, values and unit."""
    unit = unit_of(name) if (name.startswith(PREFIX) and name != LAW) or name in PD else _UNITS.get(name, "")
    before, after = (
        "none" if value is None else f"{value:.10g}" if isinstance(value, float) else str(value) for value in (old, new)
    )
    return f"{where}{' ' + name if name else ''}: {before} -> {after} {unit}".rstrip()
