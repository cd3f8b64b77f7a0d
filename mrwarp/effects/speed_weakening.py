"""Weakening with speed: ``(1 + alpha*|qd|)^p instead of p = 1``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def speed_weakening_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The hysteretic torque falls with speed by another power than the model's."""
    s.weakening = s.weakening * values[row, at]
    return s


LAW = EffectLaw(
    name="speed_weakening",
    title="weakening with speed",
    sentence="The hysteretic torque falls with speed by another power than the model's.",
    equation="(1 + alpha*|qd|)^p instead of p = 1",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(
            name="power",
            unit="1",
            null=1.0,
            low=lambda r: 0.1,
            high=lambda r: 3.0,
            negative=False,
            starts=lambda r: (0.7, 0.85, 1.2, 1.6),
        ),
    ),
    law=speed_weakening_law,
    source="shear thinning (Herschel-Bulkley)",
    depends_on=("qd", "current"),
    remedy="none needed; it belongs to the fluid",
    needs="alpha",
)
