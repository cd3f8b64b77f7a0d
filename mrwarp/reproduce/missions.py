"""The mission behind figures 10 and 11: windows of every phase, simulated once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from mrwarp import paper
from mrwarp.energy.power import BatteryCfg, ElectricalCfg
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.enums import Coupling
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.reproduce import walks
from mrwarp.reproduce.cache import Job
from mrwarp.reproduce.comparison import Findings, over_seeds
from mrwarp.reproduce.policies import ensembles
from mrwarp.trials.mission import MissionCfg, MissionTrace, PhaseLoad, calibrate, measure, run

HELD = (3.0, 0.3)
"""Payload [kg] and speed [m/s] of the walk of table 7 that is the mission's way back, see :class:`MissionCfg`."""


@dataclass(frozen=True, kw_only=True)
class Windows:
    """What was simulated."""

    phases: dict[str, dict[str, PhaseLoad]]
    """By robot and phase."""


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
    """Share of time [1] in which MR_Go-SAL's calves are held in the walk :data:`HELD`; NaN if none arrived."""
    arrivals: list[str]
    """Note on windows that fell or came too late, see :func:`walks.lost`."""


def simulate(job: Job) -> Findings:
    """Simulate a window of every phase, one per policy, or repetitions of a single one."""
    settings = job.settings
    seeds = settings.policy_seeds if settings.policy_seeds > 1 else settings.rollouts
    env = make_walk_cfg(coupling=Coupling.EXPLICIT, threads=settings.threads)
    cfg = MissionCfg(window=settings.window, seeds=seeds, env=env, seed=settings.seed)
    return job.save(Windows(phases=measure(cfg, ensembles(settings.policies), job.report)))


def read(job: Job) -> Mission:
    """Carry the windows over the phases with the numbers calibrated on this run's Go1 alone."""
    phases = job.load("windows", Windows).phases
    walked = walks.read(job)
    fit = walked.calibrated()
    heat, battery, _ = calibrate(phases["go1"], fit.cfg, ThermalCfg(), BatteryCfg())
    held = [r for r in walked.both if (r.robot, *r.cell) == ("mr_go_sal", *HELD)]
    return Mission(
        traces={robot: run(found, fit.cfg, heat, battery, feedback=False) for robot, found in phases.items()},
        electrical=fit.cfg,
        thermal=heat,
        battery=battery,
        misfit=fit.rmse,
        held=over_seeds(held[0].hold.mean(-1), walked.seed_of(held[0]))["ours"] if held else math.nan,
        arrivals=arrivals(phases),
    )


def arrivals(phases: Mapping[str, Mapping[str, PhaseLoad]]) -> list[str]:
    """Note on the windows of each robot; what did not finish one way counts on neither."""
    counts = {
        f"{paper.NAMES[robot]}, {name}": (phase.tried, phase.fell, phase.late)
        for robot, found in phases.items()
        for name, phase in found.items()
    }
    return [f"{note} A repetition counts if it finished both ways." for note in walks.lost(counts)]
