"""``mrwarp bench``: run the virtual torque bench and write its recordings."""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any, Self

import numpy as np
from matplotlib.figure import Figure

from mrwarp.bench.bench_effects import EFFECTS, LOG_DT, SUBSTEPS, EffectError, Effects
from mrwarp.bench.excitation import EVALUATION_CURRENTS
from mrwarp.bench.virtual_bench import BenchCfg, BenchData, run_bench
from mrwarp.identify.replay import simulate
from mrwarp.options.command_line import CommandLine
from mrwarp.options.data_options import Bench
from mrwarp.paper import FIGURE_4
from mrwarp.params import MrParams
from mrwarp.recording.load import HOLDING_FILE, Recording, save_holding, save_recording
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.run_dir import check_writable, write_result
from mrwarp.trials.walking import calf_motion
from mrwarp.usd.asset import load_bench

_PARTS = ("fit", "evaluation")


def run(options: Bench, line: CommandLine) -> int:
    """Run the virtual bench; 0 when its recordings are written, 2 on bad input, 130 when stopped by Ctrl-C."""
    if options.list_effects:
        print(effect_table(Effects.defaults()))
        return 0
    cfg = make_cfg(options)
    _check_free(options.out, options.overwrite)
    check_writable(options.out)
    actor = None if cfg.policy is None else OnnxPolicy(cfg.policy)
    try:
        return _run(cfg, actor, options, line)
    except KeyboardInterrupt:
        left = f"what {options.out} holds is not complete" if options.out.exists() else "nothing was written"
        raise KeyboardInterrupt(left) from None


def effect_table(effects: Effects) -> str:
    """The effects with value, unit, law and argument, as text."""
    head = f"{'effect':20s} {'value':>10s} {'unit':16s} law (s = smooth sign); why"
    rows = [
        f"{spec.name:20s} {effects[spec.name]:10.4g} {spec.unit:16s} {spec.law}; {spec.why}"
        + ("" if effects.acts(spec.name) else " (absent)")
        for spec in EFFECTS.values()
    ]
    return "\n".join([head, *rows])


def make_cfg(options: Bench) -> BenchCfg:
    """The session that the options ask for."""
    chosen = {}
    for text in options.effect:
        name, equals, value = text.partition("=")
        try:
            chosen[name] = float(value)
        except ValueError:
            form = "NAME=VALUE" if not equals else "a number"
            raise EffectError(f"--effect {text}: {value!r} is not {form}; e.g. --effect coil_lag=0.02") from None
    return BenchCfg(
        effects=Effects.defaults(options.scale_effects).replace(**chosen),
        params=load_bench(options.asset).actuators[0].mr or MrParams(),
        trajectories=options.trajectories,
        samples=options.samples,
        evaluation_samples=options.evaluation_samples,
        policy=options.policy,
        seed=options.seed,
    )


def _check_free(out: Path, overwrite: bool) -> None:
    """Keep recordings of different sessions apart."""
    there = [f for part in _PARTS if (out / part).is_dir() for f in sorted((out / part).iterdir())]
    if there and not overwrite:
        raise ValueError(f"{there[0].parent} holds recordings already; choose another --out or add --overwrite")


def _run(cfg: BenchCfg, actor: OnnxPolicy | None, options: Bench, line: CommandLine) -> int:
    started = time.perf_counter()
    with _Progress(options.progress, started) as show:
        pool = None
        if actor is not None:
            show(0.0, "walking")
            pool = calf_motion(actor, str(cfg.policy), seconds=cfg.longest + 10.0, dt=LOG_DT / SUBSTEPS, seed=cfg.seed)
        data = run_bench(cfg, show, pool)
        figures = _write(data, cfg, options, show)
        figures["seconds"] = round(time.perf_counter() - started, 1)
        write_result(options.out, figures, seed=cfg.seed, command=str(line))
    print(_table(figures, cfg))
    print(f"\nrecordings, {HOLDING_FILE}, bench.png and result.json in {options.out}")
    return 0


def _write(data: BenchData, cfg: BenchCfg, options: Bench, show: _Progress) -> dict[str, Any]:
    """Write recordings and picture; returns the session's figures."""
    kind = ".csv.gz" if options.format == "csv" else ".parquet"
    for part, recording in zip(_PARTS, (data.fit, data.evaluation), strict=True):
        for old in sorted((options.out / part).glob("*")) if options.overwrite else []:
            if old.name.endswith((".csv.gz", ".parquet")):
                old.unlink()
        if recording is not None:
            show(1.0, f"writing {options.out / part}")
            save_recording(recording, options.out / part, kind=kind)
    save_holding(data.holding, options.out)
    show(1.0, "comparing with eq. 14")
    figures = measure(data, cfg)
    draw(data, cfg, options.out / "bench.png")
    return figures


