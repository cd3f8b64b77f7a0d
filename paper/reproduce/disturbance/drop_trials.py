"""The guided mass of the hardware's trials (section 6.3) on walking robots: table 4's hardware rows, figure 7, table 5.

Both branches act, as in the paper's configurations B and D. The paper says nothing of the contact: it is a pad on which
the two masses part after the paper's impact window of 0.1 s.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mrwarp import paper
from mrwarp.enums import Coupling, ZStep
from mrwarp.trials import impact
from mrwarp.trials.falling_mass import MassCfg, contact_stiffness
from mrwarp.trials.impact import ImpactCfg, ImpactKind, ImpactSweep, ImpactTrace, Variant, body_extremes
from mrwarp.trials.impact_figures import MOTOR_WINDOW
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import BRAKE, Findings
from paper.reproduce.disturbance.push_rule import fallen
from paper.reproduce.settings import (
    IMPACTS,
    TRAININGS,
    Ensemble,
    Settings,
    impacts_time,
    seeds_of,
    study_files,
    trained_gains,
)
from paper.study.plan import AWARE, CONVENTIONAL, STUDY
from paper.study.plan import BRAKE as BRAKE_POLICIES

PHASES = (0.5, 1.0)
"""Gait phases in which FR and RL stand, the pair that the hardware's impacts were applied to (section 6.3)."""

STIFFNESS = contact_stiffness(paper.IMPACTOR["mass"], paper.MASS["mr_go"], paper.IMPACTOR["window"])
"""Of the contact [N/m]: both masses part after the window over which the paper takes its means, 0.1 s."""

LITERAL, JOINT = "the paper's torque", "brake constraint"
"""The two columns."""


@dataclass(frozen=True, kw_only=True)
class Drop:
    """One way to drop the mass."""

    brake: bool = False
    """Whether the devices are brake constraints; else they have the paper's torque."""
    holding: bool = True
    """Whether both branches of the scheduler act, or damping alone."""
    exact: bool = False
    """Whether eq. 15 takes the closed step; else Euler's, the paper's, which devices that slide at once overshoot."""

    @property
    def name(self) -> str:
        """In words."""
        text = [JOINT if self.brake else LITERAL]
        return ", ".join(text + ["damping alone"] * (not self.holding))

    @property
    def column(self) -> str:
        """End of the conditions of its rows; the paper's equations have none."""
        return {LITERAL: "", JOINT: BRAKE}.get(self.name, f"; {self.name}")


COLUMNS = (Drop(), Drop(brake=True))
"""The columns of every row."""

DROPS = (*COLUMNS, Drop(holding=False))
"""Ways to drop the mass on the robots of table 4 and figure 7."""

BOUND = (0.8, 1.6, 3.0, 6.0, 12.0, 25.0)
"""Sliding torques of devices that bound what any can do [N·m]: from eq. 14's at 1.5 A and 3 rad/s to eq. 18's yield
torque there."""

QUICK = 50.0
"""beta of those devices [1/rad]: they slide after a fiftieth of a radian, as good as at once."""


def ideal(torque: float) -> Variant:
    """A device that slides at a torque [N·m] at any speed while its damping gate is open, and has no drag."""
    amps = CURRENT_GROUPS[-1]
    none = {"D": 0.0, "B": 0.0, "C": 0.0, "I1": 0.0, "K0": 0.0, "alpha": 0.0}
    return Variant(current=amps, params={**none, "beta": QUICK, "gamma": 0.0, "K1": torque * QUICK / amps})


def config(drop: Drop, settings: Settings, paths: Sequence[Path], variants: tuple[Variant, ...]) -> ImpactCfg:
    """The sweep of falling masses on robots that some policies walk."""
    return ImpactCfg(
        kind=ImpactKind.DROP,
        variants=variants,
        trials=len(paths) * settings.impacts,
        gains=trained_gains(paths),
        mass=MassCfg(stiffness=STIFFNESS),
        env=impact.fixed_current_env(
            holding=drop.holding,
            coupling=Coupling.CONSTRAINT if drop.brake else Coupling.EXPLICIT,
            z_step=ZStep.EXACT if drop.exact else ZStep.EULER,
            threads=settings.threads,
        ),
        phases=PHASES,
        seed=settings.seed,
    )


