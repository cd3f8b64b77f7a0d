"""A sweep from beginning to end: what is finished is kept, the rest runs, and what came out is laid side by side.

Trials run in processes on this machine or on a Ray cluster, both by :func:`mrwarp.sweep.trial.run_trial`; how each
stands is in its ``trial.json``.
"""

from __future__ import annotations

import os
import queue
import shlex
import signal
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

from mrwarp.run_dir import claim, write_result
from mrwarp.sweep import compare
from mrwarp.sweep.grid import GridError, Trial
from mrwarp.sweep.trial import FINISHED, PATIENCE, State, Status, last_lines, read_status, run_trial, write_status

EVERY = 30.0
"""Time between two lines on all running trials [s]."""

LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Environment variables that keep the numerical libraries of a trial to its share of the cores."""


class LocalRunner:
    """Processes on this machine, some at a time.

    Args:
        workers: Trials at a time.
        cpus: CPU threads of each.
        gpus: GPUs of each; trial and GPUs are matched by ``CUDA_VISIBLE_DEVICES``.
        visible: Names of the GPUs that there are.

    Raises:
        GridError: there are not so many GPUs.
    """

    def __init__(self, workers: int, *, cpus: int = 1, gpus: int = 0, visible: tuple[str, ...] = ()) -> None:
        if gpus and len(visible) < gpus:
            raise GridError(f"--gpus {gpus}: this machine has {len(visible)}; give fewer or another --address")
        self.workers = min(workers, len(visible) // gpus) if gpus else workers
        self._threads = dict.fromkeys(LIMITS, str(cpus))
        self._shares: queue.SimpleQueue[dict[str, str]] = queue.SimpleQueue()
        for k in range(self.workers):
            own = ",".join(visible[k * gpus : (k + 1) * gpus])
            self._shares.put({"CUDA_VISIBLE_DEVICES": own} if gpus else {})

    def run(self, trial: Trial, folder: Path, retries: int, stopped: Callable[[], bool]) -> None:
        """Run it with GPUs of its own."""
        share = self._shares.get()
        try:
            run_trial(trial, folder, retries=retries, environment={**self._threads, **share}, stopped=stopped)
        finally:
            self._shares.put(share)

    def close(self) -> None:
        """Nothing is left to give back."""


class RayRunner:
    """Tasks of Ray: on this machine, or on the cluster at an address whose nodes share the sweep's folder.

    Args:
        workers: Trials at a time on this machine; a cluster's resources decide there.
        cpus: CPUs of each trial.
        gpus: GPUs of each trial.
        address: Cluster, or None for one of its own on this machine, which listens on loopback alone.

    Raises:
        GridError: Ray is not installed, or the cluster does not answer.
    """

    workers = 1000
    """Tasks that wait at Ray at a time, which runs as many as it has room for."""

    def __init__(self, workers: int, *, cpus: int = 1, gpus: int = 0, address: str | None = None) -> None:
        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # nothing about a run leaves it
        if address is None:
            # Ray's switch for machines that are no cluster: all its servers bind to 127.0.0.1
            os.environ["RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"] = "0"
        try:
            import ray  # pyright: ignore[reportMissingImports]
        except ImportError:
            raise GridError("--runner ray: Ray is not installed; run pip install 'mrwarp[sweep]'") from None
        self._ray: Any = ray
        here = {"include_dashboard": False, "num_cpus": workers * cpus} if address is None else {"address": address}
        try:
            ray.init(logging_level="ERROR", log_to_driver=False, **here)
        except (ConnectionError, RuntimeError, ValueError) as error:
            where = "on this machine" if address is None else f"--address {address}"
            raise GridError(f"{where}: Ray does not start ({' '.join(str(error).split())[:200]})") from None
        self._resources = {"num_cpus": cpus, "num_gpus": gpus}
        self._threads = dict.fromkeys(LIMITS, str(cpus))

    def run(self, trial: Trial, folder: Path, retries: int, stopped: Callable[[], bool]) -> None:
        """Ray repeats a task whose worker or node died; one that it gave up leaves a failed trial."""
        task = self._ray.remote(max_retries=retries, **self._resources)(_remote)
        reference = task.remote(trial, str(folder), retries, self._threads)
        try:
            while not self._ray.wait([reference], timeout=0.5)[0]:
                if stopped():
                    self._ray.cancel(reference)
                    # Ray calls a task done as soon as it is cancelled, while its process still saves
                    deadline = time.monotonic() + PATIENCE
                    while read_status(folder).state is State.RUNNING and time.monotonic() < deadline:
                        time.sleep(0.2)
                    return
            self._ray.get(reference)
        except self._ray.exceptions.RayError as error:
            status = read_status(folder)
            status.state, status.pid = State.FAILED, None
            status.why = f"its worker was lost ({' '.join(str(error).split())[:200]})"
            write_status(folder, status)

    def close(self) -> None:
        """Leave the cluster; one of our own ends."""
        self._ray.shutdown()


def _remote(trial: Trial, folder: str, retries: int, variables: dict[str, str]) -> str:
    """A trial in a worker of Ray."""
    return run_trial(trial, Path(folder), retries=retries, environment=variables).value


class Session:
    """The trials of one call.

    Args:
        trials: What is run.
        out: Folder of the sweep; each trial has one of its own in it.

    Raises:
        GridError: a trial's folder holds a run with other arguments.
    """

    def __init__(self, trials: Sequence[Trial], out: Path) -> None:
        self._out = out
        self._trials = {(out / trial.name).absolute(): trial for trial in trials}
        self._seen = {folder: read_status(folder) for folder in self._trials}
        for folder, trial in self._trials.items():
            found = self._seen[folder].args
            if found and found != [trial.command, *trial.args]:
                raise GridError(f"{folder}: holds '{shlex.join(found)}'; name another --out or remove it")

    def run(self, runner: LocalRunner | RayRunner, *, retries: int, figures: Sequence[str], command: str) -> int:
        """Run what has no result yet, and compare what there is.

        Args:
            runner: Where; closed at the end.
            retries: Most new starts of a trial that is killed.
            figures: Names of the figures to show; empty takes the command's own.
            command: Command line, for the record.

        Returns:
            0 when every trial has a result, 1 when one failed, 130 after Ctrl-C.

        Raises:
            FolderError: another sweep writes into the folder.
            OSError: the disk takes no more; the running trials have saved and ended.
        """
        with claim(self._out):
            # a scheduler that takes the machine away says so by SIGTERM: as Ctrl-C
            previous = signal.signal(signal.SIGTERM, signal.default_int_handler)
            try:
                interrupted = self._run(runner, retries)
                return self._report(figures, command, interrupted)
            finally:
                signal.signal(signal.SIGTERM, previous)
                runner.close()

    def _run(self, runner: LocalRunner | RayRunner, retries: int) -> bool:
        """Run the trials that are left; whether Ctrl-C ended them."""
        left = {
            folder: trial
            for folder, trial in self._trials.items()
            if self._seen[folder].state not in FINISHED or not (folder / "result.json").is_file()
        }
        kept = len(self._trials) - len(left)
        known = f", {kept} of them finished before" if kept else ""
        swept = next(iter(self._trials.values())).command
        print(f"{len(self._trials)} trials of mrwarp {swept}{known}; output in {self._out}", flush=True)
        for folder, trial in left.items():
            self._seen[folder] = Status(args=[trial.command, *trial.args], seconds=self._seen[folder].seconds)
            write_status(folder, self._seen[folder])
        stop, pool = threading.Event(), ThreadPoolExecutor(runner.workers, thread_name_prefix="trial")
        try:
            running = {pool.submit(runner.run, trial, folder, retries, stop.is_set) for folder, trial in left.items()}
            printed = time.monotonic()
            while running:
                done, running = wait(running, timeout=0.2)
                for future in done:
                    future.result()  # an error that is none of a trial's comes out here
                self._log_changes(left)
                if time.monotonic() - printed >= EVERY:
                    printed = time.monotonic()
                    for folder, trial in left.items():
                        if self._seen[folder].state is State.RUNNING:
                            print(f"    {trial.name}: {''.join(last_lines(folder, 1)).strip()[:140]}", flush=True)
            return False
        except KeyboardInterrupt:
            print("\nstopping: trainings save a checkpoint; a second Ctrl-C does not wait", file=sys.stderr, flush=True)
            return True
        finally:
            stop.set()
            try:
                pool.shutdown(cancel_futures=True)
            except KeyboardInterrupt:
                os._exit(130)  # the kernel ends the trials with their parent
            self._log_changes(left)

    def _log_changes(self, left: dict[Path, Trial]) -> None:
        """A line for each trial that began, was begun again or ended."""
        for folder, trial in left.items():
            now, before = read_status(folder), self._seen[folder]
            if (now.state, now.attempts) == (before.state, before.attempts):
                continue
            self._seen[folder] = now
            ended = sum(status.state not in (State.WAITING, State.RUNNING) for status in self._seen.values())
            text = str(now.state)
            if now.state is State.RUNNING:
                text = f"started again ({now.why})" if now.attempts > 1 else "started"
            elif now.state in FINISHED:
                text = f"{now.state} after {now.seconds:.0f} s"
            elif now.state is State.FAILED:
                text = "\n    ".join([f"FAILED ({now.why}); its last lines:", *now.lines])
            print(f"[{ended}/{len(self._trials)}] {trial.name}: {text}", flush=True)

    def _report(self, figures: Sequence[str], command: str, interrupted: bool) -> int:
        """Table, CSV, picture and result of what there is; returns the exit code."""
        rows = [compare.read_row(trial, folder) for folder, trial in self._trials.items()]
        swept = rows[0].trial.command
        try:
            names = compare.choose(rows, swept, figures)
        except ValueError as error:
            print(f"mrwarp sweep: {error}", file=sys.stderr)
            names = compare.choose(rows, swept, [])
        print("\n" + "\n".join(compare.lines(rows, names)))
        compare.write_csv(rows, self._out / "trials.csv")
        if names:
            compare.plot(rows, names, self._out / "trials.png")
        states = Counter(row.status.state.value for row in rows)
        content = {"swept": swept, "states": dict(states), "conditions": compare.summary(rows, names)}
        content["trials"] = [row.as_result() for row in rows]
        write_result(self._out, content, seed=0, command=command)
        finished = sum(states[state.value] for state in FINISHED)
        print(
            f"\n{finished} of {len(rows)} trials have a result; trials.csv, trials.png and result.json in {self._out}"
        )
        if interrupted:
            print("stopped; the same command goes on")
            return 130
        if finished < len(rows):
            print("the same command runs the failed ones again")
        return int(finished < len(rows))
