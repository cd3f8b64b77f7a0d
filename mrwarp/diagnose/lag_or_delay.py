"""Coil lag or command delay: whether the current creeps or arrives late, decided by the single steps of the command.

A log says between which two samples the command changed, not when. Both effects are then the same mean change of the
first samples after a step. But a delay leaves each of these samples wholly old or wholly new, as the step fell before
or after, where a lag leaves them anywhere in between: the single steps distinguish what their mean does not.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mrwarp.diagnose.problem import Fit, Problem
from mrwarp.diagnose.screening import Models
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.parameters import row_column

LAG, DELAY = "coil_lag", "command_delay"
_AGES = 48
"""Times of the step between two samples that are integrated over."""


@dataclass(frozen=True)
class LagOrDelay:
    """The model with whichever of lag and delay the single steps speak for."""

    model: Fit
    excluded: str | None = None
    """The one of the two that the steps speak against: no alternative, regardless of the fits."""
    undecided: str | None = None
    """The one that stays an alternative, regardless of the fits."""
    refined: Mapping[tuple[str, str], tuple[float, float, float]] = field(default_factory=dict)
    """Parameters, and their intervals, that the steps give better than the fit; normalised units."""


@dataclass(frozen=True)
class StepResponses:
    """Steps of the command that stand alone and show in the torque."""

    late: np.ndarray
    """Part of the old current's torque that is still there at the samples after each step, shape (E, J)."""
    error: np.ndarray
    """Its standard error, shape (E, J)."""
    trajectory: np.ndarray
    """Trajectory of each step, shape (E,)."""
    dt: float
    """Sampling interval [s]."""


def decided_by_steps(models: Models, final: Fit, candidates: list[str]) -> LagOrDelay:
    """Decide between lag and delay where one of them is named and the other does nearly as well."""
    named = [e for e in (LAG, DELAY) if e in models.added(final)]
    if len(named) != 1:
        return LagOrDelay(final)
    certain = LagOrDelay(final, refined=_refined(find_steps(models.problem, final)) if named[0] == DELAY else {})
    other = DELAY if named[0] == LAG else LAG
    without = models.without(final, named[0])
    screened = models.screened(without, [other]) if other in candidates else []
    if not screened:
        return certain
    rival = models.grown(without, screened[0])
    behind = (rival.total - final.total) / max(without.total - final.total, 1e-9)
    if behind > models.problem.settings.steps.near:
        return certain
    steps = find_steps(models.problem, final if named[0] == LAG else rival)
    found = more_likely(steps, models.problem.settings.gain.distinct) if steps is not None else None
    if steps is None or found is None:  # neither law knows when the command changed: their fits do not decide
        return LagOrDelay(final, undecided=other)
    model, loser = (final, other) if found == named[0] else (rival, named[0])
    return LagOrDelay(model, excluded=loser, refined=_refined(steps) if found == DELAY else {})


def _refined(steps: StepResponses | None) -> dict[tuple[str, str], tuple[float, float, float]]:
    """The delay by the single steps, where the fit does not have it.

    The fit has a delay of parts of a sample as a mean of two samples. And where all steps fall equally between two
    samples, as where the log and the command share a clock, every delay up to the next whole sample gives one record.
    """
    if steps is None:
        return {}
    size = size_from(steps, DELAY)
    _, (in_parts, _, whole) = _likelihoods(steps, DELAY)
    if size[0] < 2.0 * steps.dt or whole.max() > in_parts.max() - 1e-6:  # equal at a whole sample
        return {(DELAY, CATALOGUE[DELAY].parameters[0].name): size}
    return {}


def more_likely(steps: StepResponses, distinct: float) -> str | None:
    """The one of the two effects that the steps speak for, by this chi-squared; None where they do not decide."""
    lag, delay = (float(_profile(steps, effect)[1].max()) for effect in (LAG, DELAY))
    if 2.0 * abs(lag - delay) < distinct:
        return None
    return LAG if lag > delay else DELAY


