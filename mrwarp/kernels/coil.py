"""The coil: current follows the command with a first-order lag, by its exact step."""

import warp as wp


@wp.func
def coil_current(current: float, command: float, time_constant: float, dt: float) -> float:
    """Coil current after ``dt`` [A]: the solution of ``T dI/dt = I_cmd - I``; no lag for T = 0 (the paper)."""
    if time_constant <= 0.0:
        return command
    return command + (current - command) * wp.exp(-dt / time_constant)


@wp.kernel
def coil_kernel(
    # parameters, scalars [s, s]
    time_constant: float,
    dt: float,
    # in, shape (E, M) [A]
    command_in: wp.array2d[float],
    current_in: wp.array2d[float],
    # out, shape (E, M) [A]
    current_out: wp.array2d[float],
):
    """Advance the coil current by one step."""
    env, joint = wp.tid()
    current_out[env, joint] = coil_current(current_in[env, joint], command_in[env, joint], time_constant, dt)
