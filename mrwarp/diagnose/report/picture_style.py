"""How the pictures of a diagnosis look: colours, sizes, labels of their axes."""

from __future__ import annotations

from typing import Any

from mrwarp.diagnose.verdict_text import quantity

MEASURED, BEFORE, AFTER, ALTERNATIVE, NOISE, OTHER = "#222222", "#d55e00", "#0072b2", "#56b4e9", "#d0d0d0", "#e69f00"
"""Okabe and Ito's colours: baseline, extension, its alternatives; grey for noise, yellow for what stays unexplained."""

STYLE: dict[Any, Any] = {
    "font.size": 12.0,
    "axes.titlesize": 12.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 12.0,
    "legend.fontsize": 11.0,
    "legend.framealpha": 0.85,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "lines.linewidth": 1.6,
    "axes.axisbelow": True,
    "text.parse_math": False,
    "path.simplify_threshold": 0.5,
    "axes.formatter.limits": (-4, 5),
}
WIDTH = 6.4
"""Width of a figure [in]: fills a phone, and leaves its letters readable."""
DPI = 100


def axis_label(key: str, units: dict[str, str], gap: str = " ") -> str:
    """What a column of a recording holds, with its unit."""
    return f"velocity{gap}[{units['q']}/s]" if key == "qd" else f"{quantity(units[key])}{gap}[{units[key]}]"


def short(text: str, most: int) -> str:
    """A name on one line, shortened in the middle; what a font cannot show is replaced."""
    text = "".join(c if c.isprintable() else "?" for c in text)
    return text if len(text) <= most else f"{text[: most // 2 - 1]}…{text[-(most - most // 2) :]}"
