"""``mrwarp bench``: run the virtual torque bench and write its recordings."""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from pathlib import Path
from typing import Any, Self

import numpy as np

from mrwarp.bench.bench_effects import EFFECTS, EffectError, Effects
from mrwarp.bench.excitation import EVALUATION_CURRENTS
from mrwarp.bench.virtual_bench import PAPER_SAMPLES, BenchCfg, BenchData, run_bench
from mrwarp.options.arguments import Parser, count, seed, whole
from mrwarp.paper import FIGURE_4
from mrwarp.params import MrParams
from mrwarp.recording.load import HOLDING_FILE, Recording, save_holding, save_recording
from mrwarp.run_dir import check_writable, one_line, write_result

_PARTS = ("fit", "evaluation")


def main(argv: list[str] | None = None) -> int:
    """Run the virtual bench; 0 when its recordings are written, 2 on bad input, 130 when stopped by Ctrl-C."""
    argv = sys.argv[1:] if argv is None else argv
    args = _parser().parse_args(argv)
    if args.list_effects:
        print(effect_table(Effects.defaults()))
        return 0
    try:
        cfg = _cfg(args)
        _check_free(args.out, args.overwrite)
        check_writable(args.out)
        if cfg.policy is not None:
            from mrwarp.rl.policy import OnnxPolicy  # starts torch

            OnnxPolicy(cfg.policy)
        return _run(cfg, args, "mrwarp bench " + shlex.join(argv))
    except (ValueError, OSError) as error:
        print(f"mrwarp bench: {one_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        left = f"what {args.out} holds is not complete" if args.out.exists() else "nothing was written"
        print(f"stopped; {left}", file=sys.stderr)
        return 130


def effect_table(effects: Effects) -> str:
    """The effects with value, unit, law and argument, as text."""
    head = f"{'effect':20s} {'value':>10s} {'unit':16s} law (s = smooth sign); why"
    rows = [
        f"{spec.name:20s} {effects[spec.name]:10.4g} {spec.unit:16s} {spec.law}; {spec.why}"
        + ("" if effects.acts(spec.name) else " (absent)")
        for spec in EFFECTS.values()
    ]
    return "\n".join([head, *rows])


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="mrwarp bench",
        description="Virtual torque bench: drives one MR joint along prescribed motion and logs it at 200 Hz. Writes "
        "DIR/fit, DIR/evaluation, DIR/holding.csv, DIR/bench.png and DIR/result.json.",
    )
    parser.add_argument("--out", type=Path, default=Path("runs/bench"), help="output folder (default: runs/bench)")
    parser.add_argument("--overwrite", action="store_true", help="replace recordings that are already there")
    parser.add_argument(
        "--effect", action="append", default=[], metavar="NAME=VALUE",
        help="set one effect, in SI units; may be repeated; --list-effects shows them",
    )  # fmt: skip
    parser.add_argument("--list-effects", action="store_true", help="print all effects with defaults and reasons")
    parser.add_argument(
        "--scale-effects", type=float, default=1.0, metavar="X",
        help="factor on the strength of all effects and noise; 0 leaves only those given by --effect (default: 1)",
    )  # fmt: skip
    parser.add_argument("--seed", type=seed, default=0, help="seed of motions, currents and noise (default: 0)")
    parser.add_argument("--trajectories", type=count, default=120, help="trajectories to fit (default: 120)")
    parser.add_argument("--samples", type=count, default=PAPER_SAMPLES, help="their samples in total (default: 665442)")
    parser.add_argument(
        "--evaluation-samples", type=whole, default=4000, metavar="N",
        help="samples of each of the 30 evaluation trajectories; 0 for none (default: 4000)",
    )  # fmt: skip
    parser.add_argument("--policy", type=Path, help="take the calf motion from this walking policy (.onnx)")
    parser.add_argument("--asset", type=Path, help="bench asset (default: mr_bench.usda)")
    parser.add_argument("--format", choices=("csv", "parquet"), default="csv", help="file type (default: csv)")
    parser.add_argument(
        "--progress", action=argparse.BooleanOptionalAction, default=True, help="show progress (default: on)"
    )
    return parser


def _cfg(args: argparse.Namespace) -> BenchCfg:
    from mrwarp.usd.asset import load_bench

    if not 0.0 <= args.scale_effects <= 10.0:
        raise EffectError(f"--scale-effects {args.scale_effects:g} is out of range; allowed: 0 to 10")
    chosen = {}
    for text in args.effect:
        name, equals, value = text.partition("=")
        try:
            chosen[name] = float(value)
        except ValueError:
            form = "NAME=VALUE" if not equals else "a number"
            raise EffectError(f"--effect {text}: {value!r} is not {form}; e.g. --effect coil_lag=0.02") from None
    params = load_bench(args.asset).actuators[0].mr or MrParams()
    return BenchCfg(
        effects=Effects.defaults(args.scale_effects).replace(**chosen),
        params=params,
        trajectories=args.trajectories,
        samples=args.samples,
        evaluation_samples=args.evaluation_samples,
        policy=args.policy,
        seed=args.seed,
    )


def _check_free(out: Path, overwrite: bool) -> None:
    """Keep recordings of different sessions apart."""
    there = [f for part in _PARTS if (out / part).is_dir() for f in sorted((out / part).iterdir())]
    if there and not overwrite:
        raise ValueError(f"{there[0].parent} holds recordings already; choose another --out or add --overwrite")


def _run(cfg: BenchCfg, args: argparse.Namespace, command: str) -> int:
    started = time.perf_counter()
    with _Progress(args.progress, started) as show:
        data = run_bench(cfg, show)
        figures = _write(data, cfg, args, show)
        figures["seconds"] = round(time.perf_counter() - started, 1)
        write_result(args.out, figures, seed=cfg.seed, command=command)
    print(_table(figures, cfg))
    print(f"\nrecordings, {HOLDING_FILE}, bench.png and result.json in {args.out}")
    return 0


def _write(data: BenchData, cfg: BenchCfg, args: argparse.Namespace, show: _Progress) -> dict[str, Any]:
    """Write recordings and picture; returns the session's figures."""
    kind = ".csv.gz" if args.format == "csv" else ".parquet"
    for part, recording in zip(_PARTS, (data.fit, data.evaluation), strict=True):
        for old in sorted((args.out / part).glob("*")) if args.overwrite else []:
            if old.name.endswith((".csv.gz", ".parquet")):
                old.unlink()
        if recording is not None:
            show(1.0, f"writing {args.out / part}")
            save_recording(recording, args.out / part, kind=kind)
    save_holding(data.holding, args.out)
    show(1.0, "comparing with eq. 14")
    figures = measure(data, cfg)
    draw(data, cfg, args.out / "bench.png")
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
    from mrwarp.identify.replay import simulate

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
    from matplotlib.figure import Figure

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
