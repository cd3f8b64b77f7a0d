"""The mission behind figures 10 and 11: windows of every phase, simulated once."""

from __future__ import annotations

from dataclasses import dataclass

from mrwarp.electrical.battery import BatteryCfg
from mrwarp.electrical.power import ElectricalCfg, Use
from mrwarp.electrical.thermal import ThermalCfg
from mrwarp.env.cfg import make_walk_cfg
from mrwarp.evaluate.mission import MissionCfg, MissionTrace, PhaseUse, calibrate, measure, run
from mrwarp.reproduce import store, walking
from mrwarp.reproduce.experiment import Experiment, Findings, Job
from mrwarp.reproduce.settings import ensembles

DATA = "mission.npz"
"""File with the data."""


@dataclass(frozen=True, kw_only=True)
class Mission:
    """Missions of the three robots, and the numbers that Go1's figures fixed."""

    traces: dict[str, MissionTrace]
    electrical: ElectricalCfg
    thermal: ThermalCfg
    battery: BatteryCfg


def simulate(job: Job) -> Findings:
    """Simulate a window of every phase, one per policy, or repetitions of a single one."""
    settings = job.settings
    seeds = settings.policy_seeds if settings.policy_seeds > 1 else settings.rollouts
    cfg = MissionCfg(
        window=settings.window, seeds=seeds, env=make_walk_cfg(threads=settings.threads), seed=settings.seed
    )
    store.save(job.out / DATA, measure(cfg, ensembles(settings), job.report))
    return Findings()


def read(job: Job) -> Mission:
    """Carry the windows over the phases with the numbers calibrated on this run's Go1 alone."""
    phases = {
        robot: {name: PhaseUse(**{**phase, "use": Use(**phase["use"])}) for name, phase in found.items()}
        for robot, found in store.load(job.folders["windows"] / DATA).items()
    }
    electrical = walking.read(job.folders["walks"]).calibrated().cfg
    heat, battery, _ = calibrate(phases["go1"], electrical, ThermalCfg(), BatteryCfg())
    traces = {robot: run(found, electrical, heat, battery, feedback=False) for robot, found in phases.items()}
    return Mission(traces=traces, electrical=electrical, thermal=heat, battery=battery)


EXPERIMENT = Experiment(
    name="windows", title="Windows of the mission", compute=simulate, shown=False,
    settings=("policies", "rollouts", "window", "seed"),
)  # fmt: skip
