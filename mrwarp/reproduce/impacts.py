"""The impacts of section 6.3 behind tables 4 and 5 and figures 6 and 7: the simulated push, and the falling mass.

The push is simulated under every reading of what the paper leaves open: it states the force, not its duration, the
motors' gains, where in the stance it began or which torque its dynamic branch had. Each reading has its own duration,
calibrated on the 0 A row; the other rows are predictions.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.enums import Coupling
from mrwarp.nn.network_file import shipped_model
from mrwarp.params import BoucWenParams, HoldParams
from mrwarp.reproduce.cache import Job
from mrwarp.reproduce.comparison import Findings, seeds_of
from mrwarp.reproduce.settings import Ensemble, Settings
from mrwarp.trials import impact
from mrwarp.trials.impact import ImpactCfg, ImpactKind, ImpactSweep, ImpactTrace, Variant, body_extremes
from mrwarp.trials.impact_figures import MOTOR_WINDOW
from mrwarp.trials.walking import Policy
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS, PUBLIC_GAINS, TROT_PHASE

CELLS = ("min_height", "peak_down_velocity")
"""The two columns of table 4."""

FL_RR_STANCE = (0.0, 0.5)
"""Gait phases in which FL and RR stand, the pair that carries the paper's simulated impact (figure 6b)."""

FR_RL_STANCE = (0.5, 1.0)
"""Gait phases in which FR and RL stand, the pair that the hardware's impacts were applied to (section 6.3)."""

COARSE = tuple(round(0.05 * k, 2) for k in range(1, 13))
"""Durations tried first [s]."""

WINDOW = 0.8
"""Time after the push's onset over which minima are taken [s]."""

NEARLY_OFF = 1e-3
"""Current that holds nothing but lets the holding gate open [A]: the low gain also without current."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One set of choices."""

    name: str
    coupling: Coupling = Coupling.EXPLICIT
    """The paper's torque, or the brake constraint."""
    holding: bool = False
    """Whether the holding branch may open beside the dynamic one."""
    soft_at_zero: bool = False
    """Whether the holding gate lowers the motor's gain at 0 A too, where nothing holds (eqs. 8, 9 to the letter)."""
    gains: tuple[float, float] | None = PUBLIC_GAINS
    """Kp, Kd of all motors; None is the asset's 35 and 0.6. Only those walk with policies that were trained with them,
    all others with policies that were trained with :data:`mrwarp.usd.robot.PUBLIC_GAINS`."""
    phases: tuple[float, float] | None = FL_RR_STANCE
    """Gait phase at onset; None is any."""
    torque: str = "eq. 14"
    """Sliding torque of the dynamic branch: ``eq. 14``, ``pg_rlstm`` (eq. 16), ``unweakened`` (eq. 14 with
    alpha = 0) or ``yield`` (eq. 18 as if it slid at its yield torque)."""


BASE = Reading(name="base: explicit, damping alone, Kp 20, FL-RR stance, eq. 14")
"""What the text says, with public gains."""

LETTER = replace(
    BASE, name="both branches, eqs. 8, 9 to the letter, FR-RL stance, Kp 17, Kd 0.1", holding=True, soft_at_zero=True,
    gains=(17.0, 0.1), phases=FR_RL_STANCE,
)  # fmt: skip
"""All that the scheduler does, with gains that were chosen, like the duration, by the 0 A row alone."""

READINGS = (
    BASE,
    replace(BASE, name="Kp 35, Kd 0.6 (our asset)", gains=None),
    replace(BASE, name="FR-RL stance", phases=FR_RL_STANCE),
    replace(BASE, name="brake constraint", coupling=Coupling.CONSTRAINT),
    replace(BASE, name="with holding", holding=True),
    replace(BASE, name="with holding, brake constraint", holding=True, coupling=Coupling.CONSTRAINT),
    replace(BASE, name="with holding, low gain at 0 A too", holding=True, soft_at_zero=True),
    replace(BASE, name="PG-RLSTM torque (eq. 16)", torque="pg_rlstm"),
    replace(BASE, name="no speed weakening", torque="unweakened"),
    replace(BASE, name="sliding at the yield torque (eq. 18)", torque="yield"),
    replace(BASE, name="Kd 0.1", gains=(20.0, 0.1)),
    LETTER,
    replace(LETTER, name="the same, Kp 20, Kd 0.5", gains=PUBLIC_GAINS),
    replace(LETTER, name="the same, Kp 20, Kd 0.1", gains=(20.0, 0.1)),
    replace(LETTER, name="the same, Kp 18, Kd 0.1", gains=(18.0, 0.1)),
    replace(LETTER, name="the same, Kp 16, Kd 0.3", gains=(16.0, 0.3)),
    replace(LETTER, name="the same as with Kp 18, Kd 0.1, no speed weakening", gains=(18.0, 0.1), torque="unweakened"),
    replace(LETTER, name="the same as with Kp 17, Kd 0.1, PG-RLSTM torque", torque="pg_rlstm"),
    replace(LETTER, name="the same as with Kp 17, Kd 0.1, no speed weakening", torque="unweakened"),
)
"""The base and what differs from it, then the reading that is adopted and what differs from that."""

