"""Pictures of the physics checks, each to be read without its text."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.verify import accuracy, held_joint
from benchmarks.verify.accuracy import Accuracy
from benchmarks.verify.engines import Agreement
from benchmarks.verify.held_joint import HoldRun, StandRun
from benchmarks.verify.passivity import PassivityRun
from mrwarp.enums import Coupling

COLOURS = {"constraint": "tab:blue", "explicit": "tab:orange", "reference": "black"}
"""Colour of each coupling in every picture."""

LABELS = {
    "constraint": "constraint coupling (mrwarp)",
    "explicit": "explicit torque, eq. 6 (the paper)",
    "reference": "reference, 50 µs, true stick",
}


def passivity_picture(runs: list[PassivityRun], path: Path) -> None:
    """Falling link and impact: motion, energy that the devices took out, and the energy they injected."""
    figure, axes = _figure(
        "Passivity at 5 ms: a brake may only take energy out", "Work = force of the solver's own rows x joint motion"
    )
    first = [run for run in runs if run.backend is runs[0].backend]
    names = list(dict.fromkeys(run.name for run in first))
    for run in first:
        style = {"color": COLOURS[run.coupling.value], "label": LABELS[run.coupling.value]}
        time, work = run.dt * np.arange(1, len(run.work) + 1), run.work.sum(axis=2).mean(axis=1).cumsum()
        if run.name == names[0]:
            axes[0, 0].plot(time, 1e3 * run.q, **style)
            axes[0, 1].plot(time, work, **style)
        elif run.name == names[1]:
            axes[1, 0].plot(time, work, **style)
    _label(axes[0, 0], f"{names[0]}: the constraint stops the link and keeps it", "time [s]", "angle [mrad]")
    _label(axes[0, 1], f"{names[0]}: explicit braking drives the link", "time [s]", "work of the device so far [J]")
    _label(axes[1, 0], f"{names[1]}, mean of 0, 0.5, 1, 1.5 A", "time [s]", "work of the four devices so far [J]")
    for axis in axes.flat[:3]:
        axis.axhline(0.0, color="grey", linewidth=0.8)
        axis.legend(fontsize=8)
    for offset, coupling in ((-0.2, Coupling.CONSTRAINT), (0.2, Coupling.EXPLICIT)):
        injected = [r.figures["injected"] for name in names for r in first if (r.name, r.coupling) == (name, coupling)]
        at = np.arange(len(names)) + offset
        axes[1, 1].bar(at, injected, 0.38, color=COLOURS[coupling.value], label=LABELS[coupling.value])
        for x, value in zip(at, injected, strict=True):
            axes[1, 1].text(x, value, f"{value:.2g} J", ha="center", va="bottom", fontsize=8)
    seconds = {run.name: run.dt * len(run.work) for run in first}
    axes[1, 1].set_xticks(range(len(names)), [f"{_wrap(n)}\n({seconds[n]:g} s)" for n in names], fontsize=8)
    axes[1, 1].margins(y=0.15)
    _label(axes[1, 1], "Energy injected (positive work of single steps)", "", "injected energy per robot [J]")
    axes[1, 1].legend(fontsize=8)
    figure.savefig(path, dpi=120)


def holding_picture(holds: list[HoldRun], stands: list[StandRun], trap: list[StandRun], path: Path) -> None:
    """Creep, break-away, standing on brakes, and the line-search trap."""
    figure, axes = _figure(
        f"Holding at {held_joint.CURRENT:g} A (tau_y = 25.4 N·m), 5 ms steps",
        "A held joint must not creep, must let go at tau_y, and four of them must carry the robot",
    )
    _creep(axes[0, 0], holds)
    for run in holds:
        if run.brake:
            style = {"linestyle": "-" if run.backend is holds[0].backend else "--", "linewidth": 2}
            colour = "tab:blue" if run.name == holds[0].name else "tab:purple"
            label = f"{run.name} ({run.inertia:.3g} kg·m²), {run.backend.value}"
            axes[0, 1].plot(run.ramp[:, 0], np.abs(run.ramp[:, 1]), color=colour, label=label, **style)
    axes[0, 1].axvspan(*held_joint.BREAKAWAY_LIMITS, color="tab:green", alpha=0.15, label="allowed: 0.99 to 1.01")
    axes[0, 1].axhline(held_joint.MOVING, color="grey", linestyle=":", label="counts as moving: 0.05 rad/s")
    axes[0, 1].set_yscale("log")
    axes[0, 1].set_ylim(1e-4, 10.0)
    _label(axes[0, 1], "Break-away under a rising load", "load / tau_y", "joint speed [rad/s]")
    axes[0, 1].legend(fontsize=7)
    _stand(axes[1, 0], stands)
    _trap(axes[1, 1], trap)
    figure.savefig(path, dpi=120)


def accuracy_picture(result: Accuracy, path: Path) -> None:
    """Trajectories of one run against the reference, and the errors by step."""
    kept, worn = result.kept["constraint"], result.kept["explicit"]
    figure = Figure(figsize=(13, 8), layout="constrained")
    figure.suptitle(
        "Accuracy: one MR joint (0.3 kg link) at 5 ms against a 50 µs reference: same law, loads and currents\n"
        f"Explicit torque chatters at rest and wears the hysteresis state z down: {worn:.0%} of it left after 0.5 s "
        f"(constraint: {kept:.0%})"
    )
    grid = figure.add_gridspec(3, 2, width_ratios=(2, 1))
    rows = [figure.add_subplot(grid[i, 0]) for i in range(3)]
    typical = result.typical_run()
    for name in ("explicit", "constraint", "reference"):
        path_of = result.paths[name][:, typical]
        time = np.linspace(0.0, accuracy.SECONDS, len(path_of))
        for axis, column in zip(rows, (0, 1), strict=False):
            line = "--" if name == "reference" else "-"
            axis.plot(time, path_of[:, column], line, color=COLOURS[name], label=LABELS[name])
    _label(rows[0], "Angle", "", "q [rad]")
    _label(rows[1], "Velocity", "", "qd [rad/s]")
    rows[0].legend(fontsize=8)
    times = accuracy.middles(0.005)
    rows[2].plot(times, result.profile.load(times)[:, typical], color="tab:green", label="load on the joint [N·m]")
    rows[2].step(times, result.profile.current(times)[:, typical], color="tab:red", label="coil current [A]")
    rows[2].legend(fontsize=8)
    _label(rows[2], "What was applied", "time [s]", "N·m, A")
    for row, (title, unit) in enumerate((("angle", "rad"), ("velocity", "rad/s"))):
        axis = figure.add_subplot(grid[0, 1] if row == 0 else grid[1, 1])
        for coupling in Coupling:
            table = result.rms[coupling.value]
            order = result.order(coupling)[row]
            steps = [1e3 * float(dt) for dt in table]
            errors = [value[row] for value in table.values()]
            axis.loglog(
                steps, errors, "o-", color=COLOURS[coupling.value], label=f"{coupling.value}: order {order:.2f}"
            )
        axis.axvline(5.0, color="grey", linestyle=":", label="the simulator's step")
        axis.set_xticks([1, 2.5, 5, 10], ["1", "2.5", "5", "10"])
        _label(axis, f"RMS {title} error, {result.profile.pulse_at.size} random runs", "step [ms]", f"[{unit}]")
        axis.legend(fontsize=8)
    axis = figure.add_subplot(grid[2, 1])
    axis.axis("off")
    axis.text(0.0, 0.5, _error_table(result), family="monospace", fontsize=9, va="center")
    figure.savefig(path, dpi=120)


def engines_picture(cases: list[Agreement], path: Path) -> None:
    """Differences of the engines over 100 ms with their tolerances."""
    figure = Figure(figsize=(13, 4.8), layout="constrained")
    figure.suptitle(
        "mujoco.batch (float64) and MuJoCo-Warp (float32) from the same state under the same torques\n"
        "Tolerance: dt·kappa(M)·eps32·|qacc| per step, times the measured growth of a small velocity error"
    )
    for axis, case in zip(figure.subplots(1, len(cases), sharey=True), cases, strict=True):
        time = 5.0 * np.arange(1, len(case.difference) + 1)
        for column, (colour, name) in enumerate((("tab:blue", "q [m, rad]"), ("tab:red", "qd [m/s, rad/s]"))):
            axis.semilogy(time, np.maximum(case.difference[:, column], 1e-10), "o-", color=colour, label=name)
            axis.semilogy(time, case.tolerance[:, column], "--", color=colour, label=f"tolerance of {name.split()[0]}")
        _label(axis, f"{case.name} (largest foot force {case.foot_force:.0f} N)", "time [ms]", "")
        axis.legend(fontsize=7)
    figure.axes[0].set_ylabel("largest difference")
    figure.savefig(path, dpi=120)


def _creep(axis: Axes, holds: list[HoldRun]) -> None:
    for share in (0, 1):
        at = np.arange(len(holds)) + 0.4 * share - 0.2
        label = f"load {held_joint.LOADS[share]:.0%} of tau_y"
        bars = axis.bar(
            at, [run.creep[share] for run in holds], 0.38, color=("tab:blue", "tab:cyan")[share], label=label
        )
        axis.bar_label(bars, fmt="%.2g", fontsize=7, padding=2, bbox={"facecolor": "white", "pad": 0.3, "linewidth": 0})
        limit = held_joint.CREEP_LIMITS[share]
        axis.axhline(limit, color=("tab:blue", "tab:cyan")[share], linestyle=":", label=f"limit {limit:g} rad/s")
    settings = {True: "", False: "\nMuJoCo's default\nfriction"}
    names = [f"{run.name}\n({run.backend.value}){settings[run.brake]}" for run in holds]
    axis.set_xticks(range(len(holds)), names, fontsize=7)
    axis.set_yscale("log")
    axis.set_ylim(1e-5, 1e2)
    _label(axis, "Creep of a held joint", "", "speed [rad/s]")
    axis.legend(fontsize=7, loc="upper left", ncols=2)


def _stand(axis: Axes, stands: list[StandRun]) -> None:
    sinking = []
    for run in stands:
        feet = "stiff feet" if run.stiff_feet else "feet as in the asset"
        sunk, slip = 1e3 * (run.height[0] - run.height[-1]), 1e3 * run.foot_slip
        sinking.append(f"{run.backend.value}, {feet}: trunk sinks {sunk:.2f} mm, feet slide {slip:.1f} mm")
    for run, colour in zip([run for run in stands if not run.stiff_feet], ("tab:blue", "tab:red"), strict=False):
        time, drift = held_joint.DT * np.arange(len(run.calf)), 1e3 * (run.calf - run.calf[0])
        for leg in range(4):
            label = f"{run.backend.value}, four calves" if leg == 0 else None
            axis.plot(time, drift[:, leg], color=colour, linewidth=1, label=label)
    expected = 1e3 * stands[0].expected_drift.max()
    axis.axhline(-expected, color="grey", linestyle=":", label="creep that the largest brake torque predicts")
    axis.text(0.03, 0.05, "\n".join(sinking), transform=axis.transAxes, fontsize=7, va="bottom")
    axis.set_ylim(-1.5 * expected, 0.05 * expected)
    _label(axis, "Robot on its four brakes, calf motors off", "time [s]", "drift of the calf angle [mrad]")
    axis.legend(fontsize=7, loc="upper right")


def _trap(axis: Axes, trap: list[StandRun]) -> None:
    at = np.arange(len(trap))
    drift = [1e3 * run.figures()["calf_drift_max"] for run in trap]
    bars = axis.bar(at - 0.2, drift, 0.38, color="tab:blue", label="largest drift of a calf in 2 s [mrad]")
    axis.bar_label(bars, fmt="%.2g", fontsize=8)
    counts = [run.unsolved for run in trap]
    bars = axis.bar(
        at + 0.2, np.maximum(counts, 1e-3), 0.38, color="tab:red", label="steps that sim.unsolved counted, of 600"
    )
    axis.bar_label(bars, labels=[str(count) for count in counts], fontsize=8)
    axis.set_yscale("log")
    axis.set_ylim(1e-2, 1e5)
    axis.set_xticks(at, [str(run.ls_iterations) for run in trap])
    _label(axis, "The line-search trap is never silent", "line-search iterations of the solver", "mrad, steps")
    axis.legend(fontsize=8)


def _error_table(result: Accuracy) -> str:
    lines = ["RMS error        explicit     constraint", ""]
    for dt in result.rms["explicit"]:
        for row, unit in enumerate(("rad  ", "rad/s")):
            values = [result.rms[name][dt][row] for name in ("explicit", "constraint")]
            head = f"{1e3 * float(dt):>4g} ms" if row == 0 else " " * 7
            lines.append(f"{head} {unit}  {values[0]:>10.4f}  {values[1]:>12.4f}")
    return "\n".join(lines)


def _figure(title: str, subtitle: str) -> tuple[Figure, np.ndarray]:
    figure = Figure(figsize=(13, 9), layout="constrained")
    figure.suptitle(f"{title}\n{subtitle}")
    return figure, figure.subplots(2, 2)


def _label(axis: Axes, title: str, x: str, y: str) -> None:
    axis.set_title(title, fontsize=10)
    axis.set_xlabel(x)
    axis.set_ylabel(y)
    axis.grid(True, alpha=0.3)


def _wrap(name: str) -> str:
    return name.replace(", ", ",\n")
