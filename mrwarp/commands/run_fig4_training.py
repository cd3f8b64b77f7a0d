"""``mrwarp reproduce fig4 --train``: the models of figure 4, trained anew."""

from __future__ import annotations

import argparse
import shlex
import sys
from pathlib import Path

from mrwarp.bench.virtual_bench import BenchCfg
from mrwarp.nn.training import FitCfg
from mrwarp.options.arguments import Parser, seed
from mrwarp.reproduce.figures.fig4_training import Figure4Cfg, figure4
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import quiet_libraries


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
