"""Cogging: ``A*sin(N*q) + B*cos(N*q)``, and up to seven more harmonics, each with its own size and phase.

The further harmonics are looked for in what the stronger ones leave, where a joint turns all the way round.
"""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path

HARMONICS = 8
"""Most harmonics, the strongest included."""


@wp.func
def cogging_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """A torque that repeats along the angle."""
    if values[row, at] != 0.0 or values[row, at + 1] != 0.0:
        angle = values[row, at + 2] * s.q
        s.torque = s.torque + values[row, at] * wp.sin(angle) + values[row, at + 1] * wp.cos(angle)
    for k in range(wp.static(HARMONICS - 1)):
        more = at + 3 + 3 * k
        if values[row, more + 2] > 0.0:
            angle = values[row, more + 2] * s.q
            s.torque = s.torque + values[row, more] * wp.sin(angle) + values[row, more + 1] * wp.cos(angle)
    return s


def _more(k: int) -> tuple[EffectParameter, ...]:
    """Numbers of one more harmonic."""
    periods = f"periods_{k}"
    return (
        *(
            EffectParameter(name=f"{part}_{k}", unit="N·m", scale=(0, 0, 1), form=True, requires=periods)
            for part in ("sine", "cosine")
        ),
        EffectParameter(
            name=periods, unit="1/rad", scale=(-1, 0, 0), form=True, negative=False, low=lambda r: 0.0, repeats=True
        ),
    )


LAW = EffectLaw(
    name="cogging",
    title="cogging",
    sentence="A torque that repeats along the angle.",
    equation="A*sin(N*q) + B*cos(N*q), and as much for up to seven more N",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="sine", unit="N·m", scale=(0, 0, 1)),
        EffectParameter(name="cosine", unit="N·m", scale=(0, 0, 1)),
        EffectParameter(
            name="periods",
            unit="1/rad",
            scale=(-1, 0, 0),
            negative=False,
            low=lambda r: 3.0 / r.q,
            # of a joint that turns all the way round: three samples a period at the speed of its slower runs
            high=lambda r: max(120.0 / r.q, 2.1 / (r.slow * r.dt) if r.turns >= 1.0 else 0.0),
            repeats=True,
            starts=lambda r: tuple((6.0 + 1.6 * k) / r.q for k in range(50)),
        ),
        *(p for k in range(2, HARMONICS + 1) for p in _more(k)),
    ),
    law=cogging_law,
    adds=True,
    contains="gravity",
    source="slots and magnets of a motor, teeth of a gear",
    depends_on=("q",),
    remedy="compensate by a table over the angle",
)
