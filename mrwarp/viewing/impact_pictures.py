"""Pictures of an impact sweep for those without a viewer: contact sheet, loops and gate timeline."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrwarp.trials.impact import ImpactSweep, ImpactTrace
from mrwarp.usd.robot import LEGS
from mrwarp.viewing.frames import Gate
from mrwarp.viewing.side_view import SideView

INSTANTS = (0.0, 0.05, 0.1, 0.2, 0.4)
"""Instants after the impact's onset at which the robots are drawn [s]."""

COLORS = ("#7a7f87", "#3a8f3a", "#e08a1e", "#b4451f", "#1f6fb4", "#6a3d9a")
"""One colour per setting."""


def contact_sheet(sweep: ImpactSweep, trace: ImpactTrace, path: Path) -> None:
    """Side views of the first trial per current at five instants, and height and speed of all currents below."""
    currents = sweep.cfg.currents
    side = SideView(sweep.env.sim.scene)
    slots = [joint // 3 for joint in sweep.env.actuator.mr_joints]
    figure = Figure(figsize=(12, 1.7 * len(currents) + 4.2), layout="constrained")
    grid = figure.add_gridspec(len(currents) + 1, 2, height_ratios=[1.0] * len(currents) + [2.0])
    for row, current in enumerate(currents):
        axis = figure.add_subplot(grid[row, :])
        for column, instant in enumerate(INSTANTS):
            k = min(int(np.searchsorted(trace.t, instant)), len(trace.t) - 1)
            dyn, hold = trace.m_dyn[row, 0, k, slots], trace.m_hold[row, 0, k, slots]
            gate = np.where(dyn > 0.0, Gate.DYNAMIC, np.where(hold > 0.0, Gate.HOLD, Gate.OFF))
            force = np.zeros((len(LEGS), 3))
            force[:, 2] = trace.f_foot[row, 0, k]
            x = 0.9 * column
            side.draw(axis, trace.qpos[row, k], gate, force, x=x)
            text = f"{1e3 * instant:.0f} ms\nz = {trace.height[row, 0, k]:.3f} m"
            axis.text(x + 0.22, 0.47, text, fontsize=8, ha="left", va="top")
        axis.axhline(0.0, color="0.5", linewidth=0.8)
        axis.set(xlim=(-0.45, 0.9 * len(INSTANTS) - 0.25), ylim=(-0.03, 0.5), aspect="equal", yticks=[], xticks=[])
        axis.set_ylabel(f"{current:g} A", rotation=0, ha="right", va="center", fontsize=11)
        axis.spines[:].set_visible(False)
    for column, (series, label) in enumerate(
        ((trace.height, "trunk height [m]"), (trace.velocity, "vertical velocity [m/s]"))
    ):
        axis = figure.add_subplot(grid[-1, column])
        for row, current in enumerate(currents):
            mean, sd = series[row].mean(axis=0), series[row].std(axis=0)
            color = COLORS[row % len(COLORS)]
            axis.plot(trace.t, mean, color=color, label=f"{current:g} A")
            axis.fill_between(trace.t, mean - sd, mean + sd, color=color, alpha=0.12, linewidth=0)
        axis.set(xlabel="time after onset [s]", ylabel=label)
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8, title="mean, SD over trials", title_fontsize=8)
    figure.suptitle("First trial of every current; foot forces as arrows, calves coloured by gate", fontsize=11)
    figure.savefig(path, dpi=100)


def loops(trace: ImpactTrace, currents: tuple[float, ...], path: Path) -> None:
    """Torque of the devices over calf velocity and angle during the impact, all trials and legs."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    axes = figure.subplots(1, 2, sharey=True)
    for row, current in enumerate(currents):
        color = COLORS[row % len(COLORS)]
        tau = trace.tau_mr[row].reshape(-1)
        for axis, values in zip(axes, (trace.qd[row], trace.q[row]), strict=True):
            axis.plot(values.reshape(-1), tau, ".", color=color, markersize=2, alpha=0.35, label=f"{current:g} A")
    axes[0].set(xlabel="calf velocity [rad/s]", ylabel="torque of the MR device [N·m]")
    axes[1].set(xlabel="calf angle [rad]")
    for axis in axes:
        axis.grid(alpha=0.3)
        axis.axhline(0.0, color="0.6", linewidth=0.8)
    axes[0].axvline(0.0, color="0.6", linewidth=0.8)
    axes[0].legend(markerscale=4)
    figure.savefig(path, dpi=110)


def timeline(trace: ImpactTrace, currents: tuple[float, ...], path: Path) -> None:
    """When each leg's gates were open in the first trial, per current."""
    figure = Figure(figsize=(11, 1.2 * len(currents) + 1.2), layout="constrained")
    axes = np.atleast_1d(figure.subplots(len(currents), 1, sharex=True))
    for row, (axis, current) in enumerate(zip(axes, currents, strict=True)):
        for leg in range(len(LEGS)):
            for gate, color in ((trace.m_dyn, "#e08a1e"), (trace.m_hold, "#1f6fb4")):
                axis.fill_between(
                    trace.t, leg - 0.35, leg + 0.35, where=gate[row, 0, :, leg] > 0.0, color=color, linewidth=0
                )
            loaded = trace.f_foot[row, 0, :, leg] > 5.0
            axis.fill_between(trace.t, leg - 0.45, leg + 0.45, where=loaded, color="0.85", linewidth=0, zorder=0)
        axis.set(yticks=range(len(LEGS)), yticklabels=LEGS, ylabel=f"{current:g} A", ylim=(-0.6, len(LEGS) - 0.4))
    axes[-1].set_xlabel("time after onset [s]")
    figure.suptitle("Gates of the first trial: damping orange, holding blue; grey = foot loaded", fontsize=11)
    figure.savefig(path, dpi=110)
