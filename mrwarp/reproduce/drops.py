"""The falling mass behind the hardware rows of table 4, figure 7 and table 5: 10 kg on the backs of walking robots."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

from mrwarp.actuator.mr_actuator import HoldCurrent
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.reproduce import readings, store
from mrwarp.reproduce.ensemble import Ensemble
from mrwarp.reproduce.experiment import Experiment, Findings, Job, seeds_of
from mrwarp.trials.impact import MOTOR_WINDOW, ImpactCfg, ImpactKind, ImpactSweep, ImpactTrace
from mrwarp.usd.robot import LEGS, PUBLIC_GAINS

DATA = "drops.npz"
"""File with the data."""

GAINS = {"Kp 20, Kd 0.5": PUBLIC_GAINS, "Kp 35, Kd 0.6": None}
"""Gains of all motors by name, which the paper does not state; None is the asset's."""


def simulate(job: Job) -> Findings:
    """Drop the mass at every current with both sets of gains; the device is the brake that it is on hardware."""
    settings = job.settings
    env = make_walk_cfg(hold_current=HoldCurrent.FIXED, threads=settings.threads)
    env = replace(env, actuator=replace(env.actuator, holding=False))
    found = {}
    for k, (name, gains) in enumerate(GAINS.items()):
        job.report(name, k / len(GAINS))
        cfg = ImpactCfg(
            kind=ImpactKind.DROP, trials=len(settings.impacted) * settings.impacts, gains=gains, env=env,
            phases=readings.FR_RL_STANCE, seed=settings.seed,
        )  # fmt: skip
        found[name] = measured(ImpactSweep(cfg, Ensemble(settings.struck(gains))).run())
    store.save(job.out / DATA, {"found": found, "policies": len(settings.impacted)})
    return Findings()


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
        **{name: np.where(met, values, np.nan) for name, values in readings.cells(trace).items()},
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
    return [*note, *readings.fallen(fell, "falling masses")]


def read(folder: Path) -> tuple[dict[str, dict[str, np.ndarray]], np.ndarray | None]:
    """Figures by gains, and the policy of each trial, None with a single one."""
    tree = store.load(folder / DATA)
    count = next(iter(tree["found"].values()))["min_height"].shape[1]
    return tree["found"], seeds_of(np.arange(count), tree["policies"])


EXPERIMENT = Experiment(
    name="drops", compute=simulate, shown=False,
    settings=("impacted", "aware", "impacts", "seed"),
)  # fmt: skip