class _Progress:
    """One line that is written over, and left behind however the work ends."""

    def __init__(self, on: bool, started: float) -> None:
        self.on, self.started, self.last = on, started, ""

    def __call__(self, share: float, text: str) -> None:
        line = f"[{time.perf_counter() - self.started:4.0f} s] {100 * share:3.0f} % {text}"
        if self.on and (line[8:] != self.last[8:]):
            print(f"\r{line:60s}", end="", file=sys.stderr, flush=True)
            self.last = line

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self.last:
            print(file=sys.stderr)


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
    errors = _errors(data.evaluation, cfg.params)
    figures["plain_rmse"], figures["torque_rms"] = {}, {}
    for amps in EVALUATION_CURRENTS:
        at = [k for k, run in enumerate(data.evaluation.trajectories) if run.id.endswith(f"_{amps:g}A")]
        rmse = np.array([np.sqrt(np.mean(errors[k] ** 2)) for k in at])
        rms = np.array([np.sqrt(np.mean(data.evaluation.trajectories[k].torque ** 2)) for k in at])
        for name, values in (("plain_rmse", rmse), ("torque_rms", rms)):
            figures[name][f"{amps:g}"] = {"mean": float(values.mean()), "sd": float(values.std(ddof=1)), "unit": "N·m"}
    return figures


def _ranges(recording: Recording) -> dict[str, Any]:
    runs = recording.trajectories
    return {
        "trajectories": len(runs),
        "samples": recording.samples,
        "q_max": max(float(np.abs(run.q).max()) for run in runs),
        "qd_max": max(float(np.abs(run.qd).max()) for run in runs),
        "torque_max": max(float(np.abs(run.torque).max()) for run in runs),
        "currents": sorted({float(x) for run in runs for x in np.unique(run.current)}),
    }


def _errors(recording: Recording, params: MrParams) -> list[np.ndarray]:
    """Eq. 14 by the simulator's own kernels, minus the torque that was measured, per trajectory."""
    plain = simulate(params.to_dict(), recording)
    return [tau - run.torque for tau, run in zip(plain, recording.trajectories, strict=True)]


def _table(figures: dict[str, Any], cfg: BenchCfg) -> str:
    lines = [effect_table(cfg.effects), "", f"{'part':12s} {'trajectories':>12s} {'samples':>9s} currents [A]"]
    for part, values in figures["parts"].items():
        amps = ", ".join(f"{x:g}" for x in values["currents"])
        lines.append(f"{part:12s} {values['trajectories']:12d} {values['samples']:9d} {amps}")
    if "plain_rmse" in figures:
        lines += ["", "RMSE [N·m] of eq. 14 with the device's coefficients over ten evaluation trajectories"]
        lines.append(f"{'current':>8s} {'mean':>7s} {'SD':>7s} {'torque RMS':>11s} {'paper':>7s}")
        for amps, row in figures["plain_rmse"].items():
            rms = figures["torque_rms"][amps]["mean"]
            theirs = FIGURE_4["bouc_wen"][float(amps)].mean
            lines.append(f"{amps:>6s} A {row['mean']:7.3f} {row['sd']:7.3f} {rms:11.3f} {theirs:7.3f}")
    return "\n".join(lines)


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
    axis.plot(run.t[part], run.torque[part], linewidth=1.0, label="bench")
    axis.plot(run.t[part], plain[part], linewidth=1.0, label="eq. 14")
    axis.plot(run.t[part], run.current[part], linewidth=0.8, color="0.5", label="current command [A]")
    axis.set(xlabel="time [s]", ylabel="torque [N·m]", title=f"{run.id}: the current is switched")
    axis.legend()

    amps = np.linspace(0.0, float(data.holding.current.max()), 100)
    h = cfg.params.hold
    axes[1, 1].plot(data.holding.current, data.holding.torque, ".", markersize=4, label="break-away tests")
    axes[1, 1].plot(amps, h.T_max * amps**h.n / (h.K**h.n + amps**h.n), linewidth=1.0, label="eq. 18")
    axes[1, 1].set(xlabel="current [A]", ylabel="torque [N·m]", title="break-away at rest")
    axes[1, 1].legend()
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    figure.savefig(path, dpi=120)
