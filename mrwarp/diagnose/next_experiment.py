"""The experiment that best separates effects which a data set cannot tell apart.

Each of a few standard experiments is simulated with the named effect and fitted with its rival, and the other way
round, for either may be the truth. The rival also has to go on explaining the data that are there. What it then cannot
imitate, against the noise of this data set, is the separation (T-optimality by enumeration).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from mrwarp.diagnose.choice import Choice
from mrwarp.diagnose.engine import Engine, Fitted
from mrwarp.diagnose.result import NextExperiment
from mrwarp.diagnose.step_response import DELAY, LAG
from mrwarp.diagnose.verdict_text import measured, quantity
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.effects.replay_kernel import HEAT_TIMES
from mrwarp.identify.dataset import Dataset, Motion
from mrwarp.identify.kinematics import Kinematics
from mrwarp.identify.least_squares import ridge_solve
from mrwarp.identify.parameters import Parameters, jacobian
from mrwarp.identify.replay import EffectReplay

_CHI2 = 100.0
"""What the wrong effect has to miss, in units of the noise's variance: four times what decides, for the experiment's
own noise and for models that err."""
_EDGES = 80
"""Steps of the current that tell a lag from a delay (:mod:`mrwarp.diagnose.step_response`)."""
_RUN = (3.0, 10.0)
"""Shortest and longest run [s]."""
_RUNS = 4
"""Fewest runs, and as many as are simulated: an effect has to foretell runs that it was not fitted to."""
_MANY_RUNS = 24
"""Runs above which they are made longer instead."""
_LONGEST = 36000.0
_AWAY = (-1.4, -0.7, 0.7, 1.4)
"""Where else the logarithm of a number is tried."""
_FAR = 30.0
"""Loss on the data at which a model is no rival any more, in units of the noise's variance."""
_REST = (600.0, 1800.0)
"""Shortest and longest rest [s]."""
_REPEATS = (3, 6, 12)
"""Runs that are repeated after a rest."""
_DRIFTS = frozenset(name for name, law in CATALOGUE.items() if "time" in law.depends_on)


@dataclass(frozen=True)
class _Standard:
    """A standard experiment. A motion sweeps evenly from one frequency to another, or stays at one."""

    motion: str
    """The motion in words, with its amplitude and frequencies."""
    size: float
    """Amplitude over the range of the angle [1]."""
    low: float
    """Frequencies at the start and the end of each run [Hz], where the speed of the data allows them."""
    high: float
    current: str
    """steps, staircase, levels or none."""


_SLOWLY, _STEADY = "swings slowly, by ±{a} at {low} Hz", "swings by ±{a} at {low} Hz"
_SWEEP = "swings by ±{a}, faster and faster from {low} to {high} Hz"
_STANDARD: dict[str, _Standard] = {
    "current steps": _Standard(_STEADY, 0.35, 1.0, 1.0, "steps"),
    "current steps, slow swing": _Standard(_SLOWLY, 0.35, 0.25, 0.25, "steps"),
    "current staircase": _Standard(_STEADY, 0.35, 1.0, 1.0, "staircase"),
    "slow swings": _Standard(_SLOWLY, 0.45, 0.25, 0.25, "levels"),
    "wide swings": _Standard(_SWEEP, 0.45, 0.3, 3.0, "levels"),
    "wide swings without current": _Standard(_SWEEP, 0.45, 0.3, 3.0, "none"),
    "middling swings": _Standard(_SWEEP, 0.2, 0.3, 5.0, "levels"),
    "small swings": _Standard(_SWEEP, 0.1, 0.3, 6.0, "levels"),
}

_CURRENTS = {
    "steps": "step the {name} at odd moments, 0.2 to 0.5 s apart, to and fro between its lowest and its highest third, "
    "up to {top},",
    "staircase": "raise and lower the {name} in eight slow steps up to {top}",
    "levels": "hold the {name} at another level in each run, from 0 to {top},",
    "none": "leave the {name} at 0",
}
"""What is done with the current."""


@dataclass(frozen=True)
class _Start:
    """Numbers from which the wrong model tries to imitate the true one, and what the data say about them."""

    x: np.ndarray
    normal: np.ndarray
    """Second derivatives of half its loss on the data, shape (P, P)."""
    moment: np.ndarray
    """Half its negative slope, shape (P,)."""
    loss: float
    """What it loses on the data here, against its best."""


