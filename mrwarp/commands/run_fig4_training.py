"""``mrwarp reproduce fig4 --train``: the models of figure 4, trained anew."""

from __future__ import annotations

from mrwarp.bench.virtual_bench import BenchCfg
from mrwarp.nn.training import FitCfg
from mrwarp.options.command_line import CommandLine
from mrwarp.options.paper_options import TrainFigure4
from mrwarp.reproduce import fig4
from mrwarp.run_dir import check_writable, write_result


def run(options: TrainFigure4, line: CommandLine) -> int:
    """Make figure 4; 0 when every claim holds at full strength, 1 when one does not, 2 on bad input."""
    check_writable(options.out)
    bench = BenchCfg(samples=options.samples, trajectories=options.trajectories, seed=options.seed)
    recipe = FitCfg(epochs=options.epochs, windows_per_epoch=options.windows_per_epoch, seed=options.seed)
    result = fig4.train(bench, recipe, options.strengths, options.out)
    write_result(options.out, result, seed=options.seed, command=str(line))
    for name, holds in result["verdicts"].items():
        print(f"{name:34s} {'holds' if holds else 'MISSED'}")
    return 0 if all(result["verdicts"].values()) else 1
