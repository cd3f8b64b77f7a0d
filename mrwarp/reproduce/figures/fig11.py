"""Figure 11: temperature rises of calves and all motors over the mission."""

from __future__ import annotations

import math

import numpy as np

from mrwarp import paper
from mrwarp.reproduce import missions
from mrwarp.reproduce.experiment import Findings, Job, compare, over_seeds
from mrwarp.reproduce.missions import Mission
from mrwarp.trials import mission_figures, walk_pictures

TITLES = {
    "calf_walking": "calves, both walks", "calf_standby": "calves, standby", "all": "all motors, mission",
    "proximal": "hips and thighs, mission",
}  # fmt: skip
"""Rises as the paper names them; that of hips and thighs follows from its other two."""


def compute(job: Job) -> Findings:
    """Rises per robot, and the relief of the calves by SAL."""
    found = missions.read(job)
    figures = {robot: mission_figures.row(robot, trace) for robot, trace in found.traces.items()}
    rows = []
    for robot, trace in found.traces.items():
        for name, title in TITLES.items():
            cell = figures[robot]["rise"][name]
            ours, why = over_seeds(trace.rise[name]), _why(robot, name, found)
            condition = f"{paper.NAMES[robot]}, {title}"
            rows.append(compare(condition, ("rise", "K", 2), cell["paper"], ours, why, calibrated=cell["calibrated"]))
    change = mission_figures.changes(figures)
    relief = change["calf_walking_rise"]
    for name, title in (("calf_walking_rise", TITLES["calf_walking"]), ("all_rise", TITLES["all"])):
        why = _relief(found) if name == "calf_walking_rise" else _why("mr_go_sal", "all", found)
        rows.append(missions.change_row(found, change[name], title, "change of rise", why))
    walk_pictures.mission_temperature(found.traces, figures, job.out / "temperature.png")
    return Findings(
        rows=rows,
        claims={
            f"SAL lowers the calves' rise while walking by at least {-100.0 * relief['paper']:.1f} %": relief["ours"]
            <= relief["paper"],
            "held calves do not warm while standing": figures["mr_go_sal"]["rise"]["calf_standby"]["mean"] <= 0.5,
        },
        notes=[
            *found.arrivals,
            f"{found.thermal.housing_capacity:.0f} J/K and {found.thermal.housing_resistance:.1f} K/W of the housings "
            "are fitted to Go1's calves; every rise of the other robots, and of all motors, is a prediction.",
        ],
        pictures={"temperature.png": "Motor temperatures over the mission, and rises beside the paper's (black marks)"},
        figures={"changes": change},
    )  # fmt: skip


def _why(robot: str, name: str, found: Mission) -> str:
    proximal = float(found.traces[robot].rise["proximal"].mean())
    theirs = paper.proximal_rise(robot)
    if name in ("all", "proximal"):
        return (
            f"Hips and thighs warm by {proximal:.1f} K here; the paper's two means imply {theirs:.1f} K: all motors "
            "have the calves' housing in our model, and the policy chooses how much the thighs carry."
        )
    if robot == "go1":
        left = float(found.traces[robot].rise[name].mean()) - paper.MISSION_RISE[robot][name]
        return f"Go1's calves alone fix both numbers of the housings; their fit leaves {left:+.2f} K here."
    return "A prediction from Go1's calves; " + _relief(found)[:1].lower() + _relief(found)[1:]


def _relief(found: Mission) -> str:
    rise = {robot: float(np.mean(trace.rise["calf_walking"])) for robot, trace in found.traces.items()}
    load, speed = missions.HELD
    theirs = paper.TABLE_7[load, speed]["simulation"]  # type: ignore[index]
    shares = f"{100.0 * found.held:.0f} % of the time and the paper's for {100.0 * theirs:.0f} % (table 7)"
    held = "" if math.isnan(found.held) else f", which at {load:g} kg and {speed:g} m/s are held for {shares},"
    return f"Our calves{held} warm by {rise['mr_go_sal']:.1f} K with SAL and {rise['mr_go']:.1f} K without."
