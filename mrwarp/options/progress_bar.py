"""How far a command is: a bar with the stage and an honest estimate, or a line per stage where nobody watches."""

from __future__ import annotations

import re
import sys
import threading
import time
from types import TracebackType
from typing import Any, Self

from mrwarp.runtime import duration

STAGE_WORDS = 6
"""Most words of a stage."""

IN_FULL = ("note:", "warning:", "likely:", "error:")
"""Beginnings of texts that are no stage: they are printed whole, above the bar, and once per run."""

LEAST_SHARE, LEAST_SECONDS = 0.1, 2.0
"""Part of the work, and time, from which an estimate is made: what begins says little of what follows."""

STEADY = 1.5
"""Ratio of two estimates of the whole time up to which both are believed: one that jumps is not shown."""

WIDTH = 20
"""Characters of the bar."""

REFRESH = 0.5
"""Time between two drawings of a bar whose stage lasts [s]."""


class ProgressBar:
    """Takes stages and shares of the work, and shows them on a terminal as one line that is drawn again.

    Where the stream is no terminal, each stage is a line, printed when it begins. Numbers in a stage do not make
    another one. Usable in a ``with`` block, which clears the bar at its end.

    Args:
        stream: Where it is shown; the standard output by default.
    """

    def __init__(self, stream: Any = None) -> None:
        self._stream = sys.stdout if stream is None else stream
        self._live = self._stream.isatty()
        self._begun = self._moved = time.perf_counter()
        self._stage, self._detail, self._ending = "", "", ""
        self._share: float | None = None
        self._whole = self._before = 0.0
        self._seen: set[str] = set()
        self._lock, self._ended = threading.RLock(), threading.Event()  # a signal may come while a line is drawn
        if self._live:
            threading.Thread(target=self._refresh, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.done()

    @property
    def seconds(self) -> float:
        """Time since it was made [s]."""
        return time.perf_counter() - self._begun

    def __call__(self, text: str, share: float | None = None, *, detail: str = "", ending: str = "") -> None:
        """A stage goes on.

        Args:
            text: The stage, of which the first clause is shown; or a note, see :data:`IN_FULL`.
            share: Part of the work that is done [1], if it is known.
            detail: Figures of the moment, shown on a terminal.
            ending: What is known of the end, in place of an estimate from ``share``.
        """
        if text.startswith(IN_FULL):
            self.note(text)
            return
        with self._lock:
            self._stage, self._detail, self._ending = stage_of(text), detail, ending
            if share is not None and share != self._share:
                self._learn(share)
            if self._live:
                self._draw()
            elif (key := re.sub(r"[\d.,]+", "#", self._stage)) not in self._seen:
                self._seen.add(key)
                print(self._line(), file=self._stream, flush=True)

    def note(self, text: str) -> None:
        """Print a text of its own above the bar, once per run."""
        if text not in self._seen:
            self._seen.add(text)
            self.line(f"[{self.seconds:5.1f} s] {text}")

    def line(self, text: str) -> None:
        """Print a line above the bar."""
        with self._lock:
            print(f"\r\033[K{text}" if self._live else text, file=self._stream, flush=True)

    def log(self, text: str) -> None:
        """Print a line where no terminal shows the bar: a log of a long stage has figures, too."""
        if not self._live:
            self.line(text)

    def done(self) -> None:
        """Clear the bar."""
        self._ended.set()
        with self._lock:
            if self._live:
                print("\r\033[K", end="", file=self._stream, flush=True)

    def left(self, now: float) -> float | None:
        """Time that is left [s], by ``time.perf_counter``; None while nothing honest can be said."""
        if self._share is None or self._share < LEAST_SHARE or self._moved - self._begun < LEAST_SECONDS:
            return None
        if not self._before / STEADY <= self._whole <= self._before * STEADY:
            return None
        left = self._whole - (now - self._begun)
        return left if left > 0.0 else None  # it lasts longer than estimated: nobody knows how long

    def _learn(self, share: float) -> None:
        """Estimate the whole time again from a share that is done now."""
        self._moved, self._share = time.perf_counter(), share
        if share > 0.0:
            self._before, self._whole = self._whole, (self._moved - self._begun) / share

    def _text(self) -> str:
        """Stage, and how long it may still take."""
        left = self.left(time.perf_counter())
        ending = self._ending or ("" if left is None else f"about {roughly(left)} left")
        return ", ".join(filter(None, (self._stage, self._detail if self._live else "", ending)))

    def _line(self) -> str:
        return f"[{self.seconds:5.1f} s] {self._text()}"

    def _draw(self) -> None:
        if self._share is None:
            shown = self._line()
        else:
            full = round(WIDTH * min(max(self._share, 0.0), 1.0))
            shown = f"[{'#' * full}{'-' * (WIDTH - full)}] {self._share:4.0%}  {self._text()}"
        print(f"\r\033[K{shown}", end="", file=self._stream, flush=True)

    def _refresh(self) -> None:
        """Draw a lasting stage again, so that its time goes on."""
        while not self._ended.wait(REFRESH):
            with self._lock:
                if self._stage and not self._ended.is_set():
                    self._draw()


def roughly(seconds: float) -> str:
    """A length of time with the digits that an estimate has: to five seconds, later to minutes."""
    return duration(5.0 * max(round(seconds / 5.0), 1))


def stage_of(text: str) -> str:
    """The first clause of a text, of at most :data:`STAGE_WORDS` words."""
    clause = re.split(r"[:;]\s|\s\(|,\s", text.strip(), maxsplit=1)[0].removesuffix(":")
    return " ".join(clause.split()[:STAGE_WORDS])
