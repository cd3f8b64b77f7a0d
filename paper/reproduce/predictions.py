"""Figures that were predicted before anybody had run them: intervals frozen in a commit, then one run, hits and misses.

The rule, which stood before the run. A prediction's centre is what was measured, carried over by a closed form; its
half width is that of a 90 % interval by Student's t over training seeds, of which one in ten is missed by chance:

* *New training seeds* (:data:`NEW_SEEDS`) of table 2's policies: the mean over n seeds predicts that over m others,
  half width t s sqrt(1/n + 1/m). The first were trained with the devices' network of an earlier bench, these with the
  one that is shipped; the rule takes that for nothing.
* *The same policies elsewhere*, from poses and gait phases that they never started from: half width t s/sqrt(n),
  where s is what the closed form makes of the measured spreads as though these were independent. It tests the form.

  * 5 kg on the back: a line in the load through 0 and 3 kg (the trainings ended at 3.5 kg).
  * A gait of 2 Hz: by similarity the angles at 2 Hz and a speed v are those at 1.5 Hz and 3/4 v, 4/3 times as fast, so
    that eps_hold counts as 3/4 of it; the support branch's row of 0.15 rad/s, as a line in the speed.
  * A lighter falling mass on the same pad: by momentum the robot's speed is in proportion to m/(m + M).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from mrwarp import paper
from mrwarp.energy.model_numbers import calibrate
from mrwarp.enums import Coupling, ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.options.json_file import read_json_file
from mrwarp.resources import POLICIES, policy_file
from mrwarp.run_dir import write_text
from mrwarp.trials import walk_figures
from mrwarp.trials.impact import ImpactSweep, Variant
from mrwarp.trials.walk_trials import WalkCfg, standing_load, walk
from mrwarp.trials.walking import PAYLOAD_VARIANT
from mrwarp.usd.robot import GAIT_FREQUENCY
from paper.reproduce import walks
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import CELLS, Findings, TextTable, identified, over_seeds, seeds_of
from paper.reproduce.disturbance import drop_trials
from paper.reproduce.disturbance.drop_trials import Drop
from paper.reproduce.disturbance.table4 import DROPPED
from paper.reproduce.settings import (
    Ensemble,
    NotYet,
    ensembles,
    networks,
    rollouts_time,
    walks_time,
)
from paper.reproduce.table2 import TRAINED
from paper.reproduce.verdicts import Results, change
from paper.study import paper_tables
from paper.study.plan import AWARE, CONVENTIONAL
from paper.study.rollouts import PLANT, EvaluationCfg

UNSEEN = POLICIES / "unseen"
"""Policies of the new seeds, and the frozen intervals."""

FROZEN = "predictions.json"
"""The intervals, in that folder."""

LEVEL = 0.9
"""Share of the intervals that should be hit."""

WIDE = 0.25
"""Width of an interval, relative to its centre, beyond which a hit proves little."""

NEW_SEEDS = (5, 6, 7, 8, 9)
"""Training seeds that no figure had seen."""

LOAD = 5.0
"""Load on the back [kg]."""

PACE, PACED = 2.0, (0.4, 0.5)
"""Stride frequency [Hz], and the speeds walked with it [m/s]."""

LIGHT = 5.0
"""Falling mass [kg]."""

WITHDRAWN = ("push of", "drop of")
"""Beginnings of the conditions that were frozen for policies that are no longer shipped, and for readings of table 4
that are no longer made. They are neither run nor counted."""

METRICS = {
    "v_x_rmse": ("v_x RMSE", "m/s", 3),
    "v_x_bias": ("v_x bias", "m/s", 3),
    "height": ("mean CoM height", "m", 3),
}
"""Of table 2: quantity, unit and digits."""

COT, REDUCTION, HELD = ("COT", "", 2), ("reduction of COT", "%", 1), ("activation", "%", 1)
SPEED = ("peak downward velocity", "m/s", 3)
CHANGE = ("change of v_x RMSE by training", "%", 1)

Quantity = tuple[str, str, int]


@dataclass(frozen=True, kw_only=True)
class Prediction:
    """One frozen interval."""

    condition: str
    quantity: str
    unit: str
    digits: int
    centre: float
    half_width: float

    @property
    def wide(self) -> bool:
        """Whether the interval is wider than :data:`WIDE` of its value: hit cheaply, it proves little."""
        return 2.0 * self.half_width > WIDE * abs(self.centre)

    def hit(self, came: float) -> bool:
        """Whether what came lies in the interval; NaN, where no robot arrived, does not."""
        return abs(came - self.centre) <= self.half_width


@dataclass(frozen=True, kw_only=True)
class Known:
    """A measured mean over seeds, its spread, and how many seeds."""

    mean: float
    sd: float
    n: int

    def times(self, factor: float) -> Known:
        """In proportion."""
        return Known(mean=factor * self.mean, sd=abs(factor) * self.sd, n=self.n)

    def plus(self, other: Known) -> Known:
        """Sum of two, as though independent."""
        return Known(mean=self.mean + other.mean, sd=math.hypot(self.sd, other.sd), n=min(self.n, other.n))


def between(first: Known, second: Known, share: float) -> Known:
    """On the line from the first (0) through the second (1)."""
    return first.times(1.0 - share).plus(second.times(share))


def interval(known: Known, new: int | None = None) -> float:
    """Half width: ``new`` is the number of new seeds; None where the same policies walk."""
    t = float(stats.t.ppf(0.5 + 0.5 * LEVEL, known.n - 1))
    return t * known.sd * math.sqrt(1.0 / known.n + (1.0 / new if new else 0.0))


def freeze(found: Results) -> list[Prediction]:
    """All predictions by the rule, from the committed results alone."""
    made = []

    def add(condition: str, quantity: Quantity, known: Known, new: int | None = None) -> None:
        name, unit, digits = quantity
        shown = {"condition": condition, "quantity": name, "unit": unit, "digits": digits}
        made.append(Prediction(**shown, centre=known.mean, half_width=interval(known, new)))

    def row(part: str, condition: str, quantity: str) -> Known:
        figure = found.row(part, condition, quantity)
        return Known(mean=figure.ours, sd=figure.sd or 0.0, n=figure.n)

    for condition in TRAINED.values():
        for quantity in METRICS.values():
            add(condition, quantity, row("table2", condition, quantity[0]), len(NEW_SEEDS))
    for sal, (first, second) in paper_tables.PAIRS.items():
        figure = change("table2", "v_x RMSE", (TRAINED[first], TRAINED[second]))(found)[0]
        known = Known(mean=figure.ours, sd=figure.sd or 0.0, n=figure.n)
        add(f"SAL {sal}", CHANGE, known, len(NEW_SEEDS))
    for k, speed in enumerate((0.3, 0.5)):
        for robot in walks.SAL:
            name = paper.NAMES[robot]
            bare, loaded = (row("table6", f"{name}, {cell}", COT[0]) for cell in (CELLS[k], CELLS[k + 2]))
            add(f"{name}, {paper.condition_name(LOAD, speed)}", COT, between(bare, loaded, LOAD / 3.0))
        saved, held = _saved(row, k), _held(row, k)
        saved_loaded, held_loaded = _saved(row, k + 2), _held(row, k + 2)
        condition = paper.condition_name(LOAD, speed)
        add(condition, REDUCTION, between(saved, saved_loaded, LOAD / 3.0))
        add(condition, HELD, between(held, held_loaded, LOAD / 3.0))
    slower = PACE / GAIT_FREQUENCY
    table = {line[0]: line[1:] for line in found.table("support", "choices")["rows"]}
    cells = [tuple(map(float, text.split(","))) for text in table["eps_hold 0.15 rad/s"][:2]]
    for speed in PACED:
        share = (speed / slower - 0.3) / 0.2
        for which, quantity, spread in ((0, REDUCTION, _saved), (1, HELD, _held)):
            slow, fast = (replace(spread(row, k), mean=cells[k][which]) for k in (0, 1))
            add(f"{PACE:g} Hz, {paper.condition_name(0.0, speed)}", quantity, between(slow, fast, share))
    body, heavy = paper.MASS["mr_go"], paper.IMPACTOR["mass"]
    slowed = (LIGHT / (LIGHT + body)) / (heavy / (heavy + body))
    for drop in drop_trials.COLUMNS:
        for amps in (0.0, 1.5):
            known = row("table4", DROPPED.format(f"{amps:g} A") + drop.column, SPEED[0]).times(slowed)
            add(_falls(drop, amps), SPEED, known)
    return made


def _falls(drop: Drop, amps: float) -> str:
    """Condition of the lighter falling mass."""
    return f"{LIGHT:g} kg fall, {amps:g} A{drop.column}"


def _saved(row: Any, k: int) -> Known:
    return row("table6", f"SAL against MR_Go, {CELLS[k]}", REDUCTION[0])


def _held(row: Any, k: int) -> Known:
    return row("table7", f"{CELLS[k]}, paper's simulation", HELD[0])


def write(found: Results, folder: Path = UNSEEN) -> Path:
    """Freeze the predictions.

    Raises:
        ValueError: they are frozen already.
    """
    path = folder / FROZEN
    if path.exists():
        raise ValueError(f"{path}: is frozen; predictions are made once")
    folder.mkdir(parents=True, exist_ok=True)
    content = {"level": LEVEL, "new_seeds": NEW_SEEDS, "predictions": [asdict(each) for each in freeze(found)]}
    return write_text(path, json.dumps(content, indent=1, ensure_ascii=False) + "\n")


def read(folder: Path = UNSEEN) -> list[Prediction]:
    """The frozen predictions."""
    found = read_json_file(folder / FROZEN, "run 'mrwarp reproduce docs --freeze'")
    return [Prediction(**each) for each in found["predictions"]]


def trained() -> tuple[int, ...]:
    """Those of the new seeds whose policies are there, of either training."""
    both = {seed: [policy_file(UNSEEN, plant, seed).is_file() for plant in (CONVENTIONAL, AWARE)] for seed in NEW_SEEDS}
    return tuple(seed for seed, there in both.items() if all(there))


def files() -> list[Path]:
    """Frozen intervals and policies of the new seeds.

    Raises:
        NotYet: nothing is frozen.
    """
    if not (UNSEEN / FROZEN).is_file():
        raise NotYet(f"{UNSEEN / FROZEN}: nothing is frozen; 'mrwarp reproduce docs --freeze' does that")
    return [UNSEEN / FROZEN, *(policy_file(UNSEEN, plant, k) for plant in (CONVENTIONAL, AWARE) for k in trained())]


@dataclass(frozen=True, kw_only=True)
class Trials:
    """Outcomes of the policies that were there when the intervals were frozen."""

    came: dict[str, dict[str, float]]
    """By condition and quantity."""


def simulate(job: Job) -> Findings:
    """Walk and hit what was predicted of table 6's and table 4's policies."""
    came: dict[str, dict[str, float]] = {}
    for k, (name, part) in enumerate((("loads and gait", _walked), ("drops", _dropped))):
        job.report(name, k / 2.0)
        for (condition, quantity), value in part(job).items():
            came.setdefault(condition, {})[quantity] = value
    return job.save(Trials(came=came))


def compute(job: Job) -> Findings:
    """Predictions and their outcome: hits and misses. New training seeds are walked here."""
    trials = job.load("unseen", Trials).came
    came = {(condition, name): value for condition, found in trials.items() for name, value in found.items()}
    came |= _trained(job)
    frozen = read()
    return findings([(each, came.get((each.condition, each.quantity))) for each in frozen])


def findings(pairs: list[tuple[Prediction, float | None]]) -> Findings:
    """The table of predictions and what came; None has not been run."""
    rows = []
    run = [(each, value) for each, value in pairs if value is not None]
    for each, value in pairs:
        bounds = (each.centre - each.half_width, each.centre + each.half_width)
        low, high = (f"{bound:.{each.digits}f}" for bound in bounds)
        unit = f" [{each.unit}]" if each.unit else ""
        if value is None:
            shown, verdict = "", "withdrawn" if each.condition.startswith(WITHDRAWN) else "not run yet"
        else:
            shown = f"{value:.{each.digits}f}" if math.isfinite(value) else "none arrived"
            verdict = ("hit, proves little" if each.wide else "hit") if each.hit(value) else "missed"
        rows.append([each.condition, f"{each.quantity}{unit}", f"{low} to {high}", shown, verdict])
    hits = sum(each.hit(value) for each, value in run)
    narrow = [(each, value) for each, value in run if not each.wide]
    most = (
        f"{hits} of {len(run)} hit their {100.0 * LEVEL:.0f} % interval. {len(run) - len(narrow)} intervals are wider "
        f"than {100.0 * WIDE:.0f} % of their value, and a hit of theirs proves little; of the {len(narrow)} others "
        f"{sum(each.hit(value) for each, value in narrow)} hit"
    )
    waiting = [each for each, value in pairs if value is None and not each.condition.startswith(WITHDRAWN)]
    left = f", {len(waiting)} are not run yet" if waiting else ""
    return Findings(
        **identified(
            ("hit", f"at least {100.0 * LEVEL:.0f} % of the frozen intervals are hit", hits >= LEVEL * len(run))
        ),
        tables=[
            TextTable(
                title=f"Frozen before they were run: {most}{left}",
                head=["condition", "quantity", "predicted", "came", ""],
                rows=rows,
                id="frozen",
            )
        ],
        figures={"hits": hits, "predictions": [asdict(each) | {"came": value} for each, value in pairs]},
    )


Came = Mapping[tuple[str, str], float]
"""Outcomes by condition and quantity."""


def _trained(job: Job) -> Came:
    """Table 2 with policies of the new seeds; nothing before some are trained."""
    settings, seeds = job.settings, trained()
    if len(seeds) < 2:  # one has no spread
        return {}
    cfg = EvaluationCfg(
        coupling=Coupling.CONSTRAINT,
        folder=UNSEEN,
        seeds=seeds,
        rollouts=settings.rollouts,
        seed=settings.seed + 1,
        threads=settings.threads,
    )
    table = paper_tables.table2(cfg)
    found = {
        (TRAINED[name], quantity[0]): float(row.seeds[metric].mean())
        for name, row in table.rows.items()
        for metric, quantity in METRICS.items()
    }
    return found | {(f"SAL {sal}", CHANGE[0]): -100.0 * table.rmse[sal].reduction for sal in paper_tables.PAIRS}


def _walked(job: Job) -> Came:
    """Table 6's policies with the load, and at the pace."""
    settings, found = job.settings, {}
    env = TaskCfg(coupling=Coupling.EXPLICIT, z_step=ZStep.EULER, threads=settings.threads)
    n = settings.policy_seeds
    policies = ensembles(settings.policies)
    base = WalkCfg(
        robots=walks.SAL, trials=n * settings.rollouts, distance=settings.distance, seed=settings.seed + 1, env=env
    )
    # Go1's rows of table 6 calibrate, from the poses they have there
    calibrating = walk(replace(base, robots=("go1",), seed=settings.seed), policies)
    stood, _ = standing_load(
        replace(env, robot="go1", payload=PAYLOAD_VARIANT, currents=(1.5,)), load=paper.arm_load(), hold=False
    )
    electrical = calibrate(walk_figures.calibration_rows(calibrating, stood)).cfg
    paced = replace(base, payloads=(0.0,), speeds=PACED, env=replace(env, gait_frequency=PACE))
    for begins, cfg in (("", replace(base, payloads=(LOAD,))), (f"{PACE:g} Hz, ", paced)):
        cots: dict[str, dict[str, float]] = {}
        for result in walk(cfg, policies):
            seeds, condition = seeds_of(result.trial, n), begins + result.condition
            cot = over_seeds(walk_figures.cot(result, electrical), seeds)["ours"]
            cots.setdefault(condition, {})[result.robot] = cot
            found[f"{paper.NAMES[result.robot]}, {condition}", COT[0]] = cot
            if result.robot == "mr_go_sal":
                held = over_seeds(result.hold.mean(-1), seeds)["ours"] if len(result.hold) else math.nan
                found[condition, HELD[0]] = 100.0 * held
        for condition, cot in cots.items():
            found[condition, REDUCTION[0]] = 100.0 * (1.0 - cot["mr_go_sal"] / cot["mr_go"])
    return found


