"""Figures 10 and 11: power, charge and temperatures of the pickup-and-return mission, from windows of every phase."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrwarp import paper
from mrwarp.energy import consistency
from mrwarp.energy.power import BatteryCfg, ElectricalCfg
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.enums import Coupling, ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.paper import PaperValue
from mrwarp.runtime import drawing
from mrwarp.trials import walk_figures, walk_pictures
from mrwarp.trials.mission import MissionCfg, MissionTrace, PhaseLoad, calibrate, measure, run
from mrwarp.usd.robot import CALF_COLUMNS
from paper.reproduce import walks
from paper.reproduce.cache import Experiment, Job
from paper.reproduce.comparison import Comparison, Findings, compare, identified
from paper.reproduce.settings import ensembles, over_seeds, walks_time
from paper.reproduce.verdicts import Claim, rows
from paper.study.plan import POWER_PRICE

HELD = (3.0, 0.3)
"""Payload [kg] and speed [m/s] of the walk of table 7 that is the mission's way back, see :class:`MissionCfg`."""

RISES = {
    "calf_walking": "calves, both walks",
    "calf_standby": "calves, standby",
    "all": "all motors, mission",
    "proximal": "hips and thighs, mission",
}
"""Rises as the paper names them; that of hips and thighs follows from its other two."""


@dataclass(frozen=True, kw_only=True)
class Windows:
    """The simulated missions."""

    phases: dict[str, dict[str, PhaseLoad]]
    """By robot and phase."""


@dataclass(frozen=True, kw_only=True)
class Mission:
    """Missions of the three robots, and the numbers that Go1's figures fixed."""

    traces: dict[str, MissionTrace]
    figures: dict[str, Any]
    """By robot, see ``walk_figures.mission_row``."""
    changes: dict[str, Any]
    """From MR_Go to MR_Go-SAL, see ``walk_figures.mission_changes``."""
    errors: dict[tuple[str, ...], float]
    """Standard error of each figure by what Go1's rows leave open of the electrical numbers: by robot, kind and name,
    and of the changes by ``change`` and name."""
    free: int
    """Degrees of freedom behind these."""
    electrical: ElectricalCfg
    thermal: ThermalCfg
    battery: BatteryCfg
    misfit: float
    """To what Go1's calibration rows fit [W], root of the mean square, see table 6."""
    loaded: Mapping[str, tuple[float, float]]
    """Mean squared torque of hips and thighs and of calves [(N·m)^2] of Go1 in the walk :data:`HELD`, by what its
    policies pay for a watt."""
    held: float
    """Share of time [1] in which MR_Go-SAL's calves are held in the walk :data:`HELD`; NaN if none arrived."""
    arrivals: list[str]
    """Note on windows that fell or came too late, see :func:`walks.lost`."""


def simulate(job: Job) -> Findings:
    """Simulate a window of every phase, one per policy, or repetitions of a single one."""
    settings = job.settings
    seeds = settings.policy_seeds if settings.policy_seeds > 1 else settings.rollouts
    env = TaskCfg(coupling=Coupling.EXPLICIT, z_step=ZStep.EULER, threads=settings.threads)
    cfg = MissionCfg(window=settings.window, seeds=seeds, env=env, seed=settings.seed)
    return job.save(Windows(phases=measure(cfg, ensembles(settings.policies), job.report)))


def read(job: Job) -> Mission:
    """Carry the windows over the phases with the numbers calibrated on this run's Go1 alone."""
    phases = job.load("windows", Windows).phases
    walked = walks.read(job)
    fit = walked.calibrated()

    def carried(cfg: ElectricalCfg) -> tuple[dict[str, MissionTrace], ThermalCfg, BatteryCfg]:
        heat, battery, _ = calibrate(phases["go1"], cfg, ThermalCfg(), BatteryCfg())
        return {name: run(found, cfg, heat, battery, feedback=False) for name, found in phases.items()}, heat, battery

    traces, heat, battery = carried(fit.cfg)
    figures, changes, named = _figures(traces)
    errors = fit.error(lambda cfg: np.array(list(_figures(carried(cfg)[0])[2].values())))
    held = [r for r in walked.both if (r.robot, *r.cell) == ("mr_go_sal", *HELD)]
    return Mission(
        traces=traces,
        figures=figures,
        changes=changes,
        errors=dict(zip(named, errors.tolist(), strict=True)),
        free=fit.free,
        electrical=fit.cfg,
        thermal=heat,
        battery=battery,
        misfit=fit.rmse,
        loaded=_loaded(walked),
        held=over_seeds(held[0].hold.mean(-1), walked.seed_of(held[0]))["ours"] if held else math.nan,
        arrivals=arrivals(phases),
    )


