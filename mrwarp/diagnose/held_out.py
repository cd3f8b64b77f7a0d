"""Predictions of held-out data: trajectories left out in turn, and other recordings of the device.

Every trajectory is predicted once, by the baseline and by the extension as they are reported, each fitted again to the
other trajectories by their normal equations. Where these would not have chosen the extension, the baseline stands for
it. So the whole data set counts, none of it twice, and every figure of error or gain of a diagnosis comes from here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from mrwarp.diagnose.checks.spikes import Spikes
from mrwarp.diagnose.problem import Fit, Problem
from mrwarp.diagnose.residual_structure import groups_along
from mrwarp.diagnose.search import Selection
from mrwarp.identify.boosting import (
    chosen_samples,
    cross_predicted,
    end_processes,
    spread_where_it_repeats,
)
from mrwarp.identify.damper import prediction_errors, undo_moving_average
from mrwarp.identify.dataset import Motion, sample_noise
from mrwarp.identify.projection import Progress
from mrwarp.identify.replay import EffectReplay
from mrwarp.recording.load import Recording, check_same_units
from mrwarp.sysid.left_out import left_out
from mrwarp.sysid.pieces import Pieces
from mrwarp.sysid.settings import Rest

MODELS = ("baseline", "extended")


@dataclass(frozen=True)
class HeldOut:
    """Squared error of each trajectory, normalised units, shape (T,), and what was predicted of it, shape (N,).

    Samples of weight 0, where nobody knows the state of the joint, do not count in the former.
    """

    baseline: np.ndarray
    extended: np.ndarray
    predicted_baseline: np.ndarray
    predicted_extended: np.ndarray
    agreed: float
    """Share of the trajectories without which the extension would have been chosen."""


def hold_out(problem: Problem, selection: Selection, baseline: Fit, extended: Fit) -> HeldOut:
    """Predict every trajectory by what the others say; ``baseline`` and ``extended`` are the models as reported."""
    before, after = (_predicted(problem, fit) for fit in (baseline, extended))
    others = [fit.total - fit.loo_loss for fit in (selection.base, selection.final)]
    agreed = others[1] <= others[0]
    for part, chosen in zip(problem.motion.parts, agreed, strict=True):
        if not chosen:
            after[part] = before[part]
    errors = problem.weight * (np.stack([before, after]) - problem.measured) ** 2
    squares = np.add.reduceat(errors, problem.motion.start[:-1], axis=1)
    return HeldOut(squares[0], squares[1], before, after, float(agreed.mean()))


def held_out_squares(problem: Problem, fit: Fit) -> np.ndarray:
    """Squared error of each trajectory by a model fitted to the others, shape (T,); normalised units."""
    errors = problem.weight * (_predicted(problem, fit) - problem.motion.torque) ** 2
    return np.add.reduceat(errors, problem.motion.start[:-1])


def _predicted(problem: Problem, fit: Fit) -> np.ndarray:
    """Torque of each trajectory by the fit without it, shape (N,)."""
    columns = [*fit.free, len(fit.x)]
    pieces = Pieces.of_grams(fit.equations.parts[:, columns][:, :, columns])
    out = fit.torque.copy()
    if len(pieces.square) < 2:
        return out
    for delta, part in zip(left_out(pieces), problem.motion.parts, strict=True):
        out[part] += delta @ fit.slopes[fit.free, part]
    return out


@dataclass(frozen=True, kw_only=True)
class Share:
    """A part of the baseline's squared mismatch, with its 95 % interval over trajectories [1]."""

    share: float
    ci95: tuple[float, float]


@dataclass(frozen=True, kw_only=True)
class Account:
    """Where the baseline's squared mismatch on unseen trajectories goes; the three shares add up to 1."""

    named: Share
    """Share that the named effects take away."""
    repeatable: Share
    """Share that no named effect takes away, but a predictor without any law predicts on held-out trajectories."""
    not_repeatable: Share
    """Differences between repeats of the same motion; without repeats, the share that such a predictor misses."""
    left: float
    """Error of the predictor, as a share of the measured torque's standard deviation [1]."""
    cycle_spread: float | None
    """Spread of the torque where the same motion comes again, as such a share; None where it hardly ever does."""
    learnable: Share
    """Part of the extended model's RMSE that the predictor takes away on trajectories it never saw."""
    spikes: float = 0.0
    """Part of the mismatch that spikes carry, within what is not repeatable; no figure of error has them [1]."""
    unreported: float = Rest.unreported
    """Share of the mismatch that may repeat without being reported [1]."""
    of_runs: float = 0.0
    """Part of the mismatch by which runs differ in zero and gain, where the same motion comes again within them; it is
    in what is not repeatable [1]."""

    @property
    def unnamed(self) -> float:
        """Share that repeats without a name, of the mismatch without its spikes [1]."""
        return self.repeatable.share / max(1.0 - self.spikes, 1e-9)

    @property
    def competing(self) -> float:
        """Share next to which a cause has to stand: it may be a part also of what differs from run to run [1]."""
        return self.unnamed + self.of_runs / max(1.0 - self.spikes, 1e-9)

    @property
    def least(self) -> float:
        """Share that does not repeat, of the mismatch without its spikes [1]."""
        return max(self.not_repeatable.share - self.spikes, 0.0) / max(1.0 - self.spikes, 1e-9)

    @property
    def open(self) -> bool:
        """Whether much of the mismatch repeats and has no name."""
        return self.unnamed > self.unreported


