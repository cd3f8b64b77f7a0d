"""``mrwarp sweep``: six trials survive a killed worker; resumed, extended, stopped; failures cost only themselves."""

import json
import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.sweep.grid import Trial
from mrwarp.sweep.runners import Status, read_status
from tests.messages import Refused

SIX = ["--command", "train", "--grid", "seed=0,1,2", "actuator=none,bouc_wen", "--workers", "3"]


def status_in(folder: Path) -> Status:
    """How the trial in a folder stands."""
    return read_status(Trial(folder=folder, values={}, args=[]))


def result(out: Path) -> dict:
    """The sweep's result."""
    return json.loads((out / "result.json").read_text())


def kill_one_worker(out: Path, *, begun: Callable[[Path], bool]) -> threading.Thread:
    """Kill the process of the first trial that has got somewhere, from outside the sweep."""

    def watch() -> None:
        for _ in range(1200):
            for folder in sorted(out.glob("seed=*")):
                status = status_in(folder)
                if status.state == "running" and status.pid and begun(folder):
                    os.kill(status.pid, signal.SIGKILL)
                    (out / "killed").write_text(folder.name)
                    return
            time.sleep(0.05)

    thread = threading.Thread(target=watch)
    thread.start()
    return thread


@pytest.mark.usefixtures("fake")
def test_six_trials_survive_a_killed_worker(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """SIGKILL to a trial's process in mid-run: it is begun again from its checkpoint, and all six have results."""
    monkeypatch.setenv("FAKE_STEP_TIME", "0.1")  # the second life lasts longer than between two looks at it
    watch = kill_one_worker(tmp_path, begun=lambda folder: (folder / "checkpoint.pt").is_file())
    assert main(["sweep", "--out", str(tmp_path), *SIX]) == 0
    watch.join()
    killed = (tmp_path / "killed").read_text()
    found = result(tmp_path)
    assert found["states"] == {"done": 6} and len(found["trials"]) == 6
    assert {t["name"]: t["attempts"] for t in found["trials"]} == {
        t["name"]: 1 + (t["name"] == killed) for t in found["trials"]
    }
    assert all(t["figures"]["iterations"] == 20 for t in found["trials"])
    log = (tmp_path / killed / "log.txt").read_text()
    assert log.count("starts at step") == 2 and log.count("starts at step 0") == 1
    said = capsys.readouterr().out
    assert f"{killed}: done after" in said and ", 2 starts\n" in said and "6 of 6 trials have a result" in said
    assert {path.name for path in tmp_path.iterdir() if path.is_file()} == {
        "result.json",
        "trials.csv",
        "trials.png",
        "killed",
    }


@pytest.mark.usefixtures("fake")
def test_failures_cost_only_themselves_and_are_run_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """One refuses, one crashes, one misses its aim; a second call runs the first two and what is new."""
    args = ["--out", str(tmp_path), "--command", "train", "--retries", "1", "--workers", "4"]
    assert main(["sweep", *args, "--grid", "seed=0,90,91,93"]) == 1
    said = capsys.readouterr().out
    assert "seed=91: failed after" in said and "exit code 1 without a result.json; its last lines:" in said
    assert "    RuntimeError: seed 91 crashes" in said and "    train/ppo.py: seed 90 is refused" in said
    assert result(tmp_path)["states"] == {"done": 1, "failed": 2, "missed": 1}
    failed = {t["name"]: t for t in result(tmp_path)["trials"]}["seed=91"]
    assert failed["why"].startswith("exit code 1") and failed["last_lines"][-1] == "RuntimeError: seed 91 crashes"

    logs = {seed: (tmp_path / f"seed={seed}" / "log.txt").read_text() for seed in (0, 93)}
    assert main(["sweep", *args, "--grid", "seed=0,90,91,93,5"]) == 1
    assert "5 trials of mrwarp train, 2 of them finished before" in capsys.readouterr().out
    assert {seed: (tmp_path / f"seed={seed}" / "log.txt").read_text() for seed in logs} == logs
    assert result(tmp_path)["states"] == {"done": 2, "failed": 2, "missed": 1}


@pytest.mark.usefixtures("fake")
def test_another_sweep_is_not_overwritten(tmp_path: Path, refused: Refused) -> None:
    """Other fixed arguments in the same folder are refused, by the folder's name and what it holds."""
    args = ["--out", str(tmp_path), "--command", "train", "--grid", "seed=0"]
    assert main(["sweep", *args, "--", "--num-envs", "8"]) == 0
    before = (tmp_path / "result.json").read_bytes()
    error = refused("sweep", *args, "--", "--num-envs", "16")
    assert str(tmp_path / "seed=0") in error and "--num-envs 8" in error and "name another --out" in error
    assert (tmp_path / "result.json").read_bytes() == before


def second_sweep(args: list[str], out: Path) -> None:
    """A sweep in a process of its own; what it says goes to files."""
    # a shell that starts the tests in the background has it ignored
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with (out / "said").open("w") as said, (out / "errors").open("w") as errors:
        os.dup2(said.fileno(), 1)
        os.dup2(errors.fileno(), 2)
        sys.stdout, sys.stderr = said, errors
        code = main(["sweep", *args])
        said.flush()
        errors.flush()
        os._exit(code)


@pytest.mark.usefixtures("fake")
@pytest.mark.parametrize("sent", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_stops_the_workers_and_the_same_command_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sent: signal.Signals
) -> None:
    """SIGINT, or SIGTERM of a scheduler: code 130, no process left, checkpoints kept; the next call finishes."""
    args = ["--out", str(tmp_path), "--command", "train", "--grid", "seed=0,1,2", "--workers", "2"]
    monkeypatch.setenv("FAKE_STEP_TIME", "0.5")
    run = multiprocessing.get_context("fork").Process(target=second_sweep, args=(args, tmp_path))
    run.start()
    assert run.pid is not None
    deadline = time.monotonic() + 60.0
    while not all((tmp_path / f"seed={k}" / "checkpoint.pt").is_file() for k in (0, 1)):
        assert time.monotonic() < deadline and run.is_alive()
        time.sleep(0.1)
    pids = [status_in(tmp_path / f"seed={k}").pid for k in (0, 1)]
    os.kill(run.pid, sent)
    run.join(30)
    errors = (tmp_path / "errors").read_text()
    assert run.exitcode == 130, errors
    assert "the same command goes on" in (tmp_path / "said").read_text() and "Traceback" not in errors
    assert [status_in(tmp_path / f"seed={k}").state for k in (0, 1, 2)] == [
        "stopped",
        "stopped",
        "waiting",
    ]
    for pid in pids:
        assert pid is not None
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    monkeypatch.setenv("FAKE_STEP_TIME", "0")
    assert main(["sweep", *args]) == 0
    assert "starts at step 0" not in (tmp_path / "seed=0" / "log.txt").read_text().split("$ mrwarp")[2]
