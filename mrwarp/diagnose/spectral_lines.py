"""Narrow lines in the spectrum of the mismatch: pickup, resonance, a pump; what no function of the motion explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.stats import binom

from mrwarp.identify.dataset import Dataset
from mrwarp.identify.noise import Noise

_CHANCE = 1e-5
"""Chance of a false line in a data set without any."""
_LOWEST = 6
"""Fewest periods of a line in a trajectory."""
_BINS = 24
"""Half of the bins over which the background is taken."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line."""

    frequency: float
    """[Hz]"""
    gain: float
    """What taking it out would gain, in units of the noise's variance."""


def find_line(mismatch: np.ndarray, torque: np.ndarray, samples: Dataset, noise: Noise) -> Line | None:
    """Strongest line that stands out in at least half of the trajectories, or None.

    What follows the angle, the velocity or the torque within a trajectory is no line. Each trajectory's periodogram
    is divided by its local background; at a frequency without a line the median over trajectories follows from the
    exponential law, whatever their number.

    Args:
        mismatch: Measured minus simulated torque, shape (N,).
        torque: Simulated torque, shape (N,).
        samples: The samples.
        noise: The noise model.
    """
    white = noise.white(np.stack([mismatch, np.ones(len(mismatch)), torque, samples.q, samples.qd]))
    lengths = [part.stop - part.start for part in samples.parts]
    length = int(np.median(lengths))
    rate = 1.0 / float(np.median(samples.dt))
    powers = []
    for part in samples.parts:
        if part.stop - part.start < length * 0.9:
            continue
        x, *own = white[:, part][:, 8:length]
        basis = np.linalg.qr(np.stack(own).T)[0]
        x = x - basis @ (basis.T @ x)
        power = np.abs(np.fft.rfft(x, length)) ** 2 / len(x)
        background = _local_median(power) / np.log(2.0)
        powers.append(power / np.maximum(background, 1e-12))
    if len(powers) < 4:
        return None
    powers = np.array(powers)
    frequency = np.fft.rfftfreq(length, 1.0 / rate)
    inner = slice(_LOWEST, len(frequency) - 4)
    half = (len(powers) + 1) // 2
    ordered = np.sort(powers, axis=0)[-half]
    chance = binom.sf(half - 1, len(powers), np.exp(-ordered)) * len(frequency)
    best = int(np.argmin(chance[inner])) + inner.start
    if chance[best] > _CHANCE:
        return None
    gain = float(np.sum(np.maximum(2.0 * powers[:, best] - 2.0, 0.0)))
    return Line(frequency=float(frequency[best]), gain=gain)


def _local_median(power: np.ndarray) -> np.ndarray:
    """Median over neighbouring bins."""
    padded = np.pad(power, _BINS, mode="reflect" if len(power) > _BINS else "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _BINS + 1)
    return np.median(windows, axis=1)
