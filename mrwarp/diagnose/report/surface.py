"""Mismatch over two variables at once: cell means, for structure that no single variable shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrwarp.diagnose.report.binning import Axis
from mrwarp.diagnose.result import Traces

_CELLS = (16, 12)
"""Cells along the first and the second variable."""
_LEAST = 30
"""Fewest samples of a cell that is shown."""


@dataclass(frozen=True, kw_only=True)
class Surface:
    """Cell means of what the extension leaves."""

    across: Axis
    up: Axis
    x: np.ndarray
    """Edges of the cells along ``across``, shape (X + 1,)."""
    y: np.ndarray
    """Edges along ``up``, shape (Y + 1,)."""
    mean: np.ndarray
    """Shape (Y, X); NaN where there are too few samples."""
    meaning: str
    """What a positive mismatch means; empty for the plain one."""


def surface(across: Axis, up: Axis, t: Traces) -> Surface | None:
    """The view over two variables in which the cells explain most; None where one of them does not vary."""
    x, y = _edges(across.x, _CELLS[0]), _edges(up.x, _CELLS[1])
    if len(x) < 4 or len(y) < 4:
        return None
    columns, rows = len(x) - 1, len(y) - 1
    inside = (across.x >= x[0]) & (across.x <= x[-1]) & (up.x >= y[0]) & (up.x <= y[-1])
    column = np.clip(np.searchsorted(x, across.x[inside], side="right") - 1, 0, columns - 1)
    row = np.clip(np.searchsorted(y, up.x[inside], side="right") - 1, 0, rows - 1)
    cell = row * columns + column
    count = np.bincount(cell, minlength=rows * columns)
    mismatch = (t.torque - t.extended)[inside]
    best, most = None, -1.0
    for meaning, sign in across.signs.items():
        total = np.bincount(cell, weights=sign[inside] * mismatch, minlength=rows * columns)
        mean = np.where(count >= _LEAST, total / np.maximum(count, 1), np.nan)
        share = float(np.nansum(count * mean**2))
        if share > most * (1.0 if best is not None and best.meaning else 1.3):
            shape = mean.reshape(rows, columns)
            best, most = Surface(across=across, up=up, x=x, y=y, mean=shape, meaning=meaning), share
    return best if best is not None and np.isfinite(best.mean).sum() >= 12 else None


def _edges(x: np.ndarray, cells: int) -> np.ndarray:
    """Even edges over the bulk of a variable, or edges between its levels where it has few."""
    levels = np.unique(np.round(x / (float(np.ptp(x)) or 1.0), 3)) * (float(np.ptp(x)) or 1.0)
    if len(levels) <= cells:
        middle = 0.5 * (levels[1:] + levels[:-1])
        return np.concatenate([[float(x.min())], middle, [float(x.max())]]) if len(levels) > 2 else levels
    low, high = np.quantile(x, (0.005, 0.995))
    return np.linspace(float(low), float(high), cells + 1)