class Dropper:
    """Drops masses on the same walking robots; they walk in once per kind of device."""

    def __init__(self, settings: Settings, paths: Sequence[Path]) -> None:
        self.settings, self.paths, self.policy = settings, paths, Ensemble(paths)
        self._walkers: dict[bool, ImpactSweep] = {}

    def drop(self, drop: Drop, variants: tuple[Variant, ...]) -> dict[str, np.ndarray]:
        """:func:`measured` with all settings of the device."""
        cfg, kind = config(drop, self.settings, self.paths, variants), drop.brake
        if kind not in self._walkers:
            self._walkers[kind] = ImpactSweep(replace(cfg, variants=(Variant(current=0.0),)), self.policy)
            self._walkers[kind].walk_in()
        sweep = ImpactSweep(cfg, self.policy)
        sweep.begin_with(self._walkers[kind])
        return measured(sweep.run(again=True))


@dataclass(frozen=True, kw_only=True)
class Drops:
    """The simulated falling masses: 10 kg on the backs of walking robots."""

    figures: dict[str, dict[str, np.ndarray]]
    """:func:`measured` by the names of :data:`DROPS`, at the currents of eq. 20."""
    bound: dict[str, np.ndarray]
    """Without a device's torque and with each of :data:`BOUND`."""
    struck: dict[str, dict[str, np.ndarray]]
    """Table 5: by training and column (```training, column```), SAL off and on."""
    policies: int
    """Policies of ``figures`` and ``bound``; trial i was walked by policy ``i % policies``."""
    trained: int
    """Policies of each training of ``struck``."""

    def seeds(self) -> np.ndarray | None:
        """Policy of each trial of ``figures``, shape (N,); None with a single policy."""
        return seeds_of(np.arange(next(iter(self.figures.values()))["min_height"].shape[1]), self.policies)

    def trained_seeds(self) -> np.ndarray | None:
        """Policy of each trial of ``struck``."""
        return seeds_of(np.arange(next(iter(self.struck.values()))["min_height"].shape[1]), self.trained)


def simulate(job: Job) -> Findings:
    """Drop the mass on table 4's robots at every current, on table 5's with SAL off and on, and on bounding devices."""
    settings = job.settings
    currents = tuple(Variant(current=amps) for amps in CURRENT_GROUPS)
    dropper, figures = Dropper(settings, settings.impacted), {}
    for k, drop in enumerate(DROPS):
        job.report(drop.name, 0.5 * k / len(DROPS))
        figures[drop.name] = dropper.drop(drop, currents)
    devices = (Variant(current=0.0, params=ideal(0.0).params), *map(ideal, BOUND))
    job.report("bound", 0.5)
    bound = dropper.drop(Drop(brake=True, holding=False, exact=True), devices)
    struck = {}
    for training in (CONVENTIONAL, AWARE):
        job.report(training, 0.8)
        for drop in COLUMNS:
            folder = BRAKE_POLICIES if drop.brake and training == AWARE else STUDY  # Go1 has no device
            dropper = Dropper(settings, study_files((training,), folder=folder))
            struck[f"{training}, {drop.name}"] = dropper.drop(drop, (currents[0], currents[-1]))
    return job.save(
        Drops(
            figures=figures,
            bound=bound,
            struck=struck,
            policies=len(settings.impacted),
            trained=len(dropper.paths),
        )
    )


def read(job: Job) -> Drops:
    """Data of :func:`simulate`."""
    return job.load("drops", Drops)


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
    return [*note, *fallen(fell, "falling masses")]


EXPERIMENTS = (
    Experiment(
        name="drops",
        compute=simulate,
        settings=IMPACTS,
        files=lambda: [*study_files(TRAININGS), *study_files((AWARE,), folder=BRAKE_POLICIES)],
        seconds=impacts_time(16.0),
    ),
)
