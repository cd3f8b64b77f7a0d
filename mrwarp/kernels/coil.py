"""The coil: current follows the command with a first-order lag, by its exact step."""

import warp as wp


@wp.func
def coil_current(current: float, command: float, time_constant: float, dt: float) -> float:
    """Coil current after ``dt`` [A]: the solution of ``T dI/dt = I_cmd - I``; no lag for T = 0 (the paper)."""
    if time_constant <= 0.0:
        return command
    return command + (current - command) * wp.exp(-dt / time_constant)


@wp.func
def mean_coil_current(current: float, command: float, time_constant: float, dt: float) -> float:
    """Mean of the coil current over the step that :func:`coil_current` takes from ``current`` [A].

    A torque that is held over a step follows this mean: with the current of the step's end it would answer dt/2 early.
    """
    if time_constant <= 0.0:
        return command
    return command + (current - command) * time_constant / dt * (1.0 - wp.exp(-dt / time_constant))
