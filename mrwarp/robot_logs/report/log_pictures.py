"""Pictures of a robot's verdict: where and when simulation and log part, errors by joint and channel, a trace."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from mrwarp.robot_logs.report.compared_replays import Compared, joint_windows
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.sysid.report.pictures import AFTER, BEFORE, MEASURED, drawn

CELLS, MOST_NAMES = 240, 6
"""Most columns of the map over time, and most recordings whose names find room over it."""


TITLES = {
    "where": "Where and when simulation and log disagree",
    "errors": "Error by joint and by channel",
    "trace": "Where the named joint errs most: log and simulations",
}
"""All pictures, each with its title: what is to be seen in it."""

NAMES = tuple(TITLES)


def draw(d: RobotDiagnosis, compared: list[Compared]) -> tuple[dict[str, bytes], list[str]]:
    """PNGs by name, and a note on each that could not be drawn."""
    makers = {"where": lambda: _where(d, compared), "errors": lambda: _errors(d), "trace": lambda: _trace(d, compared)}
    return drawn(makers, TITLES, size=11.0, dpi=110.0)


def accused(d: RobotDiagnosis) -> list[int]:
    """Joints that the verdict speaks of, else the one with the largest error."""
    found = [j for j, joint in enumerate(d.model.joints) if any(_touches(c.where, joint) for c in d.causes)]
    errors = [d.per_joint[joint]["baseline"] for joint in d.model.joints]
    return found or [int(np.argmax(errors))]


def _touches(where: str, joint: str) -> bool:
    return where == joint or (where != "robot" and joint.startswith(f"{where}_"))


def _where(d: RobotDiagnosis, compared: list[Compared]) -> Figure:
    """Error of each joint over time as a map, and each joint's error next to it."""
    time, before, _ = joint_windows(compared)
    joints = len(d.model.joints)
    spacing = 2.0 * float(np.median(np.diff(time)))
    edges = np.linspace(0.0, time[-1] + spacing, int(np.clip(time[-1] / spacing, 1, CELLS)) + 1)
    cell = np.clip(np.searchsorted(edges, time, side="right") - 1, 0, len(edges) - 2)
    grid = np.full((joints, len(edges) - 1), np.nan)
    for k in np.unique(cell):
        grid[:, k] = np.sqrt((before[cell == k] ** 2).mean(axis=0))
    figure = Figure(figsize=(8.0, 1.5 + 0.24 * max(joints, 4)), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[3, 1], sharey=True)
    image = left.pcolormesh(edges, np.arange(joints + 1), 1e3 * grid, cmap="magma_r", vmin=0.0)
    figure.colorbar(image, ax=left, label="error of the angle [mrad]", pad=0.01)
    begin = 0.0
    for run in d.log.runs:
        left.axvline(begin, color="white", linewidth=1.0)
        if len(d.log.runs) <= MOST_NAMES:
            left.text(begin, -0.1, f" {run.id}", fontsize=7, va="bottom", color="#5c646e")
        begin += float(run.t[-1])
    left.set(xlabel="time, recordings end to end [s]", yticks=np.arange(joints) + 0.5)
    left.set_yticklabels(d.model.joints, fontsize=8)
    left.invert_yaxis()
    marked = accused(d) if d.causes else []
    values = [1e3 * d.per_joint[joint]["baseline"] for joint in d.model.joints]
    colors = [BEFORE if j in marked else "#a3abb5" for j in range(joints)]
    right.barh(np.arange(joints) + 0.5, values, color=colors, height=0.7)
    right.set(xlabel="RMS [mrad]")
    return figure


def _errors(d: RobotDiagnosis) -> Figure:
    """Before and after, by joint and by channel."""
    channels = d.per_channel
    figure = Figure(figsize=(8.0, 1.6 + 0.22 * max(len(d.model.joints), len(channels), 5)), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[3, 2])
    y = np.arange(len(d.model.joints))
    for shift, key, color, label in ((-0.2, "baseline", BEFORE, "description"), (0.2, "extended", AFTER, "extended")):
        left.barh(y + shift, [1e3 * d.per_joint[j][key] for j in d.model.joints], 0.38, color=color, label=label)
    left.set(xlabel="RMS error of the angle [mrad]", yticks=y)
    left.set_yticklabels(d.model.joints, fontsize=8)
    left.invert_yaxis()
    left.legend(frameon=False, fontsize=8)
    names = list(channels)
    share = [100.0 * e["extended"] / max(e["baseline"], 1e-12) for e in channels.values()]
    right.barh(np.arange(len(names)), share, 0.6, color=AFTER)
    right.axvline(100.0, color=BEFORE, linewidth=1.5)
    right.set(xlabel="error with the causes, % of before", yticks=np.arange(len(names)))
    right.set_yticklabels(names, fontsize=8)
    right.invert_yaxis()
    return figure


def _trace(d: RobotDiagnosis, compared: list[Compared]) -> Figure:
    """The joint that is blamed, in the window in which it errs most, with its neighbours in time."""
    joint = max(accused(d), key=lambda j: d.per_joint[d.model.joints[j]]["baseline"])
    c = max(compared, key=lambda c: float((c.left(False)["q"][:, :, joint] ** 2).mean(axis=1).max()))
    worst = int(np.argmax((c.left(False)["q"][:, :, joint] ** 2).mean(axis=1)))
    near = np.flatnonzero((np.abs(c.offset - c.offset[worst]) < 1.0) & (c.windows.run == c.windows.run[worst]))
    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=[2, 1])
    for k, w in enumerate(near):
        t = c.time[w]
        label = [None, None, None] if k else ["log", "description", "extended"]
        top.plot(t, 1e3 * c.windows.measured["q"][w, :, joint], color=MEASURED, linewidth=2.0, label=label[0])
        top.plot(t, 1e3 * c.before["q"][w, :, joint], color=BEFORE, linewidth=1.2, label=label[1])
        top.plot(t, 1e3 * c.after["q"][w, :, joint], color=AFTER, linewidth=1.2, label=label[2])
        bottom.plot(t, 1e3 * c.left(False)["q"][w, :, joint], color=BEFORE, linewidth=1.2)
        bottom.plot(t, 1e3 * c.left(True)["q"][w, :, joint], color=AFTER, linewidth=1.2)
    top.set(ylabel="angle [mrad]")
    top.set_title(f"{d.model.joints[joint]}; each window begins from the logged state", fontsize=9)
    bottom.set(xlabel="time, recordings end to end [s]", ylabel="mismatch [mrad]")
    bottom.axhline(0.0, color="#a3abb5", linewidth=0.8)
    top.legend(frameon=False, fontsize=8, ncols=3)
    return figure
