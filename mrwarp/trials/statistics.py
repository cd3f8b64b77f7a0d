"""Mean and spread of a figure over its trials, of a ratio of two figures, and intervals of paired differences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import stats


def spread(values: np.ndarray) -> dict[str, float]:
    """Mean and sample standard deviation, which is 0 for one value; both NaN without any, and where one is NaN."""
    mean = float(values.mean()) if len(values) else float("nan")
    return {"mean": mean, "sd": float(values.std(ddof=1)) if len(values) > 1 else mean - mean}


def ratio_sd(numerator: tuple[float, float], denominator: tuple[float, float]) -> float:
    """Standard deviation of the ratio of two independent figures, to first order.

    Args:
        numerator: Mean and standard deviation.
        denominator: Mean, not 0, and standard deviation.
    """
    (a, da), (b, db) = numerator, denominator
    return math.hypot(da / b, a * db / b**2)


def half_width(values: np.ndarray) -> float:
    """Half width of the 95 % interval of the mean (Student's t), shape (n,); 0 for one value."""
    n = len(values)
    return float(stats.t.ppf(0.975, n - 1) * values.std(ddof=1) / np.sqrt(n)) if n > 1 else 0.0


def interval(values: Sequence[float | None] | np.ndarray) -> dict[str, Any]:
    """Mean and half width of its 95 % interval (Student's t); of the values that are numbers, which stand there too."""
    known = np.array([v for v in values if v is not None and np.isfinite(v)], dtype=float)
    mean = float(known.mean()) if len(known) else float("nan")
    return {"mean": mean, "half_width": half_width(known), "values": known.tolist()}


def share(count: int, of: int) -> dict[str, float]:
    """A share with its 95 % interval (Wilson's), ``low`` to ``high``."""
    ends = stats.binomtest(count, of).proportion_ci(method="wilson")
    return {"share": count / of, "low": float(ends.low), "high": float(ends.high)}
