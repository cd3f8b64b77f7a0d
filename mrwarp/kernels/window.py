"""History of (q_c, qd, I) for the learned residual (eq. 12): a ring per joint, read out oldest sample first."""

import warp as wp

WINDOW = 50
"""Samples of history, paper eq. 12: 0.25 s at 200 Hz."""

FEATURES = 3
"""Features per sample: displacement q_c [rad], velocity qd [rad/s], coil current I [A]."""


@wp.func
def window_row(sample: int, head: int, length: int) -> int:
    """Ring row of the ``sample``-th oldest entry when the newest was written at ``head``."""
    return (head + 1 + sample) % length


@wp.kernel
def window_read_kernel(
    # in, shape (E, M, WINDOW, FEATURES), (1,)
    ring_in: wp.array4d[float],
    head_in: wp.array[int],
    # out, shape (E, M, WINDOW, FEATURES)
    window_out: wp.array4d[float],
):
    """Copy the ring in the order of time, oldest sample first."""
    env, joint, sample = wp.tid()
    length = ring_in.shape[2]
    row = window_row(sample, head_in[0], length)
    for k in range(FEATURES):
        window_out[env, joint, sample, k] = ring_in[env, joint, row, k]
