"""From a recording to a fitted baseline with its noise model: what every diagnosis starts from."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.diagnose.features import Group, make_groups
from mrwarp.diagnose.physical_units import factor_of
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.dataset import Motion, rms
from mrwarp.identify.fit import BoucWenStructure
from mrwarp.identify.least_squares import ridge_solve
from mrwarp.identify.noise import Noise, estimate_noise, trajectory_spread
from mrwarp.identify.parameters import LINEAR, LINEAR_PART, SHAPE, Parameters, shape_coordinates
from mrwarp.identify.projection import Point, Progress, search_starts
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
_BEGUN = 0.8
"""Ratio of squared mismatches of a trajectory's head below which it begins under way instead of without stress."""
_MANY = 20
"""Trajectories above which the features take up little of their offsets and factors; below, they take up most."""


@dataclass
class Baseline:
    """A data set with eqs. 14 and 15 fitted to it."""

    engine: Engine
    fitted: Fitted
    groups: list[Group]


def prepare(
    recording: Recording,
    *,
    known: tuple[str, ...] = (),
    model: Model | None = None,
    threads: int = 1,
    seed: int = 0,
    told: Progress = lambda text: None,
) -> Baseline:
    """Fit eqs. 14 and 15, and learn the noise.

    Args:
        recording: Measured runs.
        known: Effects of ``model`` that are part of the baseline.
        model: A model that is known already: one more start, and the values of its effects.
        threads: CPU threads.
        seed: Seed of the samples on which starts are searched.
        told: Told what is being done.
    """
    motion = Motion.of(recording, resistance=_resistance(recording))
    samples = motion
    zero = _zero(recording, model) / samples.scales.q
    structure = BoucWenStructure(samples, zero)
    told("eqs. 14 and 15: starts")
    points = search_starts(structure, Replay(samples), limit=_STARTS_ON, seed=seed)[:2]
    starts = [_coordinates_of(structure, point, motion) for point in points]
    rate = min(float(np.exp(point.theta[1])) for point in points)
    weight = samples.settled(rate)
    engine = Engine(EffectReplay(motion, threads=threads), zero, weight, recording.units)
    told("noise")
    c = engine.coordinates(known, _known_bends(known, model, motion))
    if model is not None:
        starts.append(_start_of(model, structure, motion))
    plain = engine.coordinates(())
    for shape in _SHAPES:  # the search sees few samples: now and then it ends in a corner
        starts.append(np.array([*starts[0][LINEAR_PART], *shape]))
    starts = [plain.grown(x, known) for x in starts]
    for x in starts if model is not None else []:
        _known_values(c, x, model, motion)
    level = float(samples.torque.std()) or 1.0
    engine.noise = Noise(whitening=np.ones(1), sigma=level, rms=level, offset=0.0, gain=0.0)
    fitted = min((engine.fit(c, x, tolerance=1e-4) for x in starts), key=lambda f: float(f.loss.sum()))
    held = hold_rests(engine, recording, fitted, rate)
    if held is not None:
        told("the joint rests now and then")
        samples, fitted = engine.samples, held
    plain_rms = rms(samples.torque - fitted.torque)
    first = fitted
    for _ in range(2):
        groups = groups_of(engine, c, fitted.x)
        engine.noise = learn_noise(engine, fitted.torque, groups)
        fitted = engine.fit(c, fitted.x)
    if rms(samples.torque - fitted.torque) > _SPOILT * plain_rms:
        told("the misfit is larger than any noise: plain least squares")
        engine.misfit, fitted = True, first
        groups = groups_of(engine, c, fitted.x)
        engine.noise = learn_noise(engine, fitted.torque, groups)
        fitted = engine.fit(c, fitted.x)
    return Baseline(engine, fitted, groups)


def hold_rests(engine: Engine, recording: Recording, fitted: Fitted, rate: float) -> Fitted | None:
    """Hold the joint still where it seems to rest, if that fits the torque better.

    A stress that decays in a rest may be a motion below the sensor's noise, then the noise is the better guess.

    Args:
        engine: The data set; its motion is changed if the joint is held.
        recording: Measured runs.
        fitted: The best model so far.
        rate: How fast z forgets along the way [1/inner unit of q].

    Returns:
        The model fitted to the motion with rests; None if the motion stays as it is.
    """
    motion, weight = engine.motion, engine.weight
    held = Motion.of(recording, motion.scales, resistance=motion.resistance, rests=True)
    if not held.kinematics.rests:
        return None
    engine.follow(held)
    engine.weight = held.settled(rate) * ~held.doubtful
    refitted = engine.fit(fitted.coordinates, fitted.x, tolerance=1e-4)
    known = weight * engine.weight
    before, after = (known @ (held.torque - fit.torque) ** 2 for fit in (fitted, refitted))
    if after < before:
        return refitted
    engine.follow(motion)
    engine.weight = weight
    return None


