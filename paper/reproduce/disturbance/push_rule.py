"""The simulated push of section 6.3 by a rule that was committed before it was run above 0 A, see docs/choices.md.

The rule. The policies' own gains; the onset locked to the gait, just after FL and RR touch down; nothing else is moved.
Damping alone, the branch that section 6.3 evaluates. Of :data:`DURATIONS` that one whose row of 0 A is nearest in drop,
peak speed (table 4) and peak torque of the front leg (figure 6), by the sum of squared relative differences; of equals
the shortest. Everything above 0 A is what comes out: with the paper's torque (eqs. 6, 14, Euler's step), and with the
brake constraint.

Found with table 4 in view: the square of :data:`SQUARE`, which crosses the angle in eq. 14 with the drag at 0 A.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mrwarp import paper
from mrwarp.enums import Coupling, ZStep
from mrwarp.trials import impact
from mrwarp.trials.impact import ImpactCfg, ImpactSweep, ImpactTrace, Variant, body_extremes
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import BRAKE, Findings
from paper.reproduce.disturbance import two_knees
from paper.reproduce.settings import (
    IMPACTS,
    Ensemble,
    Settings,
    impacts_time,
    trained_gains,
)

CELLS = ("min_height", "peak_down_velocity")
"""The two columns of table 4."""

PHASES = (0.0, 0.08)
"""Gait phases at the onset, over which a policy's pushes are spread: FL and RR, the pair that carries the paper's
simulated impact (figure 6b), have just touched down and stand for the whole fall. The paper's row of 0 A spreads by
1 mm, which pushes over a whole stance cannot."""

PAIR = ("FL", "RR")
"""Legs that stand."""

DURATIONS = (0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.8)
"""Durations to choose from [s]; the paper states none."""

HEIGHT = paper.TABLE_2["D"]["height"].mean
"""Height from which the paper's robot falls [m]: the mean of its actuator-aware policy with SAL on."""

WINDOW = 0.8
"""Time after the push's onset over which minima are taken [s]."""

DERIVED = round(two_knees.half_period(), 1)
"""Duration that the paper's own row of 0 A asks for [s], see :mod:`paper.reproduce.paper_checks`; the policies had no
part in it."""

NO_DRAG = {"D": 0.0, "B": 0.0, "C": 0.0, "I1": 0.0, "K0": 0.0}
"""Eq. 14 without what is left of it at 0 A."""


def papers_zero() -> dict[str, float]:
    """The paper's row of 0 A: drop [m], peak speed [m/s], and the front leg's peak motor torque [N·m]."""
    row, leg = paper.TABLE_4["simulation"][0.0], paper.FIGURE_6_PUSH[PAIR[0]]
    return {
        "drop": HEIGHT - row["min_height"].mean,
        "speed": -row["peak_down_velocity"].mean,
        "peak": leg["peak"] / (1.0 + leg["peak_change"]),
    }


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One way to read the device; the rule's are :data:`LITERAL` and :data:`JOINT`."""

    brake: bool = False
    """Whether the devices are brake constraints; else they have the paper's torque."""
    holding: bool = False
    """Whether both branches of the scheduler act, or damping alone."""
    raw: bool = False
    """Whether q_c of eq. 14 is the calf's angle itself, less the paper's offset of 0.2 mrad; else the displacement from
    the neutral stance."""
    free: bool = False
    """Whether the device has no drag at 0 A; section 4.2 says that it has."""
    derived: bool = False
    """Whether the push lasts :data:`DERIVED`, or what the rule takes."""
    usual_height: bool = False
    """Whether the policies were trained with the usual weight of the trunk's height."""

    @property
    def name(self) -> str:
        """In words."""
        text = ["brake constraint" if self.brake else "the paper's torque"]
        text += ["both branches"] * self.holding + [f"push of {DERIVED:g} s"] * self.derived
        text += ["usual weight of the height"] * self.usual_height
        return ", ".join(text + ["raw angle"] * self.raw + ["no drag at 0 A"] * self.free)

    @property
    def column(self) -> str:
        """End of the conditions of its rows; the paper's equations have none."""
        return {LITERAL: "", JOINT: BRAKE}.get(self, f"; {self.name}")

    def variant(self, amps: float) -> Variant:
        """The device at a current [A]."""
        params = {"q_neutral": 0.0} if self.raw else {}
        return Variant(current=amps, params=params | (NO_DRAG if self.free and amps == 0.0 else {}))


LITERAL, JOINT = Reading(), Reading(brake=True)
"""The paper's equations, and the device as this program has it."""

SHORT = Reading(derived=True)
"""The paper's equations under the push that its own row of 0 A asks for."""

