"""Inertia: ``J*qdd``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def rotor_inertia_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """A mass turns with the joint between the device and the torque sensor."""
    s.torque = s.torque + values[row, at] * s.qdd
    return s


LAW = EffectLaw(
    name="rotor_inertia",
    title="inertia",
    sentence="A mass turns with the joint between the device and the torque sensor.",
    equation="J*qdd",
    kind="mechanism",
    stage="torque",
    parameters=(EffectParameter(name="inertia", unit="kg·m²", scale=(-1, 0, 1)),),
    law=rotor_inertia_law,
    adds=True,
    source="Newton's second law",
    depends_on=("qdd",),
    mechanics=True,
    remedy="add it to the model's inertia",
    positive="an inertia is above 0",
)
