"""Steps of the command, one by one: whether the current arrives late (delay) or creeps (lag).

A log says between which two samples the command changed, not when. Both effects are then the same mean change of the
first samples after a step. But a delay leaves each of these samples wholly old or wholly new, as the step fell before
or after, where a lag leaves them anywhere in between: the single steps tell apart what their mean does not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.parameters import row_column

LAG, DELAY = "coil_lag", "command_delay"
_AGES = 48
"""Times of the step between two samples that are integrated over."""
_ENOUGH = 3
"""Fewest steps for an answer."""
_CLEAR = 6.0
"""Difference of the logarithms of two likelihoods from which one is believed."""
_VISIBLE = 4.0
"""Smallest change of torque by a step, over the noise."""
_MODEL_ERROR = 0.03
"""What the model may be wrong about that change [1]."""


@dataclass(frozen=True, kw_only=True)
class Edges:
    """Steps of the command that stand alone and show in the torque."""

    late: np.ndarray
    """Part of the old current's torque that is still there at the samples after each step, shape (E, J)."""
    error: np.ndarray
    """Its standard error, shape (E, J)."""
    trajectory: np.ndarray
    """Trajectory of each step, shape (E,)."""
    dt: float
    """Sampling interval [s]."""


def told_apart(edges: Edges) -> str | None:
    """The one of the two effects that the single steps speak for, or None where they do not tell."""
    gap = log_likelihood(edges, LAG) - log_likelihood(edges, DELAY)
    if abs(gap) < _CLEAR:
        return None
    return LAG if gap > 0.0 else DELAY


def size_from(edges: Edges, effect: str) -> tuple[float, float, float]:
    """Size of an effect from the single steps, and its 95 % interval by the profile of the likelihood [s]."""
    sizes, profile = _profile(edges, effect)
    inside = sizes[profile > profile.max() - 1.92]
    step = float(np.diff(sizes).min())
    return float(sizes[np.argmax(profile)]), max(0.0, float(inside.min()) - step), float(inside.max()) + step


def find_edges(engine: Engine, lag: Fitted) -> Edges | None:
    """Steps of a data set, measured against the model without the lag; None if they are too few."""
    s = engine.samples
    dt = float(np.median(s.dt))
    if float(np.ptp(s.dt)) > 1e-3 * dt:
        return None
    row = lag.coordinates.row(lag.x)
    constant = row_column(LAG, CATALOGUE[LAG].parameters[0].name)
    reach = int(np.clip(np.ceil(1.6 * row[constant] / dt), 3, 40))
    rows = np.stack([row, row])
    rows[:, constant] = 0.0
    rows[1, row_column(DELAY, CATALOGUE[DELAY].parameters[0].name)] = reach * dt
    new, old = engine.replay.torque(rows).astype(float)
    noise = engine.noise_model.rms
    late, error, trajectory = [], [], []
    for index, part in enumerate(s.parts):
        jumps = np.abs(np.diff(s.current[part])) > 1e-3 * engine.motion.ranges.current
        at = np.flatnonzero(jumps) + 1
        before = np.diff(at, prepend=-reach)
        after = np.diff(at, append=part.stop - part.start + reach)
        for k in part.start + at[(before > reach) & (after >= reach)]:
            if k + reach > part.stop or k - 2 < part.start:
                continue
            window = slice(k, k + reach)
            change = new[window] - old[window]
            if np.abs(change).min() < _VISIBLE * noise:
                continue
            level = float(np.mean(s.torque[k - 2 : k] - new[k - 2 : k]))
            late.append((new[window] + level - s.torque[window]) / change)
            error.append(np.hypot(1.2 * noise / np.abs(change), _MODEL_ERROR))
            trajectory.append(index)
    if len(late) < _ENOUGH:
        return None
    return Edges(late=np.array(late), error=np.array(error), trajectory=np.array(trajectory), dt=dt)


def log_likelihood(edges: Edges, effect: str) -> float:
    """Largest logarithm of the likelihood of the steps with one of the effects."""
    return float(_profile(edges, effect)[1].max())


def _profile(edges: Edges, effect: str) -> tuple[np.ndarray, np.ndarray]:
    """Sizes [s] and the logarithm of the likelihood at each.

    The time of each step is integrated over, and so is one common time of all steps of a trajectory; the better counts.
    """
    dt, reach = edges.dt, edges.late.shape[1]
    age = (np.arange(_AGES) + 0.5) / _AGES * dt
    since = age[:, None] + dt * np.arange(reach)
    sizes = dt * (np.geomspace(0.02, 2.0 * reach, 80) if effect == LAG else np.linspace(0.02, reach, 50 * reach))
    members = [np.flatnonzero(edges.trajectory == k) for k in np.unique(edges.trajectory)]
    profile = np.empty(len(sizes))
    for i, size in enumerate(sizes):
        late = np.exp(-since / size) if effect == LAG else (since < size).astype(float)
        miss = (edges.late[:, None, :] - late) / edges.error[:, None, :]
        each = -0.5 * np.minimum(miss**2, 25.0).sum(axis=2)
        single = float(_mean_exp(each).sum())
        common = float(sum(_mean_exp(each[m].sum(axis=0)[None])[0] for m in members))
        profile[i] = max(single, common)
    return sizes, profile


def _mean_exp(logs: np.ndarray) -> np.ndarray:
    """Logarithm of the mean over the last axis."""
    top = logs.max(axis=-1)
    return top + np.log(np.mean(np.exp(logs - top[..., None]), axis=-1))
