"""Results of a session on the virtual bench: figures of ``result.json``, the printed tables and the picture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mrwarp.bench.bench_effects import EFFECTS, Effects
from mrwarp.bench.excitation import EVALUATION_CURRENTS
from mrwarp.bench.virtual_bench import BenchCfg, BenchData
from mrwarp.identify.replay import simulate
from mrwarp.paper import FIGURE_4
from mrwarp.params import BoucWenParams, MrParams
from mrwarp.recording.load import Recording
from mrwarp.runtime import text_table


def effect_table(effects: Effects, *, all_of_them: bool = False) -> str:
    """The effects that act, with value, unit, law and argument, as text; or all that there are."""
    rows = [
        (
            spec.name,
            f"{effects[spec.name]:.4g} {spec.unit}",
            spec.law,
            spec.why + ("" if effects.acts(spec.name) else " (absent)"),
        )
        for spec in EFFECTS.values()
        if all_of_them or effects.acts(spec.name)
    ]
    return "\n".join(text_table(("effect", "value", "law (s = smooth sign)", "why this value"), rows, left=4))


def measure(data: BenchData, cfg: BenchCfg) -> dict[str, Any]:
    """Figures of a session: sizes, ranges, and what plain eq. 14 with the device's coefficients leaves."""
    figures: dict[str, Any] = {
        "effects": {name: {"value": cfg.effects[name], "unit": spec.unit} for name, spec in EFFECTS.items()},
        "gait": data.fit.header["gait"],
        "parts": {"fit": _ranges(data.fit)},
        "holding_tests": len(data.holding.current),
        "plain_rmse_fit": float(np.sqrt(np.mean(np.concatenate(_errors(data.fit, cfg.params)) ** 2))),
    }
    if data.evaluation is None:
        return figures
    figures["parts"]["evaluation"] = _ranges(data.evaluation)
    figures["plain_rmse"], figures["torque_rms"] = {}, {}
    runs = list(zip(data.evaluation.trajectories, _errors(data.evaluation, cfg.params), strict=True))
    for current in (f"{cfg.share * amps:g}" for amps in EVALUATION_CURRENTS):
        own = [(error, run.torque) for run, error in runs if run.id.endswith(f"_{current}A")]
        rms = np.sqrt([[np.mean(values**2) for values in pair] for pair in own])
        for name, values in zip(("plain_rmse", "torque_rms"), rms.T, strict=True):
            figures[name][current] = {"mean": float(values.mean()), "sd": float(values.std(ddof=1)), "unit": "N·m"}
    return figures


def _ranges(recording: Recording) -> dict[str, Any]:
    runs = recording.trajectories
    largest = {
        f"{name}_max": max(float(np.abs(getattr(run, name)).max()) for run in runs) for name in ("q", "qd", "torque")
    }
    currents = sorted({float(x) for run in runs for x in np.unique(run.current)})
    return {"trajectories": len(runs), "samples": recording.samples, **largest, "currents": currents}


def _errors(recording: Recording, params: MrParams) -> list[np.ndarray]:
    """Eq. 14 by the simulator's own kernels, minus the torque that was measured, per trajectory."""
    plain = simulate(params.to_dict(), recording)
    return [tau - run.torque for tau, run in zip(plain, recording.trajectories, strict=True)]


def lines(figures: dict[str, Any], cfg: BenchCfg) -> list[str]:
    """Effects, sizes and errors as text."""
    parts = [
        (name, str(part["trajectories"]), str(part["samples"]), ", ".join(f"{x:g}" for x in part["currents"]))
        for name, part in figures["parts"].items()
    ]
    found = [effect_table(cfg.effects), "", *text_table(("part", "trajectories", "samples", "currents [A]"), parts)]
    if "plain_rmse" in figures:
        of_paper = cfg.params.bouc_wen == replace(BoucWenParams(), q_neutral=cfg.params.bouc_wen.q_neutral)
        of_paper = of_paper and cfg.share == 1.0
        rows = [
            (
                f"{amps} A",
                f"{row['mean']:.3f}",
                f"{row['sd']:.3f}",
                f"{figures['torque_rms'][amps]['mean']:.3f}",
                f"{FIGURE_4['bouc_wen'][float(amps)].mean:.3f}" if of_paper else "",
            )
            for amps, row in figures["plain_rmse"].items()
        ]
        found += ["", "RMSE [N·m] of eq. 14 with the device's coefficients over ten evaluation trajectories"]
        found += text_table(("current", "mean", "SD", "torque RMS", "paper"), rows)
    return found


def draw(data: BenchData, cfg: BenchCfg, path: Path) -> None:
    """Loops over angle and velocity per current, two seconds over time, and the break-away torques."""
    shown = data.evaluation or data.fit
    widest = max(shown.trajectories, key=lambda run: ("_sine" in run.id, float(np.abs(run.q).max())))
    # the same motion at each current of the evaluation
    loops = [run for run in shown.trajectories if run.id.rpartition("_")[0] == widest.id.rpartition("_")[0]]
    figure = Figure(figsize=(11, 7.5), layout="constrained")
    axes = figure.subplots(2, 2)
    for run in loops:
        # the second half of an evaluation trajectory, where the current is on throughout
        part = slice(len(run.t) // 2, len(run.t) // 2 + min(1600, len(run.t) // 2))
        label = f"{run.current[part].max():g} A"
        axes[0, 0].plot(run.q[part], run.torque[part], linewidth=0.7, label=label)
        axes[0, 1].plot(run.qd[part], run.torque[part], linewidth=0.7, label=label)
    for axis, label in ((axes[0, 0], "angle [rad]"), (axes[0, 1], "velocity [rad/s]")):
        axis.set(xlabel=label, ylabel="torque [N·m]", title=f"loops over {label.split()[0]}")
        axis.legend(title="current")

    run = next((x for x in shown.trajectories if "_1.2A" in x.id), shown.trajectories[0])
    plain = _errors(Recording(trajectories=(run,)), cfg.params)[0] + run.torque
    middle = np.flatnonzero(np.diff(run.current) != 0.0)
    start = max(int(middle[0]) - 100, 0) if len(middle) else 0
    part = slice(start, start + 400)
    axis = axes[1, 0]
    time = run.t[part] - run.t[start]  # of a session the stamps have too many digits for an axis
    axis.plot(time, run.torque[part], linewidth=1.0, label="bench")
    axis.plot(time, plain[part], linewidth=1.0, label="eq. 14")
    axis.plot(time, run.current[part], linewidth=0.8, color="0.5", label="current command [A]")
    axis.set(xlabel="time [s]", ylabel="torque [N·m]", title=f"{run.id}: the current is switched")
    axis.legend()

    amps = np.linspace(0.0, float(data.holding.current.max()), 100)
    axes[1, 1].plot(data.holding.current, data.holding.torque, ".", markersize=4, label="break-away tests")
    axes[1, 1].plot(amps, cfg.params.hold.yield_torque(amps), linewidth=1.0, label="eq. 18")
    axes[1, 1].set(xlabel="current [A]", ylabel="torque [N·m]", title="break-away at rest")
    axes[1, 1].legend()
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
