"""Pictures of walks and missions in the paper's form: figures 8 to 11."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from mrwarp.energy.power import cost_of_transport
from mrwarp.paper import NAMES, ROBOTS
from mrwarp.params import GateParams
from mrwarp.runtime import panels
from mrwarp.trials.mission import MissionTrace
from mrwarp.trials.power_meter import BIN, RANGE
from mrwarp.trials.walk_trials import WalkResult

COLORS = {"go1": "#8a8f98", "mr_go": "#c98b3c", "mr_go_sal": "#1f6fb4"}
"""Colour of each robot."""


PAPER_MARK = {"marker": "D", "markersize": 5, "color": "black", "markerfacecolor": "white", "linestyle": "none"}
"""A figure of the paper, with its spread where it has one."""


NOT_WHOLE = "without the coils' power, which is not known"
"""Of a cost of transport that is drawn hollow."""


def shown_cost(row: Mapping[str, Any]) -> tuple[float, float, bool]:
    """Mean and spread of a condition's cost of transport, and whether it is whole.

    Where nobody stated the coils' resistance it is that of all other parts, as the least that the walk costs, without
    a spread. Both are NaN where no trial arrived.
    """
    whole = row["cot"]["mean"]
    if whole is not None and np.isfinite(whole):
        return whole, row["cot"]["sd"], True
    if not row["trials"]:
        return np.nan, np.nan, False
    known = sum(part for part in row["parts"].values() if part is not None and np.isfinite(part))
    return float(cost_of_transport(known, row["mass"], row["speed"]["mean"])), np.nan, False


def cost(rows: Sequence[dict[str, Any]], path: Path) -> None:
    """Cost of transport per condition as bars, the paper's as marks; hatched bars were calibrated (figure 9).

    A bar without the coils' power is hollow. A robot without a bar has no entry of the legend.
    """
    cells = list(dict.fromkeys((row["payload"], row["command"]) for row in rows))
    figure, ((axis,),) = panels((9, 4.5), grid="y")
    width, drawn, hollow = 0.8 / len(ROBOTS), [], False
    for row in rows:
        x = cells.index((row["payload"], row["command"])) + (ROBOTS.index(row["robot"]) - 1) * width
        mean, sd, whole = shown_cost(row)
        if np.isfinite(mean):
            _bar(axis, x, width, row["robot"], (mean, sd), calibrated=row["calibrated"], whole=whole)
            drawn, hollow = [*drawn, row["robot"]], hollow or not whole
        if row["paper"]:
            axis.errorbar(x + 0.25 * width, row["paper"]["cot"], row["paper"]["sd"], capsize=2, **PAPER_MARK)
    axis.set_xticks(range(len(cells)), [f"{payload:g} kg, {command:g} m/s" for payload, command in cells])
    axis.set_ylabel("cost of transport [1]")
    calibrated, theirs = (any(row[name] for row in rows) for name in ("calibrated", "paper"))
    handles = _bar_legend(list(dict.fromkeys(drawn)), calibrated, theirs, hollow)
    figure.legend(handles=handles, loc="outside upper center", ncols=5, fontsize=8)
    figure.savefig(path, dpi=110)


def _bar(
    axis: Axes, x: float, width: float, robot: str, figure: tuple[float, float], *, calibrated: bool, whole: bool = True
) -> None:
    """A figure of one robot with its spread over the trials."""
    mean, sd = figure
    axis.bar(
        x,
        mean,
        width if whole else 0.96 * width,
        yerr=sd if np.isfinite(sd) else None,
        color=COLORS[robot] if whole else "white",
        edgecolor="white" if whole else COLORS[robot],
        linewidth=1.0 if whole else 1.5,
        error_kw={"capsize": 3, "ecolor": "0.25"},
        hatch="//" if calibrated else None,
    )


def _bar_legend(robots: Sequence[str], calibrated: bool, theirs: bool, hollow: bool = False) -> list[Patch | Line2D]:
    """Meaning of the bars' colours, hatches and marks."""
    found: list[Patch | Line2D] = [Patch(color=COLORS[robot], label=NAMES[robot]) for robot in robots]
    if calibrated:
        found.append(Patch(facecolor="white", edgecolor="0.5", hatch="//", label="used to calibrate"))
    if theirs:
        found.append(Line2D([], [], **PAPER_MARK, label="paper"))
    if hollow:
        found.append(Patch(facecolor="white", edgecolor="0.3", label=NOT_WHOLE))
    return found


