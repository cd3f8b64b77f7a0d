"""Faults of a recording: runs of another device, or whose torque has another zero, sign or factor.

Eqs. 14 and 15 with few numbers describe all runs together, each with an offset of its own; runs that they do not fit
count less (iteratively re-weighted least squares), so a minority of faulty runs does not bend the others' fit.
Offsets that fall into two groups with a wide gap between them are a zero that moved between runs; they have to show
in both halves of the runs. Runs that fit with the other sign only are reversed; factors in two groups are another
gain, where the control input of these runs is among that of the others and the factor makes them runs like these.
What scatters without a gap is left to the noise, and so is what goes with the place or the control input of the runs.
Runs that need other coefficients altogether are of another device (clusterwise regression, Spaeth, Computing 22,
1979): its own group has to describe each run far better than the other, which a drift from run to run is not, and to
predict most runs without them, better than boosting predicts them from all others: what one function of the motion
describes is one device, of any law. It is looked for first, for some of its runs would be taken for another
gain; where one factor makes the groups equal, it is a gain.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mrwarp.identify.checks.shared_fit import LEAST_GROUP, RunTable, SharedFit
from mrwarp.identify.contradictions import opposed, resists
from mrwarp.recording.data import quantity
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.settings import Faults, Settings


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
    """That number for each run of the recording; without the fault 0 (a zero) or 1 (a factor)."""
    sentence: str


def recording_faults(
    recording: Recording, settings: Settings | None = None
) -> tuple[Recording, tuple[RecordingFault, ...]]:
    """The faults of a recording, and the recording without them: signs turned, zeros and factors taken out.

    Runs of another device are left out.
    """
    found: list[RecordingFault] = []
    settings = settings or Settings()
    if len(recording.trajectories) < settings.gain.few:
        return recording, ()
    table = RunTable(recording)
    if not table.usable:
        return recording, ()
    for look in (_reversed_runs, _other_device, _moved_zero, _other_gain):
        fault = look(recording, table, settings)
        if fault is not None:
            found.append(fault)
            recording = _mended(recording, fault)
            if len(recording.trajectories) < settings.gain.few:
                break
            if fault.kind == "other_device":
                table = RunTable(recording)
        table.take(recording)
    return recording, tuple(found)


def turned_signs(recording: Recording, settings: Settings | None = None) -> tuple[Recording, RecordingFault | None]:
    """The recording with the torque turned of the few runs that fit the others with the other sign only."""
    settings = settings or Settings()
    if len(recording.trajectories) < settings.gain.few or not (table := RunTable(recording)).usable:
        return recording, None
    fault = _reversed_runs(recording, table, settings)
    return (recording if fault is None else _mended(recording, fault)), fault


def zeros_about(recording: Recording, zeros: Mapping[str, float], moved: Sequence[str]) -> RecordingFault:
    """Zeros of the runs about their middle, as a fit found them, with the runs ``moved`` away from the others."""
    names = [run.id for run in recording.trajectories]
    values = np.array([zeros[name] for name in names])
    far = np.array([k for k, name in enumerate(names) if name in moved])
    return _fault(recording, "torque_zero", far, values, recording.units["torque"], 0.0)


def _similar(fit: SharedFit, faults: Faults) -> np.ndarray:
    """Runs that what all agree on fits."""
    factors, fits = fit.factors()
    return (fits > faults.agree) & (np.abs(np.log(np.maximum(factors, 1e-3))) < np.log(faults.similar))


def _moved_zero(recording: Recording, table: RunTable, settings: Settings) -> RecordingFault | None:
    fit, faults = table.fit, settings.faults
    similar = _similar(fit, faults)
    if np.mean(similar) < faults.agree:
        return None  # one description does not fit the runs: an offset would stand for something else
    rest = [y - x @ fit.coefficients for x, y in zip(fit.rows, table.torque, strict=True)]
    offsets = np.array([r.mean() for r in rest])
    # a run's cycles are few and similar: its own slow misfit is the error of its offset
    error = _rms([_error_of_mean(r) for r in rest])
    split = _two_groups(offsets, faults.gap, max(settings.gain.detail * table.std, settings.spikes.far * error))
    if split is None or _explained(offsets, table.places, faults.explained):
        return None
    halves = np.array([[r[: len(r) // 2].mean(), r[len(r) // 2 :].mean()] for r in rest])
    if not _lasts(halves, split, offsets):
        return None
    near, far = sorted(split, key=lambda group: float(abs(np.median(offsets[group]))))
    if not similar[far].all() or all(recording.trajectories[int(k)].one_way for k in far):
        return None  # of a run that never turns back, dry friction and a zero are one number
    zero = float(offsets[near].mean())
    return _fault(recording, "torque_zero", far, offsets - zero, recording.units["torque"], zero)


def _explained(offsets: np.ndarray, places: np.ndarray, share: float) -> bool:
    """Whether this share of the offsets' variance follows from where the runs are and what drives them."""
    design = np.column_stack([np.ones(len(offsets)), places])
    left = offsets - design @ np.linalg.lstsq(design, offsets, rcond=1e-6)[0]
    return float(np.var(left)) < (1.0 - share) * float(np.var(offsets))


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


