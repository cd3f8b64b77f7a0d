"""Saturation over current: ``K1*tanh(u*I)/u``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def current_saturation_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The yield torque grows ever less with current: the core saturates."""
    u = values[row, at]
    if u > 0.0:
        s.field = wp.tanh(u * s.field) / u
    return s


LAW = EffectLaw(
    name="current_saturation",
    title="saturation over current",
    sentence="The yield torque grows ever less with current: the core saturates.",
    equation="K1*tanh(u*I)/u",
    kind="mechanism",
    stage="current",
    parameters=(
        EffectParameter(
            name="u",
            unit="1/A",
            scale=(0, -1, 0),
            negative=False,
            low=lambda r: 1e-3 / r.current,
            high=lambda r: 10.0 / r.current,
            starts=lambda r: (0.3 / r.current, 0.7 / r.current, 1.5 / r.current),
        ),
    ),
    law=current_saturation_law,
    source="eq. 18 saturates, eq. 14 does not",
    depends_on=("current",),
    remedy="more steel in the flux path",
    needs="field",
    of_published_laws="saturation",
    unseen="too few levels of current",
)
