"""Wear: ``yield*(1 - d*t)``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def wear_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The device loses yield torque steadily over the session."""
    s.yield_gain = s.yield_gain * (1.0 - values[row, at] * s.time)
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
    ),
    law=wear_law,
    source="settling and degradation of the fluid's particles",
    depends_on=("time",),
    remedy="repeat the first run last; stir or replace the fluid",
)
