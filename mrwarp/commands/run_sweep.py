"""``mrwarp sweep``: one command over a grid of its options, side by side, resumable; a lost trial costs only itself."""

from __future__ import annotations

import argparse
import contextlib
import os
import shlex
import signal
import sys
import time
from collections import Counter
from pathlib import Path

from mrwarp.options.arguments import Parser, count, whole
from mrwarp.run_dir import FolderError, check_writable, claim, one_line, write_result
from mrwarp.sweep import compare
from mrwarp.sweep.grid import Command, GridError, Trial, make_trials
from mrwarp.sweep.runners import LocalRunner, RayRunner, Runner
from mrwarp.sweep.trial import FINISHED, State, Status, last_lines, read_status, write_status

EVERY = 30.0
"""Time between two lines on all running trials [s]."""


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
        folders = {(args.out / trial.name).absolute(): trial for trial in trials}
        _refuse_others(folders)
        check_writable(args.out)
        with claim(args.out):
            runner = _runner(args)
            # a scheduler that takes the machine away says so by SIGTERM: as Ctrl-C
            previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
            try:
                return _sweep(args, folders, runner, "mrwarp sweep " + shlex.join(argv))
            except OSError:
                runner.stop()
                raise
            finally:
                signal.signal(signal.SIGTERM, previous)
                runner.close()
    except (GridError, FolderError, ValueError) as error:
        print(f"mrwarp sweep: {error}", file=sys.stderr)
        return 2
    except OSError as error:  # a full disk: what is finished stays
        print(f"mrwarp sweep: {one_line(error)}; the same command goes on", file=sys.stderr)
        return 1


def _runner(args: argparse.Namespace) -> Runner:
    """Where the trials run.

    Raises:
        GridError: not there.
    """
    workers = args.workers or max((os.cpu_count() or 1) // args.cpus, 1)
    if args.address or args.runner == "ray":
        return RayRunner(workers, cpus=args.cpus, gpus=args.gpus, address=args.address)
    return LocalRunner(workers, cpus=args.cpus, gpus=args.gpus, visible=_gpus() if args.gpus else ())


def _gpus() -> tuple[str, ...]:
    import warp as wp

    if named := os.environ.get("CUDA_VISIBLE_DEVICES"):
        return tuple(named.split(","))
    return tuple(str(k) for k in range(wp.get_cuda_device_count()))


def _refuse_others(folders: dict[Path, Trial]) -> None:
    """Keep the results of another sweep.

    Raises:
        GridError: a trial's folder holds a run with other arguments.
    """
    for folder, trial in folders.items():
        status = read_status(folder)
        if status.args and status.args != [trial.command, *trial.args]:
            raise GridError(f"{folder}: holds '{shlex.join(status.args)}'; name another --out or remove it")


def _sweep(args: argparse.Namespace, folders: dict[Path, Trial], runner: Runner, command: str) -> int:
    seen = {folder: read_status(folder) for folder in folders}
    left = {folder: trial for folder, trial in folders.items() if not _has_result(folder, seen[folder])}
    kept = len(folders) - len(left)
    print(f"{len(folders)} trials of mrwarp {args.command}" + (f", {kept} of them finished before" if kept else "")
          + f"; output in {args.out}", flush=True)  # fmt: skip
    for folder, trial in left.items():
        seen[folder] = Status(args=[trial.command, *trial.args], seconds=seen[folder].seconds)
        write_status(folder, seen[folder])
    interrupted = False
    try:
        runner.start(left, args.retries)
        told = time.monotonic()
        while True:
            running = runner.running()
            _tell(folders, left, seen)
            if not running:
                break
            if time.monotonic() - told >= EVERY:
                _tell_running(folders, seen)
                told = time.monotonic()
            time.sleep(0.2)
    except KeyboardInterrupt:
        interrupted = True
        print("\nstopping: trainings save a checkpoint; a second Ctrl-C does not wait", file=sys.stderr, flush=True)
        try:
            runner.stop()
        except KeyboardInterrupt:
            _kill(left)
        _tell(folders, left, seen)
    return _report(args, folders, command, interrupted)


def _has_result(folder: Path, status: Status) -> bool:
    return status.state in FINISHED and (folder / "result.json").is_file()


def _tell(folders: dict[Path, Trial], left: dict[Path, Trial], seen: dict[Path, Status]) -> None:
    """A line for each trial that began, was begun again or ended."""
    for folder, trial in left.items():
        now, before = read_status(folder), seen[folder]
        if (now.state, now.attempts) == (before.state, before.attempts):
            continue
        seen[folder] = now
        ended = sum(status.state not in (State.WAITING, State.RUNNING) for status in seen.values())
        lead = f"[{ended}/{len(folders)}] {trial.name}"
        if now.state is State.RUNNING:
            again = f"started again ({now.why})" if now.attempts > 1 else "started"
            print(f"{lead}: {again}", flush=True)
        elif now.state in FINISHED:
            print(f"{lead}: {now.state.value} after {now.seconds:.0f} s", flush=True)
        elif now.state is State.FAILED:
            print(f"{lead}: FAILED ({now.why}); its last lines:", flush=True)
            print("".join(f"    {line}\n" for line in now.lines), end="", flush=True)
        elif now.state is State.STOPPED:
            print(f"{lead}: stopped", flush=True)


def _tell_running(folders: dict[Path, Trial], seen: dict[Path, Status]) -> None:
    """How far the running trials are."""
    for folder, trial in folders.items():
        if seen[folder].state is State.RUNNING:
            print(f"    {trial.name}: {' '.join(''.join(last_lines(folder, 1)).split())[:140]}", flush=True)


def _kill(left: dict[Path, Trial]) -> None:
    """End the processes on this machine at once."""
    for folder in left:
        if pid := read_status(folder).pid:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(pid, signal.SIGKILL)


def _report(args: argparse.Namespace, folders: dict[Path, Trial], command: str, interrupted: bool) -> int:
    """Table, CSV, picture and result of what there is; returns the exit code."""
    rows = [compare.Row(trial=trial, status=(status := read_status(folder)),
                        figures=compare.read_figures(folder) if status.state in FINISHED else {})
            for folder, trial in folders.items()]  # fmt: skip
    try:
        names = compare.choose(rows, args.command, args.figure)
    except ValueError as error:
        print(f"mrwarp sweep: {error}", file=sys.stderr)
        names = compare.choose(rows, args.command, [])
    states = Counter(row.status.state for row in rows)
    print("\n" + "\n".join(compare.lines(rows, names)))
    compare.write_csv(rows, args.out / "trials.csv")
    if names:
        compare.plot(rows, names, args.out / "trials.png")
    finished = sum(states[state] for state in FINISHED)
    write_result(
        args.out,
        {
            "swept": args.command,
            "states": {state.value: count for state, count in states.items()},
            "conditions": compare.summary(rows, names),
            "trials": [compare.as_result(row) for row in rows],
        },
        seed=0,
        command=command,
    )
    print(f"\n{finished} of {len(rows)} trials have a result; trials.csv, trials.png and result.json in {args.out}")
    if interrupted:
        print("stopped; the same command goes on")
        return 130
    if finished < len(rows):
        print("the same command runs the failed ones again")
        return 1
    return 0
