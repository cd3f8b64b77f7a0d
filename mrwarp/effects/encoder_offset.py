"""Offset of the encoder: ``q - o``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def encoder_offset_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The angle is read from a shifted zero."""
    s.q = s.q - values[row, at]
    return s


LAW = EffectLaw(
    name="encoder_offset",
    title="offset of the encoder",
    sentence="The angle is read from a shifted zero.",
    equation="q - o",
    kind="calibration",
    stage="motion",
    parameters=(EffectParameter(name="offset", unit="rad", scale=(1, 0, 0)),),
    law=encoder_offset_law,
    source="homing of an incremental encoder",
    depends_on=("q",),
    remedy="home the encoder",
)
