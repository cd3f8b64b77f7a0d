"""From a mission to the figures of figures 10 and 11, ours beside the paper's."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from mrwarp import paper
from mrwarp.trials.mission import MissionTrace, PhaseLoad
from mrwarp.trials.statistics import ratio_sd, spread

RISES = ("calf_walking", "calf_standby")
"""Go1's rises that fixed the thermal model."""

GROUPS = ("electrical", "thermal", "battery")
"""Groups of numbers that Go1's figures fixed: its way out the arm's mass, its way back the speed of both ways and that
arm and item are the 3 kg of table 6, its standby the electrical model, its calves the thermal model, its depletion the
capacity. Every figure of the other robots is a prediction."""


def row(robot: str, trace: MissionTrace, *, calibrated: Collection[str] = GROUPS) -> dict[str, Any]:
    """One robot's figures beside the paper's.

    Args:
        robot: Of ``paper.ROBOTS``.
        trace: Its mission.
        calibrated: Groups of :data:`GROUPS` whose numbers come from Go1's figures, which are then marked; none where
            the task is not the paper's.
    """
    own = {name: robot == "go1" and name in calibrated for name in GROUPS}
    theirs = paper.MISSION_POWER[robot]
    mean, sd = paper.MISSION_DEPLETION[robot]
    return {
        "power": {name: {**spread(values), "paper": theirs[name], "calibrated": own["electrical"]}
                  for name, values in trace.power.items()},
        "seconds": {name: spread(values) for name, values in trace.seconds.items()},
        "depletion": {**spread(trace.depletion), "paper": mean, "paper_sd": sd, "calibrated": own["battery"]},
        "rise": {name: {**spread(values), "paper": _paper_rise(robot, name),
                        "calibrated": own["thermal"] and name in RISES}
                 for name, values in trace.rise.items()},
    }  # fmt: skip


def _paper_rise(robot: str, name: str) -> float | None:
    """The paper's rise [K]; that of hips and thighs follows from its other two means, the fluid's is not given."""
    return paper.proximal_rise(robot) if name == "proximal" else paper.MISSION_RISE[robot].get(name)


def windows(phases: Mapping[str, Mapping[str, PhaseLoad]]) -> dict[str, Any]:
    """How many windows of each robot's walks began, fell or came too late, and how many count: those of both ways."""
    return {
        robot: {
            name: {"tried": phase.tried, "fell": phase.fell, "late": phase.late, "counted": len(phase.seconds)}
            for name, phase in found.items() if phase.trial is not None
        }
        for robot, found in phases.items()
    }  # fmt: skip


def changes(rows: dict[str, Any]) -> dict[str, Any]:
    """Relative change from MR_Go to MR_Go-SAL, ours and the paper's; predictions.

    ``sd`` and ``paper_sd`` are those of the ratio of two independent figures; the latter is None where the paper states
    no spread.
    """
    if not {"mr_go", "mr_go_sal"} <= set(rows):
        return {}
    picks = {
        "outbound_power": lambda row: row["power"]["outbound"], "return_power": lambda row: row["power"]["return"],
        "depletion": lambda row: row["depletion"], "calf_walking_rise": lambda row: row["rise"]["calf_walking"],
        "all_rise": lambda row: row["rise"]["all"],
    }  # fmt: skip
    found = {}
    for name, pick in picks.items():
        before, after = pick(rows["mr_go"]), pick(rows["mr_go_sal"])
        found[name] = {
            "ours": after["mean"] / before["mean"] - 1.0,
            "sd": ratio_sd((after["mean"], after["sd"]), (before["mean"], before["sd"])),
            "paper": after["paper"] / before["paper"] - 1.0,
            "paper_sd": ratio_sd((after["paper"], after["paper_sd"]), (before["paper"], before["paper_sd"]))
            if "paper_sd" in after else None,
            "calibrated": False,
        }  # fmt: skip
    return found
