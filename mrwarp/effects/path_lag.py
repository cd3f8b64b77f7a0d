"""Path lag: ``dF/ds = (I - F)/l``, s the joint's way: the field, or what it holds, follows the current along a way.

A lag in time passes while the joint stands still; one along a way does not, and is over sooner the faster the joint
moves. Chains of particles or bristles that have to be strained again after a change of the current show it: with a
stiffness of their own and a limit that follows the current, the torque nears a new limit over limit/stiffness.
"""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def path_lag_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The torque follows the current over a way of the joint, not over a time."""
    length = values[row, at]
    if length > 0.0:
        field = float(s.field)
        if s.begins == 0:
            before, after = s.qd_before, s.qd
            # as in the path of the hysteresis: up to a reversal and after it, else a cubic
            way = wp.abs(s.dt * (0.5 * (before + after) + s.dt / 12.0 * (s.qdd_before - s.qdd)))
            if before * after < 0.0:
                way = 0.5 * s.dt * (before * before + after * after) / (wp.abs(before) + wp.abs(after))
            field = s.field + (memory[line, slot] - s.field) * wp.exp(-way / length)
        memory[line, slot] = field
        s.field = field
    return s


LAW = EffectLaw(
    name="path_lag",
    title="path lag",
    sentence="The torque follows the current over a way of the joint, not over a time.",
    equation="dF/ds = (I - F)/l, s the way",
    kind="mechanism",
    stage="current",
    parameters=(
        EffectParameter(
            name="length",
            unit="rad",
            scale=(1, 0, 0),
            negative=False,
            low=lambda r: 1e-4 * r.q,
            high=lambda r: 0.5 * r.q,
            starts=lambda r: tuple(x * r.q for x in (0.001, 0.003, 0.01, 0.03, 0.1)),
        ),
    ),
    law=path_lag_law,
    states=1,
    source="LuGre friction with a limit that follows the current: Jimenez and Alvarez-Icaza 2005",
    depends_on=("current", "memory"),
    remedy="none on the driver: it is the fluid's; let the policy know it",
    needs="command",
    unseen="the current hardly changes within a trajectory",
)