def not_predicted(problem: Problem, held: HeldOut, extended: Fit, seed: int) -> np.ndarray:
    """Torque on held-out trajectories that no predictor gives, at the samples that boosting looks at.

    Gradient boosting on other trajectories predicts the extended model's rest, and where that is much also next to
    smooth functions, and the torque itself; the best of these counts. Normalised units, shape (M,).
    """
    motion = problem.motion
    at = chosen_samples(motion, problem.weight, problem.settings.effort.samples)
    predicted_by = partial(cross_predicted, motion, at, seed=seed, threads=problem.replay.threads)
    after, signals = motion.torque - held.predicted_extended, [held.predicted_extended]
    left = _left(after, predicted_by(after, extra=signals), at)
    if float(left @ left) < (1.0 - problem.settings.rest.unreported) * float(np.sum(after[at] ** 2)):
        smooth = np.vstack([group.rows for group in groups_along(problem, extended) if not group.slow])
        more = _left(after, predicted_by(after, extra=signals, smooth=smooth), at)
        direct = _left(motion.torque, predicted_by(motion.torque), at)
        left = min(left, more, direct, key=lambda x: float(x @ x))
    if problem.replay.threads > 1:
        end_processes()
    return left


def account_of(
    problem: Problem,
    held: HeldOut,
    left: np.ndarray,
    seed: int,
    *,
    law: bool = False,
    spikes: Spikes | None = None,
) -> Account:
    """Divide the mismatch into what is named, what repeats all the same and what does not repeat.

    Only :func:`not_predicted` torque counts as not repeatable. Where the same motion comes again and
    differs by clearly less, that counts. Where it hardly ever does, the interval reaches down to the noise from sample
    to sample, which no predictor gives. ``law`` says whether another law takes the place of eq. 15.
    What the extended model leaves at ``spikes`` does not repeat.
    """
    motion = problem.motion
    at = chosen_samples(motion, problem.weight, problem.settings.effort.samples)
    torque = motion.torque
    before, after = torque - held.predicted_baseline, torque - held.predicted_extended
    run = np.searchsorted(motion.start, at, side="right") - 1
    squares = np.stack([np.bincount(run, x**2, len(motion.dt)) for x in (before[at], after[at], left)])
    rng = np.random.default_rng(seed)
    pick = rng.integers(0, squares.shape[1], (2000, squares.shape[1]))
    draws = np.moveaxis(squares[:, pick].sum(axis=2), 0, 1)  # (draws, 3)
    # what spikes leave, as if they were thinned like the samples
    stand = np.zeros(len(motion.dt)) if spikes is None else np.add.reduceat(spikes.at * after**2, motion.start[:-1])
    stand *= len(at) / max(float(np.sum(problem.weight > 0.0)), 1.0)
    spiky, spiky_drawn = float(stand.sum()), stand[pick].sum(axis=1)[:, None]
    spread = float(torque[at].std()) or 1.0
    low, high = np.percentile(_shares(draws), (2.5, 97.5), axis=0)
    total = squares.sum(axis=1)
    learnable = _shares(total[None])[0, -1]
    samples = np.bincount(run, minlength=len(motion.dt))[pick].sum(axis=1)
    again, drawn = _spread(problem, after, at, pick)
    # a zero and a gain that differ from run to run do not repeat, and are not in what differs within a run
    varies = np.bincount(run, problem.of_runs(left, held.predicted_extended[at], at) ** 2, len(motion.dt))
    drawn = drawn * samples + varies[pick].sum(axis=1)
    clearly = problem.settings.rest.with_law if law else problem.settings.gain.half
    differs = 0.0
    if again is not None and again * len(at) < clearly * total[2]:
        within = again * len(at)
        if within + varies.sum() < clearly * total[2]:
            total[2] = within + varies.sum()
            draws[:, 2] = drawn
        differs = float(total[2]) - within
    ends = np.percentile(_shares(draws + spiky_drawn), (2.5, 97.5), axis=0)
    if again is None:
        floor = np.stack([*draws.T[:2], drawn], axis=1) + spiky_drawn
        floor = np.percentile(_shares(floor), (2.5, 97.5), axis=0)
        ends = np.minimum(ends[0], floor[0]), np.maximum(ends[1], floor[1])
    low[:-1], high[:-1] = ends[0][:-1], ends[1][:-1]
    shares = np.array([*_shares(total[None] + spiky)[0, :-1], learnable])
    named, repeatable, rest, learnable = (
        Share(share=float(x), ci95=(float(min(a, x)), float(max(b, x))))
        for x, a, b in zip(shares, low, high, strict=True)
    )
    return Account(
        named=named,
        repeatable=repeatable,
        not_repeatable=rest,
        left=float(np.sqrt(np.mean(left**2))) / spread,
        cycle_spread=None if again is None else float(np.sqrt(again)) / spread,
        learnable=learnable,
        spikes=spiky / max(float(total[0]) + spiky, 1e-300),
        unreported=problem.settings.rest.unreported,
        of_runs=differs / max(float(total[0]) + spiky, 1e-300),
    )


