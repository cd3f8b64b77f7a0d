"""The answer of a diagnosis, of any plant."""

from __future__ import annotations

from typing import Literal

Verdict = Literal["none", "named", "unexplained", "named_and_unexplained"]

VERDICTS: dict[tuple[bool, bool], Verdict] = {
    (False, False): "none",
    (True, False): "named",
    (False, True): "unexplained",
    (True, True): "named_and_unexplained",
}
"""By whether there are causes, and something that none explains."""
