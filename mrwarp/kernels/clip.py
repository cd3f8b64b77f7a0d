"""Clipping that hides nothing."""

import warp as wp


@wp.func
def clip(value: float, limit: float) -> float:
    """The value within +-limit; NaN stays NaN, where ``wp.clamp`` makes it the lower limit: a number like any other.

    NaN fails both comparisons. ``wp.isnan`` would be a call into a library on a CPU, which costs as much as eq. 15.
    """
    return wp.where(value > limit, limit, wp.where(value < -limit, -limit, value))