@dataclass(frozen=True)
class _Pair:
    """Two models of which one is simulated and the other fitted to it."""

    true: Fitted
    wrong: Parameters
    starts: list[_Start]


def propose(engine: Engine, choice: Choice, seed: int) -> NextExperiment | None:
    """The experiment for the first named effect that has rivals; None where nothing is left open."""
    for effect, rivals in choice.alternatives.items():
        if not rivals:
            continue
        names = (effect, *rivals)
        pairs = _pairs(engine, choice, effect, rivals)
        if _DRIFTS & set(names):
            return _rest_and_repeat(engine, pairs, names)
        if {LAG, DELAY} <= set(names):
            kinds = ["current steps, slow swing"]
        elif engine.samples.current.any():
            kinds = list(_STANDARD)
        else:
            kinds = [kind for kind, standard in _STANDARD.items() if standard.current == "none"]
        trials = {kind: _trial(engine, kind, np.random.default_rng(seed)) for kind in kinds}
        missed = {kind: min((_missed(engine, t, p) for p in pairs), default=0.0) for kind, t in trials.items()}
        kind = max(missed, key=lambda k: missed[k])
        return _described(engine, kind, trials[kind], missed[kind], names)
    return None


def _pairs(engine: Engine, choice: Choice, effect: str, rivals: tuple[str, ...]) -> list[_Pair]:
    """The final model against the same with each rival in the effect's place, both ways."""
    rest = {e for e in choice.final.effects if e != effect}
    found = []
    for rival in rivals:
        other = choice.fits.get(tuple(name for name in CATALOGUE if name in {*rest, rival}))
        if other is not None:
            found += [
                _Pair(choice.final, other.coordinates, _starts(engine, other, rival)),
                _Pair(other, choice.final.coordinates, _starts(engine, choice.final, effect)),
            ]
    return found


def _starts(engine: Engine, fit: Fitted, effect: str) -> list[_Start]:
    """The fit itself, and wherever else one of the effect's own numbers may go without losing much on the data."""
    c, points = fit.coordinates, [fit.x]
    for i, slot in c.items():
        if slot.effect == effect and slot.logarithmic:
            for away in _AWAY:
                x = fit.x.copy()
                x[i] = np.clip(x[i] + away, c.low[i], c.high[i])
                if abs(x[i] - fit.x[i]) > 0.5 * abs(away):
                    points.append(_beside(engine, c, x, i))
    found = []
    for x in points:
        torque, slopes = jacobian(engine.replay, c, x)
        total = engine.grams(np.vstack([slopes, engine.samples.torque - torque]), torque).total
        found.append(_Start(x, total[:-1, :-1], total[:-1, -1], float(total[-1, -1])))
    least = found[0].loss
    return [
        dataclasses.replace(s, loss=s.loss - least, moment=s.moment if k else 0.0 * s.moment)
        for k, s in enumerate(found)
        if s.loss - least < _FAR
    ]


def _beside(engine: Engine, c: Parameters, x: np.ndarray, held: int) -> np.ndarray:
    """One step towards the best numbers with one of them held."""
    torque, slopes = jacobian(engine.replay, c, x)
    total = engine.grams(np.vstack([slopes, engine.samples.torque - torque]), torque).total
    free = [k for k in range(c.size) if k != held]
    step = np.zeros(c.size)
    step[free] = ridge_solve(total[np.ix_(free, free)], total[free, -1])
    reach = c.reach(1.0, np.inf)
    step = np.clip(step, -reach, reach)
    return np.clip(x + step, c.low, c.high)


def _missed(engine: Engine, motion: Motion, pair: _Pair) -> float:
    """What the wrong model cannot imitate of the true one in an experiment, in units of the noise's variance."""
    torque = EffectReplay(motion).torque(pair.true.coordinates.row(pair.true.x)[None])[0].astype(float)
    motion = dataclasses.replace(motion, torque=torque)
    trial = Engine(EffectReplay(motion), engine.q_zero, np.ones(len(torque)), engine.units)
    trial.noise = engine.noise_model
    return min(_least(trial, pair.wrong, start) for start in pair.starts)


