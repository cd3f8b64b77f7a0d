"""Remanence: ``play of half-width w on I``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def remanence_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The steel core keeps part of its field: the torque lags behind slow current changes too."""
    half_width = values[row, at]
    if half_width > 0.0:
        field = float(s.field)
        if s.begins == 0:
            field = wp.min(wp.max(memory[line, slot], s.field - half_width), s.field + half_width)
        memory[line, slot] = field
        s.field = field
    return s


LAW = EffectLaw(
    name="remanence",
    title="remanence",
    sentence="The steel core keeps part of its field: the torque lags behind slow current changes too.",
    equation="play of half-width w on I",
    kind="mechanism",
    stage="current",
    parameters=(
        EffectParameter(
            name="half_width",
            unit="A",
            scale=(0, 1, 0),
            negative=False,
            low=lambda r: 5e-4 * r.current,
            high=lambda r: 0.5 * r.current,
            starts=lambda r: tuple(x * r.current for x in (0.004, 0.01, 0.02, 0.04, 0.08, 0.15)),
            sudden=True,
        ),
    ),
    law=remanence_law,
    states=1,
    source="Prandtl's play operator; the coercive field of the core",
    depends_on=("current", "memory"),
    remedy="demagnetise by a decaying alternating current; softer core steel",
    needs="field",
    unseen="the current hardly changes within a trajectory",
)
