"""Where a robot's layout stands in its USD file: legs as scopes, the neutral stance at the joints.

::

    def Scope "legs"
    {
        rel mrwarp:trunk = </robot/base>
        def Scope "LF"                                  # in the order of the legs
        {
            rel mrwarp:joints = [</robot/joints/LF_HAA>, </robot/joints/LF_HFE>, </robot/joints/LF_KFE>]
            rel mrwarp:foot = </robot/LF_SHANK/LF_foot>  # a sphere
            double mrwarp:phase = 0                      # offset on the gait clock, 0 to 1
            bool mrwarp:sole = 1                         # optional: all shapes of the foot's body bear its load
        }
    }

and ``double mrwarp:neutral`` [deg] on every driven joint; ``string[] mrwarp:notes`` on the robot, what was guessed.
A file without the scope has the layout of the shipped robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

from pxr import Sdf, Usd

from mrwarp.usd.open_stage import AssetError
from mrwarp.usd.robot import MR_GO, Layout, Leg

SCOPE = "legs"

NO_LIMIT = 7200.0
"""Limit of a joint that turns freely [deg]."""

NOTES = "mrwarp:notes"
"""Attribute of the default prim."""

WEIGHTLESS = "mrwarp:weightless"
"""Attribute of a trunk that stands still and whose mass the robot's file does not give: its own mass says nothing."""


def read_layout(stage: Usd.Stage, file: Path) -> Layout:
    """The layout that a stage holds.

    Raises:
        AssetError: a leg lacks joints, foot or phase, or a joint its neutral angle.
    """
    root = stage.GetDefaultPrim()
    scope = root.GetChild(SCOPE)
    if not scope:
        return MR_GO
    legs = tuple(_leg(prim, file) for prim in scope.GetChildren())
    trunk = _targets(scope, "mrwarp:trunk", file, 1)[0].name
    joints = [joint for leg in legs for joint in leg.joints]
    if twice := next((joint for joint in joints if joints.count(joint) > 1), None):
        raise AssetError(f"{file}: {scope.GetPath()}: joint {twice} stands in two legs; leave it in one")
    there = [prim.GetName() for prim in root.GetChild("joints").GetChildren()] if root.GetChild("joints") else []
    neutral = {name: _neutral(root, name, file) for name in [*joints, *(name for name in there if name not in joints)]}
    return Layout(trunk=trunk, legs=legs, neutral=neutral)


def read_notes(stage: Usd.Stage) -> tuple[str, ...]:
    """Guesses and omissions of the import."""
    notes = stage.GetDefaultPrim().GetAttribute(NOTES)
    return tuple(notes.Get() or ()) if notes else ()


def add_note(stage: Usd.Stage, note: str) -> None:
    """Write one more note on a robot."""
    stage.GetDefaultPrim().CreateAttribute(NOTES, Sdf.ValueTypeNames.StringArray).Set([*read_notes(stage), note])


def write_layout(stage: Usd.Stage, layout: Layout, notes: Sequence[str] = ()) -> None:
    """Write a layout, and notes on it, into a stage whose joints and feet are there."""
    if notes:
        stage.GetDefaultPrim().CreateAttribute(NOTES, Sdf.ValueTypeNames.StringArray).Set(list(notes))
    root = stage.GetDefaultPrim().GetPath()
    scope = stage.DefinePrim(root.AppendChild(SCOPE), "Scope")
    scope.CreateRelationship("mrwarp:trunk").SetTargets([root.AppendChild(layout.trunk)])
    for leg in layout.legs:
        prim = stage.DefinePrim(scope.GetPath().AppendChild(leg.name), "Scope")
        prim.CreateRelationship("mrwarp:joints").SetTargets([root.AppendPath(f"joints/{name}") for name in leg.joints])
        foot = next(p.GetPath() for p in stage.Traverse() if p.GetName() == leg.foot and p.GetTypeName() == "Sphere")
        prim.CreateRelationship("mrwarp:foot").SetTargets([foot])
        prim.CreateAttribute("mrwarp:phase", Sdf.ValueTypeNames.Double).Set(leg.phase)
        if leg.sole:
            prim.CreateAttribute("mrwarp:sole", Sdf.ValueTypeNames.Bool).Set(True)
    for name, angle in layout.neutral.items():
        joint = stage.GetPrimAtPath(root.AppendPath(f"joints/{name}"))
        joint.CreateAttribute("mrwarp:neutral", Sdf.ValueTypeNames.Double).Set(round(math.degrees(angle), 6))


def _leg(prim: Usd.Prim, file: Path) -> Leg:
    phase = prim.GetAttribute("mrwarp:phase").Get()
    if not isinstance(phase, float) or not 0.0 <= phase < 1.0:
        raise AssetError(f"{file}: {prim.GetPath()}: mrwarp:phase = {phase}; allowed: a double from 0 to below 1")
    joints = tuple(path.name for path in _targets(prim, "mrwarp:joints", file, None))
    foot = _targets(prim, "mrwarp:foot", file, 1)[0]
    sole = prim.GetAttribute("mrwarp:sole").Get() is True
    return Leg(name=prim.GetName(), joints=joints, foot=foot.name, phase=phase, sole=sole)


def _targets(prim: Usd.Prim, name: str, file: Path, count: int | None) -> list[Sdf.Path]:
    targets = prim.GetRelationship(name).GetTargets() if prim.HasRelationship(name) else []
    gone = [target for target in targets if not prim.GetStage().GetPrimAtPath(target)]
    if not targets or gone or (count is not None and len(targets) != count):
        wanted = "one prim" if count == 1 else "prims, from the trunk to the foot"
        raise AssetError(
            f"{file}: {prim.GetPath()}: {name} = {[str(t) for t in targets]}; name {wanted} that are there"
        )
    return targets


def _neutral(root: Usd.Prim, name: str, file: Path) -> float:
    prim = root.GetStage().GetPrimAtPath(root.GetPath().AppendPath(f"joints/{name}"))
    value = prim.GetAttribute("mrwarp:neutral").Get() if prim else None
    if not isinstance(value, float) or not math.isfinite(value):
        where = f"{file}: {root.GetPath()}/joints/{name}"
        raise AssetError(f"{where}: mrwarp:neutral = {value}; give the neutral angle in degrees, a double")
    return math.radians(value)
