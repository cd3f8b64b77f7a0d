"""The impacts of section 6.3 behind tables 4 and 5 and figures 6 and 7: the simulated push, and the falling mass.

The paper states the push's force, not its duration, the motors' gains, which pair of legs stood, or what its row of
0 A had switched on. The rule, which stood before it was run: of a grid over these, the reading whose 0 A row comes
nearest in height at the onset, drop and peak speed is adopted (medians over the pushes of a policy, averaged over
policies; squared relative differences). Every row above 0 A is what comes out. One condition was added after a first
run, whose nearest row was that of robots some of which fell: at most :data:`FALLS` of them may.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from mrwarp import paper
from mrwarp.enums import Coupling, ZStep
from mrwarp.nn.network_file import shipped_model
from mrwarp.params import BoucWenParams, HoldParams
from mrwarp.reproduce import paper_checks
from mrwarp.reproduce.cache import Job
from mrwarp.reproduce.comparison import Findings, seeds_of
from mrwarp.reproduce.settings import PUSHED_GAINS, Ensemble, Settings
from mrwarp.trials import impact
from mrwarp.trials.impact import ImpactCfg, ImpactKind, ImpactSweep, ImpactTrace, Variant, body_extremes
from mrwarp.trials.impact_figures import MOTOR_WINDOW
from mrwarp.trials.walking import Policy
from mrwarp.usd.robot import CURRENT_GROUPS, LEGS, PUBLIC_GAINS, SEGMENTS, TROT_PHASE

CELLS = ("min_height", "peak_down_velocity")
"""The two columns of table 4."""

FL_RR_STANCE = (0.0, 0.5)
"""Gait phases in which FL and RR stand, the pair that carries the paper's simulated impact (figure 6b)."""

FR_RL_STANCE = (0.5, 1.0)
"""Gait phases in which FR and RL stand, the pair that the hardware's impacts were applied to (section 6.3)."""

STANCES = {"FL-RR": FL_RR_STANCE, "FR-RL": FR_RL_STANCE}

KP, KD = (12.0, 16.0, 20.0, 35.0), (0.1, 0.3, 0.6)
"""Gains of the grid [N·m/rad], [N·m·s/rad], which the paper does not state: around the public ones and the asset's."""

DURATIONS = tuple(round(0.1 * k, 1) for k in range(1, 9))
"""Durations of the grid [s], which the paper does not state."""

START = paper.TABLE_2["D"]["height"].mean
"""Height at the push's onset [m]: the mean height of the paper's actuator-aware policy with SAL on."""

SCORED = 6
"""Pushes per policy and duration in the grid."""

FALLS = 0.05
"""Largest share of pushes that may bring a robot down in the 0 A row that is adopted, as at the walking gate: the paper
tells of no falls, and its row spreads by 1 mm."""

WINDOW = 0.8
"""Time after the push's onset over which minima are taken [s]."""

NEARLY_OFF = 1e-3
"""Current that holds nothing but lets the holding gate open [A]: the low gain also without current."""

OFF, OPEN = 0, 1
"""Places of SAL off and of 0 A with open gates among the settings of a push; the currents above 0 A follow."""

TORQUES = ("eq. 14", "pg_rlstm", "unweakened", "yield", "required")
"""Sliding torque of the dynamic branch: eq. 14; eq. 16 by the shipped PG-RLSTM; eq. 14 with alpha = 0; eq. 18 as if it
slid at its yield torque; or what the paper's own rows require, :func:`paper_checks.required_torque`."""