def _least(trial: Engine, c: Parameters, start: _Start, steps: int = 5) -> float:
    """Least loss of a model on an experiment plus what its numbers then lose on the data."""
    x, best, damping = start.x, np.inf, 1e-6
    trying, normal, moment = x, start.normal, start.moment
    for _ in range(steps):
        torque, slopes = jacobian(trial.replay, c, trying)
        total = trial.grams(np.vstack([slopes, trial.samples.torque - torque]), torque).total
        away = trying - start.x
        loss = float(total[-1, -1]) + start.loss + float(away @ (start.normal @ away - 2.0 * start.moment))
        if loss < best:
            settled = loss > 0.98 * best
            x, best, damping = trying, loss, max(damping / 10.0, 1e-9)
            normal = total[:-1, :-1] + start.normal
            moment = total[:-1, -1] + start.moment - start.normal @ away
            if settled:
                break
        else:
            damping = max(30.0 * damping, 1e-3)
        step = ridge_solve(normal + damping * np.diag(np.diag(normal)), moment)
        reach = c.reach(1.0, 0.4)
        trying = np.clip(x + np.clip(step, -reach, reach), c.low, c.high)
    return max(best, 0.0)


# --- a motion and a current ---


def _described(engine: Engine, kind: str, trial: Motion, missed: float, names: tuple[str, ...]) -> NextExperiment:
    scales, standard = engine.samples.scales, _STANDARD[kind]
    run = _run_seconds(engine.motion)
    simulated = float(len(trial.q)) * engine.motion.ranges.dt
    seconds = simulated * _CHI2 / max(missed, 1e-9)
    if {LAG, DELAY} <= set(names):
        seconds = _EDGES * 0.35
    seconds = min(max(seconds, _RUNS * run), _LONGEST)
    if seconds > _MANY_RUNS * run:
        run = float(math.ceil(seconds / _MANY_RUNS))
    runs = math.ceil(seconds / run)
    size, low, high = _swing(engine.motion, standard)
    top = engine.motion.ranges.current * scales.current
    settings = {
        "separation_sigma": math.sqrt(missed / len(trial.q)), "range": engine.motion.ranges.q * scales.q,
        "amplitude": size * scales.q, "frequency_low": low, "frequency_high": high,
        "current_max": 0.0 if standard.current == "none" else top, "runs": float(runs), "run_seconds": run,
        "rate": 1.0 / engine.motion.ranges.dt,
    }  # fmt: skip
    unit = engine.units.get("current", "A")
    motion = standard.motion.format(a=measured(size * scales.q, engine.units.get("q", "rad")), low=f"{low:.2g}",
                                    high=f"{high:.2g}")  # fmt: skip
    current = _CURRENTS[standard.current].format(name=quantity(unit), top=measured(top, unit))
    return NextExperiment(
        what=f"in {runs} runs of {run:.3g} s, {current} while the joint {motion}",
        seconds=seconds, separates=names, kind=kind, settings=settings,
    )  # fmt: skip


def _run_seconds(like: Motion) -> float:
    """Length of a run [s]: as in the data."""
    length = np.diff(like.start) * like.dt
    return round(float(np.clip(np.median(length), *_RUN)), 1)


def _swing(like: Motion, standard: _Standard) -> tuple[float, float, float]:
    """Amplitude, inner units, and first and last frequency [Hz].

    No faster than the data in speed or acceleration: beyond, the errors of the replay's own step and of the smoothed
    motion grow, and would be told for an effect that acts at reversals.
    """
    size = standard.size * like.ranges.q
    by_speed = float(np.abs(like.qd).max()) / size
    by_acceleration = math.sqrt(float(np.percentile(np.abs(like.qdd), 99.5)) / size)
    most = min(by_speed, by_acceleration) / (2.0 * np.pi)
    return size, min(standard.low, most), min(standard.high, most)


def _trial(engine: Engine, kind: str, rng: np.random.Generator) -> Motion:
    """Motion and current of some runs within the ranges of a data set; inner units, without noise."""
    like, standard = engine.motion, _STANDARD[kind]
    r, dt = like.ranges, like.ranges.dt
    t = np.arange(round(_run_seconds(like) / dt)) * dt
    size, low, high = _swing(like, standard)
    phase = 2.0 * np.pi * (low * t + 0.5 * (high - low) * t * t / t[-1])
    q, current = size * np.sin(phase), np.zeros((_RUNS, len(t)))
    for k in range(_RUNS):
        if standard.current == "levels":
            current[k] = r.current * k / (_RUNS - 1.0)
        elif standard.current == "staircase":
            current[k] = r.current * np.round(8.0 * (1.0 - np.abs(2.0 * t / t[-1] - 1.0))) / 8.0
        elif standard.current == "steps":
            at, upper = 0, bool(k % 2)
            while at < len(t):
                span = round(rng.uniform(0.2, 0.5) / dt)
                current[k, at : at + span] = r.current * (rng.uniform(0.0, 1.0 / 3.0) + (2.0 / 3.0 if upper else 0.0))
                at, upper = at + span, not upper
    qd = np.gradient(q, dt)
    qdd = np.tile(np.gradient(qd, dt), _RUNS)
    middle = 0.5 * (like.q.max() + like.q.min())
    q, qd = np.tile(q, _RUNS) + middle, np.tile(qd, _RUNS)
    samples = Dataset(
        q=q, qd=qd, current=current.ravel(), torque=np.zeros(len(q)), start=np.arange(_RUNS + 1) * len(t),
        dt=np.full(_RUNS, dt), scales=like.scales,
    )  # fmt: skip
    time = np.tile(t, _RUNS)
    return _moved(like, samples, qdd, time, time, np.zeros((len(HEAT_TIMES), len(time))))


