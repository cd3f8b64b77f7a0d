"""Spencer's modified Bouc-Wen: a Bouc-Wen element, spring and dashpot in series with a further dashpot.

All are in units of the Bouc-Wen element's torque at the same current. With ``fading`` that torque grows more with the
current than they do: by ``fading = K1/K0`` they are constant. ``unloading`` is gamma's share of both rates beyond half.
"""

import warp as wp

from mrwarp.effects.law import EffectParameter, Path
from mrwarp.effects.laws.hysteresis import hysteresis_law, rate

PARTS = wp.constant(4)
"""Parts of a step."""


@wp.func
def spencer_law(
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
    """Linearly implicit parts of a step: stable however stiff; states z and w = q - y."""
    rate, share = values[row, at], float(1.0 / (1.0 + values[row, at + 4] * wp.abs(s.field)))
    series, inner, spring = share * values[row, at + 1], share * values[row, at + 2], share * values[row, at + 3]
    eases, loading = 1.0 / (series + inner), 0.5 + values[row, at + 5]
    z, w = float(memory[line, slot]), float(memory[line, slot + 1])
    speed_before = s.qd_before
    dt = s.dt / float(PARTS)
    yields = 1.0 / (1.0 + dt * spring * eases)
    flow = float(0.0)
    for k in range(PARTS):
        v = speed_before + (s.qd - speed_before) * (float(k) + 0.5) / float(PARTS)
        if s.begins == 0:
            past = v - (inner * v + spring * w) * eases
            drive = past - z * eases  # of the Bouc-Wen element
            free = rate * (1.0 - (loading * wp.sign(drive) * z + (1.0 - loading) * wp.abs(z)) * wp.abs(z))
            z = (z + dt * free * past) / (1.0 + dt * free * eases)
            z = wp.clamp(z, -1.0, 1.0)
            w = (w + dt * (series * v - z) * eases) * yields
        flow = (z + inner * v + spring * w) * eases
    memory[line, slot] = z
    memory[line, slot + 1] = w
    return series * flow


LAW = hysteresis_law(
    "spencer",
    "Spencer's modified Bouc-Wen law",
    "h = series*dy/dt, (series + inner)*dy/dt = z + inner*qd + spring*(q - y), "
    "dz/dt = rate*(r - (share*|r|*z*|z| + (1 - share)*r*z^2)), share = 0.5 + unloading, r = qd - dy/dt; "
    "series, inner and spring over 1 + fading*|I|",
    "B. F. Spencer, S. J. Dyke, M. K. Sain, J. D. Carlson, Phenomenological model for magnetorheological dampers, "
    "J. Eng. Mech. 123 (1997), with n = 2; one fading stands for its lines in the current of c0, c1",
    spencer_law,
    rate("rate", "1/rad", -1, (3.0, 30.0, 300.0), "q"),
    EffectParameter(
        name="series",
        unit="s/rad",
        scale=(-1, 0, 0),
        negative=False,
        divides=True,
        low=lambda r: 0.05 / r.qd,
        high=lambda r: 1e3 / r.qd,
        starts=lambda r: (1.0 / r.qd, 6.0 / r.qd, 40.0 / r.qd),
    ),
    EffectParameter(
        name="inner",
        unit="s/rad",
        scale=(-1, 0, 0),
        negative=False,
        low=lambda r: 0.0,
        high=lambda r: 10.0 / r.qd,
    ),
    EffectParameter(
        name="spring",
        unit="1/rad",
        scale=(-1, 0, 0),
        negative=False,
        low=lambda r: 0.0,
        high=lambda r: 100.0 / r.q,
    ),
    EffectParameter(
        name="fading",
        unit="1/A",
        scale=(0, -1, 0),
        negative=False,
        optional=True,
        low=lambda r: 0.0,
        high=lambda r: 30.0 / r.current,
    ),
    EffectParameter(name="unloading", unit="1", optional=True, low=lambda r: -0.5, high=lambda r: 5.0),
    states=2,
)