@dataclass(frozen=True, kw_only=True)
class Reading:
    """One set of choices."""

    kp: float
    """Of all motors [N·m/rad]. The asset's Kp of 35 walks with policies trained with it, softer ones with those trained
    with :data:`mrwarp.usd.robot.PUBLIC_GAINS`."""
    kd: float
    """[N·m·s/rad]"""
    stance: str
    """Pair that stands at the onset, of :data:`STANCES`."""
    holding: bool = False
    """Whether both branches of the scheduler act, or damping alone, which section 6.3 evaluates."""
    soft_at_zero: bool = False
    """Whether the row of 0 A has its gates open, so that the low gain of eqs. 8 and 9 acts where nothing holds; else
    SAL is off there."""
    brake: bool = False
    """Whether the devices are brake constraints; else they have the paper's torque."""
    torque: str = "eq. 14"
    """Of :data:`TORQUES`."""
    frozen: bool = False
    """Whether the joints' targets stand still from the onset on, so that no policy answers."""
    lifted: bool = True
    """Whether the joints' targets are moved until the trunk starts at :data:`START`."""
    pushed: bool = False
    """Whether the policies are those trained with :data:`mrwarp.reproduce.settings.PUSHED_GAINS` under such pushes;
    duration and lift are then by the rule anew."""

    @property
    def name(self) -> str:
        """What is chosen, in words."""
        text = [f"Kp {self.kp:g}, Kd {self.kd:g}, {self.stance}", "both branches" if self.holding else "damping alone"]
        text += ["gates open at 0 A"] * self.soft_at_zero + ["brake constraint"] * self.brake
        text += [f"{self.torque} torque"] * (self.torque != "eq. 14") + ["frozen targets"] * self.frozen
        text += ["policies trained with it"] * self.pushed
        return ", ".join(text + ["not lifted"] * (not self.lifted))

    @property
    def zero(self) -> int:
        """Place of the row that stands for the paper's 0 A."""
        return OPEN if self.soft_at_zero else OFF


GRID = tuple(
    Reading(kp=kp, kd=kd, stance=stance, holding=soft, soft_at_zero=soft)
    for kp in KP
    for kd in KD
    for stance in STANCES
    for soft in (False, True)
)
"""What the 0 A row chooses among. With SAL off at 0 A it cannot tell whether both branches act at the currents above;
there damping acts alone, which is what section 6.3 evaluates."""


def variations(adopted: Reading) -> tuple[Reading, ...]:
    """What each choice moves: the adopted reading and those that differ from it in one.

    Last, where they were trained with its gains, the policies that know the push, with either torque.
    """
    other = next(stance for stance in STANCES if stance != adopted.stance)
    knowing = replace(adopted, pushed=True)
    trained = (knowing, replace(knowing, torque="required")) if (adopted.kp, adopted.kd) == PUSHED_GAINS else ()
    return (
        adopted,
        replace(adopted, frozen=True),
        replace(adopted, lifted=False),
        replace(adopted, holding=not adopted.holding, soft_at_zero=False),
        replace(adopted, holding=True, soft_at_zero=not adopted.soft_at_zero),
        replace(adopted, stance=other),
        replace(adopted, kd=0.6 if adopted.kd < 0.6 else 0.1),
        replace(adopted, kp=35.0 if adopted.kp < 35.0 else 20.0),
        replace(adopted, brake=True),
        *(replace(adopted, torque=torque) for torque in TORQUES[1:]),
        *trained,
    )


def stance_legs(phases: tuple[float, float] | None) -> tuple[str, ...]:
    """Legs that the gait clock has on the ground over all of these phases at onset; none where any phase may be."""
    if phases is None:
        return ()
    low, high = phases
    return tuple(leg for leg, at in zip(LEGS, TROT_PHASE, strict=True) if (low + at) % 1.0 + high - low <= 0.5)


@dataclass(frozen=True, kw_only=True)
class GridCell:
    """The 0 A row of one reading, with its best duration; see :func:`medians`."""

    reading: Reading
    duration: float
    """[s]"""
    lift: float
    """Angle by which the knees' targets are opened [rad]."""
    onset: float
    """Height at the onset [m]."""
    drop: float
    """Onset less minimum height [m]."""
    speed: float
    """Peak downward speed [m/s]."""
    score: float
    """Sum of the squared relative differences of these three from the paper's."""
    fell: float
    """Share of the pushes that brought a robot down."""


