"""``mrwarp sweep``: one command over a grid of its options, side by side, resumable; a lost trial costs only itself."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Annotated

from tyro.conf import Positional

from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.run_dir import check_writable


@dataclass(frozen=True, kw_only=True)
class Sweep(Options):
    """Run a command for every combination of a grid of its options.

    Each trial has a folder of its own; trials that are finished are not run again, trainings go on from their
    checkpoints. Example: mrwarp sweep --out runs/sweep --command train --grid seed=0,1,2 actuator=bouc_wen,pg_rlstm
    -- --iterations 300 --num-envs 64
    """

    engines = False
    arguments: Positional[Annotated[tuple[str, ...], opt.some(str, "ARGUMENT", least=0)]] = ()
    """after '--': options of the command, the same for all trials"""
    out: opt.Folder
    """output folder; the same call again goes on there"""
    command: Annotated[str, opt.one(str, "NAME")]
    """what to run, e.g. train, walk, impact, fit, diagnose, learn"""
    grid: Annotated[tuple[str, ...], opt.some(str, "OPTION=V,V")]
    """values of the command's options; a value of several words stands in quotes, a flag is on or off"""
    workers: Annotated[int | None, opt.one(opt.count, "N")] = None
    """trials at a time on this machine (default: cores / --cpus)"""
    cpus: opt.Count = 1
    """CPU threads of a trial"""
    gpus: opt.Whole = 0
    """GPUs of a trial, which sees them from cuda:0 on"""
    retries: opt.Whole = 2
    """new starts of a trial that is killed"""
    figure: Annotated[tuple[str, ...], opt.some(str, "NAME")] = ()
    """figures to compare, e.g. gate.v_x_rmse.0.5"""

    def run(self, line: CommandLine) -> int:
        """0 when every trial has a result, 1 when one failed, 2 on bad input, 130 after Ctrl-C."""
        from mrwarp.sweep.grid import make_trials

        trials = make_trials(self.command, self.grid, self.arguments, self.out, threads=self.cpus)
        check_writable(self.out)

        from mrwarp.sweep.compare import report
        from mrwarp.sweep.runners import local_runner, run_trials

        workers = self.workers or max((os.cpu_count() or 1) // self.cpus, 1)
        runner = local_runner(workers, cpus=self.cpus, gpus=self.gpus, retries=self.retries)
        ended = run_trials(trials, self.out, runner)
        complete = report(trials, self.figure, self.out, str(line))
        if not ended:
            print("stopped; the same command goes on")
            return 130
        if not complete:
            print("the same command runs the failed ones again")
        return 0 if complete else 1
