"""What went wrong with a recording: runs whose torque has another zero, sign or factor than the rest.

A regression that knows no law (odd functions of velocity and of path memory, times powers of the current; position,
acceleration, what differs by direction) describes all runs together, each with an offset of its own. Offsets that fall
into two groups with a wide gap between them are a zero that moved between runs; it has to predict the second half of
runs from their first, too. Runs that the description of all fits only with the other sign are reversed; factors in two
groups are another gain. What scatters without a gap is left to the noise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrwarp.recording.data import quantity
from mrwarp.recording.load import Recording, Trajectory

_LEAST_RUNS = 4
_GAP = 2.0
"""Least width of the gap between two groups, in ranges of the wider group."""
_ERRORS = 6.0
"""Least width of the gap, in standard errors of the least certain run."""
_ZERO, _GAIN = 0.05, 0.25
"""Smallest moved zero, in standard deviations of the torque, and smallest other gain that are told [1]."""
_ALIKE, _SIMILAR, _MOST = 0.9, 1.6, 0.7
"""Least correlation of a run with what the others say, largest factor, and share of the runs for which both hold."""
_FITS = 0.7
"""Least correlation, turned round, of a run that is called reversed."""
_HELD_OUT_T = 3.0
"""Least ratio to its standard error, over runs, of what offsets of first halves gain in second halves."""
_RIDGE = 3e-3
"""Share of a feature's energy that keeps runs at the edge of what was recorded from being extrapolated."""
_STEP = 40_000
"""Most samples that are looked at."""


@dataclass(frozen=True, kw_only=True)
class RecordingFault:
    """Something that is wrong with some runs, not with the device."""

    kind: str
    """``torque_zero``, ``torque_sign`` or ``torque_gain``."""
    trajectories: tuple[str, ...]
    value: float
    """Mean of these runs against the others: offset [unit of the torque], or factor [1]."""
    unit: str
    ci95: tuple[float, float]
    """Over runs."""
    per_trajectory: dict[str, float]
    """The same number for each run of the recording; without the fault 0 (a zero) or 1 (a factor)."""
    sentence: str


