"""What a recording cannot answer, found before any fit."""

from __future__ import annotations

import dataclasses

import numpy as np

from mrwarp.diagnose.result import Diagnosis, Error, NextExperiment
from mrwarp.diagnose.verdict_text import quantity, sentence_of
from mrwarp.recording.load import Recording

MIN_TRAJECTORIES = 3
"""Fewest trajectories: with fewer nothing can be predicted by the others."""
MIN_SECONDS = 10.0
"""Shortest recording, all trajectories together [s]."""
MIN_SAMPLES = 1500
"""Fewest samples, all trajectories together."""
_CLIPPED = 0.002
"""Share of samples that stand, in runs, at the very largest torque above which the sensor counts as saturated."""
_FOLLOWED = 0.02
"""Part of the torque's variance that motion and current must predict, by the plainest of laws."""

STANDARD = (
    "record at least 12 trajectories of 4 s or more: current steps while the joint moves, sines of several amplitudes "
    "at several constant currents, in random order"
)


def hindrances(recording: Recording) -> list[str]:
    """Reasons why no verdict can be given; each names the recording to make."""
    runs = recording.trajectories
    seconds = sum(float(run.t[-1] - run.t[0]) + run.dt for run in runs)
    found = []
    if len(runs) < MIN_TRAJECTORIES:
        found.append(
            f"only {len(runs)} {'trajectory' if len(runs) == 1 else 'trajectories'}: an effect only counts when "
            f"it predicts a trajectory that it was not fitted to, so nothing can be named; {STANDARD}"
        )
    if seconds < MIN_SECONDS or recording.samples < MIN_SAMPLES:
        found.append(
            f"too little data: {seconds:.3g} s, {recording.samples} samples; a cause needs at least {MIN_SECONDS:g} s "
            f"and {MIN_SAMPLES} samples; {STANDARD}"
        )
    q = np.concatenate([run.q - run.q[0] for run in runs])
    qd = np.concatenate([run.qd for run in runs])
    noise = float(np.median([np.abs(np.diff(run.q, 2)).mean() for run in runs]))
    reach = float(np.median([np.ptp(run.q) for run in runs]))
    if reach <= 20.0 * noise or not np.any(np.abs(qd) > 0.0) or not np.any(q):
        found.append(
            "the joint does not move: friction, hysteresis and everything else in the torque shows along motion only; "
            "move it by at least ten times what it takes to make it yield, at 0.5 to 2 Hz and several amplitudes"
        )
    torque = np.concatenate([run.torque for run in runs])
    if float(np.ptp(torque)) == 0.0:
        found.append(f"the torque is {torque[0]:.4g} throughout: is the sensor connected? Then {STANDARD}")
        return found
    clipped, limit = max((_at_limit(torque), torque.max()), (_at_limit(-torque), torque.min()))
    if clipped > _CLIPPED:
        found.append(
            f"the torque sensor is saturated: {100 * clipped:.2g} % of the samples stand at its largest reading "
            f"({limit:.4g}), so the torque beyond is unknown; use a larger range or less current"
        )
    current = np.concatenate([run.current for run in runs])
    if current.max() <= 0.0 and current.min() < 0.0:
        found.append(
            f"the {quantity(recording.units['current'])} is negative throughout ({current.min():.4g} to "
            f"{current.max():.4g}): eq. 14 counts it as a size; turn its sign and diagnose again"
        )
    if not found:
        found += _unrelated(qd, current, torque, recording)
    return found


def without_verdict(recording: Recording, reasons: list[str], seed: int, seconds: float) -> Diagnosis:
    """The result for data that cannot carry a verdict: why, and the recording to make."""
    nothing = Error(rmse=float("nan"), nrmse=float("nan"), unit=recording.units["torque"])
    to_make = reasons[0].rsplit("; ", 1)[-1] if "; " in reasons[0] else STANDARD
    following = NextExperiment(what=to_make, seconds=60.0, separates=(), kind="recording")
    result = Diagnosis(
        verdict=None,
        sentence="",
        cannot_know=tuple(reasons + gaps(recording)),
        baseline=nothing,
        extended=nothing,
        next_experiment=None if to_make.endswith("diagnose again") else following,  # these data only need a change
        recording=recording,
        seconds=seconds,
        seed=seed,
    )
    return dataclasses.replace(result, sentence=sentence_of(result))


def _unrelated(qd: np.ndarray, current: np.ndarray, torque: np.ndarray, recording: Recording) -> list[str]:
    """Whether the torque has nothing to do with the motion, or drives it where it should resist."""
    q = np.concatenate([run.q for run in recording.trajectories])
    qdd = np.concatenate([np.gradient(run.qd, run.dt) for run in recording.trajectories])
    table = np.stack([np.ones_like(q), q, qd, np.sign(qd), qdd, current, current * np.sign(qd), current * qd], axis=1)
    table /= np.maximum(np.abs(table).max(axis=0), 1e-300)
    rest = torque - table @ np.linalg.lstsq(table, torque, rcond=None)[0]
    what = quantity(recording.units["torque"])
    if float(rest.var()) > (1.0 - _FOLLOWED) * float(torque.var()):
        return [
            f"the {what} does not follow motion or {quantity(recording.units['current'])}: is the sensor connected, "
            f"and does its log belong to this motion? Then {STANDARD}"
        ]
    power = (torque - torque.mean()) * qd
    if float(power.sum()) < -0.3 * float(np.abs(power).sum()):
        return [
            f"the {what} drives the motion instead of resisting it: its sign, or that of the "
            f"{quantity(recording.units['q'])}, is turned against eq. 14; turn one of them and diagnose again"
        ]
    return []


def gaps(recording: Recording) -> list[str]:
    """What cannot be known although a verdict can be given; each names the recording to make."""
    runs = recording.trajectories
    current = np.concatenate([run.current for run in runs])
    top = float(np.abs(current).max())
    levels = np.unique(np.round(current / (top or 1.0), 2))
    name, found = quantity(recording.units["current"]), []
    if len(levels) == 1:
        found.append(
            f"the {name} is {current[0]:.3g} throughout: nothing that depends on it can be known (coil lag, command "
            "delay, remanence, saturation, viscosity over current); record several constant levels and steps between "
            "them while the joint moves"
        )
    elif all(np.ptp(run.current) <= 0.02 * top for run in runs):
        found.append(
            f"the {name} is constant within each trajectory: coil lag, command delay and remanence cannot be seen; "
            f"record steps of the {name} while the joint moves"
        )
    return found


def _at_limit(x: np.ndarray) -> float:
    """Share of samples that stand, in runs, at the largest value; 0 where more are just below it, as at a peak."""
    reach = max(float(np.ptp(x)), 1e-300)
    at = x >= x.max() - 1e-9 * reach
    below = (x >= x.max() - 0.01 * reach) & ~at
    return float((at[1:] & at[:-1]).mean()) if at.sum() >= below.sum() else 0.0
