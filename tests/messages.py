"""Requirements of tests on a message: place, value and remedy, not the sentence around them."""

from collections.abc import Callable

Refused = Callable[..., str]
"""Runs a command that must refuse its input, given as words, and returns its one line: the fixture ``refused``."""


def has_parts(message: str, parts: str) -> bool:
    """Whether the message has the parts, separated by `` .. ``, in this order; any words may stand between them."""
    at = 0
    for part in parts.split(" .. "):
        found = message.find(part, at)
        if found < 0:
            return False
        at = found + len(part)
    return True
