"""Stage of a diagnosis and the time that it may still take, printed at least every few seconds."""

from __future__ import annotations

import threading
import time
from types import TracebackType
from typing import Self

from mrwarp.identify.projection import Progress

EVERY = 4.0
"""Longest silence [s]."""
_BEGINS = {
    "eqs. 14": 0.01,
    "noise": 0.03,
    "candidates": 0.16,
    "noise without": 0.25,
    "refining": 0.35,
    "pairs": 0.48,
    "smallest sizes": 0.93,
    "next experiment": 0.94,
    "pictures": 0.95,
}
"""Part of the whole time at which a step begins, by words of its line: as on the recording of ``mrwarp bench``."""


class Countdown:
    """Takes a line at every step, and repeats it with the time that is left while the step lasts.

    The time follows from what the steps so far took and from the parts that steps usually take.
    """

    def __init__(self, say: Progress, every: float = EVERY) -> None:
        self._say, self._every = say, every
        self._begun = self._said = self._step_begun = time.perf_counter()
        self._text, self._share = "reading", 0.0
        self._done, self._lock = threading.Event(), threading.Lock()
        self._thread = threading.Thread(target=self._repeat, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._done.set()
        self._thread.join()

    def __call__(self, text: str) -> None:
        """A step begins."""
        with self._lock:
            begins = [key for key in _BEGINS if key in text]
            if begins:
                self._share, self._step_begun = _BEGINS[max(begins, key=len)], time.perf_counter()
            self._text, self._said = text, time.perf_counter()
            self._say(text)

    def left(self, now: float) -> float | None:
        """Time that is left [s], by ``time.perf_counter``; None before the first step says how quick things go."""
        if self._share < 0.02:
            return None
        whole = (self._step_begun - self._begun) / self._share
        later = [share for share in (*_BEGINS.values(), 1.0) if share > self._share]
        slow = 0.2 * (now - self._step_begun)  # a step that lasts longer than it should
        return max(whole - (now - self._begun), whole * (1.0 - min(later)) + slow, 1.0)

    def _repeat(self) -> None:
        while not self._done.wait(0.25):
            with self._lock:
                now = time.perf_counter()
                if now - self._said >= self._every:
                    self._said, left = now, self.left(now)
                    self._say(f"{self._text}: going on" + (f", about {left:.0f} s left" if left else ""))
