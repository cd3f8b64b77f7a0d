"""Backlash: ``play of half-gap b on the way of the shaft``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def backlash_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """Between encoder and device there is play."""
    half_gap = values[row, at]
    if half_gap > 0.0:
        gap = float(0.0)
        if s.begins == 0:
            gap = memory[line, slot]
        free_1 = wp.clamp(gap + s.path_1, -half_gap, half_gap)
        free_2 = wp.clamp(free_1 + s.path_2, -half_gap, half_gap)
        s.path_1 = s.path_1 - (free_1 - gap)
        s.q = s.q - free_2
        driven = s.path_2 - (free_2 - free_1)
        engaged = float(1.0)
        if s.begins == 0:
            if wp.abs(free_2) < half_gap:
                engaged = 0.0
                driven = float(0.0)
            elif s.path_2 != 0.0:
                # at the end of the step: all but within the first part of the path, so that it has a slope
                engaged = wp.clamp(20.0 * driven / s.path_2, 0.0, 1.0)
            elif free_2 * s.qd <= 0.0:
                engaged = 0.0
        s.qd = engaged * s.qd
        s.qdd = engaged * s.qdd
        s.path_2 = driven
        memory[line, slot] = free_2
    return s


LAW = EffectLaw(
    name="backlash",
    title="backlash",
    sentence="Between encoder and device there is play.",
    equation="play of half-gap b on the way of the shaft",
    kind="mechanism",
    stage="shaft",
    parameters=(
        EffectParameter(
            name="half_gap",
            unit="rad",
            scale=(1, 0, 0),
            negative=False,
            low=lambda r: 2e-5 * r.q,
            high=lambda r: 0.2 * r.q,
            # data of benchmarks.confusion come back at 0.93 to 1.00 of the truth: nobody sees the path between samples
            resolution=0.025,
            starts=lambda r: tuple(x * r.q for x in (4e-5, 1e-4, 3e-4, 7e-4, 0.0015, 0.003, 0.006, 0.012, 0.025, 0.05)),
        ),
    ),
    law=backlash_law,
    states=1,
    source="Prandtl's play operator",
    depends_on=("qd", "q", "memory"),
    remedy="preload the coupling",
)