ADOPTED = LETTER
"""The reading that table 4 shows; whether its 0 A row is indeed the nearest of :data:`CANDIDATES` is a claim there."""

CANDIDATES = tuple(reading for reading in READINGS if reading.torque == "eq. 14")
"""What it was chosen among: readings with the paper's law. Those with another torque show what the law moves."""

ASSET = next(reading for reading in READINGS if reading.gains is None)
"""The same with the gains of the asset, by policies trained with them."""

UNWEAKENED = READINGS[-1]
"""The adopted reading without the speed weakening of eq. 14."""

UNDAMPED = next(reading for reading in READINGS if reading.name == "Kd 0.1")
"""The same with hardly any damping by the motors."""


def stance_legs(phases: tuple[float, float] | None) -> tuple[str, ...]:
    """Legs that the gait clock has on the ground over all of these phases at onset; none where any phase may be."""
    if phases is None:
        return ()
    low, high = phases
    return tuple(leg for leg, at in zip(LEGS, TROT_PHASE, strict=True) if (low + at) % 1.0 + high - low <= 0.5)


def undamped_speed(drop: float, *, force: float = 100.0, mass: float = paper.MASS["mr_go"]) -> float:
    """Peak speed [m/s] of a mass on a linear spring that a lasting force presses down by ``drop`` [m] without damping.

    With ``drop = 2F/k`` and ``v = F/sqrt(k m)`` it is ``sqrt(F*drop/(2m))``; any damping lowers it at the same drop.
    """
    return math.sqrt(force * drop / (2.0 * mass))


@dataclass(frozen=True, kw_only=True)
class ReadingResult:
    """Both columns of table 4 under one reading; C currents, N trials."""

    reading: str
    """Its name."""
    duration: float
    """Calibrated on the 0 A row [s]."""
    cells: dict[str, np.ndarray]
    """Minimum height [m] and peak downward velocity [m/s] of every trial, shape (C, N)."""

    @property
    def means(self) -> dict[str, np.ndarray]:
        """Of both columns over the trials, shape (C,)."""
        return {cell: values.mean(axis=1) for cell, values in self.cells.items()}

    @property
    def worst(self) -> float:
        """Largest relative difference from the paper's six predicted cells."""
        return max(abs(value) for value in predicted_off(self.means))

    @property
    def monotone(self) -> bool:
        """Whether height rises and speed falls with every step of the current."""
        return all(bool((np.diff(means) > 0.0).all()) for means in self.means.values())

    @property
    def change(self) -> dict[str, float]:
        """Change of both from 0 to 1.5 A, relative."""
        return {cell: float(means[-1] / means[0]) - 1.0 for cell, means in self.means.items()}

    @property
    def off_mismatch(self) -> list[float]:
        """Relative differences of the 0 A row, which the duration was chosen by."""
        target = paper.TABLE_4["simulation"][0.0]
        return [float(means[0]) / target[cell].mean - 1.0 for cell, means in self.means.items()]

    def figures(self) -> dict[str, Any]:
        """Plain figures."""
        names = ("reading", "duration", "worst", "monotone", "change", "off_mismatch")
        means = {cell: values.tolist() for cell, values in self.means.items()}
        return {**{name: getattr(self, name) for name in names}, **means}


def predicted_off(means: Mapping[str, np.ndarray]) -> list[float]:
    """Relative differences of the six predicted cells from the paper's, from the mean of both columns by current."""
    return [
        float(means[cell][i]) / paper.TABLE_4["simulation"][amps][cell].mean - 1.0
        for cell in CELLS
        for i, amps in enumerate(CURRENT_GROUPS)
        if amps > 0.0
    ]


def push(cfg: ImpactCfg, name: str, policy: Policy) -> tuple[ReadingResult, ImpactTrace]:
    """Calibrate the duration on the 0 A row, then push with every current.

    The duration is the one of a grid that brings both cells nearest to the paper's, by relative least squares; all
    durations are pushed as one batch, and a finer grid about the best one follows. The sweep is that of :func:`config`;
    its own duration is not used.
    """
    duration, grid = 0.0, COARSE
    for _ in range(2):
        variants = tuple(replace(cfg.variants[0], duration=tried) for tried in grid)
        found = body_extremes(ImpactSweep(replace(cfg, variants=variants, duration=grid[0]), policy).run())
        duration = grid[int(np.argmin(mismatch({cell: value.mean(1) for cell, value in found.items()})))]
        grid = tuple(t for k in range(-4, 5) if 0.0 < (t := round(duration + 0.01 * k, 3)) <= cfg.window)
    trace = ImpactSweep(replace(cfg, duration=duration), policy).run()
    return ReadingResult(reading=name, duration=duration, cells=body_extremes(trace)), trace


