"""What went wrong with a recording: runs of another device, or whose torque has another zero, sign or factor.

Eqs. 14 and 15 with few numbers describe all runs together, each with an offset of its own; runs that they do not fit
count less (iteratively re-weighted least squares), so a minority of spoilt runs does not bend what the rest says.
Offsets that fall into two groups with a wide gap between them are a zero that moved between runs; they have to show
in both halves of the runs. Runs that fit with the other sign only are reversed; factors in two groups are another
gain, where the control input of these runs is among that of the others and the factor makes them runs like these.
What scatters without a gap is left to the noise, and so is what goes with the place or the control input of the runs.
Runs that need other coefficients altogether are of another device (clusterwise regression, Spaeth, Computing 22,
1979): its own group has to describe each run far better than the other, which a drift from run to run is not, and to
foretell most runs without them, better than boosting foretells them from all others: what one function of the motion
describes is one device, whatever its law. It is looked for first, for some of its runs would be taken for another
gain; where one factor makes the groups alike, it is a gain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrwarp.identify.boosting import foretold
from mrwarp.identify.dataset import Motion
from mrwarp.recording.data import quantity
from mrwarp.recording.load import Recording, Trajectory

_LEAST_RUNS = 4
_GAP, _GAIN_GAP = 2.0, 0.7
"""Least width of the gap between two groups, in ranges of the wider group: of zeros, and of logarithms of factors."""
_ERRORS = 6.0
"""Least width of the gap, in standard errors of a run."""
_ZERO, _GAIN = 0.05, 0.25
"""Smallest moved zero, in standard deviations of the torque, and smallest other gain that are told [1]."""
_ALIKE, _SIMILAR, _MOST = 0.9, 1.6, 0.7
"""Least correlation of a run with what the others say, largest factor, and share of the runs for which both hold."""
_AS_WELL = 1.5
"""Largest error of a run of another gain that is left after its factor, over that of the middle of the others."""
_FITS = 0.7
"""Least correlation, turned round, of a run that is called reversed."""
_CONFOUNDED = 0.8
"""Share of the offsets' variance that place and control input of the runs may explain."""
_REACHES, _WEAKENINGS = (0.003, 0.01, 0.03, 0.1, 0.3), (0.0, 1.0, 4.0)
"""Elastic reach in ranges of the angle, and alpha of eq. 14 times the speed, that are tried."""
_APART, _LEAST_GROUP = 2.0, 2
"""Least factor by which the other group's coefficients leave more of each run than its own group's; its fewest runs."""
_FORETOLD = 2.0
"""The same factor for the middle run of each group where its own group does not have the run: one that is alone with
its control input is foretold by nobody."""
_BOOSTING, _LEARNED = 1.25, 6000
"""The same factor against boosting that learns from runs of both groups, and most samples that it learns from."""
_SLIPS = (0.02, 0.2)
"""Speeds [of the 95th percentile] over which dry friction turns, that are tried for another device."""
_RIDGE = 1e-6
"""Share of a feature's energy that keeps the normal equations regular."""
_REWEIGHTED = 15
"""Passes of re-weighting."""
_STEP = 20_000
"""Most samples that are looked at."""


@dataclass(frozen=True, kw_only=True)
class RecordingFault:
    """Something that is wrong with some runs, not with the device."""

    kind: str
    """``torque_zero``, ``torque_sign``, ``torque_gain`` or ``other_device``."""
    trajectories: tuple[str, ...]
    value: float
    """Mean of these runs against the others: offset [unit of the torque], or factor [1] (of another device: of its
    error, when it is described as the others)."""
    unit: str
    ci95: tuple[float, float]
    """Over runs."""
    per_trajectory: dict[str, float]
    """The same number for each run of the recording; without the fault 0 (a zero) or 1 (a factor)."""
    sentence: str


def recording_faults(recording: Recording) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """The faults of a recording, and the recording without them: signs turned, zeros and factors taken out.

    Runs of another device are left out.
    """
    found: list[RecordingFault] = []
    if len(recording.trajectories) < _LEAST_RUNS:
        return recording, ()
    table = _Table(recording)
    if not table.usable:
        return recording, ()
    for look in (_reversed_runs, _other_device, _moved_zero, _other_gain):
        fault = look(recording, table)
        if fault is not None:
            found.append(fault)
            recording = _mended(recording, fault)
            if len(recording.trajectories) < _LEAST_RUNS:
                break
            if fault.kind == "other_device":
                table = _Table(recording)
        table.take(recording)
    return recording, tuple(found)


def zeros_about(recording: Recording, zeros: Mapping[str, float], moved: Sequence[str]) -> RecordingFault:
    """Zeros of the runs about their middle, as a fit found them, with the runs ``moved`` away from the others."""
    names = [run.id for run in recording.trajectories]
    values = np.array([zeros[name] for name in names])
    far = np.array([k for k, name in enumerate(names) if name in moved])
    return _fault(recording, "torque_zero", far, values, recording.units["torque"], 0.0)


