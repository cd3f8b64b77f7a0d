"""Where trials run: processes on this machine, or a Ray cluster. Both run :func:`mrwarp.sweep.trial.run_trial`."""

from __future__ import annotations

import os
import queue
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from mrwarp.sweep.grid import GridError, Trial
from mrwarp.sweep.trial import PATIENCE, State, read_status, run_trial, write_status


class LocalRunner:
    """Processes on this machine, some at a time; how each trial stands is in its ``trial.json``.

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
        workers = min(workers, len(visible) // gpus) if gpus else workers
        self._threads = thread_limits(cpus)
        self._shares: queue.SimpleQueue[dict[str, str]] = queue.SimpleQueue()
        for k in range(workers):
            own = ",".join(visible[k * gpus : (k + 1) * gpus])
            self._shares.put({"CUDA_VISIBLE_DEVICES": own} if gpus else {})
        self._stop = threading.Event()
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="trial")
        self._left: dict[Future[Any], Path] = {}

    def start(self, trials: dict[Path, Trial], retries: int) -> None:
        """Begin with the trials, by folder; each may be begun again ``retries`` times."""
        self._left = {self._submit(trial, folder, retries): folder for folder, trial in trials.items()}

    def running(self) -> bool:
        """Whether any trial is waiting or under way; an error that is none of a trial's comes out here."""
        for future in [future for future in self._left if future.done()]:
            folder = self._left.pop(future)
            if not future.cancelled():
                self._settle(future, folder)
        return bool(self._left)

    def stop(self) -> None:
        """Have the running trials save and end, and the others not start; returns when they have."""
        self._stop.set()
        self._pool.shutdown(wait=True, cancel_futures=True)

    def close(self) -> None:
        """Give back what was used."""
        self._pool.shutdown(wait=True)

    def _submit(self, trial: Trial, folder: Path, retries: int) -> Future[Any]:
        return self._pool.submit(self._run, trial, folder, retries)

    def _settle(self, future: Future[Any], folder: Path) -> None:
        future.result()

    def _run(self, trial: Trial, folder: Path, retries: int) -> State:
        share = self._shares.get()
        try:
            environment = {**self._threads, **share}
            return run_trial(trial, folder, retries=retries, environment=environment, stopped=self._stop.is_set)
        finally:
            self._shares.put(share)


class RayRunner(LocalRunner):
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
        super().__init__(1, cpus=cpus)
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
        self._references: list[Any] = []

    def stop(self) -> None:
        """Cancel the tasks, which stop their processes."""
        for reference in self._references:
            self._ray.cancel(reference)
        # Ray calls a task done as soon as it is cancelled, while its process still saves
        deadline, folders = time.monotonic() + PATIENCE, list(self._left.values())
        while any(read_status(folder).state is State.RUNNING for folder in folders) and time.monotonic() < deadline:
            time.sleep(0.2)

    def close(self) -> None:
        """Leave the cluster; one of our own ends."""
        self._ray.shutdown()

    def _submit(self, trial: Trial, folder: Path, retries: int) -> Future[Any]:
        """Ray repeats a task whose worker or node died."""
        task = self._ray.remote(max_retries=retries, **self._resources)(_remote)
        reference = task.remote(trial, str(folder), retries, self._threads)
        self._references.append(reference)
        return reference.future()

    def _settle(self, future: Future[Any], folder: Path) -> None:
        """A task that Ray gave up leaves a failed trial."""
        try:
            future.result()
        except self._ray.exceptions.RayError as error:
            status = read_status(folder)
            status.state, status.pid = State.FAILED, None
            status.why = f"its worker was lost ({' '.join(str(error).split())[:200]})"
            write_status(folder, status)


def thread_limits(cpus: int) -> dict[str, str]:
    """Environment variables that keep the numerical libraries of a trial to its share of the cores."""
    return {name: str(cpus) for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}


def _remote(trial: Trial, folder: str, retries: int, variables: dict[str, str]) -> str:
    """A trial in a worker of Ray."""
    return run_trial(trial, Path(folder), retries=retries, environment=variables).value
