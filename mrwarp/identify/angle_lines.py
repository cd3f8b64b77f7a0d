"""Lines in a mismatch over the angle: how often per unit of angle something repeats, strongest first.

A joint that turns many times sees harmonics far closer than a grid of starts could be, one that turns once more of them
than starts are tried; the spectrum over the angle shows them. The mismatch is summed into narrow bins of the angle,
whose Fourier transform is that over the samples.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar

from mrwarp.identify.dataset import Dataset

_FINE = 4
"""Points of the spectrum within its resolution."""
_LOOKED_AT = 12
"""Peaks of the spectrum of which each is tried by least squares: one peak has many side lobes."""
_CLOSEST = 0.5
"""Repetitions per turn by which two lines differ at least: nearer ones are one, whose size drifts from turn to turn."""

_ONE_WAY = 0.1
"""Part of the samples up to which a joint that turns the other way counts as one that does not."""


def angle_lines(
    samples: Dataset, mismatch: np.ndarray, low: float, high: float, *, count: int = 1, given: tuple[float, ...] = ()
) -> list[float]:
    """Repetitions per unit of angle, times 2*pi, of the strongest lines, each found in addition to those before it.

    Args:
        samples: The motion.
        mismatch: What is left of the torque, shape (N,).
        low: Fewest repetitions [1/unit of angle].
        high: Most.
        count: Number of lines.
        given: Lines that are known already.
    """
    q, found, parts = samples.q - samples.q.min(), list(given), _directions(samples)
    reach = float(q.max()) or 1.0
    closest = max(2.0 * np.pi / reach, _CLOSEST * samples.scales.q)
    spacing = 0.5 * np.pi / high
    cell = np.minimum((q / spacing).astype(int), int(reach / spacing))
    size = _FINE * (int(reach / spacing) + 1)
    periods = 2.0 * np.pi * np.arange(size // 2 + 1) / (size * spacing)
    counts = samples.counts
    table = np.vstack([_within_runs(samples, mismatch[None]), *(_waves(samples, parts, n) for n in found)])
    while len(found) < len(given) + count:
        left = _left(table, counts)
        sums = [np.bincount(cell, weights=left * counts * part, minlength=size // _FINE) for part in parts]
        power = np.hypot.reduce(np.abs(np.fft.rfft(sums, size)), axis=0)
        power[(periods < low) | (periods > high)] = 0.0
        for n in found:
            power[np.abs(periods - n) < closest] = 0.0
        peaks = np.flatnonzero((power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])) + 1
        if not len(peaks):
            break
        width = float(periods[1] - periods[0])
        looked_at = periods[peaks[np.argsort(power[peaks])[::-1][:_LOOKED_AT]]]
        best = float(max(looked_at, key=lambda n: _gain(samples, parts, left, float(n))))
        bounds = (best - width, best + width)
        fine = minimize_scalar(
            lambda n, x=left: -_gain(samples, parts, x, n), bounds=bounds, options={"xatol": 1e-3 * width}
        )
        if -fine.fun <= 0.0:
            break
        found.append(float(fine.x))
        table = np.vstack([table, _waves(samples, parts, found[-1])])
    return found[len(given) :]


def _within_runs(samples: Dataset, rows: np.ndarray) -> np.ndarray:
    """Rows without their mean in each trajectory."""
    rows = rows.copy()
    for part in samples.parts:
        rows[:, part] -= rows[:, part].mean(axis=1, keepdims=True)
    return rows


def _directions(samples: Dataset) -> np.ndarray:
    """1 where the joint turns forward and where it turns back, else 0, each a row if a tenth of the samples do so.

    A torque that lags has another phase one way than the other; together a line would be the weaker, the finer it is.
    """
    forward = samples.qd >= 0.0
    share = float(forward.mean())
    return np.stack([forward, ~forward] if _ONE_WAY < share < 1.0 - _ONE_WAY else [np.ones(len(forward))]).astype(float)


def _waves(samples: Dataset, parts: np.ndarray, periods: float) -> np.ndarray:
    waves = np.stack([np.sin(periods * samples.q), np.cos(periods * samples.q)])
    return _within_runs(samples, (parts[:, None] * waves).reshape(-1, waves.shape[1]))


def _gain(samples: Dataset, parts: np.ndarray, left: np.ndarray, periods: float) -> float:
    """Reduction of the sum of squares by a sine of any phase, by direction of motion."""
    waves, counts = _waves(samples, parts, periods), samples.counts
    moment = waves @ (left * counts)
    return float(moment @ np.linalg.pinv(waves * counts @ waves.T) @ moment)


def _left(table: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Rest that the rows after the first leave of it."""
    if len(table) == 1:
        return table[0]
    rows = table[1:] * counts
    return table[0] - np.linalg.pinv(rows @ table[1:].T) @ (rows @ table[0]) @ table[1:]
