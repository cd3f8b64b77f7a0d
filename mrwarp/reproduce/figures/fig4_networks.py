"""Figure 4 of the paper on the virtual bench: RMSE of four torque models on ten unseen trajectories per current.

All networks are trained by one recipe on the bench's fitting data, the Bouc-Wen model is identified on the same data.
The bench's effects are what they are; strengths 0.5 and 2 show how the ranking depends on them. Each model is kept in
the output folder as soon as it is done, so an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from mrwarp import paper
from mrwarp.bench.bench_effects import Effects
from mrwarp.bench.virtual_bench import BenchCfg, BenchData, run_bench
from mrwarp.commands.run_learn import plot_history, print_epoch
from mrwarp.identify import learn
from mrwarp.identify.fit import fit
from mrwarp.model_file import read_json_file
from mrwarp.nn import network_file as model_file
from mrwarp.nn.models import SAMPLES
from mrwarp.nn.training import FitCfg
from mrwarp.options.arguments import Parser, seed
from mrwarp.run_dir import check_writable, write_result, write_text
from mrwarp.runtime import quiet_libraries

MODELS = ("mlp", "bouc_wen", "lstm", "pg_rlstm")
"""The models of Fig. 4."""

_COLOURS = {"mlp": "#9aa5b1", "bouc_wen": "#c98b3c", "lstm": "#5b8fc7", "pg_rlstm": "#2f7d4f"}


@dataclass(frozen=True, kw_only=True)
class Figure4Cfg:
    """What is trained and judged."""

    bench: BenchCfg = field(default_factory=BenchCfg)
    """The session; its effects are replaced by the default ones times each strength."""
    fit: FitCfg = field(default_factory=FitCfg)
    """Recipe of all networks."""
    strengths: tuple[float, ...] = (1.0, 0.5, 2.0)
    """Factors on the bench's effects; the first one is judged."""


def figure4(cfg: Figure4Cfg, out: Path) -> dict[str, Any]:
    """Train and evaluate all models at all strengths; returns the figures of ``result.json``.

    Args:
        cfg: What to do.
        out: Folder for models, curves and what is needed to go on.

    Raises:
        KeyboardInterrupt: the run was stopped; what is done is kept.
    """
    results: dict[str, Any] = {}
    for strength in cfg.strengths:
        bench = replace(cfg.bench, effects=Effects.defaults(strength))
        results[f"{strength:g}"] = _one_strength(bench, cfg.fit, out / f"strength_{strength:g}")
        print(f"\neffects times {strength:g}\n{learn.table(results[f'{strength:g}'])}\n", flush=True)
    first = results[f"{cfg.strengths[0]:g}"]
    plot(results, out / "figure4.png")
    return {
        "strengths": results,
        "reductions": {name: _reductions(rows) for name, rows in results.items()},
        "verdicts": judge(first),
        "paper": {
            name: {f"{amps:g}": [cell.mean, cell.sd] for amps, cell in rows.items()}
            for name, rows in paper.FIGURE_4.items()
        },
        "recipe": asdict(cfg.fit),
        "bench": {"samples": cfg.bench.samples, "trajectories": cfg.bench.trajectories, "seed": cfg.bench.seed},
    }


def judge(rows: Mapping[str, Mapping[str, Any]]) -> dict[str, bool]:
    """Each claim of the paper by name, True where it holds; ``rows`` holds a ``learn.summary`` per model."""
    best, others = rows["pg_rlstm"], [rows[name] for name in paper.FIGURE_4_REDUCTION]
    lowest = all(
        cell["mean"] < other["by_current"][amps]["mean"]
        for other in others
        for amps, cell in best["by_current"].items()
    )
    reductions = _reductions(rows)
    return {
        "pg_rlstm_lowest_at_each_current": lowest,
        "pg_rlstm_average": best["average"] <= paper.FIGURE_4_AVERAGE,
        **{f"lower_than_{name}": reductions[name] >= wanted for name, wanted in paper.FIGURE_4_REDUCTION.items()},
    }


