"""Rest of a model: smooth functions of what was measured, and narrow lines in the spectrum of the mismatch.

A missing law of any form shows in groups of smooth functions, which also say along which variables it
lies. A line (pickup, a resonance, a pump) is what no function of the motion explains.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter
from scipy.stats import binom

from mrwarp.diagnose.problem import Fit, Problem
from mrwarp.identify.dataset import Dataset, Motion, of_commonest_rate
from mrwarp.identify.normal_equations import losses
from mrwarp.identify.parameters import LINEAR, LINEAR_PART
from mrwarp.sysid.certainty import gain_and_t

LAG = "lag"
"""Form of the functions that are the torque behind lags."""
_FINE = 14
"""Highest number of periods that the fine structure resolves over the range of the angle, or in each of its turns."""
_BINS = 24
"""Half of the bins over which the background of a line is taken."""


@dataclass(frozen=True)
class Group:
    """Functions that are tested together."""

    variables: tuple[str, ...]
    """Variables they depend on, by the names of ``result.json``."""
    form: str
    rows: np.ndarray
    """Shape (k, N)."""
    slow: bool = False
    """Whether they vary mainly between trajectories."""

    @property
    def key(self) -> tuple[tuple[str, ...], str]:
        """Variables and form: the group's name."""
        return self.variables, self.form


@dataclass(frozen=True)
class Leftover:
    """Structure that a model leaves: one group of functions and what it would gain on trajectories left out."""

    group: Group
    gain: float
    t: float
    """Gain over its standard error over trajectories."""


@dataclass(frozen=True, kw_only=True)
class Line:
    """A line in the spectrum."""

    frequency: float
    """[Hz]"""
    gain: float
    """Gain of taking it out, in units of the noise's variance."""


def leftovers(problem: Problem, fit: Fit) -> list[Leftover]:
    """Gain of each group of functions on top of a model, best first."""
    groups = groups_along(problem, fit)
    rows = [fit.slopes, *(g.rows for g in groups), (problem.motion.torque - fit.torque)[None]]
    equations = problem.equations(rows, fit.torque, derivatives=True)
    target = sum(len(r) for r in rows) - 1
    _, _, plain = losses(equations, fit.free, target, ridge=1e-7)
    at, found = len(fit.slopes), []
    for group in groups:
        use = [*fit.free, *range(at, at + len(group.rows))]
        _, _, outside = losses(equations, use, target, ridge=1e-7)
        found.append(Leftover(group, *gain_and_t(plain, outside)))
        at += len(group.rows)
    return sorted(found, key=lambda f: -f.gain)