def holding(results: Sequence[WalkResult], path: Path) -> None:
    """The front-right calf over two strides with the holding intervals shaded (figures 8(a, b))."""
    shown = [r for r in results if r.robot == "mr_go_sal" and len(r.trace.t)]
    shown = shown or [r for r in results if len(r.trace.t)][:1]
    figure, axes = panels((3.6 * max(len(shown), 2), 7.0), 4, len(shown), sharex="col", sharey="row")
    for column, result in enumerate(shown):
        trace = result.trace
        value = trace.values
        force, speed, torque, current = axes[:, column]
        force.plot(trace.t, value["f_foot"], color="0.3")
        speed.plot(trace.t, value["qd"], color="#7a4fa3")
        speed.axhspan(-GateParams().eps_hold, GateParams().eps_hold, color="#7a4fa3", alpha=0.15, linewidth=0)
        torque.plot(trace.t, value["tau_motor"], color="#c0392b")
        torque.plot(trace.t, value["tau_mr"], color="#1f6fb4")
        current.step(trace.t, value["current"], color="#1f6fb4", where="post")
        for panel in axes[:, column]:
            for name, color in (("m_hold", "#1f6fb4"), ("m_dyn", "#e08a1e")):
                panel.fill_between(
                    trace.t,
                    0,
                    1,
                    where=value[name] > 0.0,
                    color=color,
                    alpha=0.15,
                    linewidth=0,
                    transform=panel.get_xaxis_transform(),
                )
        force.set_title(f"{NAMES[result.robot]}, {result.payload:g} kg, {result.command:g} m/s", fontsize=9)
        current.set_xlabel("time [s]")
    for panel, text in zip(
        axes[:, 0], ("foot force [N]", "calf velocity [rad/s]", "torque [N·m]", "current [A]"), strict=True
    ):
        panel.set_ylabel(text)
    lines = {"motor": "#c0392b", "device": "#1f6fb4"}
    areas = {
        "holding gate open": "#1f6fb4",
        "damping gate open": "#e08a1e",
        "|speed| at which holding may act": "#7a4fa3",
    }
    handles: list[Patch | Line2D] = [Line2D([], [], color=color, label=name) for name, color in lines.items()]
    handles += [Patch(color=color, alpha=0.15, linewidth=0, label=name) for name, color in areas.items()]
    figure.legend(handles=handles, loc="outside upper center", ncols=3, fontsize=8, title="front-right calf")
    figure.savefig(path, dpi=110)


def distributions(results: Sequence[WalkResult], path: Path) -> None:
    """Distributions of the front-right motors' torque magnitude, Go1 left and MR_Go-SAL right (figure 8(c))."""
    cells = list(dict.fromkeys((r.payload, r.command) for r in results))
    figure, (axes,) = panels((3.4 * max(len(cells), 2), 3.8), 1, len(cells), grid="y", sharey=True)
    sides = {"go1": -1.0, "mr_go_sal": 1.0}
    for axis, cell in zip(axes, cells, strict=True):
        for result in results:
            if (result.payload, result.command) == cell and result.robot in sides:
                for joint, counts in enumerate(result.counts):
                    _half_violin(axis, joint, counts, sides[result.robot], COLORS[result.robot])
        axis.set_xticks(range(3), ["FR hip", "FR thigh", "FR calf"])
        axis.set_title(f"{cell[0]:g} kg, {cell[1]:g} m/s", fontsize=9)
    drawn = [robot for robot in sides if any(result.robot == robot for result in results)]
    legend: list[Patch | Line2D] = [Patch(color=COLORS[robot], alpha=0.6, label=NAMES[robot]) for robot in drawn]
    legend.append(Line2D([], [], color="black", linewidth=1, label="mean"))
    axes[0].set_ylabel("|motor torque| [N·m]")
    axes[0].set_ylim(bottom=0.0)
    figure.legend(handles=legend, loc="outside upper center", ncols=3, fontsize=8)
    figure.savefig(path, dpi=110)


