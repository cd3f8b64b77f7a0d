"""Mean and standard deviation of a figure over its trials."""

from __future__ import annotations

import numpy as np


def spread(values: np.ndarray) -> dict[str, float]:
    """Mean and sample standard deviation, which is 0 for one value; both NaN without any."""
    if not len(values):
        return {"mean": float("nan"), "sd": float("nan")}
    return {"mean": float(values.mean()), "sd": float(values.std(ddof=1)) if len(values) > 1 else 0.0}
