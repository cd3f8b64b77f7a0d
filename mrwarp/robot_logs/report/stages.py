"""Stages of a robot's diagnosis in their order, and how far it is."""

from __future__ import annotations

from collections.abc import Callable

from mrwarp.options.progress_bar import ProgressBar

READING = "reading"
SESSION = "floor and delays"
DERIVATIVES = "derivatives"
SINGLE = "single causes"
FIT = "fit"
WHOLE_LOG = "whole log"
PROOF = "proof"
SIZES = "sizes"
BEFORE_AFTER = "before and after"
UNEXPLAINED = "unexplained"

BEGINS = {
    READING: 0.0,
    SESSION: 0.01,
    DERIVATIVES: 0.08,
    SINGLE: 0.28,
    FIT: 0.44,
    WHOLE_LOG: 0.75,
    PROOF: 0.78,
    SIZES: 0.84,
    BEFORE_AFTER: 0.92,
    UNEXPLAINED: 0.97,
}
"""Part of the whole time at which each begins, of the processor's time for a walk of 5 s on four feet [1]."""


def within(progress: Callable[[str], None], stage: str) -> Callable[[str], None]:
    """A progress that reports what is done in a stage."""
    return lambda text: progress(f"{stage}: {text}")


class Countdown:
    """Gives a progress bar the stage of a diagnosis, its number, and the share of the work that is done there."""

    def __init__(self, bar: ProgressBar) -> None:
        self._bar = bar

    def __call__(self, text: str) -> None:
        """Something is done in a stage, as "fit: replay 3"; or a note is made."""
        stage, _, detail = text.partition(": ")
        if stage in BEGINS:
            number = list(BEGINS).index(stage) + 1
            self._bar(f"{number} of {len(BEGINS)} {stage}", BEGINS[stage], detail=detail)
        else:
            self._bar(text)
