"""Backlash and series compliance: ``k*(e - clamp(e, -b, b))``, e the deflection from the middle of the gap.

A drive turns against an output that stands still (locked, or held by a load): the friction of the drive comes first,
then play of half-gap b, then an elastic element of stiffness k. In the gap the drive bears its own friction only, so
this is parallel to the hysteresis of eq. 15, where :mod:`mrwarp.effects.backlash` has the device behind the gap. The
usual test of a gearbox, output locked and torque ramped, shows it: lost motion 2b, torsional stiffness k. Without play
it would be C of eq. 14.

Where the output was locked at another place in each run (``own_middle`` = 1), the middle of the gap is taken as the
middle of the run's range, as torque that is ramped equally to both sides gives it; else, and in the simulator, it is
where C of eq. 14 is at rest.
"""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def compliance_with_backlash_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """Behind the drive's friction there are play and an elastic element, which lead to an output at rest."""
    if values[row, at] != 0.0:
        half_gap = values[row, at + 1]
        deflection = s.q - s.zero
        if values[row, at + 2] == 1.0:
            deflection = s.q - s.middle
        beyond = deflection - wp.clamp(deflection, -half_gap, half_gap)
        s.torque = s.torque + values[row, at] * (1.0 + values[row, at + 3] * wp.sign(beyond)) * beyond
    return s


LAW = EffectLaw(
    name="compliance_with_backlash",
    title="backlash and series compliance",
    sentence="Behind the drive's friction there are play and an elastic element, which lead to an output at rest.",
    equation="k*(1 + d*sgn(e))*(e - clamp(e, -b, b)), e = q - middle of the gap",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="stiffness", unit="N·m/rad", scale=(-1, 0, 1), low=lambda r: 0.0, negative=False),
        EffectParameter(
            name="half_gap",
            unit="rad",
            scale=(1, 0, 0),
            negative=False,
            low=lambda r: 1e-4 * r.q,
            high=lambda r: 0.45 * r.q,
            starts=lambda r: tuple(x * r.q for x in (0.003, 0.006, 0.012, 0.025, 0.05, 0.1, 0.2)),
        ),
        EffectParameter(name="own_middle", unit="1", choices=(0.0, 1.0)),
        EffectParameter(name="difference", unit="1", form=True, low=lambda r: -0.9, high=lambda r: 0.9),
    ),
    law=compliance_with_backlash_law,
    adds=True,
    source="hysteresis test of a gearbox: lost motion and torsional stiffness, output locked",
    depends_on=("q",),
    remedy="preload the gear; put the encoder on the output",
    positive="a stiffness is above 0",
    rare="it would act in less than half of the runs, at the ends of the widest ways only",
)
