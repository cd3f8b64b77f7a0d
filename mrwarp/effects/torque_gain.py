"""Gain of the torque sensor: ``g*tau``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def torque_gain_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The torque is read too large by a factor."""
    s.torque = values[row, at] * s.torque
    return s


LAW = EffectLaw(
    name="torque_gain",
    title="gain of the torque sensor",
    sentence="The torque is read too large by a factor.",
    equation="g*tau",
    kind="calibration",
    stage="sensor",
    parameters=(EffectParameter(name="gain", unit="1", null=1.0, low=lambda r: 0.1, high=lambda r: 10.0),),
    law=torque_gain_law,
    source="error of a strain-gauge bridge's factor",
    depends_on=("torque",),
    remedy="hang a known weight on the sensor",
    taken_up_by=("D", "B", "C", "I1", "K0", "K1"),
)
