"""Where trials run: GPUs are handed out to one trial at a time, errors of the sweep itself come out."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from mrwarp.sweep import runners
from mrwarp.sweep.grid import GridError, Trial
from mrwarp.sweep.runners import LocalRunner
from mrwarp.sweep.session import Session
from mrwarp.sweep.trial import State

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

    monkeypatch.setattr(runners, "run_trial", run)
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

    monkeypatch.setattr(runners, "run_trial", run)
    with pytest.raises(OSError, match="no space left"):
        Session(TRIALS, tmp_path).run(LocalRunner(2), retries=0, figures=(), command="")
