"""Guo's arctangent: ``h = 2/pi*atan(slope*(qd - speed*sgn(qdd)))``."""

import warp as wp

from mrwarp.effects.law import EffectParameter, Path
from mrwarp.effects.laws.hysteresis import hysteresis_law, rate


@wp.func
def arctangent_law(
    s: Path, q_c: float, h: float, values: wp.array2d[float], row: int, at: int,
    memory: wp.array2d[float], line: int, slot: int,
) -> float:  # fmt: skip
    """Branches for speeding up and slowing down; the acceleration's sign is that of the last change of velocity."""
    change = s.qd - memory[line, slot]
    if s.begins == 1:
        change = s.qdd
    if change != 0.0:
        memory[line, slot + 1] = wp.sign(change)
    memory[line, slot] = s.qd
    slope = values[row, at]
    return 0.63661977 * wp.atan(slope * (s.qd - values[row, at + 1] * memory[line, slot + 1]))


LAW = hysteresis_law(
    "arctangent",
    "Guo's arctangent law",
    "h = 2/pi*atan(slope*(qd - speed*sgn(qdd)))",
    "S. Guo, S. Yang, C. Pan, Dynamic modeling of magnetorheological damper behaviors, "
    "J. Intell. Mater. Syst. Struct. 17 (2006)",
    arctangent_law,
    rate("slope", "s/rad", -1, (1.0, 3.0, 10.0, 30.0), "qd"),
    EffectParameter(name="speed", unit="rad/s", scale=(1, 0, 0), low=lambda r: -r.qd, high=lambda r: r.qd),
    states=2,
)
