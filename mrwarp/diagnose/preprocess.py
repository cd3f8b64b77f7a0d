"""How a log is read before effects are searched: fewer samples, rests held still, runs under way, clocks together.

Each step takes a problem and a model that was fitted to it, and returns a problem with another reading of the motion
where the torque clearly asks for it; else the problem itself.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from mrwarp.diagnose.problem import Fit, Problem, gain_and_t, refit, threshold
from mrwarp.identify.dataset import Motion
from mrwarp.identify.replay import EffectReplay
from mrwarp.recording.load import Recording, Trajectory

LIMIT = 160_000
"""Samples up to which a recording is diagnosed as it is: beyond, more of them say nothing new."""
LEAST_RATE = 300.0
"""Rate below which nothing is decimated [Hz]: lags of a few milliseconds must still show."""
_BEGUN = 0.8
"""Ratio of squared mismatches of a trajectory's head below which it begins under way instead of without stress."""
_TRIED = (0.25, 0.5, 0.75, 1.0)
"""Shifts of the clock that are tried [samples]."""
_CLEAR, _CLEAR_T = 0.02, 4.0
"""Least gain of a shift, as a share of all that the model leaves, and its least ratio to its standard error."""


def decimate(recording: Recording) -> tuple[Recording, str | None]:
    """The recording with at most about ``LIMIT`` samples, and a note on what was done, or None.

    Angle and velocity become means over the samples around each that is kept, which takes no motion away and adds no
    phase; current and torque are those of the sample itself, so that a step of the current stays a step.
    """
    runs, every = recording.trajectories, 1
    factors = [1] * len(runs)
    while sum(len(run.t) // k for run, k in zip(runs, factors, strict=True)) > LIMIT:
        every += 2
        wider = [min(every, _odd(1.0 / run.dt / LEAST_RATE)) for run in runs]
        if wider == factors:
            break
        factors = wider
    if max(factors) == 1:
        return recording, None
    kept = tuple(_every(run, k) for run, k in zip(runs, factors, strict=True))
    out = dataclasses.replace(recording, trajectories=kept)
    rates = " or ".join(str(rate) for rate in sorted({round(1.0 / run.dt) for run in kept}))
    return out, f"{recording.samples} samples are more than a diagnosis needs: it used {out.samples}, at {rates} Hz"


def _odd(most: float) -> int:
    """Largest odd number up to ``most``, at least 1."""
    return max(1, 2 * int((most + 1e-6 + 1.0) / 2.0) - 1)


def _every(run: Trajectory, every: int) -> Trajectory:
    """One trajectory with every ``every``-th sample, an odd number."""
    if every == 1:
        return run
    count = len(run.t) // every
    middle = np.arange(count) * every + every // 2
    means = {name: getattr(run, name)[: count * every].reshape(count, every).mean(axis=1) for name in ("q", "qd")}
    samples = {name: getattr(run, name)[middle] for name in ("t", "current", "torque")}
    temperature = None if run.temperature is None else run.temperature[middle]
    return dataclasses.replace(run, **means, **samples, temperature=temperature)


def hold_rests(problem: Problem, recording: Recording, fit: Fit, rate: float) -> tuple[Problem, Fit]:
    """Hold the joint still where it seems to rest, if that fits the torque better.

    A stress that decays in a rest may be a motion below the sensor's noise, then the noise is the better guess.
    ``rate`` is how fast z forgets along the path [1/normalised unit of q]. Returns the problem, and the model fitted to
    it.
    """
    motion = problem.motion
    held = Motion.of(recording, motion.scales, resistance=motion.resistance, rests=True)
    if not held.kinematics.rests:
        return problem, fit
    resting = dataclasses.replace(problem.with_motion(held), weight=held.settled(rate) * ~held.doubtful)
    refitted = refit(resting, fit, tolerance=1e-4)
    known = problem.weight * resting.weight
    before, after = (known @ (held.torque - f.torque) ** 2 for f in (fit, refitted))
    return (resting, refitted) if after < before else (problem, fit)


def begin_under_way(problem: Problem, fit: Fit) -> Problem:
    """Let z start as if joints that move at their first sample had slid before, where the heads say so.

    The heads are the samples that fits leave out because the unknown start of z shows in them.
    """
    motion = problem.motion
    moving = motion.under_way()
    if moving.begin is None or not moving.begin.any():
        return problem
    torque = EffectReplay(moving).torque(fit.row)[0].astype(float)
    head = (problem.weight == 0.0) & ~motion.doubtful
    before, after = (np.where(head, motion.torque - tau, 0.0) ** 2 for tau in (fit.torque, torque))
    better = np.array([after[part].sum() < _BEGUN * before[part].sum() for part in motion.parts])
    if 2 * np.sum(better & (moving.begin != 0.0)) < np.sum(moving.begin != 0.0):
        return problem
    return problem.with_motion(dataclasses.replace(moving, begin=np.where(better, moving.begin, 0.0)))


def align_clocks(problem: Problem, fit: Fit) -> Problem:
    """Shift the motion by the part of a sample by which the torque is logged ahead of it, if any.

    A commanded force is held until the next sample, so a log of commands is ahead of the motion by part of a sample.
    No effect of the catalogue acts before its cause, so what speaks for such a shift speaks for the log.
    """
    motion = problem.motion
    shifts, losses, best = [0.0], [fit.loo_loss], fit
    for shift in _TRIED:
        best = refit(problem.with_motion(motion.later(shift)), best)
        shifts.append(shift)
        losses.append(best.loo_loss)
        if losses[-1].sum() > losses[-2].sum():
            break
    totals = [float(loss.sum()) for loss in losses]
    k = int(np.argmin(totals))
    gain, t = gain_and_t(losses[0], losses[k])
    if gain < max(5.0 * threshold(fit), _CLEAR * totals[0]) or t < _CLEAR_T:
        return problem
    found = shifts[k]
    if 0 < k < len(totals) - 1:  # the vertex of the parabola through the best and its neighbours
        before, here, after = totals[k - 1 : k + 2]
        found += 0.5 * _TRIED[0] * (before - after) / (before - 2.0 * here + after)
    return problem.with_motion(motion.later(found))


def clock_note(ahead: float, dt: float) -> str:
    """A note on a torque that is logged ``ahead`` samples before the motion, with a sampling interval ``dt`` [s]."""
    return (
        f"torque is logged {ahead:.2f} samples ({1e3 * ahead * dt:.2g} ms) ahead of the motion, as where a command is "
        "logged that is held until the next sample; the motion was taken that much later"
    )
