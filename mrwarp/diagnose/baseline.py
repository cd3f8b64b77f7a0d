"""From a recording to a problem: eqs. 14 and 15 fitted to it, and the noise learned from what they leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mrwarp.diagnose.preprocess import hold_rests
from mrwarp.diagnose.problem import Fit, Problem, base_vector, factor_of, fit_model, normalised, refit
from mrwarp.diagnose.residual_structure import groups_along
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.effects.law import EffectParameter
from mrwarp.identify.dataset import Motion, Scales, rms
from mrwarp.identify.fit import BoucWenStructure
from mrwarp.identify.least_squares import ridge_solve
from mrwarp.identify.noise import Noise, estimate_noise, trajectory_spread
from mrwarp.identify.parameters import LINEAR_PART, Slot
from mrwarp.identify.projection import Progress, search_starts
from mrwarp.identify.replay import EffectReplay, Replay
from mrwarp.model_file import JOINT_UNITS, Model
from mrwarp.params import MrParams
from mrwarp.recording.load import Recording

_STARTS_ON = 8000
"""Samples on which the starts of the baseline are searched."""
_SHAPES = ((0.5, 1.0, 1.0), (1.5, 1.5, 1.5), (1.5, 2.5, 2.5))
"""More starts: coordinates of alpha, beta, gamma with a hysteresis that yields within 1/3 to 1/12 of the scale."""
_SPOILT = 1.3
"""Ratio of the mismatch with the learned noise to that of least squares above which the noise is no noise."""
_MANY = 20
"""Trajectories above which the features take up little of their offsets and factors; below, they take up most."""


def fit_baseline(
    recording: Recording,
    *,
    model: Model | None = None,
    threads: int = 1,
    seed: int = 0,
    log: Progress = lambda text: None,
) -> tuple[Problem, Fit]:
    """Fit eqs. 14 and 15, and learn the noise.

    Args:
        recording: Measured runs.
        model: A model that is known already: one more start, and effects that are part of the baseline.
        threads: CPU threads.
        seed: Seed of the samples on which starts are searched.
        log: Takes a line on what is being done.
    """
    resistance = MrParams().coil.coil_resistance if recording.units.get("current") == "A" else 0.0
    motion = Motion.of(recording, resistance=resistance)
    scales = motion.scales
    q_zero = nominal_zero(recording, model) / scales.q
    log("eqs. 14 and 15: starts")
    structure = BoucWenStructure(motion, q_zero)
    points = search_starts(structure, Replay(motion), limit=_STARTS_ON, seed=seed)[:2]
    bases = [np.array([*point.linear, *point.theta]) for point in points]
    if model is not None:
        bases.append(base_vector(normalised(model.values, scales), motion.ranges.qd))
    # the search sees few samples: now and then it ends in a corner
    bases += [np.array([*bases[0][LINEAR_PART], *shape]) for shape in _SHAPES]
    log("noise")
    level = float(motion.torque.std()) or 1.0
    rate = min(float(np.exp(point.theta[1])) for point in points)
    problem = Problem(
        replay=EffectReplay(motion, threads=threads),
        measured=motion.torque,
        weight=motion.settled(rate),
        q_zero=q_zero,
        units=recording.units,
        noise=_white(level),
    )
    known = _known_numbers(model, scales)
    bends = {(effect, p.name): value for (effect, p), value in known.items() if p.form}
    layout = problem.parameters(known_effects(model), bends)
    numbers = {
        (effect, p.name): float(np.log(max(value, 1e-12))) if Slot(effect, p).logarithmic else value
        for (effect, p), value in known.items()
    }
    fits = (fit_model(problem, layout, layout.vector(x, numbers), tolerance=1e-4) for x in bases)
    plain = min(fits, key=lambda f: float(f.loss.sum()))
    at_first = problem
    problem, plain = hold_rests(problem, recording, plain, rate)
    if problem is not at_first:
        log("the joint rests now and then")
    fit = plain
    for _ in range(2):
        problem, fit = with_learned_noise(problem, fit)
    if rms(motion.torque - fit.torque) > _SPOILT * rms(motion.torque - plain.torque):
        log("the misfit is larger than any noise: plain least squares")
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
    if len(s.parts) > _MANY:
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
    """Effects of a known model that belong to the baseline."""
    return [e.name for e in model.effects if e.name in CATALOGUE] if model else []


def _known_numbers(model: Model | None, scales: Scales) -> dict[tuple[str, EffectParameter], float]:
    """Inner values of the numbers of a known model's effects."""
    return {
        (effect.name, p): effect.parameters[p.name].value / factor_of(p, scales)
        for effect in (model.effects if model else ())
        if effect.name in CATALOGUE
        for p in CATALOGUE[effect.name].parameters
        if p.name in effect.parameters
    }


def _white(level: float) -> Noise:
    """Noise without memory, and without offsets and factors of trajectories."""
    return Noise(whitening=np.ones(1), sigma=level, rms=level, offset=0.0, gain=0.0)