def _figures(
    traces: Mapping[str, MissionTrace],
) -> tuple[dict[str, Any], dict[str, Any], dict[tuple[str, ...], float]]:
    """Figures of all robots, changes by SAL, and the means of both by what they are."""
    rows = {robot: walk_figures.mission_row(robot, trace) for robot, trace in traces.items()}
    changes = walk_figures.mission_changes(rows)
    named: dict[tuple[str, ...], float] = {}
    for robot, row in rows.items():
        for kind in ("power", "rise"):
            named |= {(robot, kind, name): cell["mean"] for name, cell in row[kind].items()}
        named[robot, "depletion"] = row["depletion"]["mean"]
    return rows, changes, named | {("change", name): change["ours"] for name, change in changes.items()}


def _loaded(walked: walks.Walks) -> dict[str, tuple[float, float]]:
    """See :attr:`Mission.loaded`."""
    others = [joint for joint in range(12) if joint not in CALF_COLUMNS]
    found = {}
    for price, variant in ((f"{POWER_PRICE:g}", "both"), ("nothing", "no_power_price")):
        for result in walked.results[variant]:
            if (result.robot, *result.cell) == ("go1", *HELD) and len(result.speed):
                square = result.joints.torque_square.mean(0)
                found[price] = float(square[others].mean()), float(square[list(CALF_COLUMNS)].mean())
    return found


def arrivals(phases: Mapping[str, Mapping[str, PhaseLoad]]) -> list[str]:
    """Note on the windows of each robot; what did not finish one way counts on neither."""
    counts = {
        f"{paper.NAMES[robot]}, {name}": (phase.tried, phase.fell, phase.late)
        for robot, found in phases.items()
        for name, phase in found.items()
    }
    return [f"{note} A repetition counts if it finished both ways." for note in walks.lost(counts)]


def fig10(job: Job) -> Findings:
    """Power per phase, depletion, their changes by SAL, and what the paper's own numbers say of each other."""
    found = read(job)
    rows = []
    for robot, trace in found.traces.items():
        name = paper.NAMES[robot]
        for phase, values in trace.power.items():
            cell, standing = found.figures[robot]["power"][phase], phase == "standby"
            why = _standing(found, cell["paper"]) if standing else _walking(robot, found, phase)
            ours = _with_error(found, values[:1] if standing else values, robot, "power", phase)  # stands for all seeds
            row = compare(
                f"{name}, {phase}", ("power", "W", 1), cell["paper"], ours, why, calibrated=cell["calibrated"]
            )
            rows.append(row)
        cell = found.figures[robot]["depletion"]
        theirs = PaperValue(mean=cell["paper"], sd=cell["paper_sd"], n=paper.WALKS)
        ours, why = _with_error(found, trace.depletion, robot, "depletion"), _depletion(robot, found)
        rows.append(compare(name, ("depletion", "points", 1), theirs, ours, why, calibrated=cell["calibrated"]))
    check = consistency.check()
    first = check["by_speed"][0]
    for name in ("outbound_power", "return_power", "depletion"):
        why = (
            f"The paper's own powers ask for {100.0 * (first['energy_ratio'] - 1.0):+.1f} % at equal speeds; what SAL "
            "saves while walking is in the rows above."
            if name == "depletion"
            else _walking("mr_go_sal", found, name.removesuffix("_power"))
        )
        rows.append(change_row(found, name, name.replace("_", " "), "change", why))
    with drawing("power.png"):
        walk_pictures.mission_power(found.traces, job.out / "power.png")
    depletion = found.changes["depletion"]
    return Findings(
        rows=rows,
        **identified(
            ("depletion_lower", "SAL lowers the depletion against MR_Go", depletion["ours"] < 0.0),
            (
                "depletion_as_papers",
                f"by at least {-100.0 * depletion['paper']:.1f} %",
                depletion["ours"] <= depletion["paper"],
            ),
        ),
        notes=found.arrivals,
        pictures={"power.png": "Battery power and state of charge over the mission, mean over seeds"},
        figures={"robots": found.figures, "changes": found.changes, "consistency": check},
    )


