"""Kwok's hyperbolic tangent: ``h = tanh(slope*qd + width*sgn(q_c))``.

No device changes its branch at one place: with ``rounding`` the sign is ``tanh(q_c/rounding)``.
"""

import warp as wp

from mrwarp.effects.law import EffectParameter, Path
from mrwarp.effects.laws.hysteresis import hysteresis_law, rate


@wp.func
def kwok_law(
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
    """A function of velocity whose branches are separated by the side of the displacement."""
    side, rounding = float(wp.sign(q_c)), values[row, at + 2]
    if rounding > 0.0:
        side = wp.tanh(q_c / rounding)
    return wp.tanh(values[row, at] * s.qd + values[row, at + 1] * side)


LAW = hysteresis_law(
    "kwok",
    "Kwok's law",
    "h = tanh(slope*qd + width*sgn(q_c)), with a rounding sgn(q_c) = tanh(q_c/rounding)",
    "N. M. Kwok, Q. P. Ha, T. H. Nguyen, J. Li, B. Samali, A novel hysteretic model for magnetorheological fluid "
    "dampers and parameter identification using particle swarm optimization, Sens. Actuators A 132 (2006)",
    kwok_law,
    rate("slope", "s/rad", -1, (0.7, 2.0, 6.0, 18.0), "qd"),
    EffectParameter(name="width", unit="1", low=lambda r: -3.0, high=lambda r: 3.0),
    EffectParameter(
        name="rounding",
        unit="rad",
        scale=(1, 0, 0),
        negative=False,
        optional=True,
        low=lambda r: 0.0,
        high=lambda r: 0.5 * r.q,
    ),
    depends_on=("qd", "side"),
)
