"""The last gate of a cause, of a joint or of a robot: it gains, no channel pays for it, a body can have it.

It asks nothing of how causes were found. What it refuses is a suspect, with the reason in words.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

Cause = TypeVar("Cause")
Errors = TypeVar("Errors")


@dataclass(frozen=True, kw_only=True)
class Change:
    """Error of a channel on pieces that took no part, before and after."""

    before: float
    after: float

    @classmethod
    def of(cls, before: np.ndarray, after: np.ndarray) -> Change:
        """Of mean squared errors of N pieces, shape (N,)."""
        return cls(before=float(np.sqrt(before.mean())), after=float(np.sqrt(after.mean())))

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
        if x.share > most:
            return f"the replay's error of {name} grows with it, from {x.before:.3g} to {x.after:.3g}"
    return ""


def impossible(size: float, most: float, unit: str) -> str:
    """Why no body has a number of this size, in words; empty where one can: ``most`` is the largest [``unit``]."""
    if abs(size) <= most:
        return ""
    return f"no body of that size has it: {size:.3g} {unit}, where {most:.3g} {unit} is the most that could be"


def passed(
    causes: Sequence[Cause],
    *,
    faults: Callable[[Sequence[Cause]], Mapping[Cause, str]] = lambda causes: {},
    errors: Callable[[Sequence[Cause]], tuple[tuple[float, float], Mapping[str, Change], Errors]],
    gains: Callable[[Cause, Sequence[Cause]], float],
    most: float,
) -> tuple[list[Cause], dict[Cause, str], Errors]:
    """Causes that pass together, those that do not with the reason, and the errors of those that pass.

    Args:
        causes: All that were found.
        faults: Which of some causes have a size that nothing can have, or none that is known, and why.
        errors: Interval of the gain of some causes, each channel's change, and what else was computed with them.
        gains: Gain of one cause among some; the one that gains least goes first.
        most: Largest growth of a channel's error that is still none [1].
    """
    left, out = list(causes), dict[Cause, str]()
    while True:
        own = {cause: why for cause, why in faults(left).items() if why}
        if not own:
            gain, channels, rest = errors(left)
            if not left or not (why := refused(gain, channels, most)):
                return left, out, rest
            own = {min(left, key=lambda cause: gains(cause, left)): why}
        out |= own
        left = [cause for cause in left if cause not in own]
