"""How often the intervals of a diagnosis contain the truth, over many seeds of the virtual bench's showcase.

``python -m benchmarks.coverage --out runs/coverage``. The bench runs as on the first page about the diagnosis, with one
effect and the noise of a good stand; each seed is another session. Asked for: 90 to 98 % of the 95 % intervals contain
the truth, for every effect. ``--known`` asks for size and interval only, in a quarter of the
time. Records whose truth is stepped by other code: ``python -m benchmarks.confusion --level 0.8 --truth-rate R``,
which prints the same.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats

from mrwarp.bench.bench_effects import Effects
from mrwarp.bench.virtual_bench import BenchCfg, run_bench
from mrwarp.diagnose import diagnose
from mrwarp.run_dir import atomic_write
from mrwarp.runtime import quiet_libraries

STAND = {
    "run_bias": 0.003,
    "run_gain": 0.003,
    "torque_noise": 0.02,
    "coloured_noise": 0.01,
    "velocity_noise": 0.01,
    "encoder_step": 0.0003835,
}
"""Noise of a good stand: that of docs/diagnosis.md."""


@dataclass(frozen=True)
class Hidden:
    """An effect of the bench and the parameter that a diagnosis should find."""

    value: float
    parameter: str


HIDDEN = {
    "coil_lag": Hidden(0.012, "time_constant"),
    "command_delay": Hidden(0.0072, "delay"),
    "torque_sensor_lag": Hidden(0.004, "time_constant"),
    "velocity_lag": Hidden(0.004, "time_constant"),
    "rotor_inertia": Hidden(0.002, "inertia"),
    "coulomb_friction": Hidden(0.05, "torque"),
    "friction_asymmetry": Hidden(0.05, "coulomb"),
    "current_viscosity": Hidden(0.05, "B1"),
    "remanence": Hidden(0.03, "half_width"),
    "backlash": Hidden(0.003, "half_gap"),
}
"""Effects that bench and catalogue write by the same law."""


def found_in(effect: str, seed: int, trajectories: int, samples: int, known: bool = False) -> dict:
    """Hide an effect, diagnose, and say what was found; ``covered`` is None where it was not named.

    ``known``: no other effect may be named, which asks for size and interval only.
    """
    cfg = BenchCfg(
        effects=Effects({**STAND, effect: HIDDEN[effect].value}),
        trajectories=trajectories,
        samples=samples,
        evaluation_samples=0,
        seed=seed,
    )
    result = diagnose(run_bench(cfg).fit, effects=(effect,) if known else None, seed=seed)
    row = {"effect": effect, "seed": seed, "truth": HIDDEN[effect].value, "named": [c.name for c in result.causes]}
    cause = next((c for c in result.causes if c.name == effect), None)
    value = cause.parameters.get(HIDDEN[effect].parameter) if cause else None
    if value is None:
        return {**row, "value": None, "ci95": None, "covered": None}
    low, high = value.ci95
    return {**row, "value": value.value, "ci95": [low, high], "covered": bool(low <= row["truth"] <= high)}


def table(rows: list[dict]) -> str:
    """Share of intervals that contain the truth, with its Clopper-Pearson interval, and the mean ratio to the truth."""
    lines = ["effect                 named   contains the truth        mean value/truth"]
    for effect in HIDDEN:
        own = [row for row in rows if row["effect"] == effect]
        found = [row for row in own if row["covered"] is not None]
        if not found:
            if own:
                lines.append(f"{effect:20} {0:3d}/{len(own)}")
            continue
        inside = sum(row["covered"] for row in found)
        low, high = stats.binomtest(inside, len(found)).proportion_ci()
        ratio = np.array([row["value"] / row["truth"] for row in found])
        error = ratio.std(ddof=1) / np.sqrt(len(ratio)) if len(ratio) > 1 else float("nan")
        lines.append(
            f"{effect:20} {len(found):3d}/{len(own):<3d} {inside / len(found):7.1%} [{low:.1%}, {high:.1%}]"
            f"    {ratio.mean():.4f} ± {error:.4f}"
        )
    return "\n".join(lines)


def main() -> int:
    """Run the command; cases that stand in the output are not run again."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.coverage",
        description="How often intervals contain the truth.",
    )
    parser.add_argument("--effects", nargs="+", choices=HIDDEN, default=list(HIDDEN), help="effects (default: all)")
    parser.add_argument("--seeds", type=int, default=50, help="sessions of each (default: 50)")
    parser.add_argument("--trajectories", type=int, default=32, help="as `mrwarp bench` (default: 32)")
    parser.add_argument("--samples", type=int, default=51_200, help="as `mrwarp bench` (default: 51200)")
    parser.add_argument("--known", action="store_true", help="the effect is known: ask for size and interval only")
    parser.add_argument("--out", metavar="DIR", default="runs/coverage", help="folder of coverage.json")
    args = parser.parse_args()
    quiet_libraries(gpu=False)
    path = Path(args.out) / "coverage.json"
    rows = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else []
    done = {(row["effect"], row["seed"]) for row in rows}
    for seed in range(args.seeds):
        for effect in args.effects:
            if (effect, seed) in done:
                continue
            row = found_in(effect, seed, args.trajectories, args.samples, args.known)
            rows.append(row)
            print(f"seed {seed} {effect}: {row['value']} {row['ci95']} {row['covered']}", flush=True)
            with atomic_write(path) as partial:
                partial.write_text(json.dumps(rows, indent=1), encoding="utf-8")
    print(table(rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
