"""One trial: begun again from its checkpoint when it is killed, not when its input is bad; stopped; its last lines."""

from pathlib import Path

import pytest

from mrwarp.sweep.grid import Trial
from mrwarp.sweep.trial import State, Status, command_line, read_status, run_trial, write_status

pytestmark = pytest.mark.usefixtures("fake")


def make_trial(seed: int) -> Trial:
    """A training with one seed; the seed decides what happens to it."""
    return Trial(name=f"seed={seed}", values={"seed": str(seed)}, command="train", args=(f"--seed={seed}",))


def test_a_killed_trial_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    """SIGKILL at step 10: the second start begins there, not at 0."""
    assert run_trial(make_trial(92), tmp_path, retries=2) is State.DONE
    log = (tmp_path / "log.txt").read_text()
    assert "starts at step 0" in log and "starts at step 10" in log
    assert log.count("$ mrwarp train") == 2
    status = read_status(tmp_path)
    assert (status.attempts, status.code, status.pid) == (2, 0, None) and status.seconds > 0.0


def test_kills_without_retries_are_reported(tmp_path: Path) -> None:
    """None left: failed, with the signal's name and the last lines."""
    assert run_trial(make_trial(92), tmp_path, retries=0) is State.FAILED
    status = read_status(tmp_path)
    assert (status.why, status.attempts) == ("killed by SIGKILL", 1)
    assert status.lines[-1] == "starts at step 0"


@pytest.mark.parametrize(
    ("seed", "state", "attempts", "why"),
    [(90, State.FAILED, 1, "exit code 2"), (91, State.FAILED, 2, "exit code 1 without a result.json"),
     (93, State.MISSED, 1, "missed its aim (exit code 1)")],
)  # fmt: skip
def test_how_a_trial_ends(tmp_path: Path, seed: int, state: State, attempts: int, why: str) -> None:
    """Bad input is not tried again, a crash is, a missed aim is a result."""
    assert run_trial(make_trial(seed), tmp_path, retries=1) is state
    status = read_status(tmp_path)
    assert (status.state, status.attempts, status.why) == (state, attempts, why)


def test_stopping_lets_the_trial_save(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Stopped in the middle: state stopped, a checkpoint to go on from, and the next call finishes it."""
    monkeypatch.setenv("FAKE_STEP_TIME", "0.5")
    saved = tmp_path / "checkpoint.pt"
    assert run_trial(make_trial(0), tmp_path, retries=2, stopped=saved.is_file) is State.STOPPED
    reached = int(saved.read_text())
    assert 0 < reached < 20 and read_status(tmp_path).code == 130
    monkeypatch.setenv("FAKE_STEP_TIME", "0")
    assert run_trial(make_trial(0), tmp_path, retries=0) is State.DONE
    assert f"starts at step {reached}" in (tmp_path / "log.txt").read_text()


def test_only_a_begun_training_is_resumed(tmp_path: Path) -> None:
    """Other commands have no ``--resume``."""
    (tmp_path / "checkpoint.pt").write_text("3")
    assert command_line(make_trial(0), tmp_path)[-2:] == ["--resume", str(tmp_path / "checkpoint.pt")]
    walk = Trial(name="a", values={}, command="walk", args=())
    assert command_line(walk, tmp_path) == ["walk", "--out", str(tmp_path)]


@pytest.mark.parametrize("text", ["", "{", "[]", "null", '{"state": "asleep"}', '{"state": "done", "more": 1}'])
def test_a_damaged_status_is_a_waiting_trial(tmp_path: Path, text: str) -> None:
    """The trial is run again rather than believed."""
    (tmp_path / "trial.json").write_text(text)
    assert read_status(tmp_path) == Status()


def test_status_round_trip(tmp_path: Path) -> None:
    """What is written is read."""
    status = Status(state=State.FAILED, args=["a"], attempts=3, seconds=1.5, code=-9, why="x", lines=["y"])
    write_status(tmp_path / "new", status)
    assert read_status(tmp_path / "new") == status
