"""Viscosity that grows with current: ``B1*I*qd``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def current_viscosity_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The viscous torque depends on the current."""
    s.viscosity = s.viscosity + values[row, at] * s.current
    return s


LAW = EffectLaw(
    name="current_viscosity",
    title="viscosity that grows with current",
    sentence="The viscous torque depends on the current.",
    equation="B1*I*qd",
    kind="mechanism",
    stage="torque",
    parameters=(EffectParameter(name="B1", unit="N·m·s/(rad·A)", scale=(-1, -1, 1)),),
    law=current_viscosity_law,
    adds=True,
    source="field-dependent post-yield viscosity of MR fluids",
    depends_on=("qd", "current"),
    remedy="none needed; it belongs to the fluid",
    needs="field",
    unseen="too few levels of current",
    of_published_laws="term",
)