def _reversed_runs(recording: Recording, table: RunTable, settings: Settings) -> RecordingFault | None:
    runs = recording.trajectories
    _, fits = table.fit.factors()
    # eq. 14 says which sign is right where friction shows it, else most runs do
    driving = np.isin([run.id for run in runs], opposed(runs, settings))
    powers = np.array([resists(run.torque, run.qd) for run in runs])
    # a load that depends on the place takes no power, and may have the other sign without any fault
    passive = powers > np.clip(settings.gain.half * np.median(powers), 0.0, settings.faults.drives)
    turns = driving | ((fits < -settings.faults.agree) & ~passive)
    turned = np.flatnonzero(turns)
    if not len(turned) or 2 * len(turned) >= len(fits):
        return None
    signs = np.where(turns, -1.0, 1.0)
    fault = _fault(recording, "torque_sign", turned, signs, "1", 1.0)
    table.take(_mended(recording, fault))
    similar = _similar(table.fit, settings.faults)
    return fault if similar[turned].all() and np.mean(similar) > settings.faults.agree else None


def _other_gain(recording: Recording, table: RunTable, settings: Settings) -> RecordingFault | None:
    limits = settings.faults
    factors, fits = table.fit.factors()
    if factors.min() <= 0.0 or np.mean(fits > limits.agree) < limits.agree:
        return None
    split = _two_groups(np.log(factors), 0.5 * limits.gain_gap, 0.5 * np.log1p(limits.gain))
    if split is None:
        return None
    # once more by the runs that agree alone: the others bend what all say together
    agree = max(split, key=len)
    factors, fits = table.fit.factors(agree.tolist())
    split = _two_groups(np.log(np.maximum(factors, 1e-3)), limits.gain_gap, np.log1p(limits.gain))
    if split is None:
        return None
    most, few = sorted(split, key=len, reverse=True)
    if np.isin(few, agree).any():
        return None  # by another look at the same runs others stand out: that is the description, not the runs
    covered = _covered(recording, table.conditions[:, 2:4], few, most)
    if 3 * len(few) > len(factors) or not (fits[few] > limits.agree).all() or not covered:
        return None
    left = 1.0 - fits**2  # after its own factor, as a share of the run's energy
    if left[few].max() > limits.as_well**2 * np.median(left[most]):
        return None  # no factor makes them runs like the others
    return _fault(recording, "torque_gain", few, factors, "1", 1.0)


