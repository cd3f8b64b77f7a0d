"""Pictures of a diagnosis as small PNGs, in colours that colour-blind people distinguish."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping

import matplotlib
from matplotlib.figure import Figure
from matplotlib.font_manager import FontProperties

from mrwarp.runtime import drawing

MEASURED, BEFORE, AFTER, ALTERNATIVE, NOISE, OTHER = "#222222", "#d55e00", "#0072b2", "#56b4e9", "#d0d0d0", "#e69f00"
"""Okabe and Ito's colours: baseline, extension, its alternatives; grey for noise, yellow for what stays unexplained."""


def drawn(
    makers: Mapping[str, Callable[[], Figure | None]], titles: Mapping[str, str], *, size: float, dpi: float
) -> tuple[dict[str, bytes], list[str]]:
    """PNGs by name, in the order of their ``titles``, whose letters have a ``size`` [pt], and notes.

    A maker gives None where there are no data for its picture. A note names one that could not be drawn, and why.
    """
    found: dict[str, bytes] = {}
    notes: list[str] = []
    with matplotlib.rc_context({"axes.spines.top": False, "axes.spines.right": False}):
        for name, make in makers.items():
            with drawing(f"the picture {name!r}", notes.append):
                if (figure := make()) is not None:
                    _titled(figure, titles[name], size)
                    found[name] = png(figure, dpi)
    return {name: found[name] for name in titles if name in found}, notes


def _titled(figure: Figure, text: str, size: float) -> None:
    """Put a title above everything in a figure; a legend outside of its axes carries it, for both would overlap."""
    if figure.legends:
        figure.legends[0].set_title(text, prop=FontProperties(weight="bold", size=size))
        figure.legends[0].set_alignment("left")
    else:
        figure.suptitle(text, x=0.01, ha="left", weight="bold", fontsize=size)


def png(figure: Figure, dpi: float) -> bytes:
    """A figure as PNG, without a date or a program's name in it."""
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=dpi, metadata={"Software": None})
    return data.getvalue()
