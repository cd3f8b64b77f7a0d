"""Gain of the current: ``g*I``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def current_gain_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The current is larger than its reading by a factor."""
    gain = values[row, at]
    s.current = gain * s.current
    s.field = gain * s.field
    return s


LAW = EffectLaw(
    name="current_gain",
    title="gain of the current",
    sentence="The current is larger than its reading by a factor.",
    equation="g*I",
    kind="calibration",
    stage="current",
    parameters=(EffectParameter(name="gain", unit="1", null=1.0, low=lambda r: 0.1, high=lambda r: 10.0),),
    law=current_gain_law,
    source="error of a shunt's or Hall sensor's factor",
    depends_on=("current",),
    remedy="calibrate the current sensor",
    taken_up_by=("I1", "K1"),
)