def _moved(
    like: Motion, samples: Dataset, qdd: np.ndarray, time: np.ndarray, slid_time: np.ndarray, heat: np.ndarray
) -> Motion:
    kinematics = Kinematics(qd=samples.qd, qdd=qdd, velocity_lag=0.0, velocity_lag_error=float("inf"))
    return Motion(
        **vars(samples), qdd=qdd, time=time, slid_time=slid_time, heat=heat, ranges=like.ranges, kinematics=kinematics,
        resistance=like.resistance,
    )  # fmt: skip


# --- a rest and the first runs again ---


def _rest_and_repeat(engine: Engine, pairs: list[_Pair], names: tuple[str, ...]) -> NextExperiment:
    """What is lost by warmth comes back in a rest, what is lost by wear does not."""
    rest = _rest_for(pairs)
    count = len(engine.samples.parts)
    missed, runs = 0.0, min(_REPEATS[0], count)
    for runs in sorted({min(n, count) for n in _REPEATS}):
        motion = _repeated(engine.motion, rest, runs)
        missed = min((_missed(engine, motion, p) for p in pairs), default=0.0)
        if missed > _CHI2:
            break
    run = float(np.median(np.diff(engine.samples.start) * engine.samples.dt))
    which = "run" if runs == 1 else f"{runs} runs"
    what = (
        f"let the device rest for {rest / 60.0:.0f} minutes, then repeat the first {which} of this recording, in the "
        "same order, with the clock of the log running on"
    )
    return NextExperiment(
        what=what, seconds=rest + runs * run, separates=names, kind="rest and repeat",
        settings={"rest_seconds": rest, "runs": float(runs), "run_seconds": run, "missed_chi2": missed},
    )  # fmt: skip


def _rest_for(pairs: list[_Pair]) -> float:
    """Five time constants of the warmth, in whole minutes [s]."""
    longest = 0.0
    for pair in pairs:
        values = pair.true.coordinates.values(pair.true.x).get("temperature_drift", {})
        longest = max(longest, values.get("time_constant", 0.0))
    return 60.0 * round(float(np.clip(5.0 * longest, *_REST)) / 60.0)


def _repeated(like: Motion, rest: float, runs: int) -> Motion:
    """The first runs of a data set once more, after a rest."""
    s = like
    order = np.argsort([like.time[part.start] for part in s.parts], kind="stable")
    last = s.parts[order[-1]].stop - 1
    first = float(like.time[s.parts[order[0]].start])
    taken = np.concatenate([np.arange(s.parts[k].start, s.parts[k].stop) for k in order[:runs]])
    time = like.time[taken] - first + float(like.time[last]) + rest
    start = np.concatenate([[0], np.cumsum([s.parts[k].stop - s.parts[k].start for k in order[:runs]])])
    # the same power drives the same rise; what is stored at first is what the rest has left
    times = np.array(HEAT_TIMES)[:, None]
    stored = like.heat[:, last : last + 1] * np.exp(-rest / times)
    heat = like.heat[:, taken] + stored * np.exp(-(like.time[taken] - first) / times)
    slid = like.slid_time[taken] - float(like.slid_time[taken[0]]) + float(like.slid_time[last])
    samples = Dataset(
        q=s.q[taken], qd=s.qd[taken], current=s.current[taken], torque=s.torque[taken], start=start,
        dt=s.dt[order[:runs]], scales=s.scales,
    )  # fmt: skip
    return _moved(like, samples, like.qdd[taken], time, slid, heat)
