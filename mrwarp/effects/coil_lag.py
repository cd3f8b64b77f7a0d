"""Coil lag: ``T dI/dt = I_cmd - I``."""

import warp as wp

from mrwarp.effects.law import STEP_IN_INTERVAL, EffectLaw, EffectParameter, Path
from mrwarp.kernels.coil import coil_current, mean_coil_current


@wp.func
def coil_lag_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The current in the coil follows its command with a first-order lag."""
    time_constant = values[row, at]
    if time_constant > 0.0 and s.held == 1:
        begin = memory[line, slot]
        memory[line, slot] = coil_current(begin, s.command, time_constant, s.dt)
        s.current = mean_coil_current(begin, s.command, time_constant, s.dt)
        s.field = s.current
    elif time_constant > 0.0:
        hold, change = values[row, at + 1], s.command - s.command_before
        current = float(s.command)
        if s.begins == 0:
            start = s.command_before + wp.max(-hold, 0.0) * change
            slope = (1.0 - wp.abs(hold)) * change / s.dt
            lag = slope * time_constant
            current = start + slope * s.dt - lag + (memory[line, slot] - start + lag) * wp.exp(-s.dt / time_constant)
        memory[line, slot] = current
        s.current = current
        s.field = current
    return s


LAW = EffectLaw(
    name="coil_lag",
    title="coil lag",
    sentence="The current in the coil follows its command with a first-order lag.",
    equation="T dI/dt = I_cmd - I",
    kind="mechanism",
    stage="current",
    parameters=(
        EffectParameter(
            name="time_constant",
            unit="s",
            negative=False,
            low=lambda r: 1e-4,
            high=lambda r: 0.5,
            # the coil of a large damper takes 0.1 s, the field of one whose iron carries eddy currents a second
            most=lambda r: 2.0,
            beyond="no coil is that slow",
            starts=lambda r: (0.0005, 0.001, 0.002, 0.004, 0.008, 0.016, 0.03, 0.08),
        ),
        STEP_IN_INTERVAL,
    ),
    law=coil_lag_law,
    states=1,
    source="paper section 4.3, current-response delay; an R-L circuit",
    depends_on=("current", "memory"),
    remedy="raise the current controller's bandwidth or its supply voltage",
    needs="command",
    unseen="the current hardly changes within a trajectory",
)