def fig11(job: Job) -> Findings:
    """Temperature rises per robot, and the relief of the calves by SAL."""
    found = read(job)
    rows = []
    for robot, trace in found.traces.items():
        for name, title in RISES.items():
            cell, ours = found.figures[robot]["rise"][name], _with_error(found, trace.rise[name], robot, "rise", name)
            condition, why = f"{paper.NAMES[robot]}, {title}", _rise(robot, name, found)
            rows.append(compare(condition, ("rise", "K", 2), cell["paper"], ours, why, calibrated=cell["calibrated"]))
    relief = found.changes["calf_walking_rise"]
    whys = {"calf_walking": _relief(found), "all": _rise("mr_go_sal", "all", found)}
    for name, why in whys.items():
        rows.append(change_row(found, f"{name}_rise", RISES[name], "change of rise", why))
    with drawing("temperature.png"):
        walk_pictures.mission_temperature(found.traces, found.figures, job.out / "temperature.png")
    least = f"SAL lowers the calves' rise while walking by at least {-100.0 * relief['paper']:.1f} %"
    return Findings(
        rows=rows,
        **identified(
            ("calves_cooler", least, relief["ours"] <= relief["paper"]),
            (
                "held_calves_stay_cool",
                "held calves do not warm while standing",
                found.figures["mr_go_sal"]["rise"]["calf_standby"]["mean"] <= 0.5,
            ),
        ),
        notes=[
            *found.arrivals,
            f"{found.thermal.housing_capacity:.0f} J/K and {found.thermal.housing_resistance:.1f} K/W of the housings "
            "are fitted to Go1's calves; every rise of the other robots, and of all motors, is a prediction.",
        ],
        reasons={
            "mission.calf_heat/rise": _relief(found),
            "mission.calf_heat/change": _relief(found),
            "mission.all_heat": _price(found),
        },
        pictures={"temperature.png": "Motor temperatures over the mission, and rises next to the paper's (diamonds)"},
        figures={"changes": found.changes},
    )


def _with_error(found: Mission, values: np.ndarray, *named: str) -> dict[str, Any]:
    """A figure over seeds with its error by the electrical numbers."""
    return {**over_seeds(values), "error": found.errors[named], "error_free": found.free}


def change_row(found: Mission, name: str, title: str, quantity: str, why: str) -> Comparison:
    """Change by SAL against MR_Go, of ``walk_figures.mission_changes``; no spread when one repetition is left."""
    change, n = found.changes[name], min(len(found.traces[robot].depletion) for robot in walks.SAL)
    sd = change["paper_sd"]
    figure = {"ours": 100.0 * change["ours"], "sd": 100.0 * change["sd"] if n > 1 else None, "n": n}
    return compare(
        f"MR_Go to MR_Go-SAL, {title}",
        (quantity, "%", 1),
        PaperValue(mean=100.0 * change["paper"], sd=None if sd is None else 100.0 * sd, n=paper.WALKS),
        {**figure, "error": 100.0 * found.errors["change", name], "error_free": found.free},
        why,
    )


def _standing(found: Mission, theirs: float) -> str:
    return (
        f"Of our standing power {found.electrical.electronics:.0f} W are electronics, calibrated on Go1's rows with a "
        f"wide interval (table 6); the paper's {theirs:.0f} W bound them from above."
    )


def _walking(robot: str, found: Mission, phase: str) -> str:
    ours, theirs = float(found.traces[robot].power[phase].mean()), paper.MISSION_POWER
    if robot != "mr_go_sal":
        off = ours - theirs[robot][phase]
        place = "within" if abs(off) <= found.misfit else "beyond"
        return f"{off:+.1f} W are {place} the {found.misfit:.1f} W (RMS) to which Go1's rows fit, see table 6."
    before = float(found.traces["mr_go"].power[phase].mean())
    saved = theirs["mr_go"][phase] - theirs[robot][phase]
    return f"SAL saves {before - ours:.0f} W here and {saved:.0f} W in the paper, see table 6 for the parts."


def _depletion(robot: str, found: Mission) -> str:
    trace, theirs = found.traces[robot], paper.MISSION_POWER[robot]
    walked = float(sum(trace.seconds[name].mean() for name in ("outbound", "return")))
    energy = sum(float((trace.power[name] * trace.seconds[name]).mean()) / 3600.0 for name in trace.power)
    wanted = sum(theirs[name] * float(trace.seconds[name].mean()) / 3600.0 for name in trace.power)
    return (
        f"{walked:.0f} s of walking: our phases draw {energy:.1f} W·h, the paper's powers over the same "
        f"times {wanted:.1f} W·h of the {found.battery.capacity:.0f} W·h that Go1's depletion gives."
    )