def drift_of_zero(motion: Motion, error: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A straight line in time through what a model misses of each trajectory.

    Args:
        motion: T trajectories.
        error: Measured minus predicted torque, shape (N,).
        weight: Of each sample, shape (N,); samples of weight 0 do not count.

    Returns:
        Change of the error from a trajectory's begin to its end, and the share of the error's variance that the line
        takes, both of shape (T,); 0 where nothing counts.
    """
    found = np.zeros((2, len(motion.parts)))
    for k, part in enumerate(motion.parts):
        counts = weight[part] > 0.0
        if counts.any() and (power := error[part][counts].var()):
            time = motion.time[part]
            slope, _ = np.polyfit(time[counts], error[part][counts], 1)
            found[:, k] = slope * np.ptp(time), slope**2 * time[counts].var() / power
    return found[0], found[1]


def groups_along(problem: Problem, fit: Fit) -> list[Group]:
    """Groups of functions along the hysteresis of a model."""
    rows = np.stack([fit.row] * 3)
    gains = [LINEAR.index("K0"), LINEAR.index("K1")]
    yielding = rows[0, gains].copy()
    rows[:, LINEAR_PART] = 0.0
    rows[0, gains], rows[1, gains] = yielding, (1.0, 0.0)
    hysteretic, loop, added = problem.replay.torque(rows).astype(float)  # effects may add torque of their own
    return make_groups(problem.motion, loop - added, hysteretic - added, problem.settings.gain.share)


def make_groups(motion: Motion, loop: np.ndarray, hysteretic: np.ndarray, unchanging: float) -> list[Group]:
    """The groups of a data set.

    ``loop`` is the hysteretic torque per unit of yield gain without current, z/(1 + alpha*|qd|), ``hysteretic`` all of
    it; both of shape (N,). ``unchanging`` is the share of its largest value by which a control input may change that is
    no variable.
    """
    m, r = motion, motion.ranges
    q = 2.0 * (m.q - 0.5 * (m.q.max() + m.q.min())) / r.q
    v = np.clip(m.qd / (1.5 * r.qd), -1.5, 1.5)
    a = np.abs(v)
    current = m.current / r.current
    h = loop / _size(loop)
    hi = h * current
    tau = hysteretic / _size(hysteretic)
    qdd = np.clip(m.qdd / _size(m.qdd), -3.0, 3.0)
    time = m.time / r.session
    sign = np.tanh(m.qd / (0.02 * r.qd))
    quick = current - _low_pass(current, m, 0.02)
    heat, heat_slow = (m.heat[k] / max(float(m.heat[k].max()), 1e-12) for k in (2, 4))
    q_powers, current_powers = ({k: _chebyshev(x, k) for k in range(1, 6)} for x in (q, 2 * current - 1))
    turning = r.turns >= 1.0  # then what depends on the angle comes again with every turn
    phase = m.q / r.radian if turning else np.pi * (q + 1.0)
    fine = [f(k * phase) for k in range(1 if turning else 3, _FINE + 1) for f in (np.sin, np.cos)]
    along = fine[:4] if turning else list(q_powers.values())
    slow_v = [
        f(m.qd / (w * r.qd)) for w in (0.03, 0.1, 0.25) for f in (lambda x: x / (1 + x**2), lambda x: 1 / (1 + x**2))
    ]
    creep = [_low_pass(x, m, w) for w in (0.1, 0.4, 1.5, 5.0) for x in (h, hi)]
    q_current = [f * current_powers[j] for f in along for j in (1, 2)]
    q_current += [f * current for f in (along if turning else along[1:])]
    functions: list[tuple[tuple[str, ...], str, list[np.ndarray]]] = [
        (("q",), "smooth", [q_powers[k] for k in range(2, 6)]),
        (("q",), "periodic", fine),
        (("qd",), "smooth", [a, v**2, v * a, v**3, a**3]),
        (("qd",), "slow", [sign, np.abs(sign), *slow_v]),
        (("qdd",), "smooth", [qdd, qdd * np.abs(qdd)]),
        (("current",), "smooth", [current_powers[k] for k in (2, 3, 4)]),
        (("current", "memory"), "quick", [quick, quick * h, quick * v, quick * sign]),
        (("current", "memory"), "loop", [h * current_powers[k] for k in (2, 3, 4)]),
        (("memory",), "loop shape", [h * np.abs(h), h**2, h**3, hi * np.abs(h), hi * h, hi * h * h]),
        (("memory",), "creep", creep),
        (("memory",), LAG, [tau - _low_pass(tau, m, w) for w in (0.005, 0.015)]),
        (("q", "qd"), "product", [f * g for f in along[: 4 if turning else 3] for g in (v, a, v * a)]),
        (("q", "current"), "product", q_current),
        (("qd", "current"), "product", [f * g for f in (v, a, v * a, sign) for g in (current, current**2)]),
        (("qd", "memory"), "loop", [f * g for f in (h, hi) for g in (a, v**2, v, sign)]),
        (("q", "memory"), "loop", [f * g for f in along[:4] for g in (h, hi)]),
        (("time",), "drift", [time * h, time * hi, time * v, time * sign, time**2 * hi]),
        (("time",), "warming", [w * f for w in (heat, heat_slow) for f in (h, hi, v)]),
    ]
    if np.ptp(m.current) <= unchanging * np.abs(m.current).max():  # a constant factor is no variable
        named = [(tuple(v for v in variables if v != "current"), form, x) for variables, form, x in functions]
        functions = [row for row in named if row[0]]
    found = [
        Group(variables, form, np.stack(columns), variables == ("time",)) for variables, form, columns in functions
    ]
    return [dataclasses.replace(group, rows=group.rows[group.rows.std(axis=1) > 1e-9]) for group in found]


def _size(x: np.ndarray) -> float:
    """Size of a signal but for its rarest values."""
    return max(float(np.percentile(np.abs(x), 98)), 1e-12)


def _chebyshev(x: np.ndarray, degree: int) -> np.ndarray:
    return np.polynomial.chebyshev.chebval(np.clip(x, -1.0, 1.0), [0.0] * degree + [1.0])


def _low_pass(x: np.ndarray, samples: Dataset, time_constant: float) -> np.ndarray:
    """First-order low-pass of each trajectory that starts settled."""
    out = np.empty_like(x)
    for part, dt in zip(samples.parts, samples.dt, strict=True):
        keep = np.exp(-dt / time_constant)
        out[part], _ = lfilter([1.0 - keep], [1.0, -keep], x[part], zi=[keep * x[part.start]])
    return out


# --- lines ---


def find_line(problem: Problem, fit: Fit) -> Line | None:
    """Strongest line in a model's mismatch that stands out in at least half of the trajectories, or None.

    What follows the angle, the velocity or the torque within a trajectory is no line; where most trajectories turn one
    way at a steady speed, what repeats along the angle repeats in time, and the two cannot be distinguished.
    Trajectories of the commonest rate are looked at. Each one's periodogram is divided by its local background; at a
    frequency without a line the median over trajectories follows from the exponential law, for any number of them.
    """
    s, torque = problem.motion, fit.torque
    if np.mean([abs(s.qd[part].mean()) > s.qd[part].std() for part in s.parts]) >= 0.5:
        return None
    white = problem.noise.white(np.stack([s.torque - torque, np.ones(len(torque)), torque, s.q, s.qd]))
    common = of_commonest_rate(s.dt, s.start)
    length, dt = int(np.median(np.diff(s.start)[common])), float(np.median(s.dt[common]))
    powers = []
    for part, same in zip(s.parts, common, strict=True):
        if not same or part.stop - part.start < length * 0.9:
            continue
        x, *own = white[:, part][:, 8:length]
        basis = np.linalg.qr(np.stack(own).T)[0]
        x = x - basis @ (basis.T @ x)
        power = np.abs(np.fft.rfft(x, length)) ** 2 / len(x)
        powers.append(power / np.maximum(_local_median(power) / np.log(2.0), 1e-12))
    if len(powers) < problem.settings.gain.few:
        return None
    powers = np.array(powers)
    frequency = np.fft.rfftfreq(length, dt)
    inner = slice(problem.settings.rest.line_periods, len(frequency) - 4)
    half = (len(powers) + 1) // 2
    ordered = np.sort(powers, axis=0)[-half]
    chance = binom.sf(half - 1, len(powers), np.exp(-ordered)) * len(frequency)
    best = int(np.argmin(chance[inner])) + inner.start
    if chance[best] > problem.settings.rest.line_chance:
        return None
    gain = float(np.sum(np.maximum(2.0 * powers[:, best] - 2.0, 0.0)))
    return Line(frequency=float(frequency[best]), gain=gain)


def without_line(problem: Problem, fit: Fit, line: Line) -> Problem:
    """The problem with a line, found next to a model, taken out with its own phase and size in each trajectory."""
    motion = problem.motion
    torque = motion.torque.copy()
    for part, dt in zip(motion.parts, motion.dt, strict=True):
        phase = 2.0 * np.pi * dt * np.arange(part.stop - part.start)
        mismatch = torque[part] - fit.torque[part]
        least, taken = np.inf, np.zeros(len(phase))
        for f in line.frequency + np.linspace(-0.5, 0.5, 21) / max(dt * len(phase), 1e-9):
            table = np.column_stack([np.sin(f * phase), np.cos(f * phase), np.ones(len(phase))])
            solution = np.linalg.lstsq(table, mismatch, rcond=None)[0]
            rest = float(((mismatch - table @ solution) ** 2).sum())
            if rest < least:
                least, taken = rest, table[:, :2] @ solution[:2]
        torque[part] -= taken
    return problem.with_motion(dataclasses.replace(motion, torque=torque))


def _local_median(power: np.ndarray) -> np.ndarray:
    """Median over neighbouring bins."""
    padded = np.pad(power, _BINS, mode="reflect" if len(power) > _BINS else "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * _BINS + 1)
    return np.median(windows, axis=1)
