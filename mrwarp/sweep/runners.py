"""Runs trials: each is a process of this machine with a state in ``trial.json``.

A file ``running-...`` stands in the sweep's folder while trials may run: when it is gone, they save and end.
"""

from __future__ import annotations

import ctypes
import json
import os
import queue
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

import warp as wp

from mrwarp.options.progress_bar import ProgressBar
from mrwarp.run_dir import write_text
from mrwarp.sweep.grid import GridError, Trial

LAUNCH = (sys.executable, "-m", "mrwarp.cli")
"""Beginning of the command line of a trial's process."""

FINISHED = ("done", "missed")
"""States with a result, which are not run again."""

_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None

LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that keep the numerical libraries of a trial to its share of the cores."""


@dataclass(frozen=True)
class Runner:
    """Where trials run."""

    workers: int
    """Trials that are given to it at a time."""
    run: Callable[[Trial, Path], None]
    """Takes a trial to its end, or until the file is gone."""


@dataclass(kw_only=True)
class Status:
    """How a trial stands: content of ``trial.json``."""

    state: Literal["waiting", "running", "done", "missed", "failed", "stopped"] = "waiting"
    """Missed: it ran to its end and says that its aim was missed (exit code 1), e.g. the walking gate."""
    args: list[str] = field(default_factory=list)
    attempts: int = 0
    """Starts in this call of the sweep."""
    wall_seconds: float = 0.0
    """Time of all starts, also of earlier calls [s]."""
    why: str = ""
    """Why the last start did not end well, one line."""
    last_lines: list[str] = field(default_factory=list)
    """Of the log of a failed trial."""
    pid: int | None = None
    """Process of the command while it runs."""


def read_status(trial: Trial) -> Status:
    """Status of a trial; waiting, where nothing (readable) stands."""
    try:
        return Status(**json.loads((trial.folder / "trial.json").read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return Status()


def write_status(trial: Trial, status: Status) -> None:
    """Write a trial's status, whole or not at all."""
    write_text(trial.folder / "trial.json", json.dumps(asdict(status), indent=2) + "\n")


