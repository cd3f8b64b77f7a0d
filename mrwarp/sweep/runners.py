"""Where trials run: processes on this machine, or a Ray cluster.

``run`` takes a trial to its end, or until it is stopped; how it stands is in its ``trial.json``. So many calls of it as
``workers`` says may be under way.
"""

from __future__ import annotations

import os
import queue
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mrwarp.sweep.grid import GridError, Trial
from mrwarp.sweep.trial import PATIENCE, State, read_status, run_trial, write_status

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
