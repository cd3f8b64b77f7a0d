"""From a recording to a problem: eqs. 14 and 15 fitted, the noise learned from what they leave, the log well read.

Where the torque clearly asks for it, the log is read otherwise: rests held still, runs under way, clocks together. Each
such step takes a problem and a model fitted to it, and returns a problem with another reading, or the problem itself.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mrwarp.diagnose.problem import (
    Fit,
    Problem,
    base_vector,
    covariance,
    fit_model,
    normalised,
    refit,
    threshold,
    unit_loop,
)
from mrwarp.diagnose.residual_structure import groups_along
from mrwarp.effects.catalogue import KNOWN
from mrwarp.effects.law import EffectParameter
from mrwarp.identify.checks.stated import coil_resistance
from mrwarp.identify.dataset import Motion, Scales, rms, sample_noise
from mrwarp.identify.fit import BoucWenStructure
from mrwarp.identify.noise import Noise, estimate_noise, trajectory_spread
from mrwarp.identify.parameters import EFFECT_PART, LINEAR_PART, Slot, factor_of
from mrwarp.identify.projection import Progress, search_starts
from mrwarp.identify.replay import EffectReplay, Replay
from mrwarp.model_file import JOINT_UNITS, Model
from mrwarp.params import MrParams
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.sysid.certainty import by_ratio, gain_and_t
from mrwarp.sysid.least_squares import ridge_solve
from mrwarp.sysid.settings import Reading, Settings

_SHAPES = ((0.5, 1.0, 1.0), (1.5, 1.5, 1.5), (1.5, 2.5, 2.5))
"""More starts: coordinates of alpha, beta, gamma with a hysteresis that yields within 1/3 to 1/12 of the scale."""
_SHIFT = 0.25
"""Step of the shifts of the clock that are tried, up to a whole sample [samples]."""


def fit_baseline(
    recording: Recording,
    *,
    model: Model | None,
    threads: int,
    seed: int,
    log: Progress,
    settings: Settings | None = None,
    known: np.ndarray | None = None,
) -> tuple[Problem, Fit]:
    """Fit eqs. 14 and 15 on ``threads`` of the CPU, and learn the noise.

    A ``model`` that is known already is one more start, and its effects are part of the baseline. ``seed`` is that of
    the samples on which starts are searched; ``log`` takes a line on what is being done; the problem carries the
    ``settings``; ``known`` says of which samples of the motion the torque may be fitted, bool, shape (N,), where these
    are not all.
    """
    settings = settings or Settings()
    motion = Motion.of(recording, resistance=coil_resistance(recording, model), settings=settings)
    motion = motion.stretches(settings.reading.samples)
    if known is not None:
        motion = replace(motion, known=known)
    scales = motion.scales
    q_zero = nominal_zero(recording, model) / scales.q
    log("eqs. 14 and 15: starts")
    structure = BoucWenStructure(motion, q_zero)
    points = search_starts(structure, Replay(motion), limit=settings.effort.starts_on, seed=seed)[:2]
    bases = [np.array([*point.linear, *point.theta]) for point in points]
    if model is not None:
        values = normalised(model.values, scales)
        bases.append(base_vector(unit_loop(values) if model.law else values, motion.ranges.qd))
    # the search sees few samples: now and then it ends in a corner
    bases += [np.array([*bases[0][LINEAR_PART], *shape]) for shape in _SHAPES]
    log("noise")
    rate = min(float(np.exp(point.theta[1])) for point in points)
    problem = Problem(
        replay=EffectReplay(motion, threads=threads),
        measured=motion.torque,
        weight=motion.settled(rate),
        q_zero=q_zero,
        units=recording.units,
        noise=_white(float(motion.torque.std()) or 1.0),
        settings=settings,
    )
    nominal = _known_numbers(model, scales)
    bends = {(effect, p.name): value for (effect, p), value in nominal.items() if p.form}
    layout = problem.parameters(known_effects(model), bends)
    numbers = {
        (effect, p.name): float(np.log(max(value, 1e-12))) if Slot(effect, p).logarithmic else value
        for (effect, p), value in nominal.items()
    }
    fits = (fit_model(problem, layout, layout.vector(x, numbers), tolerance=1e-4) for x in bases)
    plain = min(fits, key=lambda f: float(f.loss.sum()))
    at_first = problem
    problem, plain = hold_rests(problem, recording, plain, rate)
    if problem is not at_first:
        log("the joint rests now and then")
    problem, fit = judged(problem, plain, log)
    quiet = quiet_current(problem, fit)
    if quiet is problem:
        return problem, fit
    log("the measured current is noisy: it is smoothed")
    return judged(*plain_problem(quiet, fit), log)


def judged(problem: Problem, plain: Fit, log: Progress) -> tuple[Problem, Fit]:
    """The problem with the noise that a model leaves found by least squares, and that model fitted to it."""
    motion, fit = problem.motion, plain
    for _ in range(2):
        problem, fit = with_learned_noise(problem, fit)
    # what repeats along the angle of a joint that turns on and on is as quick as noise, and would be taken for it
    turns = motion.ranges.turns > 1.0
    if turns or rms(motion.torque - fit.torque) > problem.settings.reading.misfit * rms(motion.torque - plain.torque):
        log("plain least squares: the misfit is larger than any noise")
        problem, fit = with_learned_noise(replace(problem, misfit=True), plain)
    return problem, fit


def with_learned_noise(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """The problem with the noise that a model leaves, and the model fitted to that."""
    problem = replace(problem, noise=learn_noise(problem, fit))
    return problem, refit(problem, fit)


def learn_noise(problem: Problem, fit: Fit) -> Noise:
    """Noise from what neither the model nor any smooth function of the measured variables explains."""
    s, torque = problem.motion, fit.torque
    mismatch = s.torque - torque
    if problem.misfit:
        return _white(rms(mismatch))
    groups = groups_along(problem, fit)
    table = np.vstack([np.ones((1, len(torque))), torque[None], *(g.rows for g in groups)]).astype(np.float32)
    table /= np.maximum(np.sqrt(np.mean(table**2, axis=1, keepdims=True)), 1e-9)
    gram, moment = (table @ table.T).astype(float), (table @ mismatch.astype(np.float32)).astype(float)
    rest = mismatch - ridge_solve(gram, moment, 1e-5) @ table
    if len(s.parts) > problem.settings.reading.many:
        offset, gain = trajectory_spread(rest, torque, s, np.empty((len(s.parts), 0)))
    else:
        middle = np.array([[s.time[p].mean(), s.heat[2][p].mean()] for p in s.parts])
        trends = (middle - middle.mean(axis=0)) / np.maximum(middle.std(axis=0), 1e-12)
        offset, gain = trajectory_spread(mismatch, torque, s, trends)
    inside = rest.copy()
    for part in s.parts:
        f = np.column_stack([np.ones(part.stop - part.start), torque[part] - torque[part].mean()])
        inside[part] -= f @ np.linalg.lstsq(f, rest[part], rcond=None)[0]
    return estimate_noise(inside, torque, s, offset, gain)


def nominal_zero(recording: Recording, model: Model | None) -> float:
    """Angle from which q_c counts: the model's, the paper's for a joint in its units, else the encoder's zero."""
    if model is not None:
        return model.values.get("q_offset", 0.0) + model.values.get("q_center", 0.0)
    if recording.units == JOINT_UNITS:
        paper = MrParams().bouc_wen
        return paper.q_offset + paper.q_center
    return 0.0


