"""Bingham plastic with viscous flow before the yield: ``h = qd/speed`` up to the yield speed, then 1."""

import warp as wp

from mrwarp.effects.law import Path
from mrwarp.effects.laws.hysteresis import hysteresis_law, rate


@wp.func
def biviscous_law(
    s: Path,
    q_c: float,
    h: float,
    values: wp.array2d[float],
    row: int,
    at: int,
    memory: wp.array2d[float],
    line: int,
    slot: int,
) -> float:
    """A steep line through zero speed between two flat ones."""
    return wp.clamp(s.qd / values[row, at], -1.0, 1.0)


LAW = hysteresis_law(
    "biviscous",
    "the Bingham law with viscous pre-yield",
    "h = max(-1, min(1, qd/speed))",
    "R. Stanway, J. L. Sproston, N. G. Stevens, Non-linear modelling of an electro-rheological vibration damper, J. "
    "Electrostat. 20 (1987); two viscosities: N. M. Wereley, L. Pang, G. M. Kamath, J. Intell. Mater. Syst. Struct. 9 "
    "(1998)",
    biviscous_law,
    rate("speed", "rad/s", 1, (0.02, 0.07, 0.25, 0.7), "qd"),
)
