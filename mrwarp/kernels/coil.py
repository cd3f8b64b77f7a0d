"""The coil: current follows the command with a first-order lag, by its exact step."""

import warp as wp


@wp.func
def coil_current(current: float, command: float, time_constant: float, dt: float) -> float:
    """Coil current after ``dt`` [A]: the solution of ``T dI/dt = I_cmd - I``; no lag for T = 0 (the paper)."""
    if time_constant <= 0.0:
        return command
    return command + (current - command) * wp.exp(-dt / time_constant)
