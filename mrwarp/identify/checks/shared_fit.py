"""One description of all runs, eqs. 14 and 15 with few numbers, and how each run stands to it.

Each run has an offset of its own; runs that the description does not fit count less (iteratively re-weighted least
squares), so that a minority does not bend what the rest says.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.ndimage import median_filter

from mrwarp.recording.load import Recording
from mrwarp.sysid.settings import Spikes

LEAST_GROUP = 2
"""Fewest runs of a group with coefficients of its own."""
_REACHES, _WEAKENINGS = (0.003, 0.01, 0.03, 0.1, 0.3), (0.0, 1.0, 4.0)
"""Elastic reach in ranges of the angle, and alpha of eq. 14 times the speed, that are tried."""
_SLIPS = (0.02, 0.2)
"""Speeds [of the 95th percentile] over which dry friction turns, that are tried for another device."""
_RIDGE = 1e-6
"""Share of a feature's energy that keeps the normal equations regular."""
_REWEIGHTED = 15
"""Passes of re-weighting."""
_STEP = 20_000
"""Most samples that are looked at."""
AFTER = 4
"""Samples that a spike reaches into."""


class RunTable:
    """Features of all runs, decimated, and their torque."""

    def __init__(self, recording: Recording) -> None:
        runs = recording.trajectories
        self.every = max(1, sum(len(r.t) for r in runs) // _STEP)
        speed = float(np.percentile(np.abs(np.concatenate([r.qd for r in runs])), 95))
        span = float(np.ptp(np.concatenate([r.q for r in runs])))
        level = max(float(np.abs(r.current).max()) for r in runs)
        self.usable = speed > 0.0 and span > 0.0 and all(len(r.t) > 20 * self.every for r in runs)
        if self.usable:
            # where a run is and what drives it, which may explain its offset
            self.places = np.array([[r.q.mean() / span, r.current.mean() / (level or 1.0)] for r in runs])
            moves = [[r.q.std() / span, r.qd.std() / speed, r.current.std() / (level or 1.0)] for r in runs]
            self.conditions = np.column_stack([self.places, moves])
            loops = [
                [z[:: self.every] for z in stress] for stress in _stress([r.q / span for r in runs], np.array(_REACHES))
            ]
            thinned = [(r.q[:: self.every], r.qd[:: self.every], r.current[:: self.every]) for r in runs]
            self.looks = [
                [
                    _features(q / span, qd / speed, current, level, z / (1.0 + alpha * np.abs(qd / speed)))
                    for (q, qd, current), z in zip(thinned, stress, strict=True)
                ]
                for stress in loops
                for alpha in _WEAKENINGS
            ]
            self.take(recording)

    def richer(self) -> SharedFit:
        """The fit with dry friction, and with friction that the control input changes, as further features."""
        rows = []
        for x in self.fit.rows:
            rubs = np.column_stack([np.tanh(x[:, 0] / slip) for slip in _SLIPS])
            by_input = [x[:, 3:4] * part for part in (x[:, :1], rubs)] if x.shape[1] > 3 else []
            rows.append(np.column_stack([x, rubs, *by_input]))
        return SharedFit(rows, self.torque)

    def take(self, recording: Recording) -> None:
        """Take the torque of a recording with the same motion, without samples that stand out of those around them."""
        self.torque = [_without_lone(r.torque)[:: self.every] for r in recording.trajectories]
        self.std = float(np.concatenate(self.torque).std()) or 1.0
        self.fit = min((SharedFit(rows, self.torque) for rows in self.looks), key=lambda fit: fit.error)


def around_each(x: np.ndarray) -> np.ndarray:
    """The middle one of the samples about each of a run, shape (N,)."""
    return median_filter(x, 2 * AFTER + 1)


def _without_lone(torque: np.ndarray) -> np.ndarray:
    """The torque of a run with the middle of the samples around in place of spikes (Hampel's filter)."""
    around = around_each(torque)
    off = np.abs(torque - around)
    return np.where(off > Spikes.far * 1.4826 * np.median(off), around, torque)


class SharedFit:
    """Coefficients that most runs agree on, and each run's factor against them."""

    def __init__(self, rows: list[np.ndarray], torque: list[np.ndarray]) -> None:
        self.rows = rows
        moments = [_moments(x, y) for x, y in zip(rows, torque, strict=True)]
        self.grams, self.crosses = (np.array([each[i] for each in moments]) for i in (0, 1))
        self.spread = np.array([y.std() for y in torque])
        weight = np.ones(len(rows))
        for _ in range(_REWEIGHTED):
            self.coefficients = self.agreed(weight)
            left = np.sqrt(self.left_by(self.coefficients))
            weight = 1.0 / np.maximum(left, 0.3 * np.median(left) + 1e-30) ** 2
        self.error = float(left.sum() / max(self.spread.sum(), 1e-30))

    def agreed(self, weight: np.ndarray) -> np.ndarray:
        """Coefficients with these weights of the runs, shape (K,)."""
        gram, moment = np.tensordot(weight, self.grams, 1), weight @ self.crosses
        scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
        return np.linalg.solve(gram / np.outer(scale, scale) + _RIDGE * np.eye(len(scale)), moment / scale) / scale

    def left_by(self, c: np.ndarray) -> np.ndarray:
        """Rest of each run under coefficients, as mean square, shape (R,)."""
        left = self.spread**2 - 2.0 * self.crosses @ c + np.einsum("i,rij,j->r", c, self.grams, c)
        return np.maximum(left, 1e-6 * self.spread**2)

    def two_devices(self) -> np.ndarray:
        """Whether each run belongs to the second of two groups with coefficients of their own, shape (R,).

        Each run begins once as the one that the half most like it is gathered about, and once as the first of a device
        that came later; the best end counts.
        """
        scale = np.maximum(self.spread**2, 1e-30)
        best, least = np.zeros(len(self.rows), dtype=bool), np.inf
        starts = [np.arange(len(self.rows)) >= k for k in range(LEAST_GROUP, len(self.rows) - 1)]
        for k in range(len(self.rows)):
            like = self.left_by(self.agreed(np.arange(len(self.rows)) == k)) / scale
            starts.append(like > np.median(like))
        for second in starts:
            for _ in range(_REWEIGHTED):
                if min(second.sum(), (~second).sum()) < LEAST_GROUP:
                    break
                left = np.column_stack([self.left_by(c) for c in self._of_two(second)])
                total, before, second = float((left.min(axis=1) / scale).sum()), second, left[:, 1] < left[:, 0]
                if total < least:
                    best, least = second, total
                if (second == before).all():
                    break
        return best

    def _of_two(self, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        weight = 1.0 / np.maximum(self.spread**2, 1e-30)
        return self.agreed(weight * ~second), self.agreed(weight * second)

    def left_by_groups(self, second: np.ndarray) -> np.ndarray:
        """Rest of each run by the other group, its own group, and that without the run; mean squares, (3, R)."""
        weight, runs = 1.0 / np.maximum(self.spread**2, 1e-30), np.arange(len(second))
        found = []
        for k in range(len(second)):
            mine = second == second[k]
            by = (~mine, mine, mine & (runs != k))
            found.append([self.left_by(self.agreed(weight * group))[k] for group in by])
        return np.array(found).T

    def factors(self, by: Sequence[int] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Factor of each run against what most runs, or those named, agree on, and its correlation with that."""
        named = np.isin(np.arange(len(self.rows)), [] if by is None else by) / np.maximum(self.spread**2, 1e-30)
        c = self.coefficients if by is None else self.agreed(named)
        shared = self.crosses @ c
        size = np.maximum(np.einsum("i,rij,j->r", c, self.grams, c), 1e-30)
        return shared / size, shared / np.sqrt(size) / np.maximum(self.spread, 1e-30)

    def factors_of_halves(self, torque: Sequence[np.ndarray]) -> np.ndarray:
        """Factor of the first and of the second half of each run against what most runs agree on, shape (2, R)."""
        out = np.empty((2, len(self.rows)))
        for run, (x, y) in enumerate(zip(self.rows, torque, strict=True)):
            for k, half in enumerate((slice(0, len(y) // 2), slice(len(y) // 2, None))):
                gram, cross = _moments(x[half], y[half])
                size = float(self.coefficients @ gram @ self.coefficients)
                out[k, run] = float(cross @ self.coefficients) / max(size, 1e-30)
        return out


def _moments(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariances of the features, and theirs with the torque, shape (K, K) and (K,).

    A feature that is constant, as a held current, varies with nothing: what the rounding of its mean leaves is none.
    """
    dx = x - x.mean(axis=0)
    dx[:, np.abs(dx).max(axis=0) <= len(x) * np.finfo(float).eps * np.abs(x).max(axis=0)] = 0.0
    return dx.T @ dx / len(y), dx.T @ (y - y.mean()) / len(y)


def _features(q: np.ndarray, qd: np.ndarray, current: np.ndarray, level: float, loop: np.ndarray) -> np.ndarray:
    """Eq. 14 in its linear numbers, shape (N, K); angle, velocity and loop in their ranges, the current's is level."""
    out = [qd, q, loop]
    if level > 0.0:
        u = current / level
        out += [u, u * loop, u * u * loop]
    return np.column_stack(out)


def _stress(paths: Sequence[np.ndarray], reaches: np.ndarray) -> list[list[np.ndarray]]:
    """Memory of each path for each reach: dz = dx - |dx|*z/reach, in units of its bound."""
    longest = max(len(x) for x in paths)
    if longest * len(paths) > 2 * sum(len(x) for x in paths):  # side by side they would be mostly empty
        alone = [_stress([x], reaches) for x in paths]
        return [[each[i][0] for each in alone] for i in range(len(reaches))]
    steps = np.diff([np.pad(x, (0, longest - len(x)), mode="edge") for x in paths], axis=1).T[:, None]
    steady, kept = np.sign(steps), np.exp(-np.abs(steps) / reaches[:, None])
    z = np.zeros((longest, len(reaches), len(paths)))
    for k in range(longest - 1):
        z[k + 1] = steady[k] + (z[k] - steady[k]) * kept[k]
    return [[z[: len(x), i, run] for run, x in enumerate(paths)] for i in range(len(reaches))]
