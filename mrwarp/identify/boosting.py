"""What of a signal can be foretold from the motion without any law: gradient boosting on trajectories it never saw.

It says what of a mismatch repeats, whatever its cause: what such a predictor cannot foretell of a trajectory that took
no part differs from run to run. It is a ceiling only: where trajectories go where no other went, a law does better.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from mrwarp.identify.dataset import Motion
from mrwarp.identify.least_squares import ridge_solve

_PAST = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64, 1.0)
"""How far back the features look [s]."""
_SAMPLES = 12_000
"""Samples that are learned from and foretold."""
_FOLDS = 5
_RIDGE = 1e-3
"""Ridge of the smooth functions, relative to their size."""
_SETTINGS = {
    "max_iter": 150,
    "learning_rate": 0.1,
    "max_leaf_nodes": 31,
    "min_samples_leaf": 10,
    "l2_regularization": 1.0,
    "early_stopping": False,
}


def chosen_samples(motion: Motion, weight: np.ndarray, limit: int = _SAMPLES) -> np.ndarray:
    """Indices of at most about ``limit`` samples that count, evenly over every trajectory."""
    known = np.flatnonzero(weight > 0.0)
    every = max(1, -(-len(known) // limit))
    return known[::every]


def features(motion: Motion, at: np.ndarray, beside: Sequence[np.ndarray] = ()) -> np.ndarray:
    """Angle, velocity, acceleration, current, their past and the path since the last reversals, shape (len(at), F).

    ``beside`` are more signals, each of shape (N,), such as a simulated torque.
    """
    now = [motion.q, motion.qd, motion.qdd, motion.current, *beside, *_reversals(motion)]
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


def foretold(
    motion: Motion,
    at: np.ndarray,
    target: np.ndarray,
    *,
    beside: Sequence[np.ndarray] = (),
    smooth: np.ndarray | None = None,
    seed: int = 0,
) -> np.ndarray:
    """A signal at the samples ``at``, foretold by boosting on the other trajectories, shape (len(at),).

    Args:
        motion: The samples.
        at: Indices that are learned from and foretold.
        target: The signal, shape (N,).
        beside: More signals to foretell it from, each of shape (N,).
        smooth: Functions, shape (k, N), whose best sum is taken out first: they go on where trees stand still.
        seed: Seed of the folds.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor

    table = features(motion, at, beside)
    run = np.searchsorted(motion.start, at, side="right") - 1
    count = len(motion.dt)
    fold = np.random.default_rng(seed).permutation(count) % min(_FOLDS, count)
    goal, out = target[at], np.zeros(len(at))
    rows = np.ones((1, len(at))) if smooth is None else np.vstack([np.ones(len(at)), smooth[:, at]])
    rows = rows / np.maximum(np.sqrt(np.mean(rows**2, axis=1, keepdims=True)), 1e-12)
    with threadpool_limits(1, "openmp"):
        for k in range(int(fold.max()) + 1):
            mine = fold[run] == k
            known = rows[:, ~mine]
            line = ridge_solve(known @ known.T, known @ goal[~mine], _RIDGE)
            model = HistGradientBoostingRegressor(random_state=seed, **_SETTINGS)
            model.fit(table[~mine], goal[~mine] - line @ known)
            out[mine] = line @ rows[:, mine] + model.predict(table[mine])
    return out


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
