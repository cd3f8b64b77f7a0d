"""Dry friction that grows with the control input: ``F1*|u|*s``, s as of Coulomb friction.

The control input u presses the rubbing parts together: a load that a gear carries, the pressure behind a seal. It
brakes whatever the sign of u, where the hysteresis of eq. 14 with ``K1*I`` would drive for a load that changes sign.
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
def load_friction_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """Dry friction grows with the size of the current."""
    if values[row, at] != 0.0:
        direction = dry_direction(s, values[row, at + 1], memory, line, slot)
        s.torque = s.torque + values[row, at] * wp.abs(s.current) * direction
    return s


LAW = EffectLaw(
    name="load_friction",
    title="friction that grows with the current",
    sentence="Dry friction grows with the size of the current.",
    equation="F1*|I|*s, ds/dt = qd/(v*5 ms), |s| <= 1",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="F1", unit="N·m/A", scale=(0, -1, 1), resolution=DRY_FRICTION_RESOLUTION),
        DRY_FRICTION_SPEED,
    ),
    law=load_friction_law,
    states=1,
    source="load-dependent friction of gears (Duclusaud et al. 2025) and of seals under pressure",
    depends_on=("qd", "current"),
    remedy="check lubrication and preload; in a gear or a seal it belongs to the device",
)
