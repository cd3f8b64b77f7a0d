"""Spikes: a few samples that stand out of all that is smooth, carry much of a mismatch, and come again nowhere.

A missing mechanism leaves a mismatch of its own form: a lag after every step of the control input, play after every
reversal. What is left of it far above the typical size is no spike where it sits at such events and lasts, or has one
sign along the motion or along what the event does to the torque.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.stats import binomtest

from mrwarp.identify.checks.shared_fit import AFTER, around_each
from mrwarp.identify.dataset import MOVING, Dataset
from mrwarp.sysid.settings import Settings

ROUNDS = 8
"""Regressions at most by which spikes are found, each without what was far off in the one before."""

_BEFORE = 1
"""Samples left out before each spike, and :data:`AFTER` after: noise is judged by what came just before."""


def find_spikes(
    left: np.ndarray, simulated: np.ndarray, samples: Dataset, counts: np.ndarray, settings: Settings | None = None
) -> np.ndarray:
    """Samples that are spikes, bool, shape (N,).

    Args:
        left: What models leave of the torque, shape (N,).
        simulated: Their torque, shape (N,).
        samples: The samples.
        counts: Samples that count, bool, shape (N,).
        settings: Rules of what stands out, and of what follows a law; None: the defaults.
    """
    settings = settings or Settings()
    spikes = settings.spikes
    far = far_off(left, samples, counts, spikes.far)
    alone = far & _stands_out(left, samples)
    stuck = _dropouts(alone, samples)
    for along in _events(samples, spikes.event):
        window = along != 0.0
        inside, outside = _rate(far, window & counts), _rate(far, ~window & counts)
        if inside > spikes.locked * outside:
            own = _has_one_sign(left * along, alone & window & ~stuck, settings)
            far &= ~window | stuck if own else ~window | alone
    # of a glitch of the motion, models make a torque that itself is far off: its own sign would be against the rest
    usual = _around(simulated, samples)
    for along in (np.sign(samples.qd), np.sign(usual - np.median(simulated))):
        if _has_one_sign(left * along, far & ~stuck, settings):
            # of a joint that goes one way, spikes of one sign are along the motion, too
            far &= alone if abs(float(along.mean())) > settings.gain.half else stuck
    carried = float(np.sum(left[far] ** 2))
    heavy = carried > settings.gain.part * float(np.sum(left[counts] ** 2))
    large = carried > spikes.size**2 * float(np.var(samples.torque[counts])) * int(counts.sum())
    return far if heavy and large and far.sum() <= spikes.most * counts.sum() else np.zeros(len(left), dtype=bool)


def _has_one_sign(along: np.ndarray, far: np.ndarray, settings: Settings) -> bool:
    """Whether stretches of far samples have one sign too often for chance, by what is left along some direction."""
    stretches = np.cumsum(np.diff(far.astype(int), prepend=0) == 1) * far
    count = int(stretches.max(initial=0))
    sums = np.bincount(stretches, weights=along, minlength=count + 1)[1:]
    one_sign = abs(float(sums.sum())) > settings.gain.half * float(np.abs(sums).sum())
    return one_sign and float(binomtest(int((sums > 0.0).sum()), count).pvalue) < settings.gain.chance


def _dropouts(far: np.ndarray, samples: Dataset) -> np.ndarray:
    """The torque that most far samples have, such as 0, as where nothing was read: those samples; bool, shape (N,).

    They are always on the same side of the motion's torque, as if they had a law.
    """
    values, counts = np.unique(samples.torque[far], return_counts=True)
    if not len(values) or 2 * counts.max() <= counts.sum():
        return np.zeros(len(far), dtype=bool)
    return far & (samples.torque == values[np.argmax(counts)])


def _stands_out(left: np.ndarray, samples: Dataset) -> np.ndarray:
    """Samples more than twice as far off as the middle one of those around, bool, shape (N,).

    What an event leaves of a mechanism goes on in the next samples.
    """
    around = _around(left, samples)
    return np.abs(left - around) > np.abs(around)


def _around(x: np.ndarray, samples: Dataset) -> np.ndarray:
    """The middle one of the samples about each, shape (N,)."""
    return np.concatenate([around_each(x[part]) for part in samples.parts])


def _rate(far: np.ndarray, at: np.ndarray) -> float:
    """Share of far samples among those at some."""
    return float(far[at].mean()) if at.any() else 0.0


def far_off(left: np.ndarray, samples: Dataset, counts: np.ndarray, least: float) -> np.ndarray:
    """Samples that are far from zero by what is typical in all, or in their trajectory if that is more; bool, (N,).

    Far is ``least`` robust standard deviations.
    """
    typical = np.full(len(left), float(np.median(np.abs(left[counts]))))
    for part in samples.parts:
        if counts[part].any():
            typical[part] = np.maximum(typical[part], np.median(np.abs(left[part][counts[part]])))
    return counts & (np.abs(left) > least * 1.4826 * typical)


def beside_spikes(spikes: np.ndarray, samples: Dataset) -> np.ndarray:
    """Spikes with the samples around them that they reach into, bool, shape (N,)."""
    out, size = np.zeros(len(spikes), dtype=bool), _BEFORE + 1 + AFTER
    for part in samples.parts:
        out[part] = binary_dilation(spikes[part], np.ones(size), origin=_BEFORE - size // 2)
    return out


def _events(samples: Dataset, seconds: float) -> list[np.ndarray]:
    """Moments after a reversal, from the last sample that moves on, and after a step of the input; each shape (N,).

    The sign is that of what the event does to the torque: of the new motion, or of the step along the motion; else 0.
    """
    turned, stepped = (np.zeros(len(samples.qd)) for _ in range(2))
    least = MOVING * float(np.percentile(np.abs(samples.qd), 95))
    jump = MOVING * float(np.abs(samples.current).max())
    for part, dt in zip(samples.parts, samples.dt, strict=True):
        reach, qd, here = max(1, round(seconds / dt)), samples.qd[part], np.arange(part.start, part.stop)
        moving = here[np.abs(qd) > least]
        for k in np.flatnonzero(np.diff(np.sign(samples.qd[moving])) != 0.0):
            turned[moving[k] : min(moving[k + 1] + reach, part.stop)] = np.sign(samples.qd[moving[k + 1]])
        steps = np.diff(samples.current[part])
        for k in np.flatnonzero(np.abs(steps) > max(jump, 1e-12)):
            along = np.where(qd[k + 1 : k + 1 + reach] < 0.0, -1.0, 1.0)
            stepped[part.start + k + 1 : part.start + k + 1 + len(along)] = np.sign(steps[k]) * along
    return [turned, stepped]
