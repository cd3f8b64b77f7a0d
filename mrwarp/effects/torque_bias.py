"""Bias of the torque sensor: ``tau + b``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def torque_bias_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The torque is read from a shifted zero."""
    s.torque = s.torque + values[row, at]
    return s


LAW = EffectLaw(
    name="torque_bias",
    title="bias of the torque sensor",
    sentence="The torque is read from a shifted zero.",
    equation="tau + b",
    kind="calibration",
    stage="sensor",
    parameters=(EffectParameter(name="bias", unit="N·m", scale=(0, 0, 1)),),
    law=torque_bias_law,
    source="zero error of a strain-gauge bridge",
    remedy="unload the sensor and zero it",
    taken_up_by=("D",),
    looks_like=("encoder_offset", "friction_asymmetry"),
)
