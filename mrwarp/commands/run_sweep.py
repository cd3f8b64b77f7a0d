"""``mrwarp sweep``: one command over a grid of its options, side by side, resumable; a lost trial costs only itself."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from pathlib import Path

import warp as wp

from mrwarp.options.arguments import Parser, count, whole
from mrwarp.run_dir import FolderError, check_writable, one_line
from mrwarp.sweep.grid import Command, GridError, make_trials
from mrwarp.sweep.runners import LocalRunner, RayRunner
from mrwarp.sweep.session import Session


def make_parser() -> argparse.ArgumentParser:
    """The options of ``mrwarp sweep``."""
    parser = Parser(
        prog="mrwarp sweep",
        usage="mrwarp sweep --out DIR --command NAME --grid OPTION=V,V,... [...] [options] -- [options of the command]",
        description="Run a command for every combination of a grid of its options. Each trial has a folder of its own; "
        "trials that are finished are not run again, trainings go on from their checkpoints.",
        epilog="mrwarp sweep --out runs/sweep --command train --grid seed=0,1,2 actuator=bouc_wen,pg_rlstm "
        "-- --iterations 300 --num-envs 64",
    )
    add = parser.add_argument
    add("--out", type=Path, required=True, help="output folder; the same call again goes on there")
    add("--command", required=True, metavar="NAME", help="what to run, e.g. train, walk, impact, fit, diagnose, learn")
    grid = "values of the command's options; a value of several words stands in quotes, a flag is on or off"
    add("--grid", nargs="+", required=True, metavar="OPTION=V,V", help=grid)
    add("--workers", type=count, help="trials at a time on this machine (default: cores / --cpus)")
    add("--cpus", type=count, default=1, help="CPU threads of a trial (default: 1)")
    add("--gpus", type=whole, default=0, help="GPUs of a trial, which sees them from cuda:0 on (default: 0)")
    add("--retries", type=whole, default=2, help="new starts of a trial that is killed (default: 2)")
    add("--figure", nargs="+", default=[], metavar="NAME", help="figures to compare, e.g. gate.v_x_rmse.0.5")
    runner = "local: processes of this machine; ray: Ray's workers (pip install 'mrwarp[sweep]'); default: local"
    add("--runner", choices=("local", "ray"), help=runner)
    add("--address", metavar="A", help="Ray cluster, e.g. auto or HOST:6379; its nodes must share --out")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Sweep; 0 when every trial has a result, 1 when one failed, 2 on bad input, 130 after Ctrl-C."""
    argv = sys.argv[1:] if argv is None else argv
    cut = argv.index("--") if "--" in argv else len(argv)
    args = make_parser().parse_args(argv[:cut])
    try:
        if args.address and args.runner == "local":
            raise GridError("--address needs --runner ray; leave --runner out")
        trials = make_trials(Command(args.command), args.grid, argv[cut + 1 :], args.out, threads=args.cpus)
        session = Session(trials, args.out)
        check_writable(args.out)
        command = "mrwarp sweep " + shlex.join(argv)
        return session.run(_runner(args), retries=args.retries, figures=args.figure, command=command)
    except (GridError, FolderError, ValueError) as error:
        print(f"mrwarp sweep: {error}", file=sys.stderr)
        return 2
    except OSError as error:  # a full disk: what is finished stays
        print(f"mrwarp sweep: {one_line(error)}; the same command goes on", file=sys.stderr)
        return 1


def _runner(args: argparse.Namespace) -> LocalRunner:
    """Where the trials run.

    Raises:
        GridError: not there.
    """
    workers = args.workers or max((os.cpu_count() or 1) // args.cpus, 1)
    if args.address or args.runner == "ray":
        return RayRunner(workers, cpus=args.cpus, gpus=args.gpus, address=args.address)
    return LocalRunner(workers, cpus=args.cpus, gpus=args.gpus, visible=_gpus() if args.gpus else ())


def _gpus() -> tuple[str, ...]:
    if named := os.environ.get("CUDA_VISIBLE_DEVICES"):
        return tuple(named.split(","))
    return tuple(str(k) for k in range(wp.get_cuda_device_count()))