def begin_under_way(engine: Engine, fitted: Fitted) -> bool:
    """Let z start as if joints that move at their first sample had slid before, where the heads say so.

    The heads are the samples that fits leave out because the unknown start of z shows in them.

    Args:
        engine: The data set; its motion is changed.
        fitted: The best model so far.
    """
    moving = engine.motion.under_way()
    if moving.begin is None or not moving.begin.any():
        return False
    torque = EffectReplay(moving).torque(fitted.coordinates.row(fitted.x))[0].astype(float)
    head = (engine.weight == 0.0) & ~engine.motion.doubtful
    before, after = (np.where(head, engine.samples.torque - tau, 0.0) ** 2 for tau in (fitted.torque, torque))
    parts = engine.samples.parts
    better = np.array([after[part].sum() < _BEGUN * before[part].sum() for part in parts])
    if 2 * np.sum(better & (moving.begin != 0.0)) < np.sum(moving.begin != 0.0):
        return False
    engine.follow(dataclasses.replace(moving, begin=np.where(better, moving.begin, 0.0)))
    return True


def _coordinates_of(structure: BoucWenStructure, point: Point, motion: Motion) -> np.ndarray:
    """Vector of a point of the search."""
    linear = dict(zip(structure.linear, point.linear, strict=True))
    alpha = structure.loop(point.theta)["alpha"]
    shape = (np.log1p(alpha * motion.ranges.qd), point.theta[1], point.theta[2])
    return np.array([*(linear[name] for name in LINEAR), *shape])


def _zero(recording: Recording, model: Model | None) -> float:
    """Angle from which q_c counts: the model's, the paper's for a joint in its units, else the encoder's zero."""
    if model is not None:
        return model.values.get("q_offset", 0.0) + model.values.get("q_center", 0.0)
    if recording.units == JOINT_UNITS:
        paper = MrParams().bouc_wen
        return paper.q_offset + paper.q_center
    return 0.0


def _start_of(model: Model, structure: BoucWenStructure, motion: Motion) -> np.ndarray:
    """Vector of a known model without its effects."""
    scales, values = motion.scales, model.values
    inner = {name: values[name] / scales.factor(name) for name in (*LINEAR, *SHAPE)}
    shape = shape_coordinates(*(inner[name] for name in SHAPE), motion.ranges.qd)
    return np.array([*(inner[name] for name in LINEAR), *shape])


def _known_bends(known: tuple[str, ...], model: Model | None, motion: Motion) -> dict[tuple[str, str], float]:
    """Numbers of a known model that bend its laws, inner units."""
    return {
        (e.name, p.name): e.parameters[p.name].value / factor_of(p, motion.scales)
        for e in (model.effects if model else ())
        if e.name in known
        for p in CATALOGUE[e.name].parameters
        if p.form and p.name in e.parameters
    }


def _known_values(c: Parameters, x: np.ndarray, model: Model | None, motion: Motion) -> None:
    """Put the effects of a known model into a vector."""
    effects = {e.name: e.parameters for e in model.effects} if model else {}
    for i, slot in c.items():
        given = effects.get(slot.effect, {}).get(slot.parameter.name)
        if given is None:
            continue
        inner = given.value / factor_of(slot.parameter, motion.scales)
        x[i] = np.log(max(inner, 1e-12)) if slot.logarithmic else inner


def groups_of(engine: Engine, c: Parameters, x: np.ndarray) -> list[Group]:
    """Groups of features along the hysteresis of a model."""
    rows = np.stack([c.row(x)] * 3)
    gains = [LINEAR.index("K0"), LINEAR.index("K1")]
    yielding = rows[0, gains].copy()
    rows[:, LINEAR_PART] = 0.0
    rows[0, gains], rows[1, gains] = yielding, (1.0, 0.0)
    hysteretic, loop, added = engine.replay.torque(rows).astype(float)  # effects may add torque of their own
    return make_groups(engine.motion, loop - added, hysteretic - added)


def learn_noise(engine: Engine, torque: np.ndarray, groups: list[Group]) -> Noise:
    """Noise from what neither the model nor any smooth function of the measured variables explains."""
    s = engine.samples
    mismatch = s.torque - torque
    if engine.misfit:
        level = rms(mismatch)
        return Noise(whitening=np.ones(1), sigma=level, rms=level, offset=0.0, gain=0.0)
    table = np.vstack([np.ones((1, len(torque))), torque[None], *(g.rows for g in groups)]).astype(np.float32)
    table /= np.maximum(np.sqrt(np.mean(table**2, axis=1, keepdims=True)), 1e-9)
    gram, moment = (table @ table.T).astype(float), (table @ mismatch.astype(np.float32)).astype(float)
    rest = mismatch - ridge_solve(gram, moment, 1e-5) @ table
    if len(s.parts) > _MANY:
        offset, gain = trajectory_spread(rest, torque, s, np.empty((len(s.parts), 0)))
    else:
        middle = np.array([[engine.motion.time[p].mean(), engine.motion.heat[2][p].mean()] for p in s.parts])
        trends = (middle - middle.mean(axis=0)) / np.maximum(middle.std(axis=0), 1e-12)
        offset, gain = trajectory_spread(mismatch, torque, s, trends)
    inside = rest.copy()
    for part in s.parts:
        f = np.column_stack([np.ones(part.stop - part.start), torque[part] - torque[part].mean()])
        inside[part] -= f @ np.linalg.lstsq(f, rest[part], rcond=None)[0]
    return estimate_noise(inside, torque, s, offset, gain)


def _resistance(recording: Recording) -> float:
    return MrParams().coil.coil_resistance if recording.units.get("current") == "A" else 0.0
