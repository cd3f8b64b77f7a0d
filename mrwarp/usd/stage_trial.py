"""USD files are tried out in a process of their own before this one opens them.

USD's readers are fast, not careful: a damaged or malicious file can make them overflow the stack, take all memory or
never end, and no exception tells. So a file is first opened, and composed in every variant, by a helper process with
little memory, stack and time (:mod:`mrwarp.usd.stage_trial_process`). What kills it is refused. What it refuses is
refused in its words. A file that passed is not tried again in this process until it, or a layer that it uses, changes.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import json
import os
import select
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from pxr import Usd

from mrwarp.usd.open_stage import AssetError, check_layer, open_here
from mrwarp.usd.stage_trial_process import MEMORY, READY

CPU_SECONDS = 20
"""Processor time that a file may take [s]."""

WALL_SECONDS = 10.0 * CPU_SECONDS
"""Longest wait for an answer [s]; a busy machine may need much longer than the helper's own processor time."""

_REMEDY = "it is damaged or made to harm: undo the last edit, or export it again"


def open_stage(file: Path, allow_external: bool = False) -> Usd.Stage:
    """Try ``file`` out, then open it with a session layer of its own as edit target.

    Raises:
        AssetError: the file cannot be read or composed, or not with the helper's memory, stack and time.
    """
    check_layer(file)
    key = (str(file.resolve()), allow_external)
    if not _unchanged(_passed.get(key, {})):
        request = {"folder": os.getcwd(), "file": str(file), "allow_external": allow_external, "seconds": CPU_SECONDS}
        with _lock:
            answer = _answer(request)
        if "trouble" in answer:
            raise AssetError(f"{file}: USD's reader {answer['trouble']} with it; {_REMEDY}")
        if "refused" in answer:
            raise AssetError(answer["refused"])
        _passed[key] = {path: digest(Path(path)) for path in answer["layers"] if Path(path).is_file()}
    return open_here(file, allow_external)


def digest(file: Path) -> str:
    """Hash of a file's content."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "blake2b").hexdigest()


_passed: dict[tuple[str, bool], dict[str, str]] = {}
"""Hash of every layer of the files that passed."""

_lock = threading.Lock()
_helper: subprocess.Popen[str] | None = None


class _GoneError(Exception):
    """The helper ended without an answer; says how."""

    def __init__(self, how: str, *, late: bool = False) -> None:
        super().__init__(how)
        self.late = late


def _unchanged(layers: dict[str, str]) -> bool:
    try:
        return bool(layers) and all(digest(Path(path)) == known for path, known in layers.items())
    except OSError:
        return False


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    """The helper's answer; a file is blamed for a crash only of a helper that was started for it."""
    fresh = _helper is None
    try:
        return _ask(_helper or _start(), request)
    except _GoneError as gone:
        if not fresh and not gone.late:  # it leaves when idle, and an earlier file may have harmed it
            return _answer(request)
        return {"trouble": str(gone)}


def _ask(helper: subprocess.Popen[str], request: dict[str, Any]) -> dict[str, Any]:
    assert helper.stdin and helper.stdout
    line = ""
    try:
        with contextlib.suppress(BrokenPipeError):
            helper.stdin.write(json.dumps(request) + "\n")
            helper.stdin.flush()
            if select.select([helper.stdout], [], [], WALL_SECONDS)[0]:
                line = helper.stdout.readline()
    except BaseException:  # Ctrl-C: the answer that is on its way must not be taken for the next one's
        stop()
        raise
    if line.endswith("\n"):
        return json.loads(line)
    code = stop()
    if code in (-signal.SIGXCPU, None):
        raise _GoneError(f"takes more than {CPU_SECONDS} s", late=True)
    raise _GoneError(f"crashes or takes more than {MEMORY >> 20} MiB ({_name(code)})")


def _name(code: int) -> str:
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit code {code}"


def _start() -> subprocess.Popen[str]:
    """Start the helper and wait until it has imported what it needs."""
    global _helper
    package = str(Path(__file__).resolve().parents[2])
    run = f"import sys; sys.path = {[package, *sys.path]!r}; from mrwarp.usd.stage_trial_process import main; main()"
    # one thread: the limit is of address space, of which every thread takes a large piece
    env = {**os.environ, "PXR_WORK_THREAD_LIMIT": "1", "MALLOC_ARENA_MAX": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        _helper = subprocess.Popen(
            [sys.executable, "-I", "-c", run], env=env, text=True, encoding="ascii",
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
        )  # fmt: skip
    except OSError as error:
        raise AssetError(f"no process can be started to try USD files out ({error.strerror}); free some") from None
    assert _helper.stdout
    if _helper.stdout.readline() != READY:
        raise AssetError(
            f"the process that tries USD files out does not start ({_name(stop() or 0)}); "
            "check that 'python -c \"import mrwarp.usd.stage_trial_process\"' works, and that memory is free"
        )
    return _helper


def stop() -> int | None:
    """End the helper, if there is one; its exit code, or None if it had to be killed."""
    global _helper
    helper, _helper = _helper, None
    if helper is None:
        return 0
    assert helper.stdin and helper.stdout
    with contextlib.suppress(OSError):
        helper.stdin.close()
    try:
        return helper.wait(1.0)
    except subprocess.TimeoutExpired:
        helper.kill()
        helper.wait()
        return None
    finally:
        helper.stdout.close()


def _forget() -> None:
    """A forked process starts a helper of its own; two must not talk to one."""
    global _helper, _lock
    _helper, _lock = None, threading.Lock()


atexit.register(stop)
os.register_at_fork(after_in_child=_forget)
