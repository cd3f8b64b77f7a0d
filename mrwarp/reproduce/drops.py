"""The falling mass behind the hardware rows of table 4, figure 7 and table 5: 10 kg on the backs of walking robots."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mrwarp.reproduce import pushes
from mrwarp.reproduce.cache import Job
from mrwarp.reproduce.comparison import Findings, seeds_of
from mrwarp.reproduce.settings import Ensemble
from mrwarp.trials.impact import (
    ImpactCfg,
    ImpactKind,
    ImpactSweep,
    ImpactTrace,
    body_extremes,
    fixed_current_env,
)
from mrwarp.trials.impact_figures import MOTOR_WINDOW
from mrwarp.usd.robot import LEGS, PUBLIC_GAINS

GAINS = {"Kp 20, Kd 0.5": PUBLIC_GAINS, "Kp 35, Kd 0.6": None}
"""Gains of all motors by name, which the paper does not state; None is the asset's."""


@dataclass(frozen=True, kw_only=True)
class Drops:
    """What was simulated."""

    figures: dict[str, dict[str, np.ndarray]]
    """:func:`measured` by the names in :data:`GAINS`."""
    policies: int
    """Policies; trial i was walked by policy ``i % policies``."""

    def seeds(self) -> np.ndarray | None:
        """Policy of each trial, shape (N,); None with a single policy."""
        return seeds_of(np.arange(next(iter(self.figures.values()))["min_height"].shape[1]), self.policies)


def simulate(job: Job) -> Findings:
    """Drop the mass at every current with both sets of gains."""
    settings, policies = job.settings, len(job.settings.impacted)
    found = {}
    for k, (name, gains) in enumerate(GAINS.items()):
        job.report(name, k / len(GAINS))
        cfg = ImpactCfg(
            kind=ImpactKind.DROP,
            trials=policies * settings.impacts,
            gains=gains,
            env=fixed_current_env(threads=settings.threads),
            phases=pushes.FR_RL_STANCE,
            seed=settings.seed,
        )
        found[name] = measured(ImpactSweep(cfg, Ensemble(settings.struck(gains))).run())
    return job.save(Drops(figures=found, policies=policies))


def measured(trace: ImpactTrace) -> dict[str, np.ndarray]:
    """Figures of every trial: table 4's cells and table 5's, shape (C, N); the 0.1 s begin at the contact.

    Returns:
        ``min_height`` [m], ``peak_down_velocity`` [m/s], ``acceleration``, the mean |a_z - g| over 0.1 s [m/s^2], and
        per leg the mean calf motor torque over 0.1 s [N·m], all NaN where the mass never met the robot; ``fell``.
    """
    dt = float(trace.t[1] - trace.t[0])
    since = trace.t - trace.contact[..., None]
    during = (since > 0.0) & (since <= MOTOR_WINDOW + 0.5 * dt)
    met = during.any(axis=2)
    count = np.where(met, during.sum(axis=2), np.nan)
    motor = (np.abs(trace.tau_motor) * during[..., None]).sum(axis=2) / count[..., None]
    acceleration = np.abs(np.diff(trace.velocity, axis=2, prepend=trace.velocity[:, :, :1]) / dt)
    return {
        **{name: np.where(met, values, np.nan) for name, values in body_extremes(trace).items()},
        "acceleration": (acceleration * during).sum(axis=2) / count,
        **{leg: motor[..., k] for k, leg in enumerate(LEGS)},
        "fell": trace.fell,
    }


def lost(found: Iterable[dict[str, np.ndarray]]) -> list[str]:
    """Notes on falling masses that missed, which leave no figure, and on robots that fell."""
    every = list(found)
    missed = sum(int(np.isnan(values["min_height"]).sum()) for values in every)
    fell = np.concatenate([np.ravel(values["fell"]) for values in every])
    note = [f"{missed} of {fell.size} masses missed the robot and leave no figure."] if missed else []
    return [*note, *pushes.fallen(fell, "falling masses")]


def read(job: Job) -> Drops:
    """Data of :func:`simulate`."""
    return job.load("drops", Drops)
