"""Which episodes end with a policy step, and the rewards that reach the learner."""

import warp as wp

FALLEN, BROKEN, TIME_OUT, DONE = range(4)
"""Rows of the flags: a fall or a wrong number; a wrong number; the length, without a fall; any of them."""


@wp.kernel
def ends_kernel(
    # parameters: least height of the trunk [m], largest z of gravity in its frame, length of an episode [policy steps],
    # least reward of a policy step
    least_height: float,
    largest_z: float,
    length: int,
    least_reward: float,
    # in, shapes (E,) [m], (E, 3) four times, (E, J) twice, (E,) 1 where a number went wrong, (E,)
    height_in: wp.array[float],
    root_pos_in: wp.array2d[float],
    gravity_in: wp.array2d[float],
    root_vel_in: wp.array2d[float],
    root_ang_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    broken_in: wp.array[int],
    reward_in: wp.array[float],
    # out, shapes (E,) [policy steps], (4, E), (E,) 0 where a number went wrong, else no less than the least
    episode_length_out: wp.array[wp.int64],
    flags_out: wp.array2d[wp.bool],
    reward_out: wp.array[float],
):
    """Count the policy step; a trunk too low or leaning too far, a state that is no number, or the time ends it."""
    env = wp.tid()
    now = episode_length_out[env] + wp.int64(1)
    episode_length_out[env] = now
    # 0*x is NaN where x is no finite number, and NaN fails every comparison
    total = float(0.0)
    for k in range(3):
        total += 0.0 * (root_pos_in[env, k] + gravity_in[env, k]) + 0.0 * (root_vel_in[env, k] + root_ang_in[env, k])
    for k in range(q_in.shape[1]):
        total += 0.0 * (q_in[env, k] + qd_in[env, k])
    upright = height_in[env] > least_height and gravity_in[env, 2] < largest_z
    broken = broken_in[env] > 0
    fallen = broken or not (upright and total == 0.0)
    time_out = now >= wp.int64(length) and not fallen
    flags_out[FALLEN, env] = fallen
    flags_out[BROKEN, env] = broken
    flags_out[TIME_OUT, env] = time_out
    flags_out[DONE, env] = fallen or time_out
    # the last reward of a robot that holds no numbers must not reach the learner
    reward_out[env] = wp.where(broken, 0.0, wp.max(reward_in[env], least_reward))
