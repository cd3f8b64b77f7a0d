"""Pictures of the mission: power and state of charge over time (figure 10), temperatures (figure 11)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from mrwarp.paper import NAMES
from mrwarp.trials.mission import MissionTrace
from mrwarp.trials.walk_pictures import COLORS


def power(traces: Mapping[str, MissionTrace], path: Path) -> None:
    """Battery power and state of charge over the mission, from a full battery."""
    figure = Figure(figsize=(9, 5.5), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for robot, trace in traces.items():
        upper.step(trace.t, trace.power_over_time, where="pre", color=COLORS[robot], label=NAMES[robot])
        lower.plot(trace.t, 100.0 - trace.charge, color=COLORS[robot])
    upper.set_ylabel("battery power [W]")
    upper.set_ylim(bottom=0.0)
    lower.set(xlabel="time [s]", ylabel="state of charge [%]")
    upper.legend(fontsize=8)
    for axis in (upper, lower):
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=110)


def temperature(traces: Mapping[str, MissionTrace], rows: Mapping[str, Any], path: Path) -> None:
    """Motor temperatures over time, and rises beside the paper's; hatched bars were calibrated."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for robot, trace in traces.items():
        left.plot(trace.t, trace.calf, color=COLORS[robot], label=f"{NAMES[robot]}, calves")
        left.plot(trace.t, trace.proximal, color=COLORS[robot], linestyle=":", label=f"{NAMES[robot]}, hips and thighs")
    left.set(xlabel="time [s]", ylabel="motor temperature above ambient [K]")
    left.legend(fontsize=7)
    groups = {"calf_walking": "calves, both walks", "calf_standby": "calves, standby", "all": "all motors, mission"}
    width = 0.8 / max(len(rows), 1)
    for k, (robot, row) in enumerate(rows.items()):
        for place, name in enumerate(groups):
            cell, x = row["rise"][name], place + (k - 0.5 * (len(rows) - 1)) * width
            right.bar(x, cell["mean"], width, yerr=cell["sd"], capsize=3, color=COLORS[robot], edgecolor="white",
                      hatch="//" if cell["calibrated"] else None)  # fmt: skip
            right.plot(x, cell["paper"], "k_", markersize=14)
    right.set_xticks(range(len(groups)), list(groups.values()), fontsize=8)
    right.plot([], [], "k_", markersize=14, label="paper")
    right.bar(0, 0, color="white", edgecolor="0.5", hatch="//", label="used to calibrate")
    right.set_ylabel("rise [K]")
    right.legend(fontsize=8)
    for axis in (left, right):
        axis.grid(alpha=0.3)
        axis.set_axisbelow(True)
    figure.savefig(path, dpi=110)
