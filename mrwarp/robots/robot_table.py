"""A robot as legged tasks see it, as a table, with the guesses and how to say them otherwise."""

from __future__ import annotations

import math
from collections.abc import Iterator

from pxr import Usd, UsdGeom

from mrwarp.usd.asset import RobotAsset, masses
from mrwarp.usd.robot import MR_GO
from mrwarp.usd.robot_layout import NO_LIMIT, WEIGHTLESS, read_notes

MIRROR = 0.2
"""How far a leg's mirror image may be from another leg that it mirrors, as a share of the feet's distance from the
middle."""


def layout_lines(asset: RobotAsset, *, guesses: bool = True) -> Iterator[str]:
    """Trunk, legs to the foot with stance, limits, gains and devices, joints of no leg, and what was guessed.

    Args:
        asset: The robot.
        guesses: Whether the table ends with :func:`guess_lines`.
    """
    layout, drives = asset.layout, {a.joint: a for a in asset.actuators}
    base = asset.stage.GetDefaultPrim().GetPath()
    total, devices = masses(asset), sum(a.mr is not None for a in asset.actuators)
    mass, own = sum(total.values()), total[layout.trunk]
    what = f"{mass:.2f} kg, trunk {layout.trunk} ({own:.2f} kg), {len(layout.legs)} legs"
    if not layout.legs and asset.stage.GetPrimAtPath(base.AppendChild(layout.trunk)).HasAttribute(WEIGHTLESS):
        what = f"{mass - own:.2f} kg on {layout.trunk}, which stands still, 0 legs"
    elif not layout.legs:
        what = f"{mass:.2f} kg, {mass - own:.2f} kg of it on {layout.trunk} ({own:.2f} kg), which stands still, 0 legs"
    yield f"{asset.path.name}: {what}, {len(layout.joints)} joints, {devices} MR devices"
    width = max(len(name) for name in layout.joints)
    head = f"{'joint':{width}s}  {'leg':8s} {'stance':>8s} {'limits [rad]':>16s}"
    yield f"{head} {'Kp':>7s} {'Kd':>6s} {'max N·m':>8s} {'rotor':>8s}  drive"
    legs = [(leg.name, joint) for leg in layout.legs for joint in leg.joints]
    named, bare = {joint for _, joint in legs}, list[str]()
    for leg, joint in [*legs, *(("-", joint) for joint in layout.joints if joint not in named)]:
        prim, drive = asset.stage.GetPrimAtPath(base.AppendPath(f"joints/{joint}")), drives[joint]
        low, high = (math.radians(prim.GetAttribute(f"physics:{which}Limit").Get()) for which in ("lower", "upper"))
        limits = f"{low:.2f} to {high:.2f}" if high - low < math.radians(2.0 * NO_LIMIT) - 1e-3 else "none"
        device = "motor" if drive.mr is None else f"MR device, {drive.mr.coil.current_max:g} A"
        if drive.mr is not None and layout.leg_of(joint) < 0:
            device, bare = f"{device}, no gates", [*bare, joint]
        yield (
            f"{joint:{width}s}  {leg:8s} {layout.neutral[joint]:8.3f} {limits:>16s} {drive.kp:7.4g} {drive.kd:6.3g} "
            f"{drive.tau_limit:8.4g} {prim.GetAttribute('newton:armature').Get() or 0.0:8.3g}  {device}"
        )
    rails = asset.stage.GetPrimAtPath(base.AppendChild("rails"))
    for rail in rails.GetChildren() if rails else []:
        yield f"rail {rail.GetName()}, which nothing drives; the ground is at z = 0 of the file"
    spheres = {p.GetName(): p for p in asset.stage.Traverse() if p.GetTypeName() == "Sphere"}
    feet = {leg.name: spheres[leg.foot] for leg in layout.legs}
    places = _places(asset, feet)
    for leg in layout.legs:
        foot, x, y = feet[leg.name], *places[leg.name]
        many = {other.name for other in layout.legs if len(other.joints) == len(leg.joints)}
        distances = {name: math.dist((x, -y), at) for name, at in places.items() if name in many and y * at[1] < 0.0}
        twin = min(distances, key=lambda name: distances[name], default=None)
        mirror = f"mirrors {twin}" if twin and distances[twin] < MIRROR * abs(y) else "mirrors no other leg"
        yield (
            f"foot of {leg.name}: {leg.foot} on {foot.GetParent().GetName()}, radius "
            f"{1e3 * foot.GetAttribute('radius').Get():.0f} mm{', and its whole sole' if leg.sole else ''}; "
            f"{'left' if y > 0.0 else 'right'}, {mirror}; phase {leg.phase:g} of the gait"
        )
    if not devices and layout != MR_GO:
        yield f"no MR devices: 'mrwarp robot fit-device {asset.path} --joint JOINT ...' puts them on"
    if bare:
        why = "no foot of a leg hangs below" if layout.legs else "there are no legs, so no foot loads"
        yield (
            f"no gates: {why} {', '.join(bare[:3])}{' and others' if bare[3:] else ''}; the coil gets its current all "
            "the time, and the device holds wherever the joint is slow"
        )
    if guesses:
        yield from guess_lines(asset)


def guess_lines(asset: RobotAsset) -> Iterator[str]:
    """Guesses of the import, first what would change the robot most."""
    if notes := read_notes(asset.stage):
        yield "guessed where the file is silent, first what would change the robot most [how good the guess is]:"
    for note in notes:
        yield f"note: {note}"


def _places(asset: RobotAsset, feet: dict[str, Usd.Prim]) -> dict[str, tuple[float, float]]:
    """Where each foot is relative to the trunk [m], forwards and to the left, as the file's bodies are placed."""
    cache, trunk = UsdGeom.XformCache(), asset.layout.trunk
    body = asset.stage.GetPrimAtPath(asset.stage.GetDefaultPrim().GetPath().AppendChild(trunk))
    own = cache.GetLocalToWorldTransform(body).GetInverse()
    points = {
        name: own.Transform(cache.GetLocalToWorldTransform(prim).ExtractTranslation()) for name, prim in feet.items()
    }
    return {name: (point[0], point[1]) for name, point in points.items()}