class _Table:
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

    def richer(self) -> _Fit:
        """The fit with dry friction, and with friction that the control input changes, as further features."""
        rows = []
        for x in self.fit.rows:
            rubs = np.column_stack([np.tanh(x[:, 0] / slip) for slip in _SLIPS])
            by_input = [x[:, 3:4] * part for part in (x[:, :1], rubs)] if x.shape[1] > 3 else []
            rows.append(np.column_stack([x, rubs, *by_input]))
        return _Fit(rows, self.torque)

    def take(self, recording: Recording) -> None:
        """Take the torque of a recording with the same motion."""
        self.torque = [r.torque[:: self.every] for r in recording.trajectories]
        self.std = float(np.concatenate(self.torque).std()) or 1.0
        self.fit = min((_Fit(rows, self.torque) for rows in self.looks), key=lambda fit: fit.error)


class _Fit:
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
        """What coefficients leave of each run, as mean square, shape (R,)."""
        left = self.spread**2 - 2.0 * self.crosses @ c + np.einsum("i,rij,j->r", c, self.grams, c)
        return np.maximum(left, 1e-6 * self.spread**2)

    def two_devices(self) -> np.ndarray:
        """Whether each run belongs to the second of two groups with coefficients of their own, shape (R,).

        Each run begins once as the one that the half most like it is gathered about, and once as the first of a device
        that came later; the best end counts.
        """
        scale = np.maximum(self.spread**2, 1e-30)
        best, least = np.zeros(len(self.rows), dtype=bool), np.inf
        starts = [np.arange(len(self.rows)) >= k for k in range(_LEAST_GROUP, len(self.rows) - 1)]
        for k in range(len(self.rows)):
            like = self.left_by(self.agreed(np.arange(len(self.rows)) == k)) / scale
            starts.append(like > np.median(like))
        for second in starts:
            for _ in range(_REWEIGHTED):
                if min(second.sum(), (~second).sum()) < _LEAST_GROUP:
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
        """What the other group leaves of each run, its own group, and that without the run; mean squares, (3, R)."""
        weight, runs = 1.0 / np.maximum(self.spread**2, 1e-30), np.arange(len(second))
        found = []
        for k in range(len(second)):
            mine = second == second[k]
            by = (~mine, mine, mine & (runs != k))
            found.append([self.left_by(self.agreed(weight * group))[k] for group in by])
        return np.array(found).T

    def factors(self, by: Sequence[int] | None = None) -> tuple[np.ndarray, np.ndarray]:
        """Factor of each run against what most runs, or those named alike, agree on, and its correlation with that."""
        alike = np.isin(np.arange(len(self.rows)), [] if by is None else by) / np.maximum(self.spread**2, 1e-30)
        c = self.coefficients if by is None else self.agreed(alike)
        shared = self.crosses @ c
        size = np.maximum(np.einsum("i,rij,j->r", c, self.grams, c), 1e-30)
        return shared / size, shared / np.sqrt(size) / np.maximum(self.spread, 1e-30)


