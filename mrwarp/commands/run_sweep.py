"""``mrwarp sweep``: one command over a grid of its options, side by side, resumable; a lost trial costs only itself."""

from __future__ import annotations

import os

import warp as wp

from mrwarp.options.command_line import CommandLine
from mrwarp.options.paper_options import Sweep
from mrwarp.run_dir import check_writable
from mrwarp.sweep.grid import GridError, make_trials
from mrwarp.sweep.session import LocalRunner, RayRunner, Session


def run(options: Sweep, line: CommandLine) -> int:
    """Sweep; 0 when every trial has a result, 1 when one failed, 2 on bad input, 130 after Ctrl-C."""
    if options.address and options.runner == "local":
        raise GridError("--address needs --runner ray; leave --runner out")
    trials = make_trials(options.command, options.grid, options.arguments, options.out, threads=options.cpus)
    session = Session(trials, options.out)
    check_writable(options.out)
    return session.run(make_runner(options), retries=options.retries, figures=options.figure, command=str(line))


def make_runner(options: Sweep) -> LocalRunner:
    """Where the trials run.

    Raises:
        GridError: not there.
    """
    workers = options.workers or max((os.cpu_count() or 1) // options.cpus, 1)
    if options.address or options.runner == "ray":
        return RayRunner(workers, cpus=options.cpus, gpus=options.gpus, address=options.address)
    return LocalRunner(workers, cpus=options.cpus, gpus=options.gpus, visible=_gpus() if options.gpus else ())


def _gpus() -> tuple[str, ...]:
    if named := os.environ.get("CUDA_VISIBLE_DEVICES"):
        return tuple(named.split(","))
    return tuple(str(k) for k in range(wp.get_cuda_device_count()))
