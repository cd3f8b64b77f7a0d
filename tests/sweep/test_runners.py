"""Where trials run: GPUs are handed out to one trial at a time, errors of the sweep itself come out."""

import sys
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor, wait
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from mrwarp.run_dir import write_text
from mrwarp.sweep import session
from mrwarp.sweep.grid import GridError, Trial
from mrwarp.sweep.session import LocalRunner, Session
from mrwarp.sweep.trial import State, Status, read_status, write_status

TRIALS = [Trial(name=f"seed={k}", values={"seed": str(k)}, command="train", args=()) for k in range(6)]


def test_no_two_trials_share_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five GPUs, two for each trial: two trials at a time, each with a pair of its own."""
    busy: set[str] = set()
    seen: list[str] = []

    def run(trial: Trial, folder: Path, *, environment: dict[str, str], **_: Any) -> State:
        pair = environment["CUDA_VISIBLE_DEVICES"]
        assert pair not in busy and environment["OMP_NUM_THREADS"] == "3"
        busy.add(pair)
        seen.append(pair)
        time.sleep(0.05)
        busy.remove(pair)
        return State.DONE

    monkeypatch.setattr(session, "run_trial", run)
    runner = LocalRunner(8, cpus=3, gpus=2, visible=("0", "1", "2", "3", "7"))
    assert runner.workers == 2
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda trial: runner.run(trial, Path(trial.name), 0, lambda: False), TRIALS))
    assert set(seen) == {"0,1", "2,3"} and len(seen) == 6


def test_more_gpus_than_there_are_are_refused() -> None:
    """Both numbers are named."""
    with pytest.raises(GridError, match="--gpus 2: this machine has 1"):
        LocalRunner(2, gpus=2, visible=("0",))


def test_an_error_of_the_sweep_itself_comes_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A full disk under ``trial.json`` is no trial's failure and must not be lost."""

    def run(*_: Any, **__: Any) -> State:
        raise OSError("no space left on device")

    monkeypatch.setattr(session, "run_trial", run)
    with pytest.raises(OSError, match="no space left"):
        Session(TRIALS, tmp_path).run(LocalRunner(2), retries=0, figures=(), command="")


class FakeRay(ModuleType):
    """As much of Ray as the runner calls, with tasks in threads; a cancelled task gets ``KeyboardInterrupt``."""

    def __init__(self) -> None:
        super().__init__("ray")
        self.exceptions = SimpleNamespace(RayError=RuntimeError)
        self.pool, self.cancelled, self.shut = ThreadPoolExecutor(4), threading.Event(), False

    def init(self, **_: Any) -> None:
        """A cluster is there."""

    def remote(self, **_: Any) -> Any:
        """Decorates a task."""
        return lambda task: SimpleNamespace(remote=lambda *args: self.pool.submit(task, *args))

    def wait(self, references: list[Future[Any]], timeout: float) -> tuple[list[Future[Any]], list[Future[Any]]]:
        """Those that are done, and the others."""
        done, left = wait(references, timeout=timeout)
        return list(done), list(left)

    def get(self, reference: Future[Any]) -> Any:
        """What a task returned."""
        return reference.result()

    def cancel(self, reference: Future[Any]) -> None:
        """Ends all of them here."""
        self.cancelled.set()

    def shutdown(self) -> None:
        """Leaves."""
        self.shut = True


@pytest.fixture
def ray(monkeypatch: pytest.MonkeyPatch) -> FakeRay:
    """In place of the package."""
    fake = FakeRay()
    monkeypatch.setitem(sys.modules, "ray", fake)
    return fake


def test_ray_runs_the_trials_and_a_lost_worker_is_a_failed_trial(
    ray: FakeRay, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Five end, the worker of one is gone; the sweep goes on and leaves the cluster."""

    def run(trial: Trial, folder: Path, *, environment: dict[str, str], **_: Any) -> State:
        assert environment["OMP_NUM_THREADS"] == "2"
        if trial.name == "seed=3":
            raise RuntimeError("the worker died")
        write_text(folder / "result.json", "{}")
        write_status(folder, Status(state=State.DONE, attempts=1, args=["train"]))
        return State.DONE

    monkeypatch.setattr(session, "run_trial", run)
    assert Session(TRIALS, tmp_path).run(session.RayRunner(2, cpus=2), retries=0, figures=(), command="") == 1
    assert ray.shut
    found = {trial.name: read_status(tmp_path / trial.name) for trial in TRIALS}
    assert [name for name, status in found.items() if status.state is not State.DONE] == ["seed=3"]
    assert found["seed=3"].why == "its worker was lost (the worker died)"


def test_a_stopped_task_of_ray_is_waited_for_while_it_saves(
    ray: FakeRay, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Cancelled, and the runner returns when the trial's status says that it has stopped."""

    def run(trial: Trial, folder: Path, **_: Any) -> State:
        write_status(folder, Status(state=State.RUNNING))
        assert ray.cancelled.wait(20.0)
        time.sleep(0.3)
        write_status(folder, Status(state=State.STOPPED))
        return State.STOPPED

    monkeypatch.setattr(session, "run_trial", run)
    runner = session.RayRunner(1)
    runner.run(TRIALS[0], tmp_path, 0, lambda: read_status(tmp_path).state is State.RUNNING)
    assert read_status(tmp_path).state is State.STOPPED
