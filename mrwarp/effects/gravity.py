"""Gravity: ``S*sin(q) + C*cos(q)``, a weight that turns with the joint; m*g*l = sqrt(S^2 + C^2), down at atan2(-C, S).

``periods`` is 1 per radian, in the unit of the angle.
"""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def gravity_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """A weight on an arm, whose torque goes with the sine of the angle from where it hangs."""
    if values[row, at] != 0.0 or values[row, at + 1] != 0.0:
        angle = values[row, at + 2] * s.q
        s.torque = s.torque + values[row, at] * wp.sin(angle) + values[row, at + 1] * wp.cos(angle)
    return s


LAW = EffectLaw(
    name="gravity",
    title="gravity",
    sentence="A weight turns with the joint, whose torque follows the sine of the angle.",
    equation="S*sin(q) + C*cos(q)",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="sine", unit="N·m", scale=(0, 0, 1)),
        EffectParameter(name="cosine", unit="N·m", scale=(0, 0, 1)),
        EffectParameter(
            name="periods",
            unit="1/rad",
            scale=(-1, 0, 0),
            null=1.0,
            negative=False,
            optional=True,
            preset=lambda r: 1.0 / r.radian if r.radian else 0.0,
        ),
    ),
    law=gravity_law,
    adds=True,
    source="statics of a weight on an arm: m*g*l*sin of the angle from where it hangs",
    depends_on=("q",),
    needs="angle",
    mechanics=True,
    remedy="balance the arm, or give its weight to the robot's model",
)
