"""Sessions on the bench: current steps, sines at constant current and gait-like motion, in random order with rests.

Or triangles alone, at whose corners a joint turns round within a sample.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import gaussian_filter1d

from benchmarks.confusion.current import Current
from benchmarks.confusion.path import Path, Turns

TRUTH_RATE = 2000.0
"""Lowest rate of the truth [1/s]; it is a multiple of the logging rate."""

SIZES: dict[str, tuple[tuple[int, int, int], float]] = {"large": ((8, 16, 8), 8.0), "small": ((3, 6, 3), 4.0)}
"""Trajectories with current steps, sines and gait, and the seconds of each, by the name of the size."""

AMPLITUDES = (0.1, 0.25, 0.4, 0.6)
"""Amplitudes of the sines [rad]."""

SINE_CURRENTS = (0.0, 0.5, 1.0, 1.5)
"""Constant currents of the sines [A]; each is moved by up to 0.1 A inwards."""

CURRENT_MAX = 1.5
"""Largest current [A]."""

SPEED_MAX = 8.0
"""Largest speed of the gait-like motion [rad/s]; the fastest sine reaches 7.5."""

DWELL = (0.6, 2.0)
"""Shortest and longest time between two current steps [s]."""

STEP = (0.15, 0.7)
"""Smallest and largest current step [A]."""

LEADS_OVER = 0.6
"""Time in which the end of a trajectory is led to the beginning of the next, where all are one run [s]."""

CORNER = 0.005
"""Standard deviation of the bell that rounds the corners of a triangle [s]."""

MOTIONS = ("mixed", "triangles")
"""Motions of a session: steps, sines and gait; triangles."""

UPDATE_RATE = 50.0
"""Updates of the current in gait-like motion [1/s]."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Prescribed motion and command of T trajectories of equal length, on the fine grid of N samples."""

    kind: tuple[str, ...]
    """Kind of each trajectory, shape (T,): "steps", "sine", "gait", "triangle" or a name of the caller's."""
    rate: float
    """Logging rate [1/s]."""
    substeps: int
    """Fine samples per logged sample."""
    q: np.ndarray
    """Displacement [rad], shape (T, N)."""
    qd: np.ndarray
    """Velocity [rad/s], shape (T, N)."""
    command: Current
    """Commanded current."""
    start: np.ndarray
    """Start of each trajectory in its session [s], shape (T,), in rising order."""

    @property
    def dt(self) -> float:
        """Step of the fine grid [s]."""
        return 1.0 / (self.rate * self.substeps)

    @property
    def logged(self) -> slice:
        """Fine samples that are logged."""
        return slice(0, None, self.substeps)

    @cached_property
    def t(self) -> np.ndarray:
        """Time of the fine samples from the start of their trajectory [s], shape (N,)."""
        return np.arange(self.q.shape[1]) * self.dt

    @cached_property
    def qdd(self) -> np.ndarray:
        """Acceleration [rad/s^2], shape (T, N)."""
        return np.gradient(self.qd, self.dt, axis=1)

    @cached_property
    def turns(self) -> Turns:
        """Monotonic stretches of q."""
        return Turns.of(self.q)

    @cached_property
    def path(self) -> Path:
        """The path of q at the logged samples."""
        return Path.of(self.q, self.turns, self.logged)

    @cached_property
    def slid(self) -> np.ndarray:
        """Way the joint has slid since the session began, at the logged samples [rad], shape (T, M)."""
        way = np.cumsum(np.abs(np.diff(self.q, axis=1, prepend=self.q[:, :1])), axis=1)
        before = np.concatenate([[0.0], np.cumsum(way[:-1, -1])])
        return way[:, self.logged] + before[:, None]


