"""Detectable sizes of a data set, and the experiment that best separates effects which it cannot distinguish.

Each of a few standard experiments is simulated with the named effect and fitted with its rival, and the other way
round, for either may be the truth. The rival also has to go on explaining the data that are there. What it then cannot
imitate, against the noise of this data set, is the separation (T-optimality by enumeration).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.stats import norm

from mrwarp.diagnose.lag_or_delay import DELAY, LAG
from mrwarp.diagnose.problem import Fit, Problem, drifts, threshold
from mrwarp.diagnose.search import Selection
from mrwarp.diagnose.verdict_text import measured, quantity
from mrwarp.effects.law import EffectParameter, Ranges
from mrwarp.effects.replay_kernel import HEAT_TIMES
from mrwarp.identify.dataset import Motion
from mrwarp.identify.kinematics import Kinematics
from mrwarp.identify.normal_equations import losses
from mrwarp.identify.parameters import Parameters, simulate, slots_of
from mrwarp.identify.replay import EffectReplay
from mrwarp.recording.data import NO_INPUT
from mrwarp.sysid.least_squares import Rules, minimise, ridge_solve
from mrwarp.sysid.pieces import Quadratic
from mrwarp.sysid.verdict import NextExperiment

_SLAB = 24
"""Sizes whose signals share one table."""
_RUN = (3.0, 10.0)
"""Shortest and longest run [s]."""
_ROUND = math.tau
"""Widest range of an angle that a swing is a part of [rad]: of a joint that turns on and on, all that depends on the
place comes again after a turn, and wider swings at its speed would take as much longer."""
_LONGEST = 36000.0
"""An experiment that would last longer [s] is not proposed."""
_AWAY = 0.7
"""Where else the logarithm of a number is tried: so far away and twice, to either side."""
_REST = (600.0, 1800.0)
"""Shortest and longest rest [s]."""
_REPEATS = (3, 6, 12)
"""Runs that are repeated after a rest."""
_RULES = Rules(iterations=4, damping=1e-7, gained=lambda gain, loss: gain < 0.02 * (loss + gain))
"""The fit of the wrong model to an experiment."""


class Standard(NamedTuple):
    """A standard experiment. A motion sweeps evenly from one frequency to another, or stays at one."""

    motion: str
    """The motion in words, with its amplitude and frequencies."""
    size: float
    """Amplitude over the range of the angle, or over a turn where that is less [1]."""
    low: float
    """Frequencies at the start and the end of each run [Hz], where the speed of the data allows them."""
    high: float
    current: str
    """steps, staircase, levels or none."""


_SLOWLY, _STEADY = "swings slowly, by ±{a} at {low} Hz", "swings by ±{a} at {low} Hz"
_SWEEP = "swings by ±{a}, faster and faster from {low} to {high} Hz"
STANDARD: dict[str, Standard] = {
    "current steps": Standard(_STEADY, 0.35, 1.0, 1.0, "steps"),
    "current steps, slow swing": Standard(_SLOWLY, 0.35, 0.25, 0.25, "steps"),
    "current staircase": Standard(_STEADY, 0.35, 1.0, 1.0, "staircase"),
    "slow swings": Standard(_SLOWLY, 0.45, 0.25, 0.25, "levels"),
    "wide swings": Standard(_SWEEP, 0.45, 0.3, 3.0, "levels"),
    "wide swings without current": Standard(_SWEEP, 0.45, 0.3, 3.0, "none"),
    "middling swings": Standard(_SWEEP, 0.2, 0.3, 5.0, "levels"),
    "small swings": Standard(_SWEEP, 0.1, 0.3, 6.0, "levels"),
}

_CURRENTS = {
    "steps": "step the {name} at odd moments, every 0.2 to 0.5 s, to and fro between its lowest and its highest third, "
    "up to {top},",
    "staircase": "raise and lower the {name} in eight slow steps up to {top}",
    "levels": "hold the {name} at another level in each run, from 0 to {top},",
    "none": "leave the {name} at 0",
}
"""Programme of the current."""


class _Pair(NamedTuple):
    """Two models of which one is simulated and the other fitted to it."""

    true: Fit
    wrong: Parameters
    starts: list[tuple[np.ndarray, Quadratic]]
    """Numbers from which the wrong one tries to imitate the true one, and its loss on the data about there."""


def propose(problem: Problem, selection: Selection, seed: int) -> NextExperiment | None:
    """The experiment for the first named effect whose rivals can be distinguished; None where nothing is left open."""
    for effect, rivals in selection.alternatives.items():
        if not rivals:
            continue
        names = (effect, *rivals)
        pairs = _pairs(problem, selection, effect, rivals)
        if not pairs:
            continue
        if any(drifts(name) for name in names):
            return _rest_and_repeat(problem, pairs, names)
        if {LAG, DELAY} <= set(names):
            kinds = ["current steps, slow swing"]
        elif problem.motion.current.any():
            kinds = list(STANDARD)
        else:
            kinds = [kind for kind, standard in STANDARD.items() if standard.current == "none"]
        trials = {kind: _trial(problem, STANDARD[kind], np.random.default_rng(seed)) for kind in kinds}
        missed = {kind: _least_missed(problem, trial, pairs) for kind, trial in trials.items()}
        kind = max(missed, key=lambda k: missed[k])
        if {LAG, DELAY} <= set(names) or _seconds(problem, trials[kind], missed[kind]) <= _LONGEST:
            return _described(problem, kind, trials[kind], missed[kind], names)
    return None


def _pairs(problem: Problem, selection: Selection, effect: str, rivals: tuple[str, ...]) -> list[_Pair]:
    """The final model against the model with each rival in the effect's place, both ways."""
    final, found = selection.final, []
    rest = {e for e in final.effects if e != effect}
    for rival in rivals:
        other = selection.fits.get(problem.parameters([*rest, rival]).effects)
        if other is not None:
            found += [
                _Pair(final, other.parameters, _starts(problem, other, rival)),
                _Pair(other, final.parameters, _starts(problem, final, effect)),
            ]
    return found