def mismatch(found: dict[str, np.ndarray]) -> np.ndarray:
    """Sum of the squared relative differences from the 0 A row, shape of the cells."""
    target = paper.TABLE_4["simulation"][0.0]
    return sum((found[cell] / target[cell].mean - 1.0) ** 2 for cell in CELLS)  # type: ignore[return-value]


def fallen(fell: np.ndarray, what: str) -> list[str]:
    """A note on the impacts that brought a robot down, of any shape, under this name; none if nothing fell."""
    if not (count := int(np.sum(fell))):
        return []
    return [f"{count} of {np.size(fell)} {what} brought the trunk below {impact.FALL_HEIGHT:g} m; their figures count."]


def config(reading: Reading, settings: Settings) -> ImpactCfg:
    """The sweep of a reading, with the duration still to be found."""
    learned = reading.torque == "pg_rlstm"
    return ImpactCfg(
        variants=tuple(_variant(reading, amps) for amps in CURRENT_GROUPS),
        trials=len(settings.impacted) * settings.impacts,
        window=WINDOW,
        phases=reading.phases,
        gains=reading.gains,
        env=impact.fixed_current_env(
            holding=reading.holding,
            coupling=reading.coupling,
            threads=settings.threads,
            actuator_model="pg_rlstm" if learned else "bouc_wen",
            actuator_file=shipped_model("pg_rlstm") if learned else None,
        ),
        seed=settings.seed,
    )


def _variant(reading: Reading, amps: float) -> Variant:
    params: dict[str, float] = {}
    if reading.torque in ("unweakened", "yield"):
        params["alpha"] = 0.0
    if reading.torque == "yield" and amps > 0.0:
        # loaded in one direction z settles at its bound, where K1*I*z is then the yield torque
        law = HoldParams()
        ratio = (amps / law.K) ** law.n
        params["K1"] = law.T_max * ratio / (1.0 + ratio) / (amps * BoucWenParams().z_bound)
    return Variant(current=NEARLY_OFF if reading.soft_at_zero and amps == 0.0 else amps, params=params)


SERIES = ("t", "height", "velocity", "tau_motor", "tau_mr", "m_dyn", "fell")
"""What is kept of the adopted reading's trace."""


@dataclass(frozen=True, kw_only=True)
class Pushes:
    """The simulated pushes."""

    readings: list[ReadingResult]
    trace: dict[str, np.ndarray]
    """Series of the adopted reading, see :class:`mrwarp.trials.impact.ImpactTrace`."""
    policies: int
    """Policies; trial i was walked by policy ``i % policies``."""

    def of(self, reading: Reading) -> ReadingResult:
        """Result of a reading."""
        return next(found for found in self.readings if found.reading == reading.name)

    def seeds(self) -> np.ndarray | None:
        """Policy of each trial, shape (N,); None with a single policy."""
        return seeds_of(np.arange(self.readings[0].cells["min_height"].shape[1]), self.policies)


def simulate_pushes(job: Job) -> Findings:
    """Calibrate the duration of every reading on the 0 A row and push at all currents."""
    settings, done, kept = job.settings, [], {}
    for k, reading in enumerate(READINGS):
        job.report(reading.name, k / len(READINGS))
        policy = Ensemble(settings.struck(reading.gains))
        found, trace = push(config(reading, settings), reading.name, policy)
        done.append(found)
        if reading is ADOPTED:
            kept = {name: getattr(trace, name) for name in SERIES}
    return job.save(Pushes(readings=done, trace=kept, policies=len(settings.impacted)))


def read_pushes(job: Job) -> Pushes:
    """Data of :func:`simulate_pushes`."""
    return job.load("pushes", Pushes)


GAINS = {"Kp 20, Kd 0.5": PUBLIC_GAINS, "Kp 35, Kd 0.6": None}
"""Gains of all motors by name, which the paper does not state; None is the asset's."""


@dataclass(frozen=True, kw_only=True)
class Drops:
    """The simulated falling masses: 10 kg on the backs of walking robots."""

    figures: dict[str, dict[str, np.ndarray]]
    """:func:`measured` by the names in :data:`GAINS`."""
    policies: int
    """Policies; trial i was walked by policy ``i % policies``."""

    def seeds(self) -> np.ndarray | None:
        """Policy of each trial, shape (N,); None with a single policy."""
        return seeds_of(np.arange(next(iter(self.figures.values()))["min_height"].shape[1]), self.policies)


def simulate_drops(job: Job) -> Findings:
    """Drop the mass at every current with both sets of gains."""
    settings, policies = job.settings, len(job.settings.impacted)
    found = {}
    for k, (name, gains) in enumerate(GAINS.items()):
        job.report(name, k / len(GAINS))
        cfg = ImpactCfg(
            kind=ImpactKind.DROP,
            trials=policies * settings.impacts,
            gains=gains,
            env=impact.fixed_current_env(threads=settings.threads),
            phases=FR_RL_STANCE,
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
    return [*note, *fallen(fell, "falling masses")]


def read_drops(job: Job) -> Drops:
    """Data of :func:`simulate_drops`."""
    return job.load("drops", Drops)