def medians(values: np.ndarray, policies: int) -> np.ndarray:
    """Medians over the pushes of each policy, shape (policies,); of a single policy every push."""
    return values if policies == 1 else np.array([np.median(values[k::policies]) for k in range(policies)])


@dataclass(frozen=True, kw_only=True)
class PushResult:
    """Both columns of table 4 under one reading; C settings (SAL off, 0 A with open gates, 0.5, 1, 1.5 A), N trials."""

    reading: Reading
    onset: np.ndarray
    """Height at the onset [m], shape (N,)."""
    cells: dict[str, np.ndarray]
    """Minimum height [m] and peak downward velocity [m/s] of every trial, shape (C, N)."""
    policies: int
    """Policies; trial i was walked by policy ``i % policies``."""
    duration: float = math.nan
    """Of the push [s]."""
    fell: int = 0
    """Pushes that brought a robot down, of all settings."""

    def by_policy(self, cell: str, place: int) -> np.ndarray:
        """:func:`medians` of a cell in one setting."""
        return medians(self.cells[cell][place], self.policies)

    def row(self, cell: str, amps: float) -> np.ndarray:
        """:meth:`by_policy` of table 4's row of a current [A]."""
        return self.by_policy(cell, self.reading.zero if amps == 0.0 else OPEN + CURRENT_GROUPS.index(amps))

    def change(self, cell: str, against: int) -> float:
        """Relative change of the mean from SAL off or from open gates at 0 A to 1.5 A."""
        return float(self.row(cell, 1.5).mean() / self.by_policy(cell, against).mean()) - 1.0

    @property
    def worst(self) -> float:
        """Largest relative difference of the six cells above 0 A from the paper's."""
        theirs = paper.TABLE_4["simulation"]
        cells = [(amps, cell) for amps in CURRENT_GROUPS if amps > 0.0 for cell in CELLS]
        return max(abs(float(self.row(cell, amps).mean()) / theirs[amps][cell].mean - 1.0) for amps, cell in cells)

    @property
    def monotone(self) -> bool:
        """Whether height rises and speed falls with every step of the current."""
        return all(bool((np.diff([self.row(cell, a).mean() for a in CURRENT_GROUPS]) > 0.0).all()) for cell in CELLS)


class Guided:
    """A policy whose knees are opened by a constant angle, thighs by half of it against, and that may stop answering.

    Args:
        policy: The policy.
        lift: Angle of the knees [rad].
        scale: Angle per unit of action [rad].
        answers: Calls after which the last action is repeated; None never.
    """

    def __init__(self, policy: Policy, lift: float, scale: float, answers: int | None = None) -> None:
        self._policy, self._answers, self._calls = policy, answers, 0
        self._offset = torch.tensor([{"hip": 0.0, "thigh": -0.5, "calf": 1.0}[s] for _ in LEGS for s in SEGMENTS])
        self._offset *= lift / scale
        self._last = torch.zeros(0)

    def __call__(self, obs: Any) -> torch.Tensor:
        """Actions (E, 12)."""
        if self._answers is None or self._calls < self._answers:
            self._last = self._policy(obs) + self._offset
        self._calls += 1
        return self._last


def sweep(reading: Reading, settings: Settings, *, lift: float, cfg: ImpactCfg) -> ImpactTrace:
    """Push under a reading."""
    paths = settings.aware if reading.kp == KP[-1] else settings.pushed if reading.pushed else settings.impacted
    steps = round(cfg.warmup / cfg.env.step_dt) if reading.frozen else None
    policy = Guided(Ensemble(paths), lift, cfg.env.action_scale, steps)
    return ImpactSweep(cfg, policy).run()


