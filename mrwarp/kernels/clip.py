"""Clipping that hides nothing."""

import warp as wp


@wp.func
def clip(value: float, limit: float) -> float:
    """The value within +-limit; NaN stays NaN, where ``wp.clamp`` makes it the lower limit: a number like any other."""
    return wp.where(wp.isnan(value), value, wp.clamp(value, -limit, limit))
