"""Shares of a diagnosis at which its stages begin, so that its progress bar can estimate the end."""

from __future__ import annotations

from mrwarp.options.progress_bar import ProgressBar

_BEGINS = {
    "eqs. 14": 0.01,
    "noise": 0.02,
    "candidates": 0.05,
    "noise without": 0.15,
    "refining": 0.19,
    "pairs": 0.23,
    "nameless structure": 0.41,
    "what repeats": 0.85,
    "smallest sizes": 0.93,
    "next experiment": 0.94,
    "pictures": 0.95,
}
"""Part of the whole time at which a stage begins, by words of its text: as on the recording of ``mrwarp bench``."""


class Countdown:
    """Gives a progress bar the share of the work that is done when a stage of a diagnosis begins."""

    def __init__(self, bar: ProgressBar) -> None:
        self._bar, self._share = bar, 0.0

    def __call__(self, text: str) -> None:
        """A stage begins, or a note is made."""
        begins = [key for key in _BEGINS if key in text]
        if begins:  # stages that come again do not turn the bar back
            self._share = max(self._share, _BEGINS[max(begins, key=len)])
        self._bar(text, self._share)
