"""Excitations of the virtual bench: the motions and currents of paper section 4.1, from a seed.

All motions start at rest, stay within 1 rad and 10 rad/s, and are given at 2 kHz; currents are commanded at the logging
rate.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mrwarp.bench.bench_effects import LOG_DT, SUBSTEPS
from mrwarp.usd.robot import GAIT_FREQUENCY

FIT_CURRENTS = (0.0, 0.5, 1.0, 1.5)
"""Currents of the fitting data [A]; 1.2 A is kept for evaluation (paper section 4.1)."""

EVALUATION_CURRENTS = (1.0, 1.2, 1.5)
"""Currents of the evaluation data [A], paper Fig. 4."""

EVALUATION_TRAJECTORIES = 10
"""Unseen motions, each run at every evaluation current."""

Q_MAX = 1.0
"""Largest displacement [rad], paper section 4.1."""

QD_MAX = 10.0
"""Largest speed [rad/s], paper section 4.1."""

KINDS = ("steps", "sine", "gait")
"""Kinds of trajectories of the fitting data, in turn."""

CALF_HARMONICS = (
    (0.206, 0.097, 0.018, 0.027, 0.008, 0.009),
    (0.148, 0.139, 0.075, 0.018, 0.014, 0.012),
    (0.092, 0.066, 0.023, 0.009, 0.013, 0.001),
    (0.215, 0.018, 0.017, 0.018, 0.004, 0.011),
)
"""Amplitudes of the first six harmonics of the stride of the four calf joints [rad], order of ``robot.LEGS``.

Measured on simulated walking at 0.5 m/s: the exported policy of ``train/ppo.py --seed 1``, 1,500 updates, 10 s."""

CALF_PHASES = (
    (-1.29, 0.15, 0.11, -0.01, 0.82, -0.44),
    (-1.38, -0.18, 0.78, 1.36, 0.46, 1.17),
    (-1.57, -0.15, 1.06, -0.20, 0.85, 2.64),
    (-2.87, 0.66, 2.91, 0.35, 2.21, -0.42),
)
"""Their phases at the start of each leg's stride [rad]."""


CalfPool = list[np.ndarray]
"""Calf angles of a walking robot about the neutral stance at 2 kHz [rad], each of shape (T,)."""


@dataclass(frozen=True, kw_only=True)
class Excitation:
    """One trajectory of the bench."""

    id: str
    kind: str
    q: np.ndarray
    """Angle at 2 kHz [rad], shape (S*SUBSTEPS,)."""
    command: np.ndarray
    """Current command at 200 Hz [A], shape (S,)."""


