"""The part of a signal that repeats, without any law: predicted by boosting, or equal where the motion comes again.

Gradient boosting's error on held-out trajectories is an upper bound of the part that does not repeat: where
trajectories go where no other went, a law does better. Where a motion comes again, with all its recent past, half of
the squared difference is the noise itself, under any law (the idea of the Gamma test: Stefansson, Koncar and Jones,
A note on the Gamma test, Neural Comput. Appl. 5, 1997).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from mrwarp.identify.dataset import MOVING, Motion
from mrwarp.sysid.least_squares import ridge_solve

_PAST = (*(0.01 * 2**k for k in range(7)), 1.0)
"""How far back the features look [s]."""
_FOLDS = 5
_RIDGE = 1e-3
"""Ridge of the smooth functions, relative to their size."""
_AGAIN = (0.1, 0.4, 1.2)
"""How far back a motion has to be the same to come again, in units of its typical time."""
_FAR = 1.5
"""How far from itself it comes again at the earliest, in the same unit."""
_NEAR, _CLOSEST = 0.1, 0.3
"""Largest distance of two samples whose motion is the same, in standard deviations; of these the closest count, as a
share of all samples."""
_PAIRS = 200
"""Fewest pairs that say anything."""
_BLOCK = 400
"""Samples whose distances to all others are in memory together."""
_HALF_NORMAL = 0.4549
"""Median of the square of a standard normal number."""
_SETTINGS = {
    "max_iter": 150,
    "learning_rate": 0.1,
    "max_leaf_nodes": 31,
    "min_samples_leaf": 10,
    "l2_regularization": 1.0,
    "early_stopping": False,
}


def chosen_samples(motion: Motion, weight: np.ndarray, limit: int) -> np.ndarray:
    """Indices of at most about ``limit`` samples that count, evenly over every trajectory."""
    known = np.flatnonzero(weight > 0.0)
    every = max(1, -(-len(known) // limit))
    return known[::every]


def features(motion: Motion, at: np.ndarray, extra: Sequence[np.ndarray] = ()) -> np.ndarray:
    """Angle, velocity, acceleration, current, their past and the path since the last reversals, shape (len(at), F).

    Of a joint that turns all the way round, where it stands within a turn, too.
    ``extra`` are more signals, each of shape (N,), such as a simulated torque.
    """
    now = [motion.q, motion.qd, motion.qdd, motion.current, *extra, *_reversals(motion)]
    if motion.ranges.turns >= 1.0:
        now += [f(motion.q / motion.ranges.radian) for f in (np.sin, np.cos)]
    varies = [x for x in now if np.ptp(x) > 0.0]
    run = np.searchsorted(motion.start, at, side="right") - 1
    first, dt = motion.start[run], motion.dt[run]
    columns = [x[at] for x in varies]
    for past in _PAST:
        before = np.maximum(at - np.maximum(1, np.round(past / dt)).astype(int), first)
        columns += [motion.q[at] - motion.q[before], motion.qd[before]]
        if np.ptp(motion.current) > 0.0:
            columns.append(motion.current[before])
    return np.stack(columns, axis=1).astype(np.float32)


def cross_predicted(
    motion: Motion,
    at: np.ndarray,
    target: np.ndarray,
    *,
    extra: Sequence[np.ndarray] = (),
    smooth: np.ndarray | None = None,
    seed: int = 0,
    threads: int = 1,
) -> np.ndarray:
    """A signal at the samples ``at``, predicted by boosting on the other trajectories, shape (len(at),).

    Args:
        motion: The samples.
        at: Indices that are learned from and predicted.
        target: The signal, shape (N,).
        extra: More signals to predict it from, each of shape (N,).
        smooth: Functions, shape (k, N), whose best sum is taken out first: they go on where trees stand still.
        seed: Seed of the folds.
        threads: Processes among which the folds are shared: trees grow in Python, which threads would wait for. They
            stay for the next call until :func:`end_processes`.
    """
    from joblib import Parallel, delayed
    from sklearn.ensemble import HistGradientBoostingRegressor

    table = features(motion, at, extra)
    run = np.searchsorted(motion.start, at, side="right") - 1
    count = len(motion.dt)
    fold = np.random.default_rng(seed).permutation(count) % min(_FOLDS, count)
    goal, out = target[at], np.zeros(len(at))
    rows = np.ones((1, len(at))) if smooth is None else np.vstack([np.ones(len(at)), smooth[:, at]])
    rows = rows / np.maximum(np.sqrt(np.mean(rows**2, axis=1, keepdims=True)), 1e-12)
    work: list[Any] = []
    folds = [fold[run] == k for k in range(int(fold.max()) + 1)]
    for mine in folds:
        known = rows[:, ~mine]
        line = ridge_solve(known @ known.T, known @ goal[~mine], _RIDGE)
        out[mine] = line @ rows[:, mine]
        model = HistGradientBoostingRegressor(random_state=seed, **_SETTINGS)
        work.append(delayed(model.fit)(table[~mine], goal[~mine] - line @ known))
    with threadpool_limits(1, "openmp"):
        grown: Any = Parallel(min(threads, len(folds)))(work)
        for mine, model in zip(folds, grown, strict=True):
            out[mine] += model.predict(table[mine])
    return out


def end_processes() -> None:
    """End the processes of :func:`cross_predicted`, which would wait for more work, and the thread that serves them."""
    from joblib.externals.loky import get_reusable_executor

    get_reusable_executor().shutdown()


def _reversals(motion: Motion) -> list[np.ndarray]:
    """Way since the last reversal, and the length of the stroke before it, each of shape (N,)."""
    since, stroke = np.zeros(len(motion.q)), np.zeros(len(motion.q))
    for part in motion.parts:
        q, qd = motion.q[part], motion.qd[part]
        turns = np.flatnonzero(np.sign(qd[1:]) * np.sign(qd[:-1]) < 0.0) + 1
        marks = np.concatenate([[0], turns])
        last = np.searchsorted(marks, np.arange(len(q)), side="right") - 1
        since[part] = q - q[marks[last]]
        stroke[part] = q[marks[last]] - q[marks[np.maximum(last - 1, 0)]]
    return [since, stroke]


def spread_where_it_repeats(motion: Motion, mismatch: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Squared spread of a mismatch where a motion comes again: counts of pairs and spread of each run, both (T,).

    A sample's motion is its angle, velocity, acceleration and current, the recent past of angle and current, and the
    strokes since the last reversals. Each is paired with the sample of the nearest motion, later or earlier by more
    than noise remembers, or in another run. The spread is robust: it comes from the median of each run. All counts are
    zero where the motion hardly ever comes again.
    """
    counts, spreads = np.zeros(len(motion.dt)), np.zeros(len(motion.dt))
    typical = float(motion.q.std() / max(motion.qd.std(), 1e-12))
    # at rest the torque depends on what was long ago
    at = at[np.abs(motion.qd[at]) > MOVING * motion.ranges.qd]
    run = np.searchsorted(motion.start, at, side="right") - 1
    if len(at) < 2 * _PAIRS:
        return counts, spreads
    past = [(np.round(share * typical / motion.dt[run])).astype(int) for share in _AGAIN]
    before = [at, *(np.maximum(at - np.maximum(1, k), motion.start[run]) for k in past)]
    columns = [x[k] for x in (motion.q, motion.current) for k in before]
    columns += [motion.qd[at], 0.3 * motion.qdd[at] * motion.qd.std() / max(motion.qdd.std(), 1e-12)]
    columns += [x[at] for x in _reversals(motion)]
    sizes = [motion.q] * len(before) + [motion.current] * len(before) + [motion.qd] * 2 + [motion.q] * 2
    rows = [(x - x.mean()) / y.std() for x, y in zip(columns, sizes, strict=True) if np.ptp(y) > 0.0]
    table = np.stack(rows, axis=1).astype(np.float32)
    squares, time = np.sum(table**2, axis=1), motion.time[at]
    nearest, distance = np.empty(len(at), dtype=int), np.empty(len(at))
    for first in range(0, len(at), _BLOCK):
        here = slice(first, first + _BLOCK)
        gaps = squares[here, None] + squares - 2.0 * table[here] @ table.T
        gaps[(run[here, None] == run) & (np.abs(time[here, None] - time) < _FAR * typical)] = np.inf
        nearest[here] = gaps.argmin(axis=1)
        distance[here] = gaps.min(axis=1)
    limit = min(_NEAR**2, float(np.quantile(distance, _CLOSEST)))
    half = 0.5 * (mismatch[at] - mismatch[at[nearest]]) ** 2
    for k in range(len(counts)):
        mine = half[(run == k) & (distance <= limit)]
        if len(mine) > _PAIRS // 10:
            counts[k], spreads[k] = len(mine), float(np.median(mine)) / _HALF_NORMAL
    known = counts.sum() >= _PAIRS and int((counts > 0).sum()) >= motion.kinematics.settings.data.runs
    return (counts, spreads) if known else (0.0 * counts, 0.0 * spreads)