def _starts(problem: Problem, fit: Fit, effect: str) -> list[tuple[np.ndarray, Quadratic]]:
    """The fit itself, and wherever else one of the effect's own numbers may go without losing much on the data."""
    p, points = fit.parameters, [fit.x]
    for i, slot in p.items():
        if slot.effect == effect and slot.logarithmic:
            for away in (-2.0 * _AWAY, -_AWAY, _AWAY, 2.0 * _AWAY):
                x = fit.x.copy()
                x[i] = np.clip(x[i] + away, p.low[i], p.high[i])
                if abs(x[i] - fit.x[i]) > 0.5 * abs(away):
                    points.append(_held_still(problem, p, x, i))
    found = [Quadratic.of(problem.linearised(p, x)[-1].total) for x in points]
    least = found[0].loss
    found[0] = dataclasses.replace(found[0], descent=np.zeros(p.size))  # the fit is the best
    away = [dataclasses.replace(data, loss=data.loss - least) for data in found]
    return [(x, data) for x, data in zip(points, away, strict=True) if data.loss < problem.settings.gain.chi2]


def _held_still(problem: Problem, p: Parameters, x: np.ndarray, held: int) -> np.ndarray:
    """One step towards the best numbers with one of them held."""
    here = Quadratic.of(problem.linearised(p, x)[-1].total)
    free = [k for k in range(p.size) if k != held]
    step, reach = np.zeros(p.size), p.reach(1.0, np.inf)
    step[free] = ridge_solve(here.normal[np.ix_(free, free)], here.descent[free])
    return np.clip(x + np.clip(step, -reach, reach), p.low, p.high)


def _least_missed(problem: Problem, motion: Motion, pairs: list[_Pair]) -> float:
    """Misfit of a wrong model to its true one in an experiment, in units of the noise's variance."""
    least = []
    for pair in pairs:
        torque = EffectReplay(motion).torque(pair.true.row)[0].astype(float)
        replay = EffectReplay(dataclasses.replace(motion, torque=torque))
        trial = dataclasses.replace(problem, replay=replay, measured=torque, weight=np.ones(len(torque)))
        least += [_least_loss(trial, pair.wrong, start, data) for start, data in pair.starts]
    return min(least, default=0.0)


def _least_loss(trial: Problem, p: Parameters, start: np.ndarray, data: Quadratic) -> float:
    """Least loss of a model on an experiment plus what its numbers then lose on the data."""

    def evaluate(x: np.ndarray) -> Quadratic:
        here, away = Quadratic.of(trial.linearised(p, x)[-1].total), x - start
        descent = here.descent + data.descent - data.normal @ away
        return Quadratic(here.loss + data.after(away), here.normal + data.normal, descent)

    best = minimise(evaluate, start, p.low, p.high, reach=p.reach(1.0, 0.4), rules=_RULES)
    return max(best.quadratic.loss, 0.0)