def _dropped(job: Job) -> Came:
    """The falling mass of table 4's hardware, lighter."""
    settings, paths, found = job.settings, job.settings.impacted, {}
    currents = (0.0, 1.5)
    for drop in drop_trials.COLUMNS:
        cfg = drop_trials.config(drop, settings, paths, tuple(Variant(current=amps) for amps in currents))
        cfg = replace(cfg, mass=replace(cfg.mass, mass=LIGHT), seed=settings.seed + 1)
        values = drop_trials.measured(ImpactSweep(cfg, Ensemble(paths)).run())["peak_down_velocity"]
        seeds = seeds_of(np.arange(cfg.trials), len(paths))
        for amps, row in zip(currents, values, strict=True):
            found[_falls(drop, amps), SPEED[0]] = over_seeds(row, seeds)["ours"]
    return found


EXPERIMENTS = (
    Experiment(
        name="unseen",
        compute=simulate,
        settings=("policies", "impacted", "rollouts", "distance", "impacts", "seed"),
        seconds=walks_time(120.0, "distance", 30.0),
    ),
    Experiment(
        name="predictions",
        compute=compute,
        needs=("unseen",),
        settings=("rollouts", "seed"),
        files=lambda: [*files(), *networks((PLANT,))],
        seconds=rollouts_time,
    ),
)
