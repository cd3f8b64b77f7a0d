"""The hysteresis kernels against references: how far is a step of 5 ms from eqs. 14 and 15 in continuous time?

A joint is moved along random sums of sines while its current command steps at random; half of the coils lag. The torque
that the kernels replay is compared with a reference in float64 that shares no code with them: between turning points
eq. 15 depends on the path alone and has a closed form. The test of this module compares it with steps of 1 µs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy.optimize import brentq

from benchmarks.verify.rigs import convergence_order, root_mean_square
from mrwarp.identify.dataset import Dataset, Scales
from mrwarp.identify.replay import Replay
from mrwarp.params import BoucWenParams

SECONDS = 1.0
"""Length of a run [s]."""

STEPS = (0.01, 0.005, 0.0025, 0.00125, 0.000625)
"""Compared sampling steps [s]."""

SEGMENT = 0.05
"""Time between steps of the current command [s]; a multiple of every compared step."""

LAG = 0.012
"""Time constant of the coils that lag [s]."""

METHODS: dict[str, tuple[bool, int]] = {"euler": (False, 0), "exact": (True, 0), "exact, interpolated": (True, 4)}
"""Ways to step z: closed form or not, parts of an interpolated step (0 = the newest velocity held, as simulated)."""

PAPER = BoucWenParams()


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """Motions and current commands, drawn at random; N runs. ``q = sum a*(1 - cos(w*t))`` starts at rest."""

    amplitude: np.ndarray
    """Of each sine [rad], shape (N, 3)."""
    frequency: np.ndarray
    """Its angular frequency w [rad/s], shape (N, 3)."""
    command: np.ndarray
    """Current command per segment [A], shape (N, segments)."""
    lag: np.ndarray
    """Time constant of the coil [s], shape (N,)."""

    @classmethod
    def draw(cls, num_runs: int, seed: int) -> Self:
        """Sines of 0.2 to 4 Hz and up to 0.2 rad, currents from 0 to 1.5 A."""
        rng = np.random.default_rng(seed)
        return cls(
            amplitude=rng.uniform(0.03, 0.2, (num_runs, 3)) * rng.choice([-1.0, 1.0], (num_runs, 3)),
            frequency=2.0 * np.pi * rng.uniform(0.2, 4.0, (num_runs, 3)),
            command=rng.uniform(0.0, 1.5, (num_runs, round(SECONDS / SEGMENT))),
            lag=LAG * (np.arange(num_runs) % 2),
        )

    def q(self, t: np.ndarray) -> np.ndarray:
        """Angle at times of shape (T,) [rad], shape (N, T)."""
        return np.einsum("ns,nst->nt", self.amplitude, 1.0 - np.cos(self.frequency[:, :, None] * t))

    def qd(self, t: np.ndarray) -> np.ndarray:
        """Velocity [rad/s], shape (N, T)."""
        return np.einsum("ns,nst->nt", self.amplitude * self.frequency, np.sin(self.frequency[:, :, None] * t))

    def commanded(self, t: np.ndarray) -> np.ndarray:
        """Command in force just before t [A], shape (N, T)."""
        segment = np.ceil(t / SEGMENT - 1e-9).astype(int) - 1
        return self.command[:, np.maximum(segment, 0)]

    def current(self, t: np.ndarray) -> np.ndarray:
        """Current at t [A], shape (N, T): the exact answer of a first-order lag to the steps of the command."""
        starts = SEGMENT * np.arange(self.command.shape[1])
        at_start, current = self.command.copy(), np.empty((len(self.lag), len(t)))
        for k, lag in enumerate(self.lag):
            for i in range(1, len(starts)) if lag else ():
                kept = np.exp(-SEGMENT / lag)
                at_start[k, i] = self.command[k, i - 1] + (at_start[k, i - 1] - self.command[k, i - 1]) * kept
            segment = np.maximum(np.ceil(t / SEGMENT - 1e-9).astype(int) - 1, 0)
            kept = np.exp(-(t - starts[segment]) / lag) if lag else 0.0
            current[k] = self.command[k, segment] + (at_start[k, segment] - self.command[k, segment]) * kept
        return current

    def mean_current(self, t: np.ndarray, dt: float) -> np.ndarray:
        """Mean of the current over the step that ends at t [A], shape (N, T); a step lies within one segment."""
        command, begin = self.commanded(t), self.current(np.maximum(t - dt, 0.0))
        lag = np.where(self.lag > 0.0, self.lag, 1.0)[:, None]
        mean = command + (begin - command) * lag / dt * (1.0 - np.exp(-dt / lag))
        return np.where((self.lag[:, None] > 0.0) & (t > 0.0), mean, command)


def along_the_path(excitation: Excitation, t: np.ndarray, p: BoucWenParams = PAPER) -> np.ndarray:
    """z at times of shape (T,) [rad], shape (N, T), by the closed form between turning points.

    On the way s from a turning point, ``u = sgn(qd)*z`` obeys ``du/ds = 1 - (beta - gamma)*u`` below zero and
    ``du/ds = 1 - (beta + gamma)*u`` above.
    """
    z = np.empty((len(excitation.lag), len(t)))
    grid = np.linspace(0.0, SECONDS, 4001)
    for run, speeds in enumerate(excitation.qd(grid)):

        def speed(time: float, run: int = run) -> float:
            return float(excitation.qd(np.array([time]))[run, 0])

        crossings = np.flatnonzero(speeds[1:-1] * speeds[2:] < 0.0) + 1
        turns = [0.0, *(brentq(speed, grid[i], grid[i + 1], xtol=1e-15) for i in crossings), np.inf]
        start = 0.0
        for a, b in zip(turns[:-1], turns[1:], strict=True):
            inside = (t >= a) & (t < b)
            times = np.append(t[inside], min(b, SECONDS))
            direction = np.sign(speed(0.5 * (a + min(b, SECONDS))))
            path = np.abs(excitation.q(times)[run] - excitation.q(np.array([a]))[run])
            reached = direction * _loaded(direction * start, path, p)
            z[run, inside], start = reached[:-1], reached[-1]
    return z


def _loaded(u: float, path: np.ndarray, p: BoucWenParams) -> np.ndarray:
    """u after a path of shape (T,)."""
    unloading, loading = p.beta - p.gamma, p.beta + p.gamma
    if u >= 0.0:
        return 1.0 / loading + (u - 1.0 / loading) * np.exp(-loading * path)
    to_zero = np.log1p(-unloading * u) / unloading
    below = 1.0 / unloading + (u - 1.0 / unloading) * np.exp(-unloading * path)
    above = -np.expm1(-loading * np.maximum(path - to_zero, 0.0)) / loading
    return np.where(path < to_zero, below, above)


def torque(
    excitation: Excitation, t: np.ndarray, z: np.ndarray, p: BoucWenParams = PAPER, held: float = 0.0
) -> np.ndarray:
    """Eq. 14 in float64 [N·m], shape (N, T); a torque that is ``held`` for a step [s] takes its mean current."""
    qd, current = excitation.qd(t), excitation.mean_current(t, held) if held else excitation.current(t)
    q_c = excitation.q(t) - (p.q_offset + p.q_center)
    hysteretic = (p.K0 + p.K1 * current) / (1.0 + p.alpha * np.abs(qd)) * z
    return p.D + p.B * qd + p.C * q_c + p.I1 * current + hysteretic


def replayed(excitation: Excitation, dt: float, *, exact: bool, substeps: int) -> np.ndarray:
    """The torque by the kernels from samples at ``dt`` [N·m], shape (N, T)."""
    t = times(dt)
    num_runs = len(excitation.lag)
    command = excitation.commanded(t)
    if substeps:  # a bench's log holds the command that begins at a sample, a coil without lag answers at once
        begins = excitation.commanded(np.minimum(t + 0.5 * dt, SECONDS))
        command = np.where(excitation.lag[:, None] > 0.0, begins, command)
    samples = Dataset(
        q=(excitation.q(t) + PAPER.q_neutral).ravel(),
        qd=excitation.qd(t).ravel(),
        current=command.ravel(),
        torque=np.zeros(num_runs * len(t)),
        start=len(t) * np.arange(num_runs + 1),
        dt=np.full(num_runs, dt),
        scales=Scales(),
    )
    replay = Replay(samples, exact=exact, substeps=substeps)
    own = {spec.name: getattr(PAPER, spec.name) for spec in PAPER.specs()}
    with_lag, without = replay.torque([{**own, "coil_time_constant": lag} for lag in (LAG, 0.0)])
    lagging = np.repeat(excitation.lag > 0.0, len(t))
    return np.where(lagging, with_lag, without).reshape(num_runs, len(t)).astype(np.float64)


def times(dt: float) -> np.ndarray:
    """Sampling times of a run [s]."""
    return dt * np.arange(round(SECONDS / dt) + 1)


@dataclass(frozen=True, kw_only=True)
class Hysteresis:
    """Errors of the replayed torque against :func:`along_the_path`."""

    rms: dict[str, list[float]]
    """RMS error over runs and time by method, one per step of :data:`STEPS` [N·m]."""
    largest: dict[str, list[float]]
    """Largest error [N·m]."""
    size: float
    """RMS of the torque itself [N·m]."""

    def order(self, method: str) -> float:
        """Observed order of convergence over all steps."""
        return float(convergence_order(STEPS, self.rms[method]))


def hysteresis(*, seed: int, num_runs: int = 64) -> Hysteresis:
    """Replay random motions at every step and compare."""
    excitation = Excitation.draw(num_runs, seed)
    rms: dict[str, list[float]] = {method: [] for method in METHODS}
    largest: dict[str, list[float]] = {method: [] for method in METHODS}
    size = 0.0
    for dt in STEPS:
        t = times(dt)
        z = along_the_path(excitation, t)
        size = float(root_mean_square(torque(excitation, t, z)))
        for method, (exact, substeps) in METHODS.items():
            true = torque(excitation, t, z, held=0.0 if substeps else dt)
            error = replayed(excitation, dt, exact=exact, substeps=substeps) - true
            rms[method].append(float(root_mean_square(error)))
            largest[method].append(float(np.abs(error).max()))
    return Hysteresis(rms=rms, largest=largest, size=size)