# --- a motion and a current ---


def _seconds(problem: Problem, trial: Motion, missed: float) -> float:
    """How long an experiment has to last [s]; ``missed`` is what the wrong model misses of the trial."""
    return float(len(trial.q)) * trial.ranges.dt * problem.settings.experiment.chi2 / max(missed, 1e-9)


def _described(problem: Problem, kind: str, trial: Motion, missed: float, names: tuple[str, ...]) -> NextExperiment:
    like, standard, units = problem.motion, STANDARD[kind], problem.units
    wanted, few = problem.settings.experiment, problem.settings.gain.few
    scales, run, seconds = like.scales, _run_seconds(like), _seconds(problem, trial, missed)
    if {LAG, DELAY} <= set(names):
        seconds = wanted.steps * 0.35
    seconds = max(seconds, few * run)
    if seconds > wanted.runs * run:
        run = float(math.ceil(seconds / wanted.runs))
    runs = math.ceil(seconds / run)
    size, low, high = _swing(like, standard)
    top = like.ranges.current * scales.current
    settings = {
        "separation_sigma": math.sqrt(missed / len(trial.q)),
        "range": like.ranges.q * scales.q,
        "amplitude": size * scales.q,
        "frequency_low": low,
        "frequency_high": high,
        "current_max": 0.0 if standard.current == "none" else top,
        "runs": float(runs),
        "run_seconds": run,
        "rate": 1.0 / like.ranges.dt,
    }
    first, last = f"{low:.2g}", f"{high:.2g}"
    form = _STEADY if standard.motion == _SWEEP and first == last else standard.motion
    motion = form.format(a=measured(size * scales.q, units["q"]), low=first, high=last)
    top_text = measured(top, units["current"])
    current = _CURRENTS[standard.current].format(name=quantity("current", units), top=top_text)
    what = f"in {runs} runs of {run:.3g} s, {current} while the joint {motion}"
    if units["current"] == NO_INPUT:
        what = f"record {runs} runs of {run:.3g} s in which the joint {motion}"
    return NextExperiment(what=what, seconds=seconds, separates=names, kind=kind, settings=settings)


def _run_seconds(like: Motion) -> float:
    """Length of a run [s]: as in the data."""
    length = np.diff(like.start) * like.dt
    return round(float(np.clip(np.median(length), *_RUN)), 1)


def _swing(like: Motion, standard: Standard) -> tuple[float, float, float]:
    """Amplitude, normalised units, and first and last frequency [Hz].

    No faster than the data in speed or acceleration: beyond, the errors of the replay's own step and of the smoothed
    motion grow, and would pass for an effect that acts at reversals.
    """
    r = like.ranges
    size = standard.size * (min(r.q, _ROUND * r.radian) if r.radian else r.q)
    by_speed = float(np.abs(like.qd).max()) / size
    by_acceleration = math.sqrt(float(np.percentile(np.abs(like.qdd), 99.5)) / size)
    most = min(by_speed, by_acceleration) / (2.0 * np.pi)
    return size, min(standard.low, most), min(standard.high, most)


def _trial(problem: Problem, standard: Standard, rng: np.random.Generator) -> Motion:
    """Motion and current of some runs within the ranges of a data set; normalised units, without noise."""
    like, count = problem.motion, problem.settings.gain.few  # an effect has to predict runs that took no part
    r, dt = like.ranges, like.ranges.dt
    t = np.arange(round(_run_seconds(like) / dt)) * dt
    size, low, high = _swing(like, standard)
    phase = 2.0 * np.pi * (low * t + 0.5 * (high - low) * t * t / t[-1])
    q, current = size * np.sin(phase), np.zeros((count, len(t)))
    for k in range(count):
        if standard.current == "levels":
            current[k] = r.current * k / (count - 1.0)
        elif standard.current == "staircase":
            current[k] = r.current * np.round(8.0 * (1.0 - np.abs(2.0 * t / t[-1] - 1.0))) / 8.0
        elif standard.current == "steps":
            at, upper = 0, bool(k % 2)
            while at < len(t):
                span = round(rng.uniform(0.2, 0.5) / dt)
                current[k, at : at + span] = r.current * (rng.uniform(0.0, 1.0 / 3.0) + (2.0 / 3.0 if upper else 0.0))
                at, upper = at + span, not upper
    qd = np.gradient(q, dt)
    qd, qdd, time = (np.tile(x, count) for x in (qd, np.gradient(qd, dt), t))
    return _exact(
        like,
        q=np.tile(q, count) + 0.5 * (like.q.max() + like.q.min()),
        qd=qd,
        qdd=qdd,
        current=current.ravel(),
        torque=np.zeros(len(qd)),
        start=np.arange(count + 1) * len(t),
        dt=np.full(count, dt),
        time=time,
        slid_time=time,
        heat=np.zeros((len(HEAT_TIMES), len(time))),
    )