def fit_excitations(
    trajectories: int, samples: int, rng: np.random.Generator, pool: CalfPool | None = None, *, share: float = 1.0
) -> list[Excitation]:
    """The fitting set: kinds in turn, at 0, 0.5, 1.0 and 1.5 A.

    ``steps``: moves and rests under a current whose level changes at random every 0.1 to 0.8 s. ``sine``: 0.5 to 2 Hz
    with changing amplitude at constant current. ``gait``: calf motion of a walking robot, current on and off.

    Args:
        trajectories: How many.
        samples: Samples at 200 Hz of all together.
        rng: Source of all that is random.
        pool: Recorded calf motion; None takes the harmonics of :data:`CALF_HARMONICS`.
        share: Factor on the currents.
    """
    out = []
    for k in range(trajectories):
        length = samples // trajectories + (k < samples % trajectories)
        kind, amps = KINDS[k % len(KINDS)], FIT_CURRENTS[(k // len(KINDS)) % len(FIT_CURRENTS)]
        if kind == "steps":
            q, command = _ramps(_fine_time(length), rng), _random_levels(length, rng)
        elif kind == "sine":
            q, command = _sines(_fine_time(length), rng), np.full(length, amps)
        else:
            q, command = _gait(_fine_time(length), rng, pool), amps * _on_and_off(length, rng)
        out.append(Excitation(id=f"{k:03d}_{kind}", kind=kind, q=q, command=share * command))
    return out


def evaluation_excitations(
    samples: int, rng: np.random.Generator, pool: CalfPool | None = None, *, share: float = 1.0
) -> list[Excitation]:
    """Ten motions that are in no other set, each at 1.0, 1.2 and 1.5 A.

    The current is on in three sections of the motion, as in paper section 6.1: an early one, a middle one, and, when
    the same motion runs a second time, all of it. ``share`` is a factor on the currents.
    """
    motions: dict[str, Callable[[np.ndarray], np.ndarray]] = {
        "gait": lambda time: _gait(time, rng, pool),
        "sine": lambda time: _sines(time, rng),
        "ramps": lambda time: _ramps(time, rng),
    }
    on = np.zeros(samples)
    for start, end in ((0.05, 0.15), (0.30, 0.40), (0.50, 1.0)):
        on[round(start * samples) : round(end * samples)] = 1.0
    out = []
    for k in range(EVALUATION_TRAJECTORIES):
        kind = list(motions)[k % len(motions)]
        time = _fine_time(samples)[: (samples * SUBSTEPS + 1) // 2]
        once = motions[kind](time) * _ease(time[-1] - time, 1.0)  # back at zero, where the second run starts
        q = np.concatenate([once, once])[: samples * SUBSTEPS]
        for amps in (share * current for current in EVALUATION_CURRENTS):
            out.append(Excitation(id=f"eval{k:02d}_{kind}_{amps:g}A", kind=kind, q=q, command=amps * on))
    return out


def _fine_time(samples: int) -> np.ndarray:
    return np.arange(samples * SUBSTEPS) * (LOG_DT / SUBSTEPS)


def _ease(time: np.ndarray, seconds: float) -> np.ndarray:
    """0 to 1 over the first seconds, with no jump in velocity or acceleration."""
    x = np.clip(time / seconds, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)


def _levels(time: np.ndarray, values: np.ndarray, hold: float) -> np.ndarray:
    """A level for each ``hold`` seconds, with smooth changes between them."""
    out = np.full(len(time), values[0])
    for k in range(1, len(values)):
        out += (values[k] - values[k - 1]) * _ease(time - k * hold, min(0.5, hold / 2))
    return out


def _sines(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A sine of 0.5 to 2 Hz whose amplitude changes every four seconds, within the limits of angle and speed."""
    hold = 4.0
    f, phase = rng.uniform(0.5, 2.0), rng.uniform(0.0, 2.0 * np.pi)
    largest = min(Q_MAX, 0.95 * QD_MAX / (2.0 * np.pi * f))
    # over a decade and more: the stance moves the calf by hundredths, the swing by tenths of a radian
    amplitude = largest * np.exp(rng.uniform(np.log(0.05), 0.0, int(time[-1] / hold) + 1))
    return _levels(time, amplitude, hold) * np.sin(2.0 * np.pi * f * time + phase) * _ease(time, 1.0)


def _ramps(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Moves to random angles at 0.2 to 5 rad/s with rests of up to 0.8 s: current steps meet both motion and rest."""
    q, now, at = np.zeros(len(time)), 0.2, 0.0
    while now < time[-1]:
        to = rng.uniform(-0.8, 0.8) * Q_MAX
        speed = np.exp(rng.uniform(np.log(0.2), np.log(5.0)))
        seconds = max(1.875 * abs(to - at) / speed, 0.05)  # 1.875: peak over mean speed
        q += (to - at) * _ease(time - now, seconds)
        now, at = now + seconds + rng.uniform(0.0, 0.8), to
    return q


def _gait(time: np.ndarray, rng: np.random.Generator, pool: CalfPool | None) -> np.ndarray:
    """Calf motion of a walking robot, stretched by 0.7 to 2 to cover what the paper measured."""
    q = _synthetic_gait(time, rng) if pool is None else _recorded_gait(time, rng, pool)
    q = q * rng.uniform(0.7, 2.0)
    speed = np.abs(np.gradient(q, time[1] - time[0])).max()
    return q * min(1.0, 0.9 * QD_MAX / speed, 0.95 * Q_MAX / np.abs(q).max()) * _ease(time, 1.0)


def _synthetic_gait(time: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    leg, f = int(rng.integers(len(CALF_HARMONICS))), GAIT_FREQUENCY * rng.uniform(0.8, 1.2)
    stretch = _levels(time, rng.uniform(0.8, 1.2, int(time[-1] * f) + 2), 1.0 / f)
    phase = 2.0 * np.pi * (f * time + rng.uniform())
    harmonics = zip(CALF_HARMONICS[leg], CALF_PHASES[leg], strict=True)
    waves = [size * np.cos((k + 1) * phase + shift) for k, (size, shift) in enumerate(harmonics)]
    return stretch * np.sum(waves, axis=0)


def _recorded_gait(time: np.ndarray, rng: np.random.Generator, pool: CalfPool) -> np.ndarray:
    """A part of one calf's recorded motion."""
    run = pool[int(rng.integers(len(pool)))]
    if len(run) < len(time):
        need, have = len(time) * LOG_DT / SUBSTEPS, len(run) * LOG_DT / SUBSTEPS
        raise ValueError(f"the recorded gait is {have:g} s long, the trajectory {need:g} s; record a longer one")
    start = int(rng.integers(len(run) - len(time) + 1))
    return run[start : start + len(time)]


def _random_levels(samples: int, rng: np.random.Generator) -> np.ndarray:
    """Current levels of random size held for 0.1 to 0.8 s."""
    return _sections(samples, 0.1, 0.8, rng, lambda k: rng.choice(FIT_CURRENTS))


def _on_and_off(samples: int, rng: np.random.Generator) -> np.ndarray:
    """Current on and off in sections of 0.5 to 4 s."""
    return _sections(samples, 0.5, 4.0, rng, lambda k: 1.0 - k % 2)


def _sections(
    samples: int, shortest: float, longest: float, rng: np.random.Generator, level: Callable[[int], float]
) -> np.ndarray:
    """Levels that are held for random times [s]."""
    out, at, k = np.empty(samples), 0, 0
    while at < samples:
        hold = int(rng.uniform(shortest, longest) / LOG_DT)
        out[at : at + hold] = level(k)
        at, k = at + hold, k + 1
    return out
