"""Stribeck friction: ``F*exp(-(qd/v)^2)*s``, s as of Coulomb friction."""

import warp as wp

from mrwarp.effects.law import DRY_FRICTION_SPEED, EffectLaw, EffectParameter, Path, dry_direction


@wp.func
def stribeck_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """Friction that is larger just above standstill than at speed."""
    if values[row, at] != 0.0:
        ratio = s.qd / values[row, at + 1]
        direction = dry_direction(s, values[row, at + 2], memory, line, slot)
        s.torque = s.torque + values[row, at] * wp.exp(-ratio * ratio) * direction
    return s


LAW = EffectLaw(
    name="stribeck",
    title="Stribeck friction",
    sentence="Friction that is larger just above standstill than at speed.",
    equation="F*exp(-(qd/v)^2)*s, ds/dt = qd/(w*5 ms), |s| <= 1",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="torque", unit="N·m", scale=(0, 0, 1)),
        EffectParameter(
            name="stribeck_speed",
            unit="rad/s",
            scale=(1, 0, 0),
            negative=False,
            divides=True,
            low=lambda r: 0.008 * r.qd,
            high=lambda r: 0.7 * r.qd,
            most=lambda r: 0.25 * r.qd,
            beyond="it would act at nearly all speeds, and Stribeck friction is a matter of low ones",
            starts=lambda r: tuple(x * r.qd for x in (0.02, 0.05, 0.1, 0.2, 0.4)),
        ),
        DRY_FRICTION_SPEED,
    ),
    law=stribeck_law,
    adds=True,
    states=1,
    source="Stribeck 1902, in the form of Armstrong-Helouvry 1991",
    depends_on=("qd",),
    remedy="other lubricant or seal",
    positive="Stribeck friction is larger at low speed",
    contains="coulomb_friction",
)
