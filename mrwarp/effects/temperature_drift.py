"""Drift with temperature: ``yield*exp(-a*s), viscosity*exp(-b*s), ds/dt = |tau*qd| + R*I^2 - s/T``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path

MOST = wp.constant(20.0)
"""Largest exponent: a search that goes astray stays finite."""


@wp.func
def temperature_drift_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The device grows weaker as the heat it turns out of motion and current warms it."""
    if values[row, at] != 0.0 or values[row, at + 1] != 0.0:
        s.yield_gain = s.yield_gain * wp.exp(wp.clamp(-values[row, at] * s.heat, -MOST, MOST))
        s.viscous_gain = s.viscous_gain * wp.exp(wp.clamp(-values[row, at + 1] * s.heat, -MOST, MOST))
    return s


LAW = EffectLaw(
    name="temperature_drift",
    title="drift with temperature",
    sentence="The device grows weaker as the heat it turns out of motion and current warms it.",
    equation="yield*exp(-a*s), viscosity*exp(-b*s), ds/dt = |tau*qd| + R*I^2 - s/T",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="yield_loss", unit="1/J", scale=(-1, 0, -1)),
        EffectParameter(name="viscosity_loss", unit="1/J", scale=(-1, 0, -1)),
        EffectParameter(
            name="time_constant",
            unit="s",
            negative=False,
            low=lambda r: 10.0,
            high=lambda r: min(3000.0, max(60.0, 0.5 * r.session)),
            starts=lambda r: tuple(min(x, max(60.0, 0.5 * r.session)) for x in (30.0, 120.0, 480.0)),
            recovers=True,
        ),
    ),
    law=temperature_drift_law,
    source="paper section 5.2: yield stress and viscosity fall with temperature",
    depends_on=("time", "memory"),
    remedy="let the device rest between runs, or keep it at one temperature",
    positive="what warms up loses torque",
    one_positive=True,
)