def plot(results: Mapping[str, Mapping[str, Any]], path: Path) -> None:
    """Bars per current and model as in the paper, its values as marks; beside them the averages per strength."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(3, 2))
    first = next(iter(results.values()))
    currents = list(first["pg_rlstm"]["by_current"])
    width = 0.8 / len(MODELS)
    for k, name in enumerate(MODELS):
        x = np.arange(len(currents)) + (k - 1.5) * width
        cells = [first[name]["by_current"][amps] for amps in currents]
        means, sds = [c["mean"] for c in cells], [c["sd"] for c in cells]
        left.bar(x, means, width, yerr=sds, capsize=3, color=_COLOURS[name], label=name)
        marks = [cell.mean if (cell := paper.FIGURE_4[name].get(float(amps))) else np.nan for amps in currents]
        left.plot(x, marks, "k_", markersize=14, label="paper" if k == 0 else None)
        averages = [rows[name]["average"] for rows in results.values()]
        right.bar(np.arange(len(results)) + (k - 1.5) * width, averages, width, color=_COLOURS[name])
    left.set_xticks(range(len(currents)), [f"{amps} A" for amps in currents])
    left.set_ylabel("RMSE on ten unseen trajectories [N·m]")
    left.legend(ncols=2, fontsize="small")
    right.set_xticks(range(len(results)), [f"effects × {name}" for name in results])
    right.set_ylabel("average RMSE [N·m]")
    for axis in (left, right):
        axis.grid(axis="y", alpha=0.3)
        axis.set_axisbelow(True)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)


def main(argv: list[str] | None = None) -> int:
    """Make Figure 4; 0 when every claim holds at full strength, 1 when one does not, 2 on bad input."""
    argv = sys.argv[1:] if argv is None else argv
    args = _parser().parse_args(argv)
    quiet_libraries()
    try:
        check_writable(args.out)
        bench = BenchCfg(samples=args.samples, trajectories=args.trajectories, seed=args.seed)
        recipe = FitCfg(epochs=args.epochs, windows_per_epoch=args.windows_per_epoch, seed=args.seed)
        cfg = Figure4Cfg(bench=bench, fit=recipe, strengths=tuple(args.strengths))
        result = figure4(cfg, args.out)
    except (ValueError, OSError) as error:
        print(f"mrwarp reproduce fig4 --train: {error}", file=sys.stderr)
        return 2
    write_result(args.out, result, seed=args.seed, command="mrwarp reproduce fig4 --train " + shlex.join(argv))
    for name, holds in result["verdicts"].items():
        print(f"{name:34s} {'holds' if holds else 'MISSED'}")
    return 0 if all(result["verdicts"].values()) else 1


def _parser() -> argparse.ArgumentParser:
    recipe, bench = FitCfg(), BenchCfg()
    parser = Parser(prog="mrwarp reproduce fig4 --train", description=figure4.__doc__)
    parser.add_argument("--out", type=Path, required=True, help="output folder; a stopped run goes on there")
    parser.add_argument("--strengths", type=float, nargs="+", default=[1.0, 0.5, 2.0], help="factors on the effects")
    parser.add_argument("--epochs", type=int, default=recipe.epochs, help="most epochs per network")
    parser.add_argument("--windows-per-epoch", type=int, default=recipe.windows_per_epoch)
    parser.add_argument("--samples", type=int, default=bench.samples, help="samples of the fitting data")
    parser.add_argument("--trajectories", type=int, default=bench.trajectories, help="trajectories of the fitting data")
    parser.add_argument("--seed", type=seed, default=0, help="seed of the bench and of the training")
    return parser


def _one_strength(bench: BenchCfg, recipe: FitCfg, out: Path) -> dict[str, Any]:
    """A ``learn.summary`` per model."""
    data: BenchData | None = None
    bouc_wen: dict[str, float] | None = None
    rows: dict[str, Any] = {}
    for name in ("bouc_wen", *(name for name in MODELS if name in SAMPLES)):
        key = {"effects": dict(bench.effects), "params": bench.params.to_dict(), "samples": bench.samples,
               "trajectories": bench.trajectories, "evaluation_samples": bench.evaluation_samples,
               "seed": bench.seed, "recipe": asdict(recipe), "model": name}  # fmt: skip
        done = _read(out / f"{name}.json", key)
        if done is None:
            if data is None:
                print(f"running the bench for {out}", flush=True)
                data = run_bench(bench)
            done = _train(name, data, bouc_wen, recipe, out)
            write_text(out / f"{name}.json", json.dumps({"key": key, **done}, indent=1))
        if name == "bouc_wen":
            bouc_wen = done["bouc_wen"]
        rows[name] = done["summary"]
    return {name: rows[name] for name in MODELS}


def _train(name: str, data: BenchData, bouc_wen: dict[str, float] | None, recipe: FitCfg, out: Path) -> dict[str, Any]:
    """Fit or train one model and judge it on the evaluation trajectories."""
    assert data.evaluation is not None  # BenchCfg here always asks for them
    if name == "bouc_wen":
        print("fitting bouc_wen", flush=True)
        fitted = learn.bench_parameters(fit(data.fit, exact=False, substeps=0, seed=recipe.seed).values)
        errors = learn.errors(learn.bouc_wen_torque(data.evaluation, fitted), data.evaluation)
        return {"summary": learn.summary(errors), "errors": _text_keys(errors), "bouc_wen": fitted}
    print(f"training {name}", flush=True)
    learned = learn.learn(data.fit, kind=name, bouc_wen=bouc_wen, cfg=recipe, report=print_epoch)
    if learned.history.stopped == "interrupted":
        raise KeyboardInterrupt
    errors = learn.errors(learn.predict(learned.model, data.evaluation), data.evaluation)
    model_file.save(replace(learned.model, source="mrwarp virtual bench"), out / f"{name}.safetensors")
    plot_history(learned.history, name, out / f"{name}_curves.png")
    return {"summary": learn.summary(errors), "errors": _text_keys(errors), "training": learned.figures}


def _reductions(rows: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """Relative reduction of the average RMSE by PG-RLSTM [1]."""
    return {name: 1.0 - rows["pg_rlstm"]["average"] / rows[name]["average"] for name in paper.FIGURE_4_REDUCTION}


def _text_keys(errors: Mapping[float, Sequence[float]]) -> dict[str, list[float]]:
    return {f"{amps:g}": list(values) for amps, values in errors.items()}


def _read(path: Path, key: dict[str, Any]) -> dict[str, Any] | None:
    """What was kept under the same key, or None."""
    if not path.is_file():
        return None
    content = read_json_file(path, "remove it, and the model is made again")
    same = isinstance(content, dict) and content.get("key") == json.loads(json.dumps(key))
    return content if same else None


if __name__ == "__main__":
    sys.exit(main())
