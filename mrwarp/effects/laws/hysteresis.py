"""Definition of a hysteresis law, and the one that is in force at a step.

A law takes the place of eq. 15 and of the weakening in eq. 14:

``tau = D + B*qd + C*q_c + I1*I + (K0 + K1*I)*h``, with ``h`` the law's unit hysteresis, near -1 or 1 where the device
slides. So the coefficients of every law are linear in the current, or saturating with the effect
``current_saturation``, its viscosity depends on the current with ``current_viscosity`` and on the direction with
``friction_asymmetry``. In a model with a law alpha = gamma = 0 and beta = 1: K0 and K1 are the sliding torque itself.

Each law is a ``@wp.func`` ``law(s, q_c, h, values, row, at, memory, line, slot) -> float``: ``s`` the step with the
path of the shaft, ``q_c`` its displacement, ``h`` the law's last value, ``values[row, at]`` the law's first parameter,
which is 0 where the law is absent, ``memory[line, slot]`` its first state. It returns the new ``h``.
"""

from typing import Any

from mrwarp.effects.law import EffectLaw, EffectParameter, Ranges


def rate(name: str, unit: str, power: int, decades: tuple[float, ...], doc_scale: str) -> EffectParameter:
    """A positive first parameter, searched by its logarithm over the motion's own scale.

    Args:
        name: Its name.
        unit: Its unit for a joint in rad.
        power: Power of the angle's unit in it.
        decades: Starts, in units of the record's range of angle or of speed.
        doc_scale: ``q`` or ``qd``, the range whose power it is measured in.
    """

    def at(r: Ranges, x: float) -> float:
        return x * getattr(r, doc_scale) ** power

    return EffectParameter(
        name=name,
        unit=unit,
        scale=(power, 0, 0),
        negative=False,
        low=lambda r: at(r, 1e-3),
        high=lambda r: at(r, 1e4),
        starts=lambda r: tuple(at(r, x) for x in decades),
    )


def hysteresis_law(
    name: str,
    title: str,
    equation: str,
    source: str,
    law: Any,
    *parameters: EffectParameter,
    states: int = 0,
    depends_on: tuple[str, ...] = ("qd", "memory"),
) -> EffectLaw:
    """A law as an entry next to the effects."""
    return EffectLaw(
        name=name,
        title=title,
        sentence=f"The hysteresis has another shape: {title}.",
        equation=equation,
        kind="law",
        stage="hysteresis",
        parameters=parameters,
        law=law,
        states=states,
        source=source,
        depends_on=depends_on,
        remedy="simulate with this law",
    )