def make_session(
    *,
    size: str = "large",
    rate: float = 200.0,
    seed: np.random.SeedSequence,
    clock_error: float = 0.005,
    truth_rate: float = TRUTH_RATE,
    motion: str = "mixed",
) -> Motion:
    """Draw a session.

    Args:
        size: One of :data:`SIZES`.
        rate: Logging rate [1/s], 100 to 3000.
        seed: Source of everything random.
        clock_error: Largest relative error of the clock that updates the current against the logging clock, drawn for
            each trajectory; 0 locks them, then all updates of a trajectory have the same phase between samples.
        truth_rate: Lowest rate at which the truth is stepped [1/s].
        motion: One of :data:`MOTIONS`.
    """
    if motion not in MOTIONS:
        raise ValueError(f"motion = {motion!r} is unknown; one of {', '.join(MOTIONS)}")
    if size not in SIZES:
        raise ValueError(f"size = {size!r} is unknown; one of {', '.join(SIZES)}")
    if not 100.0 <= rate <= 3000.0:
        raise ValueError(f"rate = {rate:g} 1/s is out of range; 100 to 3000")
    counts, seconds = SIZES[size]
    rng = np.random.default_rng(seed)
    substeps = math.ceil(truth_rate / rate)
    t = np.arange((round(seconds * rate) - 1) * substeps + 1) / (rate * substeps)
    if motion == "triangles":
        rows, kinds = [_triangle(t, rng) for _ in range(sum(counts))], ["triangle"] * sum(counts)
    else:
        rows = [_steps(t, rng) for _ in range(counts[0])]
        rows += _sines(t, counts[1], rng)
        rows += [_gait(t, rng, clock_error) for _ in range(counts[2])]
        kinds = [kind for kind, count in zip(("steps", "sine", "gait"), counts, strict=True) for _ in range(count)]
    order = rng.permutation(len(rows))
    rest = rng.uniform(5.0, 60.0, len(rows) - 1)
    return Motion(
        kind=tuple(kinds[k] for k in order),
        rate=rate,
        substeps=substeps,
        q=np.stack([rows[k][0] for k in order]),
        qd=np.stack([rows[k][1] for k in order]),
        command=Current.steps([rows[k][2] for k in order], [rows[k][3] for k in order]),
        start=np.concatenate([[0.0], np.cumsum(seconds + rest)]),
    )


def joined(motion: Motion) -> Motion:
    """All trajectories as one run, each led smoothly to where the next begins: a cubic over :data:`LEADS_OVER`."""
    gap = round(LEADS_OVER / motion.dt)
    length = motion.q.shape[1] + gap - 1
    at = np.arange(1, gap) * motion.dt
    q, qd, edges, levels = [], [], list[np.ndarray](), list[np.ndarray]()
    for k in range(len(motion.q)):
        q.append(motion.q[k])
        qd.append(motion.qd[k])
        used = np.isfinite(motion.command.edge[k])
        edges.append(motion.command.edge[k][used] + k * length * motion.dt)
        levels.append(motion.command.target[k][used])
        if k + 1 < len(motion.q):
            ends = [motion.q[k, -1], motion.q[k + 1, 0]], [motion.qd[k, -1], motion.qd[k + 1, 0]]
            lead = CubicHermiteSpline([0.0, gap * motion.dt], *ends)
            q.append(lead(at))
            qd.append(lead(at, 1))
    whole, velocity = np.concatenate(q), np.concatenate(qd)
    count = (len(whole) - 1) // motion.substeps * motion.substeps + 1
    return replace(
        motion,
        kind=("joined",),
        q=whole[None, :count],
        qd=velocity[None, :count],
        command=Current.steps([np.concatenate(edges)], [np.concatenate(levels)]),
        start=np.zeros(1),
    )