SQUARE = (LITERAL, Reading(free=True), Reading(raw=True), Reading(raw=True, free=True))
"""Raw or neutral angle, drag or none at 0 A."""

READINGS = (
    LITERAL,
    JOINT,
    Reading(holding=True),
    Reading(brake=True, holding=True),
    *(Reading(brake=brake, derived=True) for brake in (False, True)),
    *(Reading(usual_height=True, derived=derived) for derived in (False, True)),
    *SQUARE[1:],
)
"""Readings that are pushed; the first two are the columns of every row."""


def pushed(reading: Reading, settings: Settings) -> tuple[Path, ...]:
    """Policies of the pushed robots."""
    return settings.usual_height if reading.usual_height else settings.impacted


def config(reading: Reading, settings: Settings, variants: tuple[Variant, ...], duration: float) -> ImpactCfg:
    """The sweep of a reading over some settings of its device."""
    return ImpactCfg(
        variants=variants,
        trials=len(pushed(reading, settings)) * settings.impacts,
        window=WINDOW,
        duration=duration,
        phases=PHASES,
        gains=trained_gains(pushed(reading, settings)),
        env=impact.fixed_current_env(
            holding=reading.holding,
            coupling=Coupling.CONSTRAINT if reading.brake else Coupling.EXPLICIT,
            z_step=ZStep.EULER,
            threads=settings.threads,
        ),
        seed=settings.seed,
    )


class Pusher:
    """Pushes the same walking robots under one reading after another; they walk in once per kind of device."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self._walkers: dict[tuple[bool, bool], tuple[ImpactSweep, Ensemble]] = {}

    def push(self, reading: Reading, variants: tuple[Variant, ...], duration: float) -> ImpactTrace:
        """All settings of the device at once."""
        cfg, kind = config(reading, self.settings, variants, duration), (reading.brake, reading.usual_height)
        if kind not in self._walkers:
            policy = Ensemble(pushed(reading, self.settings))
            self._walkers[kind] = ImpactSweep(replace(cfg, variants=(Variant(current=0.0),)), policy), policy
            self._walkers[kind][0].walk_in()
        walkers, policy = self._walkers[kind]
        sweep = ImpactSweep(cfg, policy)
        sweep.begin_with(walkers)
        return sweep.run(again=True)


def by_policy(values: np.ndarray, policies: int) -> np.ndarray:
    """Means over the trials of each policy, shape (policies,), of values (N,); of a single policy every trial."""
    return values if policies == 1 else values.reshape(-1, policies).mean(axis=0)


@dataclass(frozen=True, kw_only=True)
class ZeroRow:
    """The row of 0 A with one duration of the push, means over policies."""

    duration: float
    """[s]"""
    onset: float
    """Height at the onset [m]."""
    drop: float
    """Onset less minimum height [m]."""
    speed: float
    """Peak downward speed [m/s]."""
    peak: float
    """Peak motor torque of the front leg that stands [N·m]."""

    @property
    def score(self) -> float:
        """Sum of the squared relative differences from :func:`papers_zero`."""
        return sum((getattr(self, name) / theirs - 1.0) ** 2 for name, theirs in papers_zero().items())


def zero_rows(pusher: Pusher) -> list[ZeroRow]:
    """The row of 0 A with every duration, of the paper's torque; the rule takes the first of the least score."""
    variants = tuple(Variant(current=0.0, duration=duration) for duration in DURATIONS)
    trace = pusher.push(LITERAL, variants, DURATIONS[0])
    rows = []
    for k, duration in enumerate(DURATIONS):
        height, torque = trace.height[k], np.abs(trace.tau_motor[k, :, :, LEGS.index(PAIR[0])])
        found = {
            "onset": height[:, 0],
            "drop": height[:, 0] - height.min(axis=1),
            "speed": -trace.velocity[k].min(axis=1),
            "peak": torque.max(axis=1),
        }
        rows.append(ZeroRow(duration=duration, **{name: float(values.mean()) for name, values in found.items()}))
    return rows


def duration_effects(pusher: Pusher) -> list[dict[str, np.ndarray]]:
    """Changes from 0 to 1.5 A [%] in each of :data:`CELLS`, shape (policies,), by :data:`DURATIONS`.

    Of the paper's torque; it stands next to the rows of 0 A and chooses nothing.
    """
    pairs = [Variant(current=amps, duration=duration) for duration in DURATIONS for amps in (0.0, CURRENT_GROUPS[-1])]
    cells = body_extremes(pusher.push(LITERAL, tuple(pairs), DURATIONS[0]))
    policies = len(pusher.settings.impacted)
    found = {cell: [by_policy(row, policies) for row in values] for cell, values in cells.items()}
    return [
        {cell: 100.0 * (rows[k + 1] / rows[k] - 1.0) for cell, rows in found.items()} for k in range(0, len(pairs), 2)
    ]


