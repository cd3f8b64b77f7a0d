"""Which lines of mrwarp have run: an input that reaches a new one is worth damaging further."""

from __future__ import annotations

import sys
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import mrwarp


class Lines:
    """Counts the lines of mrwarp that ran inside ``with``; code that has run whole is not looked at again.

    Attributes:
        new: Lines that ran for the first time in the last ``with``.
    """

    def __init__(self) -> None:
        self.new = 0
        self._folder = str(Path(mrwarp.__file__).parent)
        self._left: dict[CodeType, set[int]] = {}

    def __enter__(self) -> Lines:
        self.new = 0
        sys.settrace(self._call)
        return self

    def __exit__(self, *_: object) -> None:
        sys.settrace(None)

    def _call(self, frame: FrameType, event: str, arg: Any) -> Any:
        code = frame.f_code
        if code not in self._left:
            own = code.co_filename.startswith(self._folder)
            self._left[code] = {line for *_, line in code.co_lines() if line} if own else set()
        return self._line if self._left[code] else None

    def _line(self, frame: FrameType, event: str, arg: Any) -> Any:
        left = self._left[frame.f_code]
        if event == "line" and frame.f_lineno in left:
            left.discard(frame.f_lineno)
            self.new += 1
        return self._line