def mission_power(traces: Mapping[str, MissionTrace], path: Path) -> None:
    """Battery power and state of charge over the mission, from a full battery, as far as they are known."""
    figure, ((upper,), (lower,)) = panels((9, 5.5), 2, 1, sharex=True)
    for robot, trace in traces.items():
        known = np.isfinite(trace.power_over_time)
        label = NAMES[robot] + ("" if known.all() else ", gaps: not known")
        upper.step(trace.t, trace.power_over_time, where="pre", color=COLORS[robot], label=label if known.any() else "")
        lower.plot(trace.t, 100.0 - trace.charge, color=COLORS[robot])
    if without := [NAMES[r] for r, trace in traces.items() if not np.isfinite(trace.power_over_time).any()]:
        upper.set_title(f"not drawn: {', '.join(without)}, power not known", fontsize=9)
    upper.set(ylabel="battery power [W]", ylim=(0.0, None))
    lower.set(xlabel="time [s]", ylabel="state of charge [%]")
    figure.legend(loc="outside upper center", ncols=len(traces), fontsize=8)
    figure.savefig(path, dpi=110)


def mission_temperature(traces: Mapping[str, MissionTrace], rows: Mapping[str, Any], path: Path) -> None:
    """Motor temperatures over time, and rises compared with the paper's; hatched bars were calibrated."""
    figure, ((left, right),) = panels((11, 4.5), 1, 2)
    for robot, trace in traces.items():
        left.plot(trace.t, trace.calf, color=COLORS[robot])
        left.plot(trace.t, trace.proximal, color=COLORS[robot], linestyle=":")
    calves, others = Line2D([], [], color="0.4"), Line2D([], [], color="0.4", linestyle=":")
    left.legend([calves, others], ["calves", "hips and thighs"], fontsize=8)
    left.set(xlabel="time [s]", ylabel="motor temperature above ambient [K]")
    groups = {"calf_walking": "calves, both walks", "calf_standby": "calves, standby", "all": "all motors, mission"}
    width = 0.8 / max(len(rows), 1)
    cells = []
    for k, (robot, row) in enumerate(rows.items()):
        for place, name in enumerate(groups):
            cell, x = row["rise"][name], place + (k - 0.5 * (len(rows) - 1)) * width
            _bar(right, x, width, robot, (cell["mean"] or 0.0, cell["sd"] or 0.0), calibrated=cell["calibrated"])
            if cell["paper"] is not None:
                right.plot(x + 0.25 * width, cell["paper"], **PAPER_MARK)
            cells.append(cell)
    right.axhline(0.0, color="0.5", linewidth=0.8)
    right.set_xticks(range(len(groups)), list(groups.values()), fontsize=8)
    right.set_ylabel("temperature rise [K]")
    calibrated, theirs = any(c["calibrated"] for c in cells), any(c["paper"] is not None for c in cells)
    figure.legend(
        handles=_bar_legend(list(traces), calibrated, theirs), loc="outside upper center", ncols=5, fontsize=8
    )
    figure.savefig(path, dpi=110)


def _half_violin(axis: Any, place: int, counts: np.ndarray, side: float, color: str) -> None:
    """One half of a violin over |torque|, drawn on one side of ``place``, with its mean."""
    middle = len(counts) // 2
    folded = counts[middle:] + counts[:middle][::-1]
    levels = (np.arange(len(folded)) + 0.5) * BIN
    if folded.sum() <= 0.0:
        return
    smooth = np.convolve(folded, [0.25, 0.5, 0.25], mode="same")
    width = 0.42 * np.sqrt(smooth / smooth.max())
    drawn = slice(0, int(np.flatnonzero(folded)[-1]) + 2)
    axis.fill_betweenx(levels[drawn], place, place + side * width[drawn], color=color, alpha=0.6, linewidth=0)
    mean = (levels * folded).sum() / folded.sum()
    axis.plot([place, place + side * 0.42], [mean, mean], color="black", linewidth=1)


assert RANGE % BIN == 0.0  # the bins' edges must meet at zero for the fold
