"""Bouc-Wen with an exponent: ``dh/dt = rate*(qd - (share*|qd|*h + (1 - share)*qd*|h|)*|h|^(n - 1))``."""

import warp as wp

from mrwarp.effects.law import EffectParameter, Path
from mrwarp.effects.laws.hysteresis import hysteresis_law, rate


@wp.func
def bouc_wen_power_path(h: float, way: float, share: float, n: float) -> float:
    """h after a signed way in units of the elastic travel, by midpoints of parts that are short against it."""
    parts = int(wp.clamp(wp.ceil(4.0 * wp.abs(way)), 1.0, 10.0))
    step = wp.clamp(way, -6.0, 6.0) / float(parts)
    z = float(h)
    if way == 0.0:
        return z
    for _ in range(parts):
        if step * z > 0.0 and wp.abs(z) > 0.99999:  # yielded
            break
        middle = wp.clamp(z + 0.5 * bouc_wen_power_step(z, step, share, n), -1.0, 1.0)
        z = wp.clamp(z + bouc_wen_power_step(middle, step, share, n), -1.0, 1.0)
    return z


@wp.func
def bouc_wen_power_step(h: float, step: float, share: float, n: float) -> float:
    """Change of h along a step."""
    power = wp.pow(wp.max(wp.abs(h), 1.0e-9), n - 1.0)
    return step - (share * wp.abs(step) * h + (1.0 - share) * step * wp.abs(h)) * power


@wp.func
def bouc_wen_power_law(
    s: Path, q_c: float, h: float, values: wp.array2d[float], row: int, at: int,
    memory: wp.array2d[float], line: int, slot: int,
) -> float:  # fmt: skip
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