def _exact(like: Motion, temperature: np.ndarray | None = None, **arrays: np.ndarray) -> Motion:
    """A motion without errors of its log, that starts at rest, in place of a recorded one."""
    known = Kinematics(arrays["qd"], arrays["qdd"], velocity_lag=0.0, velocity_lag_error=float("inf"))
    as_made = {"kinematics": known, "temperature": temperature, "begin": None, "middle": None, "ahead": 0.0}
    return dataclasses.replace(like, **arrays, **as_made)


# --- a rest and the first runs again ---


def _rest_and_repeat(problem: Problem, pairs: list[_Pair], names: tuple[str, ...]) -> NextExperiment:
    """A loss by warmth comes back in a rest, a loss by wear does not."""
    like, rest = problem.motion, _rest_for(pairs)
    count = len(like.parts)
    missed, runs = 0.0, min(_REPEATS[0], count)
    for runs in sorted({min(n, count) for n in _REPEATS}):
        motion = repeated(like, rest, runs)
        missed = _least_missed(problem, motion, pairs)
        if missed > problem.settings.experiment.chi2:
            break
    run = float(np.median(np.diff(like.start) * like.dt))
    which = "run" if runs == 1 else f"{runs} runs"
    what = (
        f"let the device rest for {rest / 60.0:.0f} minutes, then repeat the first {which} of this recording, in the "
        "same order, with the clock of the log running on"
    )
    settings = {"rest_seconds": rest, "runs": float(runs), "run_seconds": run, "missed_chi2": missed}
    seconds = rest + runs * run
    return NextExperiment(what=what, seconds=seconds, separates=names, kind="rest and repeat", settings=settings)


def _rest_for(pairs: list[_Pair]) -> float:
    """Five time constants of the warmth, in whole minutes [s]."""
    numbers = [(slot, pair.true.x[i]) for pair in pairs for i, slot in pair.true.parameters.items()]
    longest = max((slot.value(x) for slot, x in numbers if slot.parameter.recovers), default=0.0)
    return 60.0 * round(float(np.clip(5.0 * longest, *_REST)) / 60.0)


def repeated(like: Motion, rest: float, runs: int) -> Motion:
    """The first runs of a data set once more, after a rest."""
    order = np.argsort(like.time[like.start[:-1]], kind="stable")
    parts = [like.parts[k] for k in order[:runs]]
    last = like.parts[order[-1]].stop - 1
    first = float(like.time[parts[0].start])
    taken = np.concatenate([np.arange(part.start, part.stop) for part in parts])
    # the same power drives the same rise; what is stored at first is what the rest has left
    times = np.array(HEAT_TIMES)[:, None]
    stored = like.heat[:, last : last + 1] * np.exp(-rest / times)
    samples = {name: getattr(like, name)[taken] for name in ("q", "qd", "qdd", "current", "torque")}
    return _exact(
        like,
        **samples,
        start=np.concatenate([[0], np.cumsum([part.stop - part.start for part in parts])]),
        dt=like.dt[order[:runs]],
        time=like.time[taken] - first + float(like.time[last]) + rest,
        slid_time=like.slid_time[taken] - float(like.slid_time[taken[0]]) + float(like.slid_time[last]),
        heat=like.heat[:, taken] + stored * np.exp(-(like.time[taken] - first) / times),
        temperature=None if like.temperature is None else like.temperature[taken],
    )


# --- the smallest size of each effect that would have shown ---