def _other_device(recording: Recording, table: RunTable, settings: Settings) -> RecordingFault | None:
    fit, limits = table.richer(), settings.faults
    second = fit.two_devices()
    if min(second.sum(), (~second).sum()) < LEAST_GROUP:
        return None
    by_other, by_own, by_rest = fit.left_by_groups(second)
    distance = np.sqrt(by_other / by_own)
    # one that is alone with its control input is predicted by no other: the middle run of each group counts
    near = distance.min() < limits.other or _better(by_rest, by_other, second) < limits.other
    if near or _separable(table.conditions, second):
        return None
    by_both = _left_by_boosting(recording, fit, table.every, settings)
    if _better(by_rest, by_both, second) < limits.boosting:
        return None
    few = second if (second.sum(), second[0]) < ((~second).sum(), not second[0]) else ~second
    runs = np.flatnonzero(few)
    factors, fits = fit.factors(np.flatnonzero(~few).tolist())
    gain = float(np.median(factors[few]))
    most = fit.agreed(~few / np.maximum(fit.spread**2, 1e-30))
    own = fit.agreed(few / np.maximum(fit.spread**2, 1e-30))
    if gain > 0.0 and (fit.left_by(gain * most) < limits.other**2 * fit.left_by(own))[runs].all():
        similar = bool((fits[few] > limits.agree).all()) and abs(math.log(gain)) > math.log1p(limits.gain)
        return _fault(recording, "torque_gain", runs, factors, "1", 1.0) if similar else None
    return _fault(recording, "other_device", runs, np.where(few, distance, 1.0), "1", 1.0)


def _better(by_rest: np.ndarray, otherwise: np.ndarray, second: np.ndarray) -> float:
    """Factor by which the rest of its own group leaves less of the middle run of both groups; mean squares, (R,)."""
    ratio = np.sqrt(otherwise / by_rest)
    return min(float(np.median(ratio[group])) for group in (second, ~second))


def _left_by_boosting(recording: Recording, fit: SharedFit, every: int, settings: Settings) -> np.ndarray:
    """Rest of each run by boosting after learning on other runs of either group, as mean square, shape (R,)."""
    from mrwarp.identify.boosting import cross_predicted  # most recordings do without, and so does `mrwarp check`
    from mrwarp.identify.dataset import Motion

    motion = Motion.of(recording, settings=settings)
    kept = np.concatenate([np.arange(part.start, part.stop, every) for part in motion.parts])
    smooth = np.zeros((fit.rows[0].shape[1], len(motion.q)))
    smooth[:, kept] = np.concatenate(fit.rows).T
    at = kept[:: -(-len(kept) // (settings.effort.samples // 2))]
    left = (motion.torque[at] - cross_predicted(motion, at, motion.torque, smooth=smooth)) * motion.scales.torque
    run = np.searchsorted(motion.start, at, side="right") - 1
    return np.array([np.var(left[run == k]) for k in range(len(fit.rows))])


def _separable(conditions: np.ndarray, second: np.ndarray) -> bool:
    """Whether one condition of the runs separates the groups: then it, and not the device, may be what differs."""
    distance = [x[second].max() < x[~second].min() or x[~second].max() < x[second].min() for x in conditions.T]
    return any(distance)


def _covered(recording: Recording, moves: np.ndarray, few: np.ndarray, most: np.ndarray) -> bool:
    """Whether stroke, speed and control input of a few runs are among the others', so that they change no factor."""
    if (moves[few] < moves[most].min(axis=0)).any() or (moves[few] > moves[most].max(axis=0)).any():
        return False
    levels = np.array([np.percentile(r.current, (5, 50, 95)) for r in recording.trajectories])
    low, high = levels[most, 0].min(), levels[most, 2].max()
    return bool(((levels[few, 1] >= low) & (levels[few, 1] <= high)).all())


def _two_groups(values: np.ndarray, share: float, least: float) -> tuple[np.ndarray, np.ndarray] | None:
    """Places of the values below and above a gap that is wide next to both groups' ranges; None: there is none."""
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
