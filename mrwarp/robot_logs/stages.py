"""Stages of a robot's diagnosis, in their order."""

from __future__ import annotations

from collections.abc import Callable

READING = "reading"
SESSION = "floor and delays"
DERIVATIVES = "derivatives"
SINGLE = "single causes"
FIT = "fit"
WHOLE_LOG = "rest of the log"
PROOF = "proof"
SIZES = "sizes"
BEFORE_AFTER = "before and after"
UNEXPLAINED = "unexplained"

BEGINS = {
    READING: 0.0,
    SESSION: 0.01,
    DERIVATIVES: 0.08,
    SINGLE: 0.2,
    FIT: 0.35,
    WHOLE_LOG: 0.7,
    PROOF: 0.75,
    SIZES: 0.8,
    BEFORE_AFTER: 0.9,
    UNEXPLAINED: 0.95,
}
"""Part of the whole time at which each begins, as on a walk of 15 s on four feet [1]."""


def within(progress: Callable[[str], None], stage: str) -> Callable[[str], None]:
    """A progress that tells what is done in a stage."""
    return lambda text: progress(f"{stage}: {text}")