def score(reading: Reading, settings: Settings) -> GridCell:
    """The 0 A row of a reading at every duration of the grid, the best of which counts.

    The knees are opened until the median height at the onset is :data:`START`: a first push tells how far the robot
    sags, :func:`paper_checks.lever` the angle that lifts it.
    """
    policies = len(settings.impacted)
    first = config(reading, settings, trials=policies * min(SCORED, settings.impacts))
    zero = first.variants[reading.zero]

    def push(durations: tuple[float, ...], lift: float, window: float) -> ImpactTrace:
        variants = tuple(replace(zero, duration=duration) for duration in durations)
        cfg = replace(first, variants=variants, window=window, duration=durations[0])
        return sweep(reading, settings, lift=lift, cfg=cfg)

    def level(values: np.ndarray) -> float:
        return float(medians(values, policies).mean())

    sagged = level(push((0.02,), 0.0, 0.02).height[0, :, 0])
    lift = (START - sagged) / paper_checks.lever(START, sagged) if abs(START - sagged) > 1e-3 else 0.0
    trace = push(DURATIONS, lift, WINDOW)
    row = paper.TABLE_4["simulation"][0.0]
    found = []
    for k, duration in enumerate(DURATIONS):
        height = trace.height[k]
        ours = level(height[:, 0]), level(height[:, 0] - height.min(axis=1)), level(-trace.velocity[k].min(axis=1))
        theirs = START, START - row["min_height"].mean, -row["peak_down_velocity"].mean
        squares = sum((x / wanted - 1.0) ** 2 for x, wanted in zip(ours, theirs, strict=True))
        shown = dict(zip(("onset", "drop", "speed"), ours, strict=True))
        fell = float(trace.fell[k].mean())
        found.append(GridCell(reading=reading, duration=duration, lift=lift, score=squares, fell=fell, **shown))
    return min(found, key=rank)


def rank(cell: GridCell) -> tuple[bool, float]:
    """What the rule sorts by: rows with too many falls last, then by the score."""
    return cell.fell > FALLS, cell.score


def fallen(fell: np.ndarray, what: str) -> list[str]:
    """A note on the impacts that brought a robot down, of any shape, under this name; none if nothing fell."""
    if not (count := int(np.sum(fell))):
        return []
    return [f"{count} of {np.size(fell)} {what} brought the trunk below {impact.FALL_HEIGHT:g} m; their figures count."]


def config(reading: Reading, settings: Settings, *, trials: int = 0, duration: float = 0.2) -> ImpactCfg:
    """The sweep of a reading over all settings of :class:`PushResult`; 0 trials take those of the settings."""
    learned = reading.torque == "pg_rlstm"
    return ImpactCfg(
        variants=tuple(device_variant(reading.torque, amps) for amps in (0.0, NEARLY_OFF, *CURRENT_GROUPS[1:])),
        trials=trials or len(settings.impacted) * settings.impacts,
        window=WINDOW,
        duration=duration,
        phases=STANCES[reading.stance],
        gains=(reading.kp, reading.kd),
        env=impact.fixed_current_env(
            holding=reading.holding,
            coupling=Coupling.CONSTRAINT if reading.brake else Coupling.EXPLICIT,
            z_step=ZStep.EULER,
            threads=settings.threads,
            actuator_model="pg_rlstm" if learned else "bouc_wen",
            actuator_file=shipped_model("pg_rlstm") if learned else None,
        ),
        seed=settings.seed,
    )


def device_variant(torque: str, amps: float) -> Variant:
    """A setting of the device; one that is loaded in one direction has z at its bound, where it slides at K1 I z."""
    params: dict[str, float] = {}
    if torque in ("unweakened", "yield", "required"):
        params["alpha"] = 0.0
    if torque in ("yield", "required") and amps > NEARLY_OFF:
        law = HoldParams()
        ratio = (amps / law.K) ** law.n
        wanted = law.T_max * ratio / (1.0 + ratio)
        if torque == "required":
            wanted = float(np.mean(paper_checks.required_torque()[amps]))
        params["K1"] = wanted / (amps * BoucWenParams().z_bound)
    return Variant(current=amps, params=params)


SERIES = ("t", "height", "velocity", "tau_motor", "tau_mr", "m_dyn", "fell")
"""What is kept of the adopted reading's trace, and of that with the required torque."""


