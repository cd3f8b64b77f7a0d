"""Friction that differs by direction: ``F*|tanh(qd/v)| + B*|qd|`` on top of eq. 14's viscous torque, which may thin.

The hysteretic torque may differ too: ``1 + y*sgn(z)`` times it. Unlike F it builds up with the stress, and is absent
where the device bears nothing.
"""

import warp as wp

from mrwarp.effects.law import DIRECTED_FRICTION_SPEED, DRY_FRICTION_RESOLUTION, EffectLaw, EffectParameter, Path


@wp.func
def friction_asymmetry_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """Friction is larger in one direction than in the other."""
    if values[row, at + 3] != 0.0:
        s.viscous_gain = s.viscous_gain / (1.0 + values[row, at + 3] * wp.abs(s.qd))
    if values[row, at + 4] != 0.0:
        s.yield_gain = s.yield_gain * (1.0 + values[row, at + 4] * wp.sign(s.z))
    if values[row, at] != 0.0 or values[row, at + 1] != 0.0:
        s.torque = s.torque + values[row, at] * wp.abs(wp.tanh(s.qd / values[row, at + 2]))
        s.torque = s.torque + values[row, at + 1] * wp.abs(s.qd)
    return s


LAW = EffectLaw(
    name="friction_asymmetry",
    title="friction that differs by direction",
    sentence="Friction is larger in one direction than in the other.",
    equation="F*|tanh(qd/v)| + B*|qd|; eq. 14's viscous torque over 1 + c*|qd|, its hysteretic times 1 + y*sgn(z)",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="coulomb", unit="N·m", scale=(0, 0, 1), resolution=DRY_FRICTION_RESOLUTION),
        EffectParameter(name="viscous", unit="N·m·s/rad", scale=(-1, 0, 1)),
        DIRECTED_FRICTION_SPEED,
        EffectParameter(
            name="thinning",
            unit="s/rad",
            scale=(-1, 0, 0),
            form=True,
            negative=False,
            low=lambda r: 0.0,
            high=lambda r: 10.0 / r.qd,
        ),
        EffectParameter(name="yielding", unit="1", form=True, low=lambda r: -0.9, high=lambda r: 0.9),
    ),
    law=friction_asymmetry_law,
    source="paper section 4.3, friction asymmetry; Janot, Gautier and Brunot 2019 for a ball screw",
    depends_on=("qd",),
    mechanics=True,
    of_published_laws="direction",
    remedy="check the seal's lip and the preload of the bearings",
)
