"""LuGre: bristles that bend, slip and damp, ``h = z + damping*dz/dt``, ``dz/dt = rate*(qd - |qd|*z/g(qd))``."""

import warp as wp

from mrwarp.effects.law import EffectParameter, Path
from mrwarp.effects.laws.hysteresis import hysteresis_law, rate


@wp.func
def lugre_law(
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
    """With ``g = 1 + stribeck*exp(-(qd/stribeck_speed)^2)``; the bend is exact over each path at the newest speed.

    Bristles that damp bear many times their sliding torque while they bend fast; for a large damping the law is not
    even passive (N. Barabanov, R. Ortega, IEEE Trans. Autom. Control 45 (2000)). In the simulator, whose step is long
    against the bending, they damp with the step's mean rate, and bear at most what slides at that speed.
    """
    ratio = s.qd / wp.max(values[row, at + 3], 1.0e-6)
    g = wp.max(1.0 + values[row, at + 2] * wp.exp(-ratio * ratio), 0.05)
    z = float(memory[line, slot])
    for k in range(2):
        path = wp.where(k == 0, s.path_1, s.path_2)
        if path != 0.0:
            end = wp.sign(path) * g
            z = end + (z - end) * wp.exp(-values[row, at] * wp.abs(path) / g)
    if s.held == 1:
        bent = z - memory[line, slot]
        memory[line, slot] = z
        return wp.clamp(z + values[row, at + 1] * bent / s.dt, -g, g)
    memory[line, slot] = z
    return z + values[row, at + 1] * values[row, at] * (s.qd - wp.abs(s.qd) * z / g)


LAW = hysteresis_law(
    "lugre",
    "the LuGre law",
    "h = z + damping*dz/dt, dz/dt = rate*(qd - |qd|*z/g), g = 1 + stribeck*exp(-(qd/stribeck_speed)^2)",
    "C. Canudas de Wit, H. Olsson, K. J. Astrom, P. Lischinsky, A new model for control of systems with friction, "
    "IEEE Trans. Autom. Control 40 (1995); for MR dampers: R. Jimenez, L. Alvarez-Icaza, Struct. Control Health Monit. "
    "12 (2005)",
    lugre_law,
    rate("rate", "1/rad", -1, (1.0, 4.0, 16.0, 64.0, 300.0), "q"),
    EffectParameter(name="damping", unit="s", low=lambda r: 0.0, high=lambda r: 10.0 * r.q / r.qd, negative=False),
    EffectParameter(name="stribeck", unit="1", low=lambda r: -0.9, high=lambda r: 5.0),
    EffectParameter(
        name="stribeck_speed",
        unit="rad/s",
        scale=(1, 0, 0),
        negative=False,
        divides=True,
        preset=lambda r: 0.1 * r.qd,
    ),
    states=1,
)
