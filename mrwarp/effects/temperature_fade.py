"""Fade with a logged temperature: ``yield*exp(-a*(T - T0)), viscosity*exp(-b*(T - T0))``.

T0, ``reference``, is the mean of the log, at which the other parameters hold. In a replay T is the logged one; a joint
of a robot has no thermometer, and T is ``temperature``, T0 unless the model file is edited.
"""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path
from mrwarp.effects.temperature_drift import MOST


@wp.func
def temperature_fade_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The device grows weaker as its temperature rises, which was logged."""
    if values[row, at] != 0.0 or values[row, at + 1] != 0.0:
        rise = s.temperature - values[row, at + 2]
        s.yield_gain = s.yield_gain * wp.exp(wp.clamp(-values[row, at] * rise, -MOST, MOST))
        s.viscous_gain = s.viscous_gain * wp.exp(wp.clamp(-values[row, at + 1] * rise, -MOST, MOST))
    return s


LAW = EffectLaw(
    name="temperature_fade",
    title="fade with temperature",
    sentence="The device grows weaker as its temperature rises, which was logged.",
    equation="yield*exp(-a*(T - T0)), viscosity*exp(-b*(T - T0))",
    kind="mechanism",
    stage="torque",
    parameters=(
        EffectParameter(name="yield_loss", unit="1/K"),
        EffectParameter(name="viscosity_loss", unit="1/K"),
        EffectParameter(name="reference", unit="degC", preset=lambda r: r.temperature),
        EffectParameter(name="temperature", unit="degC", preset=lambda r: r.temperature),
    ),
    law=temperature_fade_law,
    source="paper section 5.2: yield stress and viscosity fall with temperature",
    depends_on=("time",),
    needs="temperature",
    remedy="keep the device at one temperature, or let the controller raise the current by the logged one",
    positive="what warms up loses torque",
    one_positive=True,
)
