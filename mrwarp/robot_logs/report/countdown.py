"""How far the diagnosis of a robot's log is: which of its stages, and what is done in it."""

from __future__ import annotations

from mrwarp.options.progress_bar import ProgressBar
from mrwarp.robot_logs.stages import BEGINS


class Countdown:
    """Tells a progress bar the stage of a diagnosis, its number, and the share of the work that is done there."""

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