def _rise(robot: str, name: str, found: Mission) -> str:
    if name in ("all", "proximal"):
        return (
            f"Hips and thighs warm by {float(found.traces[robot].rise['proximal'].mean()):.1f} K here; the paper's two "
            f"means imply {paper.proximal_rise(robot):.1f} K: all motors have the calves' housing in our model, and "
            "the policy chooses how much the thighs carry."
        )
    if robot == "go1":
        left = float(found.traces[robot].rise[name].mean()) - paper.MISSION_RISE[robot][name]
        return f"Go1's calves alone fix both numbers of the housings; their fit leaves {left:+.2f} K here."
    relief = _relief(found)
    return f"A prediction from Go1's calves; {relief[:1].lower()}{relief[1:]}"


def _price(found: Mission) -> str:
    """Why hips and thighs stay cool: what policies pay for a watt, an experiment."""
    ours, theirs = float(found.traces["go1"].rise["proximal"].mean()), paper.proximal_rise("go1")
    shares = " and ".join(
        f"{100.0 * others / calves:.0f} % where policies pay {price} per watt"
        for price, (others, calves) in found.loaded.items()
    )
    return (
        f"Go1's hips and thighs warm by {ours:.1f} K and the paper's by {theirs:.1f}. A price on power unloads them: "
        f"their squared torque is of the calves' {shares} (3 kg, 0.3 m/s)."
    )


def _relief(found: Mission) -> str:
    rise = {robot: float(trace.rise["calf_walking"].mean()) for robot, trace in found.traces.items()}
    load, speed = HELD
    theirs = paper.TABLE_7[load, speed]["simulation"]
    shares = f"{100.0 * found.held:.0f} % of the time and the paper's for {100.0 * theirs:.0f} % (table 7)"
    held = "" if math.isnan(found.held) else f" At {load:g} kg and {speed:g} m/s they are held for {shares}."
    return f"Our calves warm by {rise['mr_go_sal']:.1f} K with SAL and {rise['mr_go']:.1f} K without.{held}"


EXPERIMENTS = (
    Experiment(
        name="windows",
        compute=simulate,
        settings=("policies", "rollouts", "window", "seed"),
        seconds=walks_time(40.0, "window", 10.0),
    ),
    Experiment(name="fig10", compute=fig10, needs=("walks", "windows")),
    Experiment(name="fig11", compute=fig11, needs=("walks", "windows")),
)

CLAIMS = (
    Claim(
        id="mission.power/mr_go",
        place="Figure 10",
        says="power of MR_Go out, standing, back [W]",
        measure=rows("fig10", "power", *(f"MR_Go, {phase}" for phase in ("outbound", "standby", "return"))),
        why="By numbers fitted to Go1's rows alone; while standing the devices hold.",
    ),
    Claim(
        id="mission.power/mr_go_sal",
        place="Figure 10",
        says="power of MR_Go-SAL, same order [W]",
        measure=rows("fig10", "power", *(f"MR_Go-SAL, {phase}" for phase in ("outbound", "standby", "return"))),
        why="By numbers fitted to Go1's rows alone.",
    ),
    Claim(
        id="mission.power/depletion",
        place="Figure 10",
        says="depletion of MR_Go, MR_Go-SAL [points]",
        measure=rows("fig10", "depletion", "MR_Go", "MR_Go-SAL"),
        why="Our depletion follows from the powers.",
    ),
    Claim(
        id="walk.saving/depletion",
        place="Figure 10",
        says="change of the depletion by SAL [%]",
        measure=rows("fig10", "change", "MR_Go to MR_Go-SAL, depletion"),
        effect=True,
        why="Ours follows from the powers; the paper's power and charge exclude each other.",
    ),
    Claim(
        id="mission.calf_heat/rise",
        place="Figure 11",
        says="rise of the calves while walking, MR_Go, MR_Go-SAL [K]",
        measure=rows("fig11", "rise", *(f"{name}, calves, both walks" for name in ("MR_Go", "MR_Go-SAL"))),
        why="Two thermal numbers are fitted to Go1's calves, the rest is predicted.",
    ),
    Claim(
        id="mission.calf_heat/change",
        place="Figure 11",
        says="change of that rise by SAL [%]",
        measure=rows("fig11", "change of rise", "MR_Go to MR_Go-SAL, calves, both walks"),
        effect=True,
        why="The calves rest while held.",
    ),
    Claim(
        id="mission.all_heat",
        place="Figure 11",
        says="rise of all motors, Go1, MR_Go, MR_Go-SAL [K]",
        measure=rows("fig11", "rise", *(f"{name}, all motors, mission" for name in ("Go1", "MR_Go", "MR_Go-SAL"))),
        why="Our hips and thighs carry and warm less than the paper's.",
    ),
)