EQUAL = 0.01
"""Relative difference of scores that counts as none: a push that outlasts the fall changes them by less."""


def chosen(rows: list[ZeroRow]) -> ZeroRow:
    """The row that the rule takes: the least score; of equals the shortest."""
    least = min(row.score for row in rows)
    return next(row for row in rows if row.score <= (1.0 + EQUAL) * least)


@dataclass(frozen=True, kw_only=True)
class PushResult:
    """Both columns of table 4 under one reading; C currents of eq. 20, N trials."""

    reading: Reading
    onset: np.ndarray
    """Height at the onset [m], shape (N,)."""
    cells: dict[str, np.ndarray]
    """Minimum height [m] and peak downward velocity [m/s] of every trial, shape (C, N)."""
    policies: int
    """Policies; trial i was walked by policy ``i % policies``."""
    fell: int = 0
    """Pushes that brought a robot down, of all currents."""

    def row(self, cell: str, amps: float) -> np.ndarray:
        """:func:`by_policy` of table 4's row of a current [A]."""
        return by_policy(self.cells[cell][CURRENT_GROUPS.index(amps)], self.policies)

    def effect(self, cell: str, amps: float) -> np.ndarray:
        """Change from 0 A [%], each policy against itself."""
        return 100.0 * (self.row(cell, amps) / self.row(cell, 0.0) - 1.0)

    @property
    def drop(self) -> float:
        """Mean onset less minimum height at 0 A [m]."""
        return float((self.onset - self.cells["min_height"][0]).mean())

    @property
    def monotone(self) -> bool:
        """Whether height rises and speed falls with every step of the current."""
        return all(bool((np.diff([self.row(cell, a).mean() for a in CURRENT_GROUPS]) > 0.0).all()) for cell in CELLS)


SERIES = ("t", "height", "velocity", "tau_motor", "tau_mr", "m_dyn", "f_foot", "fell")
"""Series that are kept of :data:`LITERAL` and :data:`JOINT`."""


@dataclass(frozen=True, kw_only=True)
class Pushes:
    """The simulated pushes."""

    zeros: list[ZeroRow]
    """Rows that the duration was chosen among."""
    durations: list[dict[str, np.ndarray]]
    """:func:`duration_effects`."""
    results: list[PushResult]
    """Of all :data:`READINGS`."""
    traces: dict[str, dict[str, np.ndarray]]
    """Series of the two columns by the reading's name, see :class:`mrwarp.trials.impact.ImpactTrace`."""

    @property
    def policies(self) -> int:
        """Policies; trial i was walked by policy ``i % policies``."""
        return self.results[0].policies

    def of(self, reading: Reading) -> PushResult:
        """Result of a reading."""
        return next(result for result in self.results if result.reading == reading)


def simulate(job: Job) -> Findings:
    """Choose the duration by the row of 0 A, then push under every reading at all currents."""
    settings, pusher = job.settings, Pusher(job.settings)
    zeros = zero_rows(pusher)
    results, traces = [], {}
    for k, reading in enumerate(READINGS):
        job.report(reading.name, (1.0 + k) / (1.0 + len(READINGS)))
        duration = DERIVED if reading.derived else chosen(zeros).duration
        trace = pusher.push(reading, tuple(reading.variant(amps) for amps in CURRENT_GROUPS), duration)
        results.append(
            PushResult(
                reading=reading,
                onset=trace.height[0, :, 0],
                cells=body_extremes(trace),
                policies=len(pushed(reading, settings)),
                fell=int(trace.fell.sum()),
            )
        )
        if reading in (LITERAL, JOINT):
            traces[reading.name] = {name: getattr(trace, name) for name in SERIES}
    return job.save(Pushes(zeros=zeros, durations=duration_effects(pusher), results=results, traces=traces))


def read(job: Job) -> Pushes:
    """Data of :func:`simulate`."""
    return job.load("pushes", Pushes)


def fallen(fell: np.ndarray, what: str) -> list[str]:
    """A note on the impacts that brought a robot down, of any shape, under this name; none if nothing fell."""
    if not (count := int(np.sum(fell))):
        return []
    return [f"{count} of {np.size(fell)} {what} brought the trunk below {impact.FALL_HEIGHT:g} m; their figures count."]


EXPERIMENTS = (Experiment(name="pushes", compute=simulate, settings=IMPACTS, seconds=impacts_time(12.0)),)