def _moments(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariances of the features, and theirs with the torque, shape (K, K) and (K,)."""
    dx = x - x.mean(axis=0)
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


def _alike(fit: _Fit) -> np.ndarray:
    """Runs that what all agree on fits."""
    factors, fits = fit.factors()
    return (fits > _ALIKE) & (np.abs(np.log(np.maximum(factors, 1e-3))) < np.log(_SIMILAR))


def _moved_zero(recording: Recording, table: _Table) -> RecordingFault | None:
    fit = table.fit
    alike = _alike(fit)
    if np.mean(alike) < _MOST:
        return None  # one description does not fit the runs: an offset would stand for something else
    rest = [y - x @ fit.coefficients for x, y in zip(fit.rows, table.torque, strict=True)]
    offsets = np.array([r.mean() for r in rest])
    # a run's cycles are few and alike: its own slow misfit is the error of its offset
    split = _two_groups(offsets, _GAP, max(_ZERO * table.std, _ERRORS * _rms([_error_of_mean(r) for r in rest])))
    if split is None or _explained(offsets, table.places):
        return None
    halves = np.array([[r[: len(r) // 2].mean(), r[len(r) // 2 :].mean()] for r in rest])
    if not _lasts(halves, split, offsets):
        return None
    near, far = sorted(split, key=lambda group: float(abs(np.median(offsets[group]))))
    if not alike[far].all():
        return None
    zero = float(offsets[near].mean())
    return _fault(recording, "torque_zero", far, offsets - zero, recording.units["torque"], zero)


def _explained(offsets: np.ndarray, places: np.ndarray) -> bool:
    """Whether offsets follow from where the runs are and what drives them."""
    design = np.column_stack([np.ones(len(offsets)), places])
    left = offsets - design @ np.linalg.lstsq(design, offsets, rcond=1e-6)[0]
    return float(np.var(left)) < (1.0 - _CONFOUNDED) * float(np.var(offsets))


def _error_of_mean(r: np.ndarray) -> float:
    """Standard error of a mean, from the means of eight blocks."""
    blocks = [b.mean() for b in np.array_split(r, 8)]
    return float(np.std(blocks, ddof=1) / np.sqrt(len(blocks)))


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _lasts(halves: np.ndarray, split: tuple[np.ndarray, np.ndarray], values: np.ndarray) -> bool:
    """Whether either half of the runs, shape (R, 2), has half of the gap between the groups."""
    low, high = split
    gap = values[high].min() - values[low].max()
    return bool((halves[high].min(axis=0) - halves[low].max(axis=0) > 0.5 * gap).all())


def _reversed_runs(recording: Recording, table: _Table) -> RecordingFault | None:
    _, fits = table.fit.factors()
    turned = np.flatnonzero(fits < -_FITS)
    if not len(turned) or 2 * len(turned) >= len(fits):
        return None
    signs = np.where(fits < -_FITS, -1.0, 1.0)
    fault = _fault(recording, "torque_sign", turned, signs, "1", 1.0)
    table.take(_mended(recording, fault))
    alike = _alike(table.fit)
    return fault if alike[turned].all() and np.mean(alike) > _MOST else None


def _other_gain(recording: Recording, table: _Table) -> RecordingFault | None:
    factors, fits = table.fit.factors()
    if factors.min() <= 0.0 or np.mean(fits > _ALIKE) < _MOST:
        return None
    split = _two_groups(np.log(factors), 0.5 * _GAIN_GAP, 0.5 * np.log1p(_GAIN))
    if split is None:
        return None
    # once more by the runs that agree alone: the others bend what all say together
    agree = max(split, key=len)
    factors, fits = table.fit.factors(agree.tolist())
    split = _two_groups(np.log(np.maximum(factors, 1e-3)), _GAIN_GAP, np.log1p(_GAIN))
    if split is None:
        return None
    most, few = sorted(split, key=len, reverse=True)
    if np.isin(few, agree).any():
        return None  # by another look at the same runs others stand out: that is the description, not the runs
    covered = _covered(recording, table.conditions[:, 2:4], few, most)
    if 3 * len(few) > len(factors) or not (fits[few] > _ALIKE).all() or not covered:
        return None
    left = 1.0 - fits**2  # after its own factor, as a share of the run's energy
    if left[few].max() > _AS_WELL**2 * np.median(left[most]):
        return None  # no factor makes them runs like the others
    return _fault(recording, "torque_gain", few, factors, "1", 1.0)


def _other_device(recording: Recording, table: _Table) -> RecordingFault | None:
    fit = table.richer()
    second = fit.two_devices()
    if min(second.sum(), (~second).sum()) < _LEAST_GROUP:
        return None
    by_other, by_own, by_rest = fit.left_by_groups(second)
    apart = np.sqrt(by_other / by_own)
    if apart.min() < _APART or _better(by_rest, by_other, second) < _FORETOLD or _separable(table.conditions, second):
        return None
    if _better(by_rest, _left_by_boosting(recording, fit, table.every), second) < _BOOSTING:
        return None
    few = second if (second.sum(), second[0]) < ((~second).sum(), not second[0]) else ~second
    runs = np.flatnonzero(few)
    factors, fits = fit.factors(np.flatnonzero(~few).tolist())
    gain = float(np.median(factors[few]))
    most = fit.agreed(~few / np.maximum(fit.spread**2, 1e-30))
    own = fit.agreed(few / np.maximum(fit.spread**2, 1e-30))
    if gain > 0.0 and (fit.left_by(gain * most) < _APART**2 * fit.left_by(own))[runs].all():
        alike = bool((fits[few] > _ALIKE).all()) and abs(math.log(gain)) > math.log1p(_GAIN)
        return _fault(recording, "torque_gain", runs, factors, "1", 1.0) if alike else None
    return _fault(recording, "other_device", runs, np.where(few, apart, 1.0), "1", 1.0)


def _better(by_rest: np.ndarray, otherwise: np.ndarray, second: np.ndarray) -> float:
    """Factor by which the rest of its own group leaves less of the middle run of both groups; mean squares, (R,)."""
    ratio = np.sqrt(otherwise / by_rest)
    return min(float(np.median(ratio[group])) for group in (second, ~second))


def _left_by_boosting(recording: Recording, fit: _Fit, every: int) -> np.ndarray:
    """What boosting leaves of each run after learning on other runs of either group, as mean square, shape (R,)."""
    motion = Motion.of(recording)
    kept = np.concatenate([np.arange(part.start, part.stop, every) for part in motion.parts])
    smooth = np.zeros((fit.rows[0].shape[1], len(motion.q)))
    smooth[:, kept] = np.concatenate(fit.rows).T
    at = kept[:: -(-len(kept) // _LEARNED)]
    left = (motion.torque[at] - foretold(motion, at, motion.torque, smooth=smooth)) * motion.scales.torque
    run = np.searchsorted(motion.start, at, side="right") - 1
    return np.array([np.var(left[run == k]) for k in range(len(fit.rows))])


def _separable(conditions: np.ndarray, second: np.ndarray) -> bool:
    """Whether one condition of the runs tells the groups apart: then it, and not the device, may be what differs."""
    apart = [x[second].max() < x[~second].min() or x[~second].max() < x[second].min() for x in conditions.T]
    return any(apart)


def _covered(recording: Recording, moves: np.ndarray, few: np.ndarray, most: np.ndarray) -> bool:
    """Whether stroke, speed and control input of a few runs are among the others', so that they change no factor."""
    if (moves[few] < moves[most].min(axis=0)).any() or (moves[few] > moves[most].max(axis=0)).any():
        return False
    levels = np.array([np.percentile(r.current, (5, 50, 95)) for r in recording.trajectories])
    low, high = levels[most, 0].min(), levels[most, 2].max()
    return bool(((levels[few, 1] >= low) & (levels[few, 1] <= high)).all())


def _two_groups(values: np.ndarray, share: float, least: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Places of the values below and above a gap that is wide beside both groups' ranges; None: there is none."""
    order = np.argsort(values)
    ranked = values[order]
    cut = int(np.argmax(np.diff(ranked))) + 1
    gap = ranked[cut] - ranked[cut - 1]
    within = max(ranked[cut - 1] - ranked[0], ranked[-1] - ranked[cut])
    return None if gap < max(least, share * within) else (order[:cut], order[cut:])


def _fault(
    recording: Recording, kind: str, runs: np.ndarray, values: np.ndarray, unit: str, rest: float
) -> RecordingFault:
    names = [run.id for run in recording.trajectories]
    own = values[runs]
    value = float(own.mean())
    half = 2.0 * float(np.std(own, ddof=1)) / np.sqrt(len(own)) if len(own) > 1 else 0.0
    sensor = quantity("torque", recording.units)
    several = f"{len(runs)} of {len(names)} runs" if len(runs) > 1 else f"run {names[int(runs[0])]}"
    if kind == "torque_zero":
        low, high = own.min() + rest, own.max() + rest
        elsewhere = np.delete(values, runs) + rest
        others = f", {elsewhere.min():.3g} to {elsewhere.max():.3g} {unit} in the others" if len(elsewhere) else ""
        span = f"{low:.3g} to {high:.3g} {unit}" if len(own) > 1 else f"{low:.3g} {unit}"
        text = (
            f"the zero of the {sensor} moved between runs: {span} in {several}{others}; it was taken out of the former"
        )
    elif kind == "torque_sign":
        text = f"{several}: {sensor} and motion have the other sign than in the rest; the {sensor} was turned"
    elif kind == "other_device":
        of = ", ".join(names[int(k)] for k in runs[:4]) + (", ..." if len(runs) > 4 else "")
        text = (
            f"{several} ({of}) are of another device, or of this one with other settings: what describes the rest "
            f"leaves {own.min():.2g} to {own.max():.2g} times what their own description does; they were left out, "
            "diagnose them in a folder of their own"
        )
    else:
        text = (
            f"{several}: the {sensor} is {value:.3g} times that of the rest at the same motion; it was divided by that"
        )
    return RecordingFault(
        kind=kind,
        trajectories=tuple(names[int(k)] for k in sorted(runs)),
        value=value,
        unit=unit,
        ci95=(value - half, value + half),
        per_trajectory={name: float(v) for name, v in zip(names, values, strict=True)},
        sentence=text,
    )


def _mended(recording: Recording, fault: RecordingFault) -> Recording:
    """The recording with a fault taken out of the torque of its runs, or without the runs of another device."""
    if fault.kind == "other_device":
        kept = tuple(run for run in recording.trajectories if run.id not in fault.trajectories)
        return replace(recording, trajectories=kept)

    def torque(run: Trajectory) -> np.ndarray:
        if run.id not in fault.trajectories:
            return run.torque
        own = fault.per_trajectory[run.id]
        return run.torque - own if fault.kind == "torque_zero" else run.torque / own

    return replace(recording, trajectories=tuple(replace(r, torque=torque(r)) for r in recording.trajectories))
