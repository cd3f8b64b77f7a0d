"""Mean and standard deviation of a figure over its trials, and of a ratio of two figures."""

from __future__ import annotations

import math

import numpy as np


def spread(values: np.ndarray) -> dict[str, float]:
    """Mean and sample standard deviation, which is 0 for one value; both NaN without any."""
    if not len(values):
        return {"mean": float("nan"), "sd": float("nan")}
    return {"mean": float(values.mean()), "sd": float(values.std(ddof=1)) if len(values) > 1 else 0.0}


def ratio_sd(numerator: tuple[float, float], denominator: tuple[float, float]) -> float:
    """Standard deviation of the ratio of two independent figures, to first order.

    Args:
        numerator: Mean and standard deviation.
        denominator: Mean, not 0, and standard deviation.
    """
    (a, da), (b, db) = numerator, denominator
    return math.hypot(da / b, a * db / b**2)