@dataclass(frozen=True, kw_only=True)
class Pushes:
    """The simulated pushes."""

    grid: list[GridCell]
    """All of :data:`GRID`, the nearest 0 A row first."""
    readings: list[PushResult]
    """The adopted one first, see :func:`variations`."""
    traces: dict[str, dict[str, np.ndarray]]
    """Series of the adopted reading (``eq. 14``) and of that with the required torque (``required``), see
    :class:`mrwarp.trials.impact.ImpactTrace`."""

    @property
    def adopted(self) -> GridCell:
        """The nearest 0 A row."""
        return self.grid[0]

    @property
    def policies(self) -> int:
        """Policies; trial i was walked by policy ``i % policies``."""
        return self.readings[0].policies


def simulate_pushes(job: Job) -> Findings:
    """Choose a reading by its 0 A row alone, then push with it, and with what differs from it, at all currents."""
    settings, grid = job.settings, []
    for k, reading in enumerate(GRID):
        job.report(reading.name, 0.7 * k / len(GRID))
        grid.append(score(reading, settings))
    grid.sort(key=rank)
    best, found, traces = grid[0], [], {}
    for k, reading in enumerate(readings := variations(best.reading)):
        job.report(reading.name, 0.7 + 0.3 * k / len(readings))
        chosen = best
        if reading.pushed:  # other policies sag otherwise; the torque above 0 A has no say
            chosen = score(replace(reading, torque="eq. 14"), settings)
        cfg = config(reading, settings, duration=chosen.duration)
        trace = sweep(reading, settings, lift=chosen.lift if reading.lifted else 0.0, cfg=cfg)
        result = PushResult(
            reading=reading,
            onset=trace.height[OFF, :, 0],
            cells=body_extremes(trace),
            policies=len(settings.impacted),
            duration=chosen.duration,
            fell=int(trace.fell.sum()),
        )
        found.append(result)
        if reading in (best.reading, replace(best.reading, torque="required")):
            traces[reading.torque] = {name: getattr(trace, name) for name in SERIES}
    return job.save(Pushes(grid=grid, readings=found, traces=traces))


def read_pushes(job: Job) -> Pushes:
    """Data of :func:`simulate_pushes`."""
    return job.load("pushes", Pushes)


DROPS: dict[str, tuple[tuple[float, float] | None, str]] = {
    "Kp 20, Kd 0.5": (PUBLIC_GAINS, "eq. 14"),
    "Kp 35, Kd 0.6": (None, "eq. 14"),
    "Kp 20, Kd 0.5, required torque": (PUBLIC_GAINS, "required"),
}
"""Gains of all motors, which the paper does not state, and sliding torque by name; None is the asset's gains."""


@dataclass(frozen=True, kw_only=True)
class Drops:
    """The simulated falling masses: 10 kg on the backs of walking robots."""

    figures: dict[str, dict[str, np.ndarray]]
    """:func:`measured` by the names in :data:`DROPS`."""
    policies: int
    """Policies; trial i was walked by policy ``i % policies``."""

    def seeds(self) -> np.ndarray | None:
        """Policy of each trial, shape (N,); None with a single policy."""
        return seeds_of(np.arange(next(iter(self.figures.values()))["min_height"].shape[1]), self.policies)


def simulate_drops(job: Job) -> Findings:
    """Drop the mass at every current with each of :data:`DROPS`."""
    settings, policies = job.settings, len(job.settings.impacted)
    found = {}
    for k, (name, (gains, torque)) in enumerate(DROPS.items()):
        job.report(name, k / len(DROPS))
        cfg = ImpactCfg(
            kind=ImpactKind.DROP,
            variants=tuple(device_variant(torque, amps) for amps in CURRENT_GROUPS),
            trials=policies * settings.impacts,
            gains=gains,
            env=impact.fixed_current_env(z_step=ZStep.EULER, threads=settings.threads),
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
