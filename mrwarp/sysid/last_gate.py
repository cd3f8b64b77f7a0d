"""The last gate of a cause, of a joint or of a robot: it gains, no channel pays for it, a body can have it.

It asks nothing of how causes were found. What it refuses is a suspect, with the reason in words.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrwarp.sysid.jackknife import student, sum_and_error


@dataclass(frozen=True, kw_only=True)
class Change:
    """Error of a channel on pieces that took no part, before and after."""

    before: float
    after: float
    half: float
    """Half of the 95 % interval of the relative change, over pieces [1]."""

    @classmethod
    def of(cls, before: np.ndarray, after: np.ndarray) -> Change:
        """Of mean squared errors of N pieces, shape (N,)."""
        each = np.sqrt(after / np.maximum(before, 1e-300)) - 1.0
        half = student(0.95, max(len(each) - 1, 1)) * sum_and_error(each)[1] / len(each)
        return cls(before=float(np.sqrt(before.mean())), after=float(np.sqrt(after.mean())), half=half)

    @property
    def share(self) -> float:
        """Relative change of the error [1]."""
        return self.after / max(self.before, 1e-300) - 1.0


def refused(gain: tuple[float, float], channels: Mapping[str, Change], most: float) -> str:
    """Why causes with this gain are not named, in words; empty where they may be.

    Args:
        gain: 95 % interval of the reduction of the error on pieces that took no part [1].
        channels: Errors of each channel that a cause must not make worse.
        most: Largest growth of a channel's error that is still none [1].
    """
    low, high = gain
    if not low > 0.0:
        return (
            "the error on pieces of the data that took no part does not clearly fall with it: by "
            f"{100.0 * 0.5 * (low + high):.1f} % ({100.0 * low:.1f} to {100.0 * high:.1f} %)"
        )
    for name, x in channels.items():
        if not (x.share <= most and x.share - x.half <= 0.0):
            return f"the replay's error of {name} grows with it, from {x.before:.3g} to {x.after:.3g}"
    return ""


def impossible(size: float, most: float, unit: str) -> str:
    """Why no body has a number of this size, in words; empty where one can: ``most`` is the largest [``unit``]."""
    if abs(size) <= most:
        return ""
    return f"no body of that size has it: {size:.3g} {unit}, where {most:.3g} {unit} is the most that could be"
