"""What legged tasks know of a robot, as a table."""

from __future__ import annotations

import math
from collections.abc import Iterator

from mrwarp.robots.write_robot import NO_LIMIT
from mrwarp.usd.asset import RobotAsset, masses


def layout_lines(asset: RobotAsset) -> Iterator[str]:
    """Trunk, legs from the trunk to the foot with stance, limits, gains and devices, and joints of no leg."""
    layout, drives = asset.layout, {a.joint: a for a in asset.actuators}
    base = asset.stage.GetDefaultPrim().GetPath()
    total, devices = masses(asset), sum(a.mr is not None for a in asset.actuators)
    yield (
        f"{asset.path.name}: {sum(total.values()):.2f} kg, trunk {layout.trunk} ({total[layout.trunk]:.2f} kg), "
        f"{len(layout.legs)} legs, {len(layout.joints)} joints, {devices} MR devices"
    )
    width = max(len(name) for name in layout.joints)
    head = f"{'joint':{width}s}  {'leg':8s} {'stance':>8s} {'limits [rad]':>16s}"
    yield f"{head} {'Kp':>7s} {'Kd':>6s} {'max N·m':>8s}  drive"
    legs = [(leg.name, joint) for leg in layout.legs for joint in leg.joints]
    named = {joint for _, joint in legs}
    for leg, joint in [*legs, *(("-", joint) for joint in layout.joints if joint not in named)]:
        prim, drive = asset.stage.GetPrimAtPath(base.AppendPath(f"joints/{joint}")), drives[joint]
        low, high = (math.radians(prim.GetAttribute(f"physics:{which}Limit").Get()) for which in ("lower", "upper"))
        limits = f"{low:.2f} to {high:.2f}" if high - low < math.radians(2.0 * NO_LIMIT) - 1e-3 else "none"
        device = "motor" if drive.mr is None else f"MR device, {drive.mr.coil.current_max:g} A"
        yield (
            f"{joint:{width}s}  {leg:8s} {layout.neutral[joint]:8.3f} {limits:>16s} {drive.kp:7.4g} {drive.kd:6.3g} "
            f"{drive.tau_limit:8.4g}  {device}"
        )
    for leg in layout.legs:
        foot = next(prim for prim in asset.stage.Traverse() if prim.GetName() == leg.foot)
        radius = foot.GetAttribute("radius").Get()
        yield (
            f"foot of {leg.name}: {leg.foot} on {foot.GetParent().GetName()}, radius {1e3 * radius:.0f} mm, "
            f"phase {leg.phase:g} of the gait"
        )
