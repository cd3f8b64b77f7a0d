"""Lag of the velocity: ``qd = v + T dv/dt with v the logged velocity``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def velocity_lag_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The logged velocity lags behind the true one, as a filter makes it."""
    time_constant = values[row, at]
    if time_constant > 0.0:
        s.qd = s.qd + time_constant * s.qdd
        s.qd_before = s.qd_before + time_constant * s.qdd_before
    return s


LAW = EffectLaw(
    name="velocity_lag",
    title="lag of the velocity",
    sentence="The logged velocity lags behind the true one, as a filter makes it.",
    equation="qd = v + T dv/dt with v the logged velocity",
    kind="sensor",
    stage="motion",
    parameters=(
        EffectParameter(
            name="time_constant",
            unit="s",
            negative=False,
            low=lambda r: 1e-4,
            high=lambda r: 0.1,
            most=lambda r: 0.02,  # as of a torque's sensor
            beyond="such a velocity would pass less than 8 Hz",
            starts=lambda r: (0.0007, 0.002, 0.005, 0.012),
        ),
    ),
    law=velocity_lag_law,
    source="first-order velocity filter of a motor controller",
    depends_on=("qd", "memory"),
    remedy="derive the velocity from the angle, without phase",
    rounds_corners=True,
    measured_in="qd",
)