def size_from(steps: StepResponses, effect: str) -> tuple[float, float, float]:
    """Size of an effect from the single steps, and its 95 % interval by the profile of the likelihood [s]."""
    sizes, profile = _profile(steps, effect)
    inside = sizes[profile > profile.max() - 1.92]
    step = float(np.diff(sizes).min())
    return float(sizes[np.argmax(profile)]), max(0.0, float(inside.min()) - step), float(inside.max()) + step


def find_steps(problem: Problem, lag: Fit) -> StepResponses | None:
    """Steps of a data set, measured against a model without its lag or delay; None if they are too few."""
    s, noise, settings = problem.motion, problem.noise.rms, problem.settings
    dt = float(np.median(s.dt))
    if float(np.ptp(s.dt)) > 1e-3 * dt:
        return None
    constant, delay = (row_column(effect, CATALOGUE[effect].parameters[0].name) for effect in (LAG, DELAY))
    reach = int(np.clip(np.ceil(max(1.6 * lag.row[constant], lag.row[delay] + 2.0 * dt) / dt), 3, 40))
    rows = np.stack([lag.row, lag.row])
    rows[:, [constant, delay]] = 0.0
    rows[1, delay] = reach * dt
    new, old = problem.replay.torque(rows).astype(float)
    late, error, trajectory = [], [], []
    for index, part in enumerate(s.parts):
        at = np.flatnonzero(np.abs(np.diff(s.current[part])) > 1e-3 * s.ranges.current) + 1
        before = np.diff(at, prepend=-reach)
        after = np.diff(at, append=part.stop - part.start + reach)
        for k in part.start + at[(before > reach) & (after >= reach)]:
            if k + reach > part.stop or k - 2 < part.start:
                continue
            window = slice(k, k + reach)
            change = new[window] - old[window]
            if np.abs(change).min() < settings.gain.clear_t * noise:
                continue
            level = float(np.mean(s.torque[k - 2 : k] - new[k - 2 : k]))
            late.append((new[window] + level - s.torque[window]) / change)
            error.append(np.hypot(1.2 * noise / np.abs(change), settings.steps.model_error))
            trajectory.append(index)
    if len(late) < settings.steps.enough:
        return None
    return StepResponses(np.array(late), np.array(error), np.array(trajectory), dt)


def _profile(steps: StepResponses, effect: str) -> tuple[np.ndarray, np.ndarray]:
    """Sizes [s] and the logarithm of the likelihood at each, of what explains the steps' times between samples best."""
    sizes, ways = _likelihoods(steps, effect)
    return sizes, ways.max(axis=0)


def _likelihoods(steps: StepResponses, effect: str) -> tuple[np.ndarray, np.ndarray]:
    """Sizes [s], shape (S,), and the logarithm of the likelihood at each, shape (3, S).

    A step's time between two samples is unknown and integrated over: that of each step, one that is common to all steps
    of a trajectory, and one that is common to all.
    """
    dt, reach = steps.dt, steps.late.shape[1]
    age = (np.arange(_AGES) + 0.5) / _AGES * dt
    since = age[:, None] + dt * np.arange(reach)
    sizes = dt * (np.geomspace(0.02, 2.0 * reach, 80) if effect == LAG else np.linspace(0.02, reach, 50 * reach))
    members = [np.flatnonzero(steps.trajectory == k) for k in np.unique(steps.trajectory)]
    out = np.empty((3, len(sizes)))
    for i, size in enumerate(sizes):
        late = np.exp(-since / size) if effect == LAG else (since < size).astype(float)
        miss = (steps.late[:, None, :] - late) / steps.error[:, None, :]
        each = -0.5 * np.minimum(miss**2, 25.0).sum(axis=2)
        together = np.stack([each[m].sum(axis=0) for m in members])
        out[:, i] = _mean_exp(each).sum(), _mean_exp(together).sum(), _mean_exp(each.sum(axis=0))
    return sizes, out


def _mean_exp(logs: np.ndarray) -> np.ndarray:
    """Logarithm of the mean over the last axis."""
    top = logs.max(axis=-1)
    return top + np.log(np.mean(np.exp(logs - top[..., None]), axis=-1))