def local_runner(workers: int, *, cpus: int, gpus: int, retries: int) -> Runner:
    """Processes on this machine, as many at a time as there are workers and GPUs for, with GPUs of their own.

    Raises:
        GridError: there are not so many GPUs.
    """
    there: list[str] = []
    if gpus:
        named = os.environ.get("CUDA_VISIBLE_DEVICES")
        there = named.split(",") if named else [str(k) for k in range(wp.get_cuda_device_count())]
        if len(there) < gpus:
            raise GridError(f"--gpus {gpus}: this machine has {len(there)}; give fewer")
        workers = min(workers, len(there) // gpus)
    shares: queue.SimpleQueue[dict[str, str]] = queue.SimpleQueue()
    for k in range(workers):
        own = {"CUDA_VISIBLE_DEVICES": ",".join(there[k * gpus : (k + 1) * gpus])} if gpus else {}
        shares.put({**dict.fromkeys(LIMITS, str(cpus)), **own})

    def run(trial: Trial, mark: Path) -> None:
        share = shares.get()
        try:
            run_trial(trial, mark, retries, share)
        finally:
            shares.put(share)

    return Runner(workers, run)


def run_trial(trial: Trial, mark: Path, retries: int, variables: dict[str, str]) -> None:
    """Run a trial to its end; a start that is killed or crashes is repeated, bad input is not.

    Args:
        trial: What to run; its folder gets ``log.txt`` and ``trial.json`` next to what the command writes.
        mark: File without which the process saves and ends, and none is started.
        retries: Most repetitions.
        variables: Environment variables of the process in addition to this one's.
    """
    status = Status(args=trial.args, wall_seconds=read_status(trial).wall_seconds)
    again = True
    while again and mark.exists():
        started = time.monotonic()
        status.attempts += 1
        code = _run_once(trial, mark, status, variables)
        status.wall_seconds += time.monotonic() - started
        again = status.state == "failed" and code != 2 and status.attempts <= retries
    if status.state == "failed":
        log = (trial.folder / "log.txt").read_text(encoding="utf-8", errors="replace")
        status.last_lines = [line[:300] for line in log[-20_000:].splitlines() if line.strip()][-8:]
    write_status(trial, status)


def _run_once(trial: Trial, mark: Path, status: Status, variables: dict[str, str]) -> int:
    """One start of the command; keeps its status and returns its exit code."""
    result, saved = trial.folder / "result.json", trial.folder / "checkpoint.pt"
    trial.folder.mkdir(parents=True, exist_ok=True)
    result.unlink(missing_ok=True)  # of a start that was stopped
    line = [*trial.args, "--out", str(trial.folder)]
    if trial.args[0] == "train" and saved.is_file():
        line += ["--resume", str(saved)]
    with (trial.folder / "log.txt").open("a", encoding="utf-8") as log:
        print(f"$ mrwarp {shlex.join(line)}", file=log, flush=True)
        process = subprocess.Popen(
            [*LAUNCH, *line],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONUNBUFFERED": "1", **variables},
            start_new_session=True,  # Ctrl-C comes to the sweep, which informs its trials
            preexec_fn=_die_with_parent if _LIBC else None,
        )
    status.state, status.pid = "running", process.pid
    write_status(trial, status)
    while process.poll() is None and mark.exists():
        time.sleep(0.1)
    if stopped := process.poll() is None:
        os.killpg(process.pid, signal.SIGINT)  # and what it started
    code, status.pid = process.wait(), None
    if stopped:
        status.state, status.why = "stopped", "stopped"
    elif code in (0, 1) and result.is_file():
        status.state, status.why = ("missed", "missed its aim (exit code 1)") if code else ("done", "")
    else:
        why = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        status.state, status.why = "failed", why + " without a result.json" * (code in (0, 1))
    return code


def _die_with_parent() -> None:
    """In the new process: have the kernel kill it when the process (and thread) that started it is gone."""
    assert _LIBC is not None
    _LIBC.prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG


def run_trials(trials: Sequence[Trial], out: Path, runner: Runner) -> bool:
    """Run the trials of one sweep that have no result yet, and say how each ends.

    Returns:
        Whether they came to their end; False after Ctrl-C, or the SIGTERM of a scheduler that takes the machine away.

    Raises:
        GridError: a trial's folder holds a run with other arguments.
        OSError: the disk takes no more; the running trials have saved and ended.
    """
    left = []
    for trial in trials:
        status = read_status(trial)
        if status.args and status.args != trial.args:
            raise GridError(f"{trial.folder}: holds '{shlex.join(status.args)}'; name another --out or remove it")
        if status.state not in FINISHED or not (trial.folder / "result.json").is_file():
            left.append(trial)
    count, kept = len(trials), len(trials) - len(left)
    known = f", {kept} of them finished before" if kept else ""
    print(f"{count} trials of mrwarp {trials[0].args[0]}{known}; each has a log.txt in its folder in {out}", flush=True)
    for trial in left:
        write_status(trial, Status(args=trial.args, wall_seconds=read_status(trial).wall_seconds))
    previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
    mark = out / f"running-{time.time_ns()}"  # a new name: network file systems remember which were not there
    pool, bar = ThreadPoolExecutor(runner.workers), ProgressBar()
    try:
        mark.touch()
        running = {pool.submit(runner.run, trial, mark): trial for trial in left}
        for ended, future in enumerate(as_completed(running), kept + 1):
            future.result()  # an error that is none of a trial's comes out here
            trial, status = running[future], read_status(running[future])
            took = f"{status.wall_seconds:.0f} s, {status.attempts} start{'s' * (status.attempts > 1)}"
            bar.line(f"[{ended}/{count}] {trial.folder.name}: {status.state} after {took}")
            if status.state == "failed":
                bar.line("\n    ".join([f"    {status.why}; its last lines:", *status.last_lines]))
            bar("trials of the sweep", ended / count)
        return True
    except KeyboardInterrupt:
        print("\nstopping: trainings save a checkpoint; a second Ctrl-C does not wait", file=sys.stderr, flush=True)
        return False
    finally:
        bar.done()
        mark.unlink(missing_ok=True)
        try:
            pool.shutdown()
        except KeyboardInterrupt:
            os._exit(130)  # the kernel ends the trials with their parent
        signal.signal(signal.SIGTERM, previous)
