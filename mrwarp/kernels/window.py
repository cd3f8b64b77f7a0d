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
