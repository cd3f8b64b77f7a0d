"""Dry friction that depends on the position: ``(F1*x + F2*x^2)*s``, ``x = q - q_0``.

A guide that is not straight, a cable that winds up, a rod that bends: what presses the rubbing parts together changes
along the way. q_0 is the angle where C of eq. 14 is at rest. At rest the friction stays what it was.
"""

import warp as wp

from mrwarp.effects.law import (
    DRY_FRICTION_RESOLUTION,
    DRY_FRICTION_SPEED,
    EffectLaw,
    EffectParameter,
    Path,
    dry_direction,
)


@wp.func
def position_friction_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """Dry friction changes along the stroke."""
    slope, bend = values[row, at], values[row, at + 1]
    if slope != 0.0 or bend != 0.0:
        x = s.q - s.zero
        s.torque = s.torque + x * (slope + bend * x) * dry_direction(s, values[row, at + 2], memory, line, slot)
    return s


LAW = EffectLaw(
    name="position_friction",
    title="friction that depends on the position",
    sentence="Dry friction changes along the stroke.",
    equation="(F1*x + F2*x^2)*s, x = q - q_0, ds/dt = qd/(v*5 ms), |s| <= 1",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="F1", unit="N·m/rad", scale=(-1, 0, 1), resolution=DRY_FRICTION_RESOLUTION),
        EffectParameter(name="F2", unit="N·m/rad²", scale=(-2, 0, 1), resolution=DRY_FRICTION_RESOLUTION),
        DRY_FRICTION_SPEED,
    ),
    law=position_friction_law,
    adds=True,
    states=1,
    source="Amontons' law, normal force along the path; Armstrong-Helouvry, Dupont and Canudas de Wit 1994",
    depends_on=("q", "qd"),
    remedy="align the guide; look for where it rubs",
    dry=True,
    needs="stroke",
)