def known_effects(model: Model | None) -> list[str]:
    """Effects already in a known model, which are not searched again."""
    return [e.name for e in model.effects if e.name in KNOWN] if model else []


def _known_numbers(model: Model | None, scales: Scales) -> dict[tuple[str, EffectParameter], float]:
    """Inner values of the numbers of a known model's effects."""
    return {
        (effect.name, p): effect.parameters[p.name].value / factor_of(p, scales)
        for effect in (model.effects if model else ())
        if effect.name in KNOWN
        for p in KNOWN[effect.name].parameters
        if p.name in effect.parameters
    }


def plain_problem(problem: Problem, fit: Fit) -> tuple[Problem, Fit]:
    """The problem before its noise was learned, and the model fitted to that."""
    problem = replace(problem, noise=_white(float(problem.motion.torque.std()) or 1.0), misfit=False)
    return problem, refit(problem, fit, tolerance=1e-4)


def _white(level: float) -> Noise:
    """Noise without memory, and without offsets and factors of trajectories."""
    return Noise(whitening=np.ones(1), sigma=level, rms=level, offset=0.0, gain=0.0)


# --- how the log is read ---


def decimate(recording: Recording, reading: Reading) -> tuple[Recording, str | None]:
    """The recording with at most about as many samples as are needed, and a note on what was done, or None.

    Angle and velocity become means over the samples around each that is kept, which takes no motion away and adds no
    phase; current and torque are those of the sample itself, so that a step of the current stays a step.
    """
    runs, every = recording.trajectories, 1
    factors = [1] * len(runs)
    # the widest odd step of each trajectory that keeps its rate
    least = [max(reading.least_rate, reading.per_period * _quickest(run)) for run in runs]
    widest = [
        max(1, 2 * int((1.0 / run.dt / rate + 1e-6 + 1.0) / 2.0) - 1) for run, rate in zip(runs, least, strict=True)
    ]
    while sum(len(run.t) // k for run, k in zip(runs, factors, strict=True)) > reading.samples:
        every += 2
        wider = [min(every, most) for most in widest]
        if wider == factors:
            break
        factors = wider
    if max(factors) == 1:
        return recording, None
    kept = tuple(_every(run, k) for run, k in zip(runs, factors, strict=True))
    out = replace(recording, trajectories=kept)
    rates = " or ".join(str(rate) for rate in sorted({round(1.0 / run.dt) for run in kept}))
    return out, f"{recording.samples} samples are more than a diagnosis needs: it used {out.samples}, at {rates} Hz"


def _quickest(run: Trajectory) -> float:
    """Frequency below which 95 % of the torque's energy lies [Hz]."""
    varies = (run.torque - run.torque.mean()) * np.hanning(len(run.t))
    energy = np.cumsum(np.abs(np.fft.rfft(varies)) ** 2)
    return float(np.searchsorted(energy, 0.95 * energy[-1])) / (len(run.t) * run.dt)


def _every(run: Trajectory, every: int) -> Trajectory:
    """One trajectory with every ``every``-th sample, an odd number."""
    if every == 1:
        return run
    count = len(run.t) // every
    middle = np.arange(count) * every + every // 2
    means = {name: getattr(run, name)[: count * every].reshape(count, every).mean(axis=1) for name in ("q", "qd")}
    samples = {name: getattr(run, name)[middle] for name in ("t", "current", "torque")}
    temperature = None if run.temperature is None else run.temperature[middle]
    lost = None if run.lost is None else run.lost[: count * every].reshape(count, every).any(axis=1)
    return replace(run, **means, **samples, temperature=temperature, lost=lost)


def hold_rests(problem: Problem, recording: Recording, fit: Fit, rate: float) -> tuple[Problem, Fit]:
    """Hold the joint still where it seems to rest, if that fits the torque better.

    A stress that decays in a rest may be a motion below the sensor's noise, then the noise is the better guess.
    ``rate`` is how fast z forgets along the path [1/normalised unit of q]. Returns the problem with its model.
    """
    motion = problem.motion
    read = {"rests": True, "settings": problem.settings}
    held = Motion.of(recording, motion.scales, resistance=motion.resistance, **read)
    held = held.stretches(problem.settings.reading.samples)
    held = replace(held, known=motion.known)
    still = held.kinematics.still
    if still is None or not still.any():
        return problem, fit
    resting = replace(problem.with_motion(held), weight=held.settled(rate) * ~held.uncertain)
    refitted = refit(resting, fit, tolerance=1e-4)
    known = problem.weight * resting.weight
    before, after = (known @ (held.torque - f.torque) ** 2 for f in (fit, refitted))
    if after >= before:
        return problem, fit
    if not driven(held, problem.settings):
        return resting, refitted
    sticking = replace(resting, weight=resting.weight * ~still)
    return sticking, refit(sticking, refitted, tolerance=1e-4)


def driven(motion: Motion, settings: Settings) -> bool:
    """Whether the torque of a joint that is held still grows in its rests: a drive applies it, and the joint sticks.

    A device that a bench moves can only relax while it stands, unless its control input changes. A torque that grows
    all the same comes from a drive, and static friction balances it at any size: no law of the motion knows it.
    """
    size = motion.torque.std()
    rises = []
    for rest in motion.rests:
        if rest.stop - rest.start < 4:  # no quarters
            continue
        tau = motion.torque[rest] * np.sign(motion.torque[rest].mean())
        quarters = np.array([part.mean() for part in np.array_split(tau, 4)])  # the noise is not to grow
        if np.ptp(motion.current[rest]) <= settings.gain.share * motion.ranges.current:
            rises.append(float((quarters - np.minimum.accumulate(quarters)).max()) / size)
    return len(rises) >= settings.gain.few and float(np.median(rises)) > settings.gain.detail


def sticks(problem: Problem) -> bool:
    """Whether a drive moves the joint, so that its rests do not count."""
    still = problem.motion.kinematics.still
    return still is not None and bool(still.any()) and not problem.weight[still].any()


def quiet_current(problem: Problem, fit: Fit, *, each: bool = False) -> Problem:
    """Take noise from sample to sample off a measured current where the torque is then predicted clearly better.

    What lags behind the current, or follows it with play, takes its noise away, and would be named for that. A median
    over the samples around each does so without a lag, and leaves steps as they are.
    With ``each``, all runs count equally: those of large currents gain most.
    """
    motion, found = problem.motion, [(problem, fit)]
    shortest = float(np.diff(motion.start).min())
    for width in _doubled(shortest) if sample_noise(motion, motion.current) > 0.0 else ():
        quiet = problem.with_motion(motion.quieter(int(width) + 1))
        found.append((quiet, refit(quiet, found[-1][1])))
        if found[-1][1].total > found[-2][1].total:
            break
    best, fitted = min(found, key=lambda item: item[1].total)
    ratio = by_ratio(fit.loo_loss, fitted.loo_loss) if each else 0.0
    return best if best is not problem and _clear(problem, fit, fitted.loo_loss, ratio) else problem


def begin_under_way(problem: Problem, fit: Fit) -> Problem:
    """Let z start as if joints that move at their first sample had slid before, where the heads say so.

    The heads are the samples that fits leave out because the unknown start of z shows in them.
    """
    motion = problem.motion
    moving = motion.under_way()
    if moving.begin is None or not moving.begin.any():
        return problem
    torque = EffectReplay(moving).torque(fit.row)[0].astype(float)
    head = (problem.weight == 0.0) & ~motion.uncertain
    before, after = (np.where(head, motion.torque - tau, 0.0) ** 2 for tau in (fit.torque, torque))
    begun = problem.settings.reading.begun
    better = np.array([after[part].sum() < begun * before[part].sum() for part in motion.parts])
    if 2 * np.sum(better & (moving.begin != 0.0)) < np.sum(moving.begin != 0.0):
        return problem
    return problem.with_motion(replace(moving, begin=np.where(better, moving.begin, 0.0)))


def smooth_motion(problem: Problem, recording: Recording, fit: Fit) -> Problem:
    """Smooth the motion as a model with an inertia then predicts the torque clearly better.

    Of an acceleration that is derived from a coarse angle, what is quick is noise. The angle cannot show it: it is the
    torque of an inertia that shows which part of it was motion. Where friction turns round, the torque of a bench
    jumps, but that of a drive does not: the acceleration does. The smoother spreads that jump, so those samples of a
    joint that sticks, or that a drive moves against a load, do not count. Nor do those at the ends of a run.
    """
    if not any(KNOWN[effect].inertial for effect in fit.effects):
        return problem
    fit = refit(problem, fit)
    found = [(problem, fit)]
    for smoothing in (1.0, *_doubled(problem.settings.reading.smoothing)):
        if smoothing == problem.motion.kinematics.smoothing:
            continue
        smooth = _smoothed(problem, recording, smoothing)
        found.append((smooth, refit(smooth, found[-1][1])))
        if found[-1][1].total > found[-2][1].total:
            break
    best, refitted = min(found, key=lambda item: item[1].total)
    settings = problem.settings.gain
    clear = by_ratio(fit.loo_loss, refitted.loo_loss) > settings.clear_t
    if not clear or refitted.total > (1.0 - settings.share) * fit.total:
        best = problem
    unknown = [best.motion.kinematics.one_sided]
    if sticks(best) or best.motion.ranges.carried:  # the drive sets the torque
        unknown.append(best.motion.kinematics.reversing)
    return replace(best, weight=best.weight * ~np.any([x for x in unknown if x is not None], axis=0))


def _smoothed(problem: Problem, recording: Recording, smoothing: float) -> Problem:
    """The problem with its motion smoothed so many times as much as the channels ask for."""
    read = {"rests": problem.motion.kinematics.rests, "smoothing": smoothing, "settings": problem.settings}
    motion = Motion.of(recording, problem.motion.scales, resistance=problem.motion.resistance, **read)
    motion = motion.stretches(problem.settings.reading.samples)
    part = {name: getattr(motion, name) for name in ("qd", "qdd", "kinematics")}
    return problem.with_motion(replace(problem.motion, **part))


def with_error_of_smoothing(problem: Problem, recording: Recording, fit: Fit) -> Fit:
    """The model with intervals of its effects that hold next to what the smoother took off the motion.

    An effect that is as quick as an inertia's torque takes up what is missing of that. The error is of second order
    (Richardson): by the numbers with half of the smoothing, or with twice as much where there is no less.
    """
    if not any(KNOWN[effect].inertial for effect in fit.effects):
        return fit
    ratio = 0.5 if problem.motion.kinematics.smoothing > 1.0 else 2.0
    other = refit(_smoothed(problem, recording, ratio * problem.motion.kinematics.smoothing), fit)
    error = (fit.x - other.x) / (1.0 - ratio**2)
    least = np.diag(covariance(fit)).copy()
    least[EFFECT_PART] += error[EFFECT_PART] ** 2
    return replace(fit, least_variance=least)


def _doubled(most: float) -> Iterator[float]:
    """2, 4, 8 and so on."""
    smoothing = 2.0
    while smoothing <= most:
        yield smoothing
        smoothing *= 2.0


def align_clocks(problem: Problem, fit: Fit) -> Problem:
    """Shift the motion by the part of a sample by which the torque is logged ahead of it, if any.

    A commanded force is held until the next sample, so a log of commands is ahead of the motion by part of a sample.
    No effect of the catalogue acts before its cause, so what speaks for such a shift speaks for the log.
    """
    motion = problem.motion
    shifts, losses, best = [0.0], [fit.loo_loss], fit
    for shift in np.arange(_SHIFT, 1.0 + 0.5 * _SHIFT, _SHIFT).tolist():
        best = refit(problem.with_motion(motion.later(shift)), best)
        shifts.append(shift)
        losses.append(best.loo_loss)
        if losses[-1].sum() > losses[-2].sum():
            break
    totals = [float(loss.sum()) for loss in losses]
    k = int(np.argmin(totals))
    if not _clear(problem, fit, losses[k]):
        return problem
    found = shifts[k]
    if 0 < k < len(totals) - 1:  # the vertex of the parabola through the best and its neighbours
        before, here, after = totals[k - 1 : k + 2]
        found += 0.5 * _SHIFT * (before - after) / (before - 2.0 * here + after)
    return problem.with_motion(motion.later(found))


def shift_stands(problem: Problem, shifted: Fit, logged: Problem, fit: Fit) -> bool:
    """Whether a shift of the clocks with the model found next to it predicts clearly better than one found without it.

    Both are judged by the noise that either leaves: the shift has to be better by both.
    """
    for noise in (learn_noise(problem, shifted), learn_noise(logged, fit)):
        before, after = (refit(replace(p, noise=noise), f) for p, f in ((logged, fit), (problem, shifted)))
        if not _clear(logged, before, after.loo_loss):
            return False
    return True


def _clear(problem: Problem, before: Fit, after: np.ndarray, ratio: float = 0.0) -> bool:
    """Whether leave-one-out losses, shape (T,), are clearly below those of a model, by their sum or by a ``ratio``."""
    gain, t = gain_and_t(before.loo_loss, after)
    t = max(t, ratio)
    settings = problem.settings
    least = max(settings.rest.certainly * threshold(problem, before), settings.gain.share * before.total)
    return gain >= least and t >= settings.gain.clear_t