_Row = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""q and qd on the fine grid, edges and levels of the command."""


def _steps(t: np.ndarray, rng: np.random.Generator) -> _Row:
    """Slow motion of two sines with pauses; current steps of random size at random times, during moves and pauses."""
    f = rng.uniform(0.4, 1.3)
    waves = [(1.0, f, rng.uniform(0.0, 2.0 * np.pi)), (rng.uniform(0.2, 0.6), f * rng.uniform(1.3, 2.2), 0.0)]
    speed = np.ones_like(t)
    for _ in range(max(1, round(t[-1] / 4.0))):
        begin, length = rng.uniform(0.15, 0.85) * t[-1], rng.uniform(0.4, 0.9)
        speed *= np.maximum(_smooth((begin - t) / 0.1)[0], _smooth((t - begin - length) / 0.1)[0])
    warped = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t))])
    q, qd = _waves(warped, waves)
    q, qd = started(t, q, qd * speed, rng.uniform(0.1, 0.6), rng)
    edges = np.cumsum(rng.uniform(*DWELL, math.ceil(t[-1] / DWELL[0])))
    edges = np.concatenate([[0.0], edges[edges < t[-1]]])
    level = rng.uniform(0.0, CURRENT_MAX, len(edges))
    for k in range(1, len(edges)):
        size = rng.uniform(*STEP)
        down = level[k - 1] + size > CURRENT_MAX or (level[k - 1] >= size and rng.uniform() < 0.5)
        level[k] = level[k - 1] + (-size if down else size)
    return q, qd, edges, level


def _triangle(t: np.ndarray, rng: np.random.Generator) -> _Row:
    """A triangle of 0.1 to 0.4 rad and 0.5 to 2 Hz with rounded corners; a current that steps about once a second.

    It is under way from the beginning: a joint that starts from rest shows its play there as well.
    """
    size, f = rng.uniform(0.1, 0.4), rng.uniform(0.5, 2.0)
    step = t[1] - t[0]
    q = size * 2.0 / np.pi * np.arcsin(np.sin(2.0 * np.pi * f * t + rng.uniform(0.0, 2.0 * np.pi)))
    q = gaussian_filter1d(q, CORNER / step, mode="nearest")
    edges = np.concatenate([[0.0], np.sort(rng.uniform(0.2, t[-1], round(t[-1])))])
    return q, np.gradient(q, step), edges, rng.uniform(0.0, CURRENT_MAX, len(edges))


def _sines(t: np.ndarray, count: int, rng: np.random.Generator) -> list[_Row]:
    """Sines of 0.5 to 2 Hz; amplitudes and currents are spread evenly, frequencies stratified."""
    amplitude = np.resize(AMPLITUDES, count)
    block = np.arange(count) // len(AMPLITUDES)
    current = np.array(SINE_CURRENTS)[(np.arange(count) + block) % len(SINE_CURRENTS)]
    current = current + 0.1 * rng.uniform(0.0, 1.0, count) * np.where(current > 0.5 * CURRENT_MAX, -1.0, 1.0)
    frequency = 0.5 * 4.0 ** ((rng.permutation(count) + rng.uniform(0.0, 1.0, count)) / count)
    rows = []
    for a, i, f in zip(amplitude, current, frequency, strict=True):
        q, qd = _waves(t, [(1.0, f, 0.0)])
        q, qd = started(t, q, qd, a, rng, peak=1.0)
        rows.append((q, qd, np.zeros(1), np.array([i])))
    return rows


def _gait(t: np.ndarray, rng: np.random.Generator, clock_error: float) -> _Row:
    """Six harmonics of a stride; the current follows the stride smoothly and is held between its updates."""
    f = rng.uniform(0.8, 1.8)
    waves = [(rng.uniform(0.5, 1.0) / k**1.7, k * f, rng.uniform(0.0, 2.0 * np.pi)) for k in range(1, 7)]
    q, qd = started(t, *_waves(t, waves), rng.uniform(0.1, 0.6), rng)
    period = (1.0 + rng.uniform(-clock_error, clock_error)) / UPDATE_RATE
    edges = np.arange(rng.uniform(0.0, period), t[-1], period)
    height = rng.uniform(0.2, 0.7)
    base = rng.uniform(0.0, CURRENT_MAX - 2.0 * height)
    law, _ = _waves(edges, [(1.0, f, rng.uniform(0.0, 2.0 * np.pi)), (0.25, 2.0 * f, rng.uniform(0.0, 2.0 * np.pi))])
    level = base + height * (1.0 + 0.8 * law) + 0.01 * rng.standard_normal(len(edges))
    level = np.clip(level, 0.0, CURRENT_MAX)
    return q, qd, np.concatenate([[0.0], edges]), np.concatenate([level[:1], level])


def _waves(t: np.ndarray, waves: list[tuple[float, float, float]]) -> tuple[np.ndarray, np.ndarray]:
    """Sum of waves (amplitude, frequency [1/s], phase [rad]) and its derivative."""
    x, xd = np.zeros_like(t), np.zeros_like(t)
    for amplitude, f, phase in waves:
        turn = 2.0 * np.pi * f * t + phase
        x += amplitude * np.sin(turn)
        xd += 2.0 * np.pi * f * amplitude * np.cos(turn)
    return x, xd


def _smooth(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Quintic from 0 at s = 0 to 1 at s = 1 and its derivative, constant outside."""
    s = np.clip(s, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2), 30.0 * s**2 * (1.0 - s) ** 2


def started(
    t: np.ndarray, x: np.ndarray, xd: np.ndarray, amplitude: float, rng: np.random.Generator, peak: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Motion scaled to its amplitude, about a centre within 0.05 rad of zero, that begins at rest."""
    seconds = rng.uniform(0.5, 1.0)
    factor = amplitude / (peak or np.abs(x).max())
    share, slope = _smooth(t / seconds)
    q, qd = factor * share * x, factor * (share * xd + slope / seconds * x)
    slower = min(1.0, SPEED_MAX / np.abs(qd).max())
    return slower * q + rng.uniform(-0.05, 0.05), slower * qd
