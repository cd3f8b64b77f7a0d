"""A trial is begun again from its checkpoint when it is killed, not when its input is bad; where it runs."""

import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from mrwarp.sweep import runners
from mrwarp.sweep.grid import GridError, Trial
from mrwarp.sweep.runners import Status, local_runner, read_status, run_trial, run_trials, write_status


def make_trial(out: Path, seed: int = 0) -> Trial:
    """A training with one seed, which decides what happens to it; the sweep's mark stands in its folder."""
    (out / "running").touch()
    return Trial(folder=out / f"seed={seed}", values={"seed": str(seed)}, args=["train", f"--seed={seed}"])


@pytest.mark.usefixtures("fake")
@pytest.mark.parametrize(
    ("seed", "retries", "state", "attempts", "why"),
    [
        (90, 1, "failed", 1, "exit code 2"),
        (91, 1, "failed", 2, "exit code 1 without a result.json"),
        (92, 0, "failed", 1, "killed by SIGKILL"),
        (93, 1, "missed", 1, "missed its aim (exit code 1)"),
    ],
)
def test_how_a_trial_ends(tmp_path: Path, seed: int, retries: int, state: str, attempts: int, why: str) -> None:
    """Bad input is not tried again, a crash is, a missed aim is a result; a failure keeps the last lines."""
    trial = make_trial(tmp_path, seed)
    run_trial(trial, tmp_path / "running", retries, {})
    status = read_status(trial)
    assert (status.state, status.attempts, status.why) == (state, attempts, why)
    assert bool(status.last_lines) == (state == "failed")


@pytest.mark.usefixtures("fake")
def test_only_a_training_is_resumed(tmp_path: Path) -> None:
    """Other commands have no ``--resume``."""
    trial = Trial(folder=make_trial(tmp_path).folder, values={}, args=["walk", "--seed=0"])
    trial.folder.mkdir()
    (trial.folder / "checkpoint.pt").write_text("3")
    run_trial(trial, tmp_path / "running", 0, {})
    assert (trial.folder / "log.txt").read_text().splitlines()[0] == f"$ mrwarp walk --seed=0 --out {trial.folder}"


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"state": "done", "more": 1}'])
def test_a_damaged_status_is_a_waiting_trial(tmp_path: Path, text: str) -> None:
    """The trial is run again rather than believed."""
    trial = make_trial(tmp_path)
    write_status(trial, Status(state="failed", args=["a"], attempts=3, why="x"))
    assert read_status(trial) == Status(state="failed", args=["a"], attempts=3, why="x")
    (trial.folder / "trial.json").write_text(text)
    assert read_status(trial) == Status()


def test_no_two_trials_share_a_gpu(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Five GPUs, two for each trial: two trials at a time, each with a pair of its own."""
    busy: set[str] = set()
    seen: list[str] = []

    def run(trial: Trial, mark: Path, retries: int, variables: dict[str, str]) -> None:
        pair = variables["CUDA_VISIBLE_DEVICES"]
        assert pair not in busy and variables["OMP_NUM_THREADS"] == "3"
        busy.add(pair)
        seen.append(pair)
        time.sleep(0.05)
        busy.remove(pair)

    monkeypatch.setattr(runners, "run_trial", run)
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0,1,2,3,7")
    runner = local_runner(8, cpus=3, gpus=2, retries=0)
    assert runner.workers == 2
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(runner.run, [make_trial(tmp_path, seed) for seed in range(6)], [tmp_path] * 6))
    assert set(seen) == {"0,1", "2,3"} and len(seen) == 6


def test_more_gpus_than_there_are_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Both numbers are named."""
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "0")
    with pytest.raises(GridError, match="--gpus 2: this machine has 1"):
        local_runner(1, cpus=1, gpus=2, retries=0)


def test_an_error_of_the_sweep_itself_comes_out(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A full disk under ``trial.json`` is no trial's failure and must not be lost."""

    def run(*_: Any) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(runners, "run_trial", run)
    with pytest.raises(OSError, match="no space left"):
        run_trials(
            [make_trial(tmp_path, seed) for seed in range(6)], tmp_path, local_runner(2, cpus=1, gpus=0, retries=0)
        )
    assert not list(tmp_path.glob("running-*"))
