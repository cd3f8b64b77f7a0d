"""The mission behind figures 10 and 11: windows of every phase, simulated once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mrwarp import paper
from mrwarp.energy.battery import BatteryCfg
from mrwarp.energy.power import ElectricalCfg, JointLoad
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.enums import Coupling
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.paper import PaperValue
from mrwarp.reproduce import store
from mrwarp.reproduce import walks as walking
from mrwarp.reproduce.ensemble import ensembles
from mrwarp.reproduce.experiment import Comparison, Experiment, Findings, Job, over_seeds
from mrwarp.trials.mission import MissionCfg, MissionTrace, PhaseLoad, calibrate, measure, run

DATA = "mission.npz"
"""File with the data."""


@dataclass(frozen=True, kw_only=True)
class Mission:
    """Missions of the three robots, and the numbers that Go1's figures fixed."""

    traces: dict[str, MissionTrace]
    electrical: ElectricalCfg
    thermal: ThermalCfg
    battery: BatteryCfg
    misfit: float
    """To what Go1's calibration rows fit [W], root of the mean square, see table 6."""
    held: float
    """Share of time [1] in which MR_Go-SAL's calves are held in the walk :data:`HELD` of table 7; NaN if none
    arrived."""
    arrivals: list[str]
    """Note on windows that fell or came too late, see :func:`walking.lost`."""


HELD = (3.0, 0.3)
"""Payload [kg] and speed [m/s] of that walk, those of the way back, see :class:`MissionCfg`."""


def simulate(job: Job) -> Findings:
    """Simulate a window of every phase, one per policy, or repetitions of a single one."""
    settings = job.settings
    seeds = settings.policy_seeds if settings.policy_seeds > 1 else settings.rollouts
    env = make_walk_cfg(coupling=Coupling.EXPLICIT, threads=settings.threads)
    cfg = MissionCfg(window=settings.window, seeds=seeds, env=env, seed=settings.seed)
    store.save(job.out / DATA, measure(cfg, ensembles(settings), job.report))
    return Findings()


def read(job: Job) -> Mission:
    """Carry the windows over the phases with the numbers calibrated on this run's Go1 alone."""
    phases = {
        robot: {name: PhaseLoad(**{**phase, "joints": JointLoad(**phase["joints"])}) for name, phase in found.items()}
        for robot, found in store.load(job.folders["windows"] / DATA).items()
    }
    walks = walking.read(job.folders["walks"])
    fit = walks.calibrated()
    heat, battery, _ = calibrate(phases["go1"], fit.cfg, ThermalCfg(), BatteryCfg())
    traces = {robot: run(found, fit.cfg, heat, battery, feedback=False) for robot, found in phases.items()}
    return Mission(
        traces=traces, electrical=fit.cfg, thermal=heat, battery=battery, misfit=fit.rmse, held=_held(walks),
        arrivals=arrivals(phases),
    )  # fmt: skip


def change_row(found: Mission, change: Mapping[str, Any], title: str, quantity: str, why: str) -> Comparison:
    """What SAL changes against MR_Go, of :func:`mission_figures.changes`; no spread when one repetition is left."""
    n = min(len(found.traces[robot].depletion) for robot in ("mr_go", "mr_go_sal"))
    theirs = change["paper_sd"]
    return Comparison(
        condition=f"MR_Go to MR_Go-SAL, {title}", quantity=quantity, unit="%", digits=1,
        paper=PaperValue(mean=100.0 * change["paper"], sd=None if theirs is None else 100.0 * theirs),
        ours=100.0 * change["ours"], sd=100.0 * change["sd"] if n > 1 else None, n=n, why=why,
    )  # fmt: skip


def arrivals(phases: Mapping[str, Mapping[str, PhaseLoad]]) -> list[str]:
    """Note on the windows of each robot; what did not finish one way counts on neither."""
    note = walking.lost({
        f"{paper.NAMES[robot]}, {name}": (phase.tried, phase.fell, phase.late)
        for robot, found in phases.items() for name, phase in found.items()
    })  # fmt: skip
    return [f"{note[0]} A repetition counts if it finished both ways."] if note else []


def _held(walks: walking.Walks) -> float:
    for result in walks.both:
        if (result.robot, result.payload, result.command) == ("mr_go_sal", *HELD):
            return over_seeds(result.hold.mean(-1), walks.seed_of(result))["ours"]
    return math.nan


EXPERIMENT = Experiment(
    name="windows", compute=simulate, shown=False,
    settings=("policies", "rollouts", "window", "seed"),
)  # fmt: skip
