"""Kernel that keeps the last states of every environment and names the first number that is wrong."""

from typing import Any

import warp as wp

_COPY = """
const auto* from = (const decltype(values.data))((const char*)values.data + size_t(env) * values.strides[0]);
float* to = &wp::index(history, slot, env, column);
int wrong = 0;
for (int i = 0; i < values.shape[1]; ++i) {
    to[i] = (float)from[i];
    wrong |= to[i] - to[i] != 0.0f;  // what is no finite number
}
return wrong;
"""
_BEYOND = """
const float* state = &wp::index(history, slot, env, first);
int beyond = 0;
for (int i = 0; i < low.shape[0]; ++i) beyond |= (state[i] < low.data[i]) | (state[i] > high.data[i]);
return beyond;
"""


@wp.func_native(_COPY)
def copy_row(  # pyright: ignore[reportRedeclaration]
    values: wp.array2d[float], env: int, history: wp.array3d[float], slot: int, column: int
) -> int:
    """Copy the values of an environment, contiguous, into its history; 1 if one is not finite."""
    ...


@wp.func_native(_COPY)
def copy_row(  # noqa: F811 - Warp takes the one whose types fit
    values: wp.array2d[wp.float64], env: int, history: wp.array3d[float], slot: int, column: int
) -> int:
    """The same in double precision."""
    ...


@wp.func_native(_BEYOND)
def beyond(
    low: wp.array[float], high: wp.array[float], env: int, history: wp.array3d[float], slot: int, first: int
) -> int:
    """1 if one of the columns from ``first`` on is out of its bounds; NaN is not."""
    ...


@wp.func
def keep_row(
    values: wp.array2d[Any], env: int, slot: int, column: int, wrong: int, history_out: wp.array3d[float]
) -> tuple[int, int]:
    """Copy the values of an environment into its history; the next column, and 1 if one so far is not finite."""
    return column + values.shape[1], wrong | copy_row(values, env, history_out, slot, column)


@wp.kernel
def watch_kernel(
    # parameters: 1 = end of a policy step; step [s]; bits that count as overflow; bounds of a state that is not
    # broken, and of one that is not noticed, for the columns of qpos and qvel, shape (nq + nv,)
    last: int,
    dt: float,
    overflow_mask: int,
    low: wp.array[float],
    high: wp.array[float],
    notice_low: wp.array[float],
    notice_high: wp.array[float],
    # in, shapes (E, A), (E, M), (E, M) [A], (E, J) [N·m], (E, J) [N·m], (E, nq), (E, nv), (E, L) [N], (E,), (E, C)
    action_in: wp.array2d[float],
    z_in: wp.array2d[float],
    current_in: wp.array2d[float],
    tau_in: wp.array2d[float],
    bound_in: wp.array2d[float],
    qpos_in: wp.array2d[Any],
    qvel_in: wp.array2d[Any],
    f_foot_in: wp.array2d[float],
    reward_in: wp.array[float],
    overflow_in: wp.array2d[int],
    # out, shapes (E,), (N + 1, E, D), five times (E,), (E, 2), (E, C)
    age_out: wp.array[int],
    history_out: wp.array3d[float],
    rows_out: wp.array[int],
    cause_out: wp.array[int],
    broken_out: wp.array[int],
    breaks_out: wp.array[int],
    noticed_column_out: wp.array[int],
    noticed_out: wp.array2d[int],
    overflow_seen_out: wp.array2d[int],
):
    """Add the state to the ring of the last N, unless the ring waits to be read; find the first wrong column.

    ``cause`` is -1, or the column that is no finite number, or D + the column that is beyond its bounds. The last row
    of the history is where states go that are checked but not kept.
    """
    env = wp.tid()
    kept = history_out.shape[0] - 1
    size = history_out.shape[2]
    frozen = cause_out[env] >= 0
    slot = rows_out[env] % kept
    if frozen:
        slot = kept
    history_out[slot, env, 0] = float(age_out[env]) * dt
    wrong = int(0)
    k = int(1)
    k, wrong = keep_row(action_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(z_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(current_in, env, slot, k, wrong, history_out)
    # qpos and qvel before the torques that follow from them
    first = k
    k, wrong = keep_row(qpos_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(qvel_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(f_foot_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(tau_in, env, slot, k, wrong, history_out)
    k, wrong = keep_row(bound_in, env, slot, k, wrong, history_out)
    history_out[slot, env, k] = reward_in[env]
    if reward_in[env] - reward_in[env] != 0.0:
        wrong = 1

    cause = int(-1)
    if wrong == 1:
        for i in range(size):
            if cause < 0 and not wp.isfinite(history_out[slot, env, i]):
                cause = i
    # what is broken is beyond the bounds of what is noticed too
    if cause < 0 and beyond(notice_low, notice_high, env, history_out, slot, first) == 1:
        for i in range(low.shape[0]):
            state = history_out[slot, env, first + i]
            if state < notice_low[i] or state > notice_high[i]:
                if state < low[i] or state > high[i]:
                    if cause < 0:
                        cause = size + first + i
                else:
                    noticed_column_out[env] = first + i
                    noticed_out[env, 0] = noticed_out[env, 0] + 1
    dropped = int(0)
    for i in range(overflow_in.shape[1]):
        # counters and flags of the engine rise and stay: only a change is news
        now = overflow_in[env, i] & overflow_mask
        if now != overflow_seen_out[env, i]:
            dropped = 1
            overflow_seen_out[env, i] = now
    noticed_out[env, 1] = noticed_out[env, 1] + dropped

    if cause >= 0:
        if broken_out[env] == 0:
            breaks_out[env] = breaks_out[env] + 1
        broken_out[env] = 1
        if not frozen:
            cause_out[env] = cause
    if last == 0:
        age_out[env] = age_out[env] + 1
    # at the end of a policy step the state is only checked: the next torque step keeps it
    if not frozen and (last == 0 or cause >= 0):
        rows_out[env] = rows_out[env] + 1


@wp.kernel
def clear_kernel(
    # in, shape (E,)
    done_in: wp.array[wp.bool],
    # out, shape (E,) three times
    age_out: wp.array[int],
    broken_out: wp.array[int],
    reward_out: wp.array[float],
):
    """Begin the next policy step, and a new episode where one is done."""
    env = wp.tid()
    broken_out[env] = 0
    reward_out[env] = 0.0
    if done_in[env]:
        age_out[env] = 0
