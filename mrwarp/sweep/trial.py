"""One trial: the command in a process of its own, started again when it is killed; its state is in ``trial.json``."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from enum import StrEnum
from pathlib import Path

from mrwarp.run_dir import write_text
from mrwarp.sweep.grid import Trial

LAUNCH = (sys.executable, "-m", "mrwarp.cli")
"""Beginning of the command line of a trial's process."""

PATIENCE = 60.0
"""Time that a stopped trial has to save [s]."""

LAST_LINES = 8
"""Lines of a failed trial that are kept."""


class State(StrEnum):
    """How a trial stands."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    MISSED = "missed"
    """It ran to its end and says that its aim was missed (exit code 1), e.g. the walking gate."""
    FAILED = "failed"
    STOPPED = "stopped"
    """By Ctrl-C; goes on with the next call."""


FINISHED = (State.DONE, State.MISSED)
"""States with a result, which are not run again."""


@dataclass(kw_only=True)
class Status:
    """Content of ``trial.json``."""

    state: State = State.WAITING
    args: list[str] = field(default_factory=list)
    """Command and arguments."""
    attempts: int = 0
    """Starts in this call of the sweep."""
    seconds: float = 0.0
    """Time of all starts, also of earlier calls [s]."""
    code: int | None = None
    """Last exit code; negative is a signal."""
    why: str = ""
    """Why the last start did not end well, one line."""
    pid: int | None = None
    """Process of the command while it runs."""
    lines: list[str] = field(default_factory=list)
    """Last lines of a failed trial."""


def read_status(folder: Path) -> Status:
    """Status of a trial; waiting, where nothing (readable) stands."""
    try:
        content = json.loads((folder / "trial.json").read_text(encoding="utf-8"))
        return Status(**{**content, "state": State(content["state"])})
    except (OSError, ValueError, TypeError, KeyError):
        return Status()


def write_status(folder: Path, status: Status) -> None:
    """Write a trial's status, whole or not at all."""
    write_text(folder / "trial.json", json.dumps(asdict(status), indent=2) + "\n")


def command_line(trial: Trial, folder: Path) -> list[str]:
    """Command and arguments with ``--out``, and with ``--resume`` for a training that has a checkpoint."""
    line = [trial.command, *trial.args, "--out", str(folder)]
    saved = folder / "checkpoint.pt"
    return [*line, "--resume", str(saved)] if trial.command == "train" and saved.is_file() else line


def run_trial(
    trial: Trial,
    folder: Path,
    *,
    retries: int,
    environment: dict[str, str] | None = None,
    stopped: Callable[[], bool] = lambda: False,
) -> State:
    """Run a trial to its end; a start that is killed or crashes is repeated, bad input is not.

    Args:
        trial: What to run.
        folder: Its folder; gets ``log.txt`` and ``trial.json`` beside what the command writes.
        retries: Most repetitions.
        environment: Environment variables for the process.
        stopped: Asked again and again; True has the process save and end.

    Returns:
        How it ended.
    """
    before = read_status(folder)
    status = Status(args=[trial.command, *trial.args])
    if before.state is State.RUNNING:  # Ray began it again on another worker
        status.attempts, status.why = before.attempts, "its worker was killed"
    started = time.monotonic()
    while status.state is State.WAITING or (
        status.state is State.FAILED and status.code != 2 and status.attempts <= retries
    ):
        status.attempts, status.state = status.attempts + 1, State.RUNNING
        status.code, interrupted = _run_once(trial, folder, status, environment or {}, stopped)
        status.pid, status.seconds = None, before.seconds + time.monotonic() - started
        status.state, status.why = _outcome(status.code, interrupted, (folder / "result.json").is_file())
    if status.state is State.FAILED:
        status.lines = last_lines(folder)
    write_status(folder, status)
    return status.state


def _outcome(code: int, interrupted: bool, result: bool) -> tuple[State, str]:
    """State after a start, and why it did not end well."""
    if interrupted:
        return State.STOPPED, "stopped"
    if code in (0, 1) and result:
        return (State.DONE, "") if code == 0 else (State.MISSED, "missed its aim (exit code 1)")
    with contextlib.suppress(ValueError):
        return State.FAILED, f"killed by {signal.Signals(-code).name}"
    return State.FAILED, f"exit code {code}" + (" without a result.json" if code in (0, 1) else "")


def _run_once(
    trial: Trial, folder: Path, status: Status, environment: dict[str, str], stopped: Callable[[], bool]
) -> tuple[int, bool]:
    """Exit code of one start, and whether it was stopped from outside."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "result.json").unlink(missing_ok=True)  # of a start that was stopped
    line = command_line(trial, folder)
    with (folder / "log.txt").open("a", encoding="utf-8") as log:
        print(f"$ mrwarp {shlex.join(line)}", file=log, flush=True)
        process = subprocess.Popen(
            [*LAUNCH, *line],
            stdin=subprocess.DEVNULL,
            stdout=log,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONUNBUFFERED": "1", **environment},
            start_new_session=True,  # Ctrl-C comes to the sweep, which tells its trials
            preexec_fn=_die_with_parent if sys.platform == "linux" else None,
        )
        status.pid = process.pid
        write_status(folder, status)
        with contextlib.suppress(KeyboardInterrupt):  # from Ray, or in a process that runs one trial itself
            while process.poll() is None and not stopped():
                time.sleep(0.1)
        if (code := process.poll()) is not None:
            return code, False
        for sent, patience in ((signal.SIGINT, PATIENCE), (signal.SIGKILL, None)):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, sent)  # and what it started
            with contextlib.suppress(subprocess.TimeoutExpired):
                return process.wait(patience), True
        return process.returncode, True


def last_lines(folder: Path, count: int = LAST_LINES) -> list[str]:
    """Last lines of a trial's log that are not empty."""
    try:
        text = (folder / "log.txt").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return []
    return [line.rstrip()[:300] for line in text[-20_000:].splitlines() if line.strip()][-count:]


_LIBC = ctypes.CDLL(None) if sys.platform == "linux" else None


def _die_with_parent() -> None:
    """In the new process: have the kernel kill it when the process (and thread) that started it is gone."""
    assert _LIBC is not None
    _LIBC.prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG
