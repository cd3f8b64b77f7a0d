"""Guo's arctangent: ``h = 2/pi*atan(slope*(qd - speed*sgn(qdd)))``.

No device changes its branch at once: with ``rounding`` the sign is ``tanh(qdd/rounding)``.
"""

import warp as wp

from mrwarp.effects.law import EffectParameter, Path
from mrwarp.effects.laws.hysteresis import hysteresis_law, rate


@wp.func
def arctangent_law(
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
    """Branches for speeding up and slowing down; the acceleration's sign is that of the last change of velocity."""
    change = s.qd - memory[line, slot]
    if s.begins == 1:
        change = s.qdd
    if change != 0.0:
        memory[line, slot + 1] = wp.sign(change)
    memory[line, slot] = s.qd
    slope, side, rounding = values[row, at], float(memory[line, slot + 1]), values[row, at + 2]
    if rounding > 0.0:
        acceleration = float(s.qdd)
        if s.held == 1 and s.begins == 0:  # the simulator has none
            acceleration = change / s.dt
        side = wp.tanh(acceleration / rounding)
    return 0.63661977 * wp.atan(slope * (s.qd - values[row, at + 1] * side))


LAW = hysteresis_law(
    "arctangent",
    "Guo's arctangent law",
    "h = 2/pi*atan(slope*(qd - speed*sgn(qdd))), with a rounding sgn(qdd) = tanh(qdd/rounding)",
    "S. Guo, S. Yang, C. Pan, Dynamic modeling of magnetorheological damper behaviors, "
    "J. Intell. Mater. Syst. Struct. 17 (2006)",
    arctangent_law,
    rate("slope", "s/rad", -1, (1.0, 3.0, 10.0, 30.0), "qd"),
    EffectParameter(name="speed", unit="rad/s", scale=(1, 0, 0), low=lambda r: -r.qd, high=lambda r: r.qd),
    EffectParameter(
        name="rounding",
        unit="rad/s²",
        scale=(1, 0, 0),
        negative=False,
        optional=True,
        low=lambda r: 0.0,
        high=lambda r: 3.0 * r.qd**2 / r.q,
    ),
    states=2,
)