def smallest_sizes(
    problem: Problem,
    fit: Fit,
    effects: list[str],
    shows: Callable[[Fit, np.ndarray], np.ndarray] = lambda fit, torques: np.full(len(torques), np.inf),
) -> dict[str, float | None]:
    """For each effect the size of its first number at which its gain would pass the threshold, in normalised units.

    The effect's torque at several sizes is put on top of what was measured, without what the model's own numbers take
    up of it. It has to stand out of the noise in 19 of 20 such additions, and also to show next to what has no name: so
    many times as much as needed, and in so many trajectories that the last gate lets it pass. None for an effect that
    does not at any size in its range.
    """
    models, points = [(fit.parameters, fit.x)], []
    for effect in effects:
        if effect not in fit.effects:
            for size, model in _at_sizes(problem, fit, effect):
                points.append((effect, size))
                models.append(model)
    tau = simulate(problem.replay, models)
    curves: dict[str, list[tuple[float, float]]] = {}
    least = threshold(problem, fit)
    # the gain that is found scatters about the gain that is there, as the square of a normal number of this mean
    need = (np.sqrt(least) + norm.ppf(0.95)) ** 2
    for first in range(0, len(points), _SLAB):
        some = points[first : first + _SLAB]
        rows = tau[1 + first : 1 + first + len(some)] - tau[0]
        equations, odds = problem.equations([fit.slopes, rows], fit.torque), shows(fit, rows)
        for target, (effect, size) in enumerate(some, start=len(fit.slopes)):
            _, inside, _ = losses(equations, fit.free, target)
            gain = min(float(inside.sum()), float(odds[target - len(fit.slopes)]) * least, need / _through_gate(inside))
            curves.setdefault(effect, []).append((size, max(gain, 1e-12)))
    ranges = problem.motion.ranges
    return {effect: _crossing(curve, need, slots_of(effect)[0].parameter, ranges) for effect, curve in curves.items()}


def _through_gate(gains: np.ndarray) -> float:
    """Factor by which an effect's gains in T trajectories, (T,), must grow to pass the last gate in 19 of 20 additions.

    The gate asks that the gain's interval over trajectories is clear of zero. A trajectory's gain scatters by the
    noise, as g + 2*sqrt(g)*e with a normal e, and from one to the next by what the motions show. Infinite where too few
    trajectories show the effect, however large it is.
    """
    total = max(float(gains.sum()), 1e-300)
    wide, normal = norm.ppf(0.975), norm.ppf(0.95)
    between, within, sure = wide**2 * float(((gains - gains.mean()) ** 2).sum()), 4.0 * wide**2 * total, 2.0 * normal
    rises, least = total**2 - between, sure * np.sqrt(total)
    if rises <= 1e-9 * total**2:
        return np.inf
    return float((total * least + np.sqrt((total * least) ** 2 + rises * (within - least**2))) / rises) ** 2


def _at_sizes(problem: Problem, fit: Fit, effect: str) -> list[tuple[float, tuple[Parameters, np.ndarray]]]:
    """Sizes of an effect's first number, and the model with the effect of that size."""
    ranges, slots = problem.motion.ranges, slots_of(effect)
    layout = problem.parameters((*fit.effects, effect), fit.parameters.choices)
    x, own = fit.parameters.grown(fit.x, layout.effects), layout.own(effect)
    for i, slot in zip(own, slots, strict=True):
        if slot.parameter.starts is not None:  # a number that shapes the effect: in the middle of its range
            values = slot.parameter.starts(ranges)
            middle = values[len(values) // 2]
            x[i] = np.log(middle) if slot.logarithmic else middle
    first, found = slots[0].parameter, []
    for value in (first.null + layout.steps[own[0]],) if first.starts is None else first.starts(ranges):
        y = x.copy()
        y[own[0]] = np.log(value) if slots[0].logarithmic else value
        found.append((abs(value - first.null), (layout, y)))
    return found


def _crossing(
    curve: list[tuple[float, float]], need: float, parameter: EffectParameter, ranges: Ranges
) -> float | None:
    """Size at which a curve of gains over sizes passes what is needed; None beyond the parameter's range."""
    values, gains = np.log(np.array(sorted(curve, key=lambda point: point[0]))).T
    target = np.log(need)
    above = np.flatnonzero(gains >= target)
    k = int(above[0]) if len(above) else int(np.argmax(gains))
    # in proportion to the square of the size from the nearest point
    size = float(np.exp(values[k] + 0.5 * (target - gains[k])))
    if k > 0 and len(above):
        slope = (gains[k] - gains[k - 1]) / (values[k] - values[k - 1])
        size = float(np.exp(values[k] + (target - gains[k]) / max(slope, 0.5)))
    limit = max(abs(end(ranges) - parameter.null) for end in (parameter.low, parameter.high))
    return None if np.isfinite(limit) and size > limit or gains.max() < -15.0 else size
