"""Where trials run: processes on this machine, or a Ray cluster. Both run :func:`mrwarp.sweep.trial.run_trial`."""

from __future__ import annotations

import os
import queue
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Protocol

from mrwarp.sweep.grid import GridError, Trial
from mrwarp.sweep.trial import PATIENCE, State, read_status, run_trial, write_status


class Runner(Protocol):
    """Runs trials; how each stands is in its ``trial.json``."""

    def start(self, trials: dict[Path, Trial], retries: int) -> None:
        """Begin with the trials, by folder."""

    def running(self) -> bool:
        """Whether any trial is still waiting or under way."""
        ...

    def stop(self) -> None:
        """Have all trials save and end; returns when they have."""

    def close(self) -> None:
        """Give back what was used."""


def environment(cpus: int) -> dict[str, str]:
    """Variables that keep the numerical libraries of a trial to its share of the cores."""
    return {name: str(cpus) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}


class LocalRunner:
    """Processes on this machine, some at a time.

    Args:
        workers: Trials at a time.
        cpus: CPU threads of each.
        gpus: GPUs of each; trial and GPUs are matched by ``CUDA_VISIBLE_DEVICES``.
        visible: Names of the GPUs that there are.
    """

    def __init__(self, workers: int, *, cpus: int = 1, gpus: int = 0, visible: tuple[str, ...] = ()) -> None:
        if gpus and len(visible) < gpus:
            raise GridError(f"--gpus {gpus}: this machine has {len(visible)}; give fewer or another --address")
        self._workers = min(workers, len(visible) // gpus) if gpus else workers
        self._environment, self._gpus = environment(cpus), gpus
        self._free: queue.SimpleQueue[str] = queue.SimpleQueue()
        for k in range(self._workers if gpus else 0):
            self._free.put(",".join(visible[k * gpus : (k + 1) * gpus]))
        self._stop = threading.Event()
        self._pool = ThreadPoolExecutor(self._workers, thread_name_prefix="trial")
        self._futures: list[Future[State]] = []

    def start(self, trials: dict[Path, Trial], retries: int) -> None:
        """Begin with the trials."""
        self._futures = [self._pool.submit(self._run, trial, folder, retries) for folder, trial in trials.items()]

    def running(self) -> bool:
        """Whether any is left; an error that is none of the trial's comes out here."""
        for future in self._futures:
            if future.done() and not future.cancelled():
                future.result()
        return not all(future.done() for future in self._futures)

    def stop(self) -> None:
        """Ctrl-C for the running ones; the others do not start."""
        self._stop.set()
        for future in self._futures:
            future.cancel()
        self._pool.shutdown(wait=True)

    def close(self) -> None:
        """Nothing runs any more."""
        self._pool.shutdown(wait=True)

    def _run(self, trial: Trial, folder: Path, retries: int) -> State:
        mine = dict(self._environment)
        gpus = self._free.get() if self._gpus else None
        if gpus is not None:
            mine["CUDA_VISIBLE_DEVICES"] = gpus
        try:
            return run_trial(trial, folder, retries=retries, environment=mine, stopped=self._stop.is_set)
        finally:
            if gpus is not None:
                self._free.put(gpus)


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
        self._environment = environment(cpus)
        self._tasks: dict[Any, Path] = {}

    def start(self, trials: dict[Path, Trial], retries: int) -> None:
        """Begin with the trials; Ray repeats a task whose worker or node died."""
        task = self._ray.remote(max_retries=retries, **self._resources)(_remote)
        for folder, trial in trials.items():
            self._tasks[task.remote(trial, str(folder), retries, self._environment)] = folder

    def running(self) -> bool:
        """Whether any is left; a task that Ray gave up leaves a failed trial."""
        if not self._tasks:
            return False
        done, _ = self._ray.wait(list(self._tasks), num_returns=1, timeout=0)
        for reference in done:
            folder = self._tasks.pop(reference)
            try:
                self._ray.get(reference)
            except self._ray.exceptions.RayError as error:
                status = read_status(folder)
                status.state, status.pid = State.FAILED, None
                status.why = f"its worker was lost ({' '.join(str(error).split())[:200]})"
                write_status(folder, status)
        return bool(self._tasks)

    def stop(self) -> None:
        """Cancel the tasks, which stop their processes."""
        for reference in self._tasks:
            self._ray.cancel(reference)
        # Ray calls a task done as soon as it is cancelled, while its process still saves
        deadline = time.monotonic() + PATIENCE
        folders = list(self._tasks.values())
        while any(read_status(folder).state is State.RUNNING for folder in folders) and time.monotonic() < deadline:
            time.sleep(0.2)
        self._tasks.clear()

    def close(self) -> None:
        """Leave the cluster; one of our own ends."""
        self._ray.shutdown()


def _remote(trial: Trial, folder: str, retries: int, variables: dict[str, str]) -> str:
    """A trial in a worker of Ray."""
    return run_trial(trial, Path(folder), retries=retries, environment=variables).value
