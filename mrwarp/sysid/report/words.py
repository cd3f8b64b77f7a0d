"""Shares, chances and lists in the words of a page."""

from __future__ import annotations

import math
from collections.abc import Iterable


def percent(share: float, places: int = 1) -> str:
    """A share in per cent."""
    return f"{100.0 * share:.{places}f} %" if math.isfinite(share) else "unknown"


def signed(share: float, places: int = 1) -> str:
    """A change in per cent, with a typographic minus sign where it falls."""
    return percent(share, places).replace("-", "−")


def change(before: float, after: float) -> str:
    """By what a number changed, in whole per cent with a sign."""
    return f"{100.0 * (after / before - 1.0):+.0f} %".replace("-", "−") if before > 0.0 else "–"


def chance(p: float) -> str:
    """A probability for people."""
    if not math.isfinite(p):
        return "unknown"
    if p < 1e-6:
        return "less than one in a million"
    return f"1 in {round(1.0 / p):,}" if p < 0.01 else f"{100.0 * p:.0f} %"


def both(words: Iterable[str], last: str = "and") -> str:
    """Words joined by commas and "and"."""
    words = list(words)
    return words[0] if len(words) == 1 else ", ".join(words[:-1]) + f" {last} {words[-1]}" if words else ""


def short(text: str, most: int) -> str:
    """A name on one line, shortened in the middle; what a font cannot show is replaced."""
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= most else f"{text[: most // 2 - 1]}…{text[-(most - most // 2) :]}"


def capital(text: str) -> str:
    """The text with a capital at its front."""
    return text[:1].upper() + text[1:]
