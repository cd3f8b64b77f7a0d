"""Bouc-Wen with an exponent: ``dh/dt = rate*(qd - (share*|qd|*h + (1 - share)*qd*|h|)*|h|^(n - 1))``."""

import warp as wp

from mrwarp.effects.law import EffectParameter, Path
from mrwarp.effects.laws.hysteresis import hysteresis_law, rate

PART = wp.constant(0.125)
"""Largest change of h in a part of a way."""
PARTS = wp.constant(32)
"""Most parts of a way: the loop's whole height of 2 takes 16, and 27 where f falls steeply."""


@wp.func
def bouc_wen_power_path(h: float, way: float, share: float, n: float) -> float:
    """h after a signed way in units of the elastic travel.

    With u = h in the direction of the way, ``du/ds = f(u) = 1 - u^n``, and ``1 + (2*share - 1)*|u|^n`` where the stress
    is taken back. f falls with u down to f(1) = 0, so u rises to 1 and no further. The way is taken in parts that
    change u by :data:`PART` at most, each the solution of f's tangent (an exponential Rosenbrock step, second order).
    """
    if way == 0.0:
        return h
    u, left = wp.sign(way) * h, wp.abs(way)
    for _ in range(PARTS):
        if left <= 0.0 or u > 0.99999:  # yielded
            break
        power = wp.pow(wp.max(wp.abs(u), 1.0e-9), n - 1.0)
        loss = wp.where(u < 0.0, 1.0 - 2.0 * share, 1.0)
        f, fall = 1.0 - loss * power * wp.abs(u), n * wp.abs(loss) * power
        part = wp.min(left, PART / f)
        x = fall * part
        reach = wp.where(x > 1.0e-3, (1.0 - wp.exp(-x)) / wp.max(x, 1.0e-3), 1.0 - 0.5 * x)
        u = wp.min(u + part * f * reach, 1.0)
        left -= part
    return wp.sign(way) * u


@wp.func
def bouc_wen_power_law(
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
    """A large exponent yields at once, a small one gently."""
    rate, share, n = values[row, at], 0.5 + values[row, at + 1], 1.0 + values[row, at + 2]
    h = bouc_wen_power_path(h, rate * s.path_1, share, n)
    return bouc_wen_power_path(h, rate * s.path_2, share, n)


LAW = hysteresis_law(
    "bouc_wen_power",
    "Bouc-Wen's law with an exponent",
    "dh/dt = rate*(qd - (share*|qd|*h + (1 - share)*qd*|h|)*|h|^(n - 1)), share = 0.5 + unloading, n = 1 + sharpness",
    "Y.-K. Wen, Method for random vibration of hysteretic systems, J. Eng. Mech. Div. ASCE 102 (1976)",
    bouc_wen_power_law,
    rate("rate", "1/rad", -1, (1.0, 4.0, 16.0, 64.0, 300.0), "q"),
    EffectParameter(name="unloading", unit="1", low=lambda r: 0.0, high=lambda r: 5.0, negative=False),
    EffectParameter(name="sharpness", unit="1", low=lambda r: 0.0, high=lambda r: 9.0, negative=False),
)