def recording_faults(recording: Recording) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """The faults of a recording, and the recording without them: signs turned, zeros and factors taken out."""
    found: list[RecordingFault] = []
    if len(recording.trajectories) < _LEAST_RUNS:
        return recording, ()
    table = _Table(recording)
    if not table.usable:
        return recording, ()
    for look in (_reversed_runs, _moved_zero, _other_gain):
        fault = look(recording, table)
        if fault is not None:
            found.append(fault)
            recording = _mended(recording, fault)
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
        self.usable = speed > 0.0 and span > 0.0 and all(len(r.t) > 40 * self.every for r in runs)
        if self.usable:
            self.rows = [_features(r, speed, span, level)[:: self.every] for r in runs]
            middle = np.concatenate(self.rows).mean(axis=0)
            self.rows = [x - middle for x in self.rows]
            self.take(recording)

    def take(self, recording: Recording) -> None:
        """Take the torque of a recording with the same motion."""
        self.torque = [r.torque[:: self.every] for r in recording.trajectories]
        self.std = float(np.concatenate(self.torque).std()) or 1.0
        self.moments = [_moments(x, y) for x, y in zip(self.rows, self.torque, strict=True)]

    def halves(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Moments of the first half of each run."""
        return [_moments(x[: len(x) // 2], y[: len(y) // 2]) for x, y in zip(self.rows, self.torque, strict=True)]

    def factors(self) -> tuple[np.ndarray, np.ndarray]:
        """Factor of each run against what the others say, and its correlation with that."""
        gram, moment = (sum(part) for part in zip(*self.moments, strict=True))
        factors, fits = np.ones(len(self.rows)), np.zeros(len(self.rows))
        for k, (own, y) in enumerate(zip(self.moments, self.torque, strict=True)):
            others = _solved(gram - own[0], moment - own[1])
            shared, size = float(others @ own[1]), float(others @ own[0] @ others)
            factors[k] = shared / max(size, 1e-30)
            power = float(np.sqrt(max(size, 0.0) * len(y))) * float(y.std())
            fits[k] = shared / max(power, 1e-30)
        return factors, fits


def _moments(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gram matrix and moment with an offset taken out, shape (K, K) and (K,)."""
    dx = x - x.mean(axis=0)
    return dx.T @ dx, dx.T @ (y - y.mean())


def _solved(gram: np.ndarray, moment: np.ndarray) -> np.ndarray:
    """Coefficients with a slight ridge, shape (K,)."""
    scale = np.sqrt(np.maximum(np.diag(gram), 1e-30))
    return np.linalg.solve(gram / np.outer(scale, scale) + _RIDGE * np.eye(len(scale)), moment / scale) / scale


def _features(run: Trajectory, speed: float, span: float, level: float) -> np.ndarray:
    """Functions of the motion and the current, shape (N, K)."""
    qd = run.qd / speed
    odd = [np.tanh(qd / 0.03), np.tanh(qd / 0.3), qd]
    odd += [_stress(run.q / span, reach) for reach in (0.01, 0.05, 0.2)]
    out = [*odd, np.abs(odd[0]), np.abs(qd), run.q / span, np.gradient(qd) / run.dt]
    if level > 0.0:
        u = run.current / level
        out += [f * u for f in odd] + [f * u * u for f in odd] + [u, u * u, run.q / span * u]
    return np.column_stack(out)


def _stress(x: np.ndarray, reach: float) -> np.ndarray:
    """Memory of the path: dz = dx - |dx|*z/reach, in units of its bound."""
    z, out = 0.0, np.zeros(len(x))
    for k, dx in enumerate(np.diff(x).tolist(), start=1):
        size = abs(dx) / reach
        steady = 1.0 if dx > 0.0 else -1.0
        z = steady + (z - steady) * math.exp(-size) if dx else z
        out[k] = z
    return out


def _moved_zero(recording: Recording, table: _Table) -> RecordingFault | None:
    factors, fits = table.factors()
    alike = (fits > _ALIKE) & (np.abs(np.log(np.maximum(factors, 1e-3))) < np.log(_SIMILAR))
    if np.mean(alike) < _MOST:
        return None  # one description does not fit the runs: an offset would stand for something else
    coefficients = _solved(*(sum(part) for part in zip(*table.moments, strict=True)))
    rest = [y - x @ coefficients for x, y in zip(table.rows, table.torque, strict=True)]
    offsets = np.array([r.mean() for r in rest])
    # a run's cycles are few and alike: its own slow misfit is the error of its offset
    split = _two_groups(offsets, np.array([_error_of_mean(r) for r in rest]), _ZERO * table.std)
    if split is None or not _predicts(table):
        return None
    near, far = sorted(split, key=lambda group: float(abs(np.median(offsets[group]))))
    if not alike[far].all():
        return None
    zero = float(offsets[near].mean())
    return _fault(recording, "torque_zero", far, offsets - zero, recording.units["torque"], zero)


def _error_of_mean(r: np.ndarray) -> float:
    """Standard error of a mean, from the means of eight blocks."""
    blocks = [b.mean() for b in np.array_split(r, 8)]
    return float(np.std(blocks, ddof=1) / np.sqrt(len(blocks)))


def _predicts(table: _Table) -> bool:
    """Whether the offsets of first halves say what the second halves' are."""
    coefficients = _solved(*(sum(part) for part in zip(*table.halves(), strict=True)))
    rest = [y - x @ coefficients for x, y in zip(table.rows, table.torque, strict=True)]
    early = np.array([r[: len(r) // 2].mean() for r in rest])
    late = [r[len(r) // 2 :] for r in rest]
    gains = [np.mean((r - early.mean()) ** 2) - np.mean((r - own) ** 2) for r, own in zip(late, early, strict=True)]
    return float(np.mean(gains)) > _HELD_OUT_T * float(np.std(gains, ddof=1)) / np.sqrt(len(gains))


def _reversed_runs(recording: Recording, table: _Table) -> RecordingFault | None:
    signs = np.ones(len(table.rows))
    plain = table.moments
    for _ in range(len(signs) // 2):
        factors, fits = table.factors()
        worst = int(np.argmin(fits))
        if fits[worst] > -_FITS:
            break
        signs[worst] = -signs[worst]
        table.moments = [(gram, sign * moment) for (gram, moment), sign in zip(plain, signs, strict=True)]
    turned = np.flatnonzero(signs < 0.0)
    factors, fits = table.factors()
    table.moments = plain
    sure = (fits[turned] > _ALIKE) & (np.abs(np.log(np.maximum(factors[turned], 1e-3))) < np.log(_SIMILAR))
    if not len(turned) or 2 * len(turned) >= len(signs) or not sure.all() or np.mean(fits > _ALIKE) < _MOST:
        return None
    return _fault(recording, "torque_sign", turned, signs, "1", 1.0)


def _other_gain(recording: Recording, table: _Table) -> RecordingFault | None:
    factors, fits = table.factors()
    if factors.min() <= 0.0 or np.mean(fits > _ALIKE) < _MOST:
        return None
    split = _two_groups(np.log(factors), np.zeros(len(factors)), np.log1p(_GAIN))
    if split is None:
        return None
    most, few = sorted(split, key=len, reverse=True)
    if 3 * len(few) > len(factors):
        return None
    # by the runs that agree alone: the others have bent what all say together
    values = np.ones(len(factors))
    said = _solved(*(sum(table.moments[k][i] for k in most) for i in (0, 1)))
    for k in few:
        gram, moment = table.moments[k]
        values[k] = float(said @ moment) / max(float(said @ gram @ said), 1e-30)
    return _fault(recording, "torque_gain", few, values, "1", 1.0)


def _two_groups(values: np.ndarray, errors: np.ndarray, least: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Places of the values below and above a gap that is wide beside both groups' ranges; None: there is none."""
    order = np.argsort(values)
    ranked = values[order]
    cut = int(np.argmax(np.diff(ranked))) + 1
    gap = ranked[cut] - ranked[cut - 1]
    within = max(ranked[cut - 1] - ranked[0], ranked[-1] - ranked[cut])
    if gap < max(least, _GAP * within, _ERRORS * float(errors.max())):
        return None
    return order[:cut], order[cut:]


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
        text = f"the zero of the {sensor} moved between runs: {span} in {several}{others}; each run's own was taken out"
    elif kind == "torque_sign":
        text = f"{several}: {sensor} and motion have the other sign than in the rest; the {sensor} was turned"
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
    """The recording with a fault taken out of the torque of every run."""

    def torque(run: Trajectory) -> np.ndarray:
        own = fault.per_trajectory[run.id]
        return run.torque - own if fault.kind == "torque_zero" else run.torque / own

    return replace(recording, trajectories=tuple(replace(r, torque=torque(r)) for r in recording.trajectories))
