"""Terminations: a fall, a number that went wrong, or the time limit, and the reward that reaches the learner."""

# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportCallIssue=false, reportIndexIssue=false
# pyright: reportGeneralTypeIssues=false, reportOperatorIssue=false

from __future__ import annotations

import math

import warp as wp

from mrwarp.env.state import WalkState
from mrwarp.kernels.launch import Launch, record

FALLEN, DIVERGED, TIME_OUT, DONE = range(4)
"""Rows of the flags: a fall or a wrong number; a wrong number; the length, without a fall; any of them."""

LEAST_REWARD = -10.0
"""Least reward of a policy step. A trained gait earns 0.06, robots whose actions are noise of 4 standard deviations,
falls included, pay up to 4 (measured over 300 steps of 64). A solver that throws a robot makes accelerations that cost
1e5 in one step, and would shake the critic's values of all states for an update."""


@wp.kernel(enable_backward=False)
def terminations_kernel(
    # parameters: least height of the trunk [m], largest z of gravity in its frame, length of an episode [policy steps],
    # least reward of a policy step, what a fall takes from it
    least_height: float,
    largest_z: float,
    length: int,
    least_reward: float,
    fall_cost: float,
    # in, shapes (E,) [m], (E, 3) four times, (E, J) twice
    height_in: wp.array[float],
    root_pos_in: wp.array2d[float],
    gravity_in: wp.array2d[float],
    root_vel_in: wp.array2d[float],
    root_ang_in: wp.array2d[float],
    q_in: wp.array2d[float],
    qd_in: wp.array2d[float],
    # out, shapes (E,) 1 where a number went wrong, (E,), (E,) [policy steps], (4, E), (E,) 0 where a number went wrong,
    # else no less than the least
    diverged_out: wp.array[int],
    total_out: wp.array[float],
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
    diverged = diverged_out[env] > 0
    fallen = diverged or not (upright and total == 0.0)
    time_out = now >= wp.int64(length) and not fallen
    flags_out[FALLEN, env] = fallen
    flags_out[DIVERGED, env] = diverged
    flags_out[TIME_OUT, env] = time_out
    flags_out[DONE, env] = fallen or time_out
    # the last reward of a robot that holds no numbers must not reach the learner
    earned = total_out[env] - wp.where(fallen, fall_cost, 0.0)
    reward_out[env] = wp.where(diverged, 0.0, wp.max(earned, least_reward))
    diverged_out[env] = 0
    total_out[env] = 0.0


def terminate(s: WalkState, fall_height: float, fall_tilt: float, length: int, fall_cost: float) -> Launch:
    """Launch that counts the step, writes ``s.flags`` and ``s.reward``, and clears ``s.diverged`` and ``s.total``.

    A robot has fallen below ``fall_height`` [m] or beyond ``fall_tilt`` [rad], which takes ``fall_cost`` from its
    reward; ``length`` is in policy steps.
    """
    return record(
        terminations_kernel,
        len(s.q),
        [
            *(fall_height, -math.cos(fall_tilt), length, LEAST_REWARD, fall_cost),
            *(s.height, s.root_pos, s.gravity, s.root_vel, s.root_ang, s.q, s.qd),
        ],
        [s.diverged, s.total, s.episode_length_buf, s.flags, s.reward],
    )
