"""USD files are tried out in a process of their own before this one opens them.

USD's readers are fast, not careful: a damaged or malicious file can make them overflow the stack, take all memory or
never end, and no exception tells. So a file is first opened, and composed in every variant, by a helper process with
little memory, stack and time (:func:`serve`; a request a line, an answer a line). What kills it is refused; what it
refuses, in its words. A file that passed is not tried again in this process until it or a layer of it changes.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import json
import math
import os
import resource
import select
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

from pxr import Usd

from mrwarp.usd.open_stage import AssetError, check_layer, choices, open_here, said

CPU_SECONDS = 20
"""Processor time that a file may take [s]."""

WALL_SECONDS = 10.0 * CPU_SECONDS
"""Longest wait for an answer [s]; a busy machine may need much longer than the helper's own processor time."""

MEMORY = 2**30
"""Address space that a file may take [bytes]."""

STACK = 2**22
"""Stack [bytes]: half of what a process usually has, so that what overflows the asking process' ends this one first."""

IDLE = 30.0
"""Time without a request after which the process ends [s]."""

READY = "ready\n"
"""What it says once it can take requests."""

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
    """The helper ended without an answer; arguments: how, and whether it was late."""


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
        how, late = gone.args
        if not fresh and not late:  # it leaves when idle, and an earlier file may have harmed it
            return _answer(request)
        return {"trouble": how}


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
        raise _GoneError(f"takes more than {CPU_SECONDS} s", True)
    raise _GoneError(f"crashes or takes more than {MEMORY >> 20} MiB ({_name(code)})", False)


def _name(code: int) -> str:
    try:
        return signal.Signals(-code).name
    except ValueError:
        return f"exit code {code}"


def _start() -> subprocess.Popen[str]:
    """Start the helper and wait until it has imported what it needs."""
    global _helper
    package = str(Path(__file__).resolve().parents[2])
    run = f"import sys; sys.path = {[package, *sys.path]!r}; from mrwarp.usd.stage_trial import serve; serve()"
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
            "check that 'python -c \"import mrwarp.usd.stage_trial\"' works, and that memory is free"
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


def serve() -> None:
    """The helper process: answer requests until there are no more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is meant for the asking process, which then ends this one
    answers = os.fdopen(os.dup(1), "w", encoding="ascii")
    os.dup2(2, 1)  # what libraries print must not be taken for an answer
    _limit(resource.RLIMIT_CORE, 0)
    _limit(resource.RLIMIT_STACK, STACK)
    if (used := Path("/proc/self/statm")).is_file():  # elsewhere address space is not limited, or not counted
        _limit(resource.RLIMIT_AS, int(used.read_text().split()[0]) * resource.getpagesize() + MEMORY)
    answers.write(READY)
    answers.flush()
    while select.select([sys.stdin], [], [], IDLE)[0] and (line := sys.stdin.readline()):
        request = json.loads(line)
        seconds = request.pop("seconds")
        _limit(resource.RLIMIT_CPU, math.ceil(sum(resource.getrusage(resource.RUSAGE_SELF)[:2])) + seconds)
        answer = try_out(**request)
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
        if "trouble" in answer:
            return  # who knows what is left of the libraries


def try_out(folder: str, file: str, allow_external: bool) -> dict[str, Any]:
    """Open a file as the asking process would, and read every value under every choice of variants.

    Returns:
        ``layers``, the files that were read, or ``refused``, the message, or ``trouble``, what the reader does.
    """
    os.chdir(folder)
    layers: set[str] = set()
    try:
        stage = open_here(Path(file), allow_external)
        for _ in choices(stage):
            _read(stage, file)
            layers.update(layer.realPath for layer in stage.GetUsedLayers() if layer.realPath)
    except AssetError as error:
        if "bad_alloc" not in str(error):
            return {"refused": str(error)}
        return {"trouble": f"takes more than {MEMORY >> 20} MiB"}
    except MemoryError:
        return {"trouble": f"takes more than {MEMORY >> 20} MiB"}
    except Exception as error:  # whatever it is, it is about this file
        return {"refused": f"{file}: cannot be opened: {type(error).__name__}: {said(error)}; repair the file"}
    return {"layers": sorted(layers)}


def _read(stage: Usd.Stage, file: str) -> None:
    for prim in stage.TraverseAll():
        prim.GetAppliedSchemas()
        for attribute in prim.GetAttributes():
            try:
                attribute.Get()
            except MemoryError:
                raise
            except Exception as error:  # USD's, or Boost's for what has no Python type
                raise AssetError(f"{file}: {attribute.GetPath()} cannot be read: {said(error)}; remove it") from None


def _limit(which: int, value: int) -> None:
    """Lower a limit; a lower one that is set already stays."""
    soft, hard = resource.getrlimit(which)
    allowed = [limit for limit in (value, hard, soft if which != resource.RLIMIT_CPU else hard)]
    resource.setrlimit(which, (min(limit for limit in allowed if limit != resource.RLIM_INFINITY), hard))
