"""The terrain's curriculum: how far a robot came decides the level of its next episode."""

import warp as wp

from mrwarp.env.task_kernels.draws import LEVEL, draw, place
from mrwarp.env.task_kernels.ends import DONE, TIME_OUT


@wp.kernel
def course_kernel(
    # parameters: levels; 1 = levels change; shares of the commanded way above and below which they do; policy step [s]
    levels: int,
    curriculum: int,
    up_at: float,
    down_at: float,
    step_dt: float,
    # in, shapes (2,), (E, 3) [m/s], (E, 3) [m/s, m/s, rad/s], (4, E)
    key_in: wp.array[wp.int64],
    body_velocity_in: wp.array2d[float],
    command_in: wp.array2d[float],
    flags_in: wp.array2d[wp.bool],
    # out, shapes (E,), (E,) [m] twice
    level_out: wp.array[wp.int64],
    walked_out: wp.array[float],
    commanded_out: wp.array[float],
):
    """Count the way of a step; up a level after most of the way, down after little or a fall, any past the last."""
    env = wp.tid()
    walked = walked_out[env] + body_velocity_in[env, 0] * step_dt
    commanded = commanded_out[env] + command_in[env, 0] * step_dt
    if flags_in[DONE, env]:
        if curriculum == 1:
            level, share = int(level_out[env]), walked / wp.max(commanded, 1.0e-3)
            if not flags_in[TIME_OUT, env] or share < down_at:
                level = wp.max(level - 1, 0)
            elif share > up_at:
                level += 1
            if level >= levels:
                level = wp.min(int(float(levels) * draw(place(key_in, env, LEVEL), 0)), levels - 1)
            level_out[env] = wp.int64(level)
        walked, commanded = 0.0, 0.0
    walked_out[env] = walked
    commanded_out[env] = commanded
