"""Cogging: ``A*sin(N*q) + B*cos(N*q)``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def cogging_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """A torque that repeats along the angle."""
    if values[row, at] != 0.0 or values[row, at + 1] != 0.0:
        angle = values[row, at + 2] * s.q
        s.torque = s.torque + values[row, at] * wp.sin(angle) + values[row, at + 1] * wp.cos(angle)
    return s


LAW = EffectLaw(
    name="cogging",
    title="cogging",
    sentence="A torque that repeats along the angle.",
    equation="A*sin(N*q) + B*cos(N*q)",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="sine", unit="N·m", scale=(0, 0, 1)),
        EffectParameter(name="cosine", unit="N·m", scale=(0, 0, 1)),
        EffectParameter(
            name="periods",
            unit="1/rad",
            scale=(-1, 0, 0),
            negative=False,
            low=lambda r: 3.0 / r.q,
            high=lambda r: 120.0 / r.q,
            starts=lambda r: tuple((6.0 + 1.6 * k) / r.q for k in range(50)),
        ),
    ),
    law=cogging_law,
    source="slots and magnets of a motor, teeth of a gear",
    depends_on=("q",),
    remedy="compensate by a table over the angle",
)
