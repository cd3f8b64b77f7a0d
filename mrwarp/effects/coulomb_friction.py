"""Coulomb friction: ``F*s``, s the direction of :func:`~mrwarp.effects.law.dry_direction`; at rest it stays."""

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
def coulomb_friction_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """Dry friction that does not depend on the speed."""
    if values[row, at] != 0.0:
        s.torque = s.torque + values[row, at] * dry_direction(s, values[row, at + 1], memory, line, slot)
    return s


LAW = EffectLaw(
    name="coulomb_friction",
    title="Coulomb friction",
    sentence="Dry friction that does not depend on the speed.",
    equation="F*s, ds/dt = qd/(v*5 ms), |s| <= 1",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="torque", unit="N·m", scale=(0, 0, 1), resolution=DRY_FRICTION_RESOLUTION),
        DRY_FRICTION_SPEED,
    ),
    law=coulomb_friction_law,
    adds=True,
    states=1,
    source="Coulomb; seals and bearings",
    depends_on=("qd",),
    mechanics=True,
    remedy="check seals and bearings",
    positive="friction brakes",
    dry=True,
)
