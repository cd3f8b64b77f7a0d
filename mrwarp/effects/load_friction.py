"""Dry friction that grows with the control input: ``F1*|u + J*qdd|*s``, s as of Coulomb friction.

The control input u presses the rubbing parts together: a load that a gear carries, the pressure behind a seal. It
brakes for either sign of u, where the hysteresis of eq. 14 with ``K1*I`` would drive for a load that changes sign.
A gear carries what accelerates the load, too: J is the inertia behind it. Where friction is larger when the load is
driven than when it drives, as in Duclusaud's M5, the difference is ``I1*u`` of eq. 14: ``|u|*s`` where u brakes and
``-|u|*s`` where it drives is u itself.
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
        carried, inertia = float(s.current), values[row, at + 2]
        if inertia != 0.0:
            qdd = float(s.qdd)
            if s.held == 1:  # the simulator's step knows no acceleration: that of the step before
                qdd = wp.where(memory[line, slot + 2] == 1.0, (s.qd - memory[line, slot + 1]) / s.dt, 0.0)
                memory[line, slot + 1] = s.qd
                memory[line, slot + 2] = 1.0
            carried = carried + inertia * qdd
        s.torque = s.torque + values[row, at] * wp.abs(carried) * direction
    return s


LAW = EffectLaw(
    name="load_friction",
    title="friction that grows with the current",
    sentence="Dry friction grows with the size of the current.",
    equation="F1*|I + J*qdd|*s, ds/dt = qd/(v*5 ms), |s| <= 1",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="F1", unit="N·m/A", scale=(0, -1, 1), resolution=DRY_FRICTION_RESOLUTION),
        DRY_FRICTION_SPEED,
        EffectParameter(
            name="inertia",
            unit="A·s²/rad",
            scale=(-1, 1, 0),
            form=True,
            carried=True,
            negative=False,
            low=lambda r: 0.0,
            high=lambda r: 2.0 * r.current * r.q / r.qd**2,
        ),
    ),
    law=load_friction_law,
    adds=True,
    states=3,
    source="load-dependent friction of gears (Duclusaud et al. 2025, arXiv 2410.08650, M3) and of seals under pressure",
    depends_on=("qd", "current"),
    remedy="check lubrication and preload; in a gear or a seal it belongs to the device",
    positive="friction brakes",
    needs="change",
    unseen="too few levels of current",
    dry=True,
    in_place_of="K1",
)