def _spread(
    problem: Problem, mismatch: np.ndarray, at: np.ndarray, pick: np.ndarray
) -> tuple[float | None, np.ndarray]:
    """Squared spread where the motion comes again, and draws of it; else None and the white floor.

    ``pick`` are draws of trajectories, shape (draws, T).
    """
    counts, spreads = spread_where_it_repeats(problem.motion, mismatch, at)
    if not counts.any():
        return None, np.full(len(pick), sample_noise(problem.motion, mismatch) ** 2)
    mean = float(counts @ spreads / counts.sum())
    drawn = (counts * spreads)[pick].sum(axis=1) / np.maximum(counts[pick].sum(axis=1), 1.0)
    return mean, np.where(counts[pick].any(axis=1), drawn, mean)


def _left(target: np.ndarray, predicted: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Rest of a target after a prediction, shrunk by one factor: a useless prediction adds no noise."""
    size = float(predicted @ predicted)
    factor = float(np.clip(predicted @ target[at] / size, 0.0, 1.0)) if size > 0.0 else 0.0
    return target[at] - factor * predicted


def _shares(squares: np.ndarray) -> np.ndarray:
    """Named, repeatable and not repeatable share, and part of the RMSE that can be learned, shape (draws, 4)."""
    before, after, left = squares.T
    after, before = np.minimum(after, before), np.maximum(before, 1e-300)
    left = np.minimum(left, after)
    learnable = 1.0 - np.sqrt(left / np.maximum(after, 1e-300))
    return np.stack([(before - after) / before, (after - left) / before, left / before, learnable], axis=1)


def reduction(held: HeldOut, seed: int, count: int = 2000) -> tuple[float, tuple[float, float]]:
    """Reduction of the RMSE and its 95 % interval over trajectories."""
    value = 1.0 - np.sqrt(held.extended.sum() / max(held.baseline.sum(), 1e-300))
    rng = np.random.default_rng(seed)
    pick = rng.integers(0, len(held.baseline), (count, len(held.baseline)))
    draws = 1.0 - np.sqrt(held.extended[pick].sum(1) / np.maximum(held.baseline[pick].sum(1), 1e-300))
    low, high = np.percentile(draws, (2.5, 97.5))
    return float(value), (float(min(low, value)), float(max(high, value)))


@dataclass(frozen=True, kw_only=True)
class Predictor:
    """Baseline and extended model of a diagnosis, for other recordings of the same device."""

    rows: np.ndarray
    """Parameters in normalised units, shape (2, WIDTH)."""
    motion: Motion
    """The motion that they were fitted to: its scales, and how its log was read."""
    recording: Recording
    """The data to which they were fitted."""

    def torque(self, recording: Recording) -> np.ndarray:
        """Torque of both models along all trajectories end to end, shape (2, N) [unit of the recording].

        Raises:
            RecordingError: the recording has other units than the one that was fitted.
        """
        check_same_units(recording, self.recording)
        like = self.motion
        read = {name: getattr(like.kinematics, name) for name in ("rests", "smoothing", "settings")}
        motion = Motion.of(recording, like.scales, resistance=like.resistance, **read)
        if like.medians > 1:
            motion = motion.quieter(like.medians)
        if like.ahead:
            motion = motion.later(like.ahead)
        if like.begin is not None:
            motion = motion.under_way()
        return EffectReplay(motion).torque(self.rows).astype(float) * like.scales.torque


def predicted_errors(
    predictor: Predictor, recording: Recording, *, averaged: float, log: Progress = lambda text: None
) -> dict[str, dict[str, dict[str, float]]]:
    """RMSE over standard deviation of another recording of a device, by reading of its motion, model and trajectory.

    ``averaged`` is the moving average [s] that its q and torque passed before they were published; then the simulated
    torque passes the same, and the motion is taken as published and again with its average undone.

    Raises:
        RecordingError: the units differ.
    """
    log(f"predicting {len(recording.trajectories)} trajectories of {recording.source}")
    readings = {"motion as published" if averaged else "": recording}
    if averaged:
        readings["average of the motion undone"] = undo_moving_average(recording, averaged)
    cuts = np.cumsum([len(run.t) for run in recording.trajectories])[:-1]
    return {
        name: {
            model: prediction_errors(motion, np.split(tau, cuts), averaged)
            for model, tau in zip(MODELS, predictor.torque(motion), strict=True)
        }
        for name, motion in readings.items()
    }


def summary(found: dict[str, dict[str, dict[str, float]]]) -> dict[str, Any]:
    """Mean over the trajectories by reading and model, and in how many of them the extension is better."""
    out = {}
    for name, models in found.items():
        before, after = (np.array(list(models[model].values())) for model in MODELS)
        means = {"baseline": float(before.mean()), "extended": float(after.mean())}
        out[name] = {**means, "better": int((after < before).sum()), "trajectories": len(before)}
    return out
