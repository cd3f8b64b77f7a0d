"""Lag of the torque sensor: ``T dtau_m/dt = tau - tau_m``."""

import warp as wp

from mrwarp.effects.law import STEP_IN_INTERVAL, EffectLaw, EffectParameter, Path

SAMPLING_RESOLUTION = 0.005
"""Relative standard error of a lag of about a sample, as nobody sees the torque between samples.

A straight line there gives 0.7 % too little (``benchmarks.confusion --family bench --kinds torque_sensor_lag``).
"""


@wp.func
def torque_sensor_lag_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The torque is read through a first-order filter."""
    time_constant = values[row, at]
    if time_constant > 0.0:
        reading = float(s.torque)
        if s.begins == 0:
            hold, jump = values[row, at + 1], float(0.0)
            if hold != 0.0:  # the torque jumps with the command
                jump = s.torque - s.torque_before
            start = memory[line, slot + 1] + wp.max(-hold, 0.0) * jump
            reached = s.torque - wp.max(hold, 0.0) * jump
            lag = (reached - start) / s.dt * time_constant
            reading = reached - lag + (memory[line, slot] - start + lag) * wp.exp(-s.dt / time_constant)
        memory[line, slot] = reading
        memory[line, slot + 1] = s.torque
        s.torque = reading
    return s


LAW = EffectLaw(
    name="torque_sensor_lag",
    title="lag of the torque sensor",
    sentence="The torque is read through a first-order filter.",
    equation="T dtau_m/dt = tau - tau_m",
    kind="sensor",
    stage="sensor",
    parameters=(
        EffectParameter(
            name="time_constant",
            unit="s",
            negative=False,
            low=lambda r: 1e-4,
            high=lambda r: 1.0 if r.drive else 0.1,
            # a sensor that lags 20 ms passes 8 Hz: a bench that records motion does not have it; the current that a
            # drive reports is filtered for a display
            most=lambda r: 0.5 if r.drive else 0.02,
            beyond="such a reading would pass hardly any of the motion, so look whether the torque is stamped late",
            starts=lambda r: (0.0006, 0.0015, 0.003, 0.006, 0.015, *((0.04, 0.1, 0.25) if r.drive else ())),
            resolution=SAMPLING_RESOLUTION,
        ),
        STEP_IN_INTERVAL,
    ),
    law=torque_sensor_lag_law,
    states=2,
    source="low-pass of a bridge amplifier, or of the current that a drive reports",
    depends_on=("memory",),
    remedy="log the torque with more bandwidth",
    rounds_corners=True,
)
