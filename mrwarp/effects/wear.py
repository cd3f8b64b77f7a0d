"""Wear: ``yield*(1 - d*t)``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def wear_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The device loses yield torque steadily over the session."""
    # the same loss per second of the session (clock = 0), or as the surfaces slid (clock = 1)
    clock = values[row, at + 1]
    elapsed = (1.0 - clock) * s.time + clock * s.slid_time
    s.yield_gain = s.yield_gain * (1.0 - values[row, at] * elapsed)
    return s


LAW = EffectLaw(
    name="wear",
    title="wear",
    sentence="The device loses yield torque steadily over the session.",
    equation="yield*(1 - d*t)",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="rate", unit="1/s", low=lambda r: -0.9 / r.session, high=lambda r: 0.9 / r.session),
        EffectParameter(name="clock", unit="1", choices=(0.0, 1.0)),
    ),
    law=wear_law,
    source="settling and degradation of the fluid's particles",
    depends_on=("time",),
    remedy="repeat the first run last; stir or replace the fluid",
    positive="what wears loses torque",
)
