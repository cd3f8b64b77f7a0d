"""Training of figure 4: four torque models on the virtual bench, judged on ten unseen trajectories per current.

All networks are trained by one recipe on the bench's fitting data, the Bouc-Wen model is identified on the same data.
The bench's effects are what they are; strengths 0.5 and 2 show how the ranking depends on them. Each model is kept in
the output folder as soon as it is done, so an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from mrwarp import paper
from mrwarp.bench.bench_effects import Effects
from mrwarp.bench.virtual_bench import BenchCfg, BenchData, run_bench
from mrwarp.identify import learn
from mrwarp.identify.fit import fit
from mrwarp.model_file import read_json_file
from mrwarp.nn import network_file
from mrwarp.nn.models import SAMPLES
from mrwarp.nn.training import FitCfg, plot_history, print_epoch
from mrwarp.reproduce.figures.fig4 import MODELS, judge, plot, reductions
from mrwarp.run_dir import write_text


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
        "reductions": {name: reductions(rows) for name, rows in results.items()},
        "verdicts": judge(first),
        "paper": {
            name: {f"{amps:g}": [cell.mean, cell.sd] for amps, cell in rows.items()}
            for name, rows in paper.FIGURE_4.items()
        },
        "recipe": asdict(cfg.fit),
        "bench": {"samples": cfg.bench.samples, "trajectories": cfg.bench.trajectories, "seed": cfg.bench.seed},
    }


def _one_strength(bench: BenchCfg, recipe: FitCfg, out: Path) -> dict[str, Any]:
    """A ``learn.summary`` per model."""
    data: BenchData | None = None
    bouc_wen: dict[str, float] | None = None
    rows: dict[str, Any] = {}
    for name in ("bouc_wen", *(name for name in MODELS if name in SAMPLES)):
        key = {"effects": dict(bench.effects), "params": bench.params.to_dict(), "samples": bench.samples,
               "trajectories": bench.trajectories, "evaluation_samples": bench.evaluation_samples,
               "seed": bench.seed, "recipe": asdict(recipe), "model": name}  # fmt: skip
        done = _kept(out / f"{name}.json", key)
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
    network_file.save(replace(learned.model, source="mrwarp virtual bench"), out / f"{name}.safetensors")
    plot_history(learned.history, name, out / f"{name}_curves.png")
    return {"summary": learn.summary(errors), "errors": _text_keys(errors), "training": learned.figures}


def _text_keys(errors: Mapping[float, Sequence[float]]) -> dict[str, list[float]]:
    return {f"{amps:g}": list(values) for amps, values in errors.items()}


def _kept(path: Path, key: dict[str, Any]) -> dict[str, Any] | None:
    """What was kept under the same key, or None."""
    if not path.is_file():
        return None
    content = read_json_file(path, "remove it, and the model is made again")
    same = isinstance(content, dict) and content.get("key") == json.loads(json.dumps(key))
    return content if same else None
