"""Runs the cases of a kind in batches, each in a process of its own, and keeps count."""

from __future__ import annotations

import contextlib
import faulthandler
import json
import multiprocessing
import os
import random
import re
import resource
import signal
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

from benchmarks.fuzz.command_line import run_cli
from benchmarks.fuzz.coverage import Lines
from benchmarks.fuzz.kinds import KINDS
from mrwarp.options.command_table import all_commands
from mrwarp.run_dir import write_text

BATCH = 500
"""Cases of one process."""

MEMORY = 2**31
"""Address space that a batch may add to what it starts with [bytes]."""

HANG = 20.0
"""Longest time of a case [s]."""

REMEDY = re.compile(
    r"; |allowed|needed|must |use |give |name |remove|repair|correct|check |choose|again|known|--help|expected"
)
"""Words by which a remedy is recognised."""


class HangError(Exception):
    """A case took too long."""


def reason(message: str, path: Path) -> str:
    """A refusal without what differs from case to case: its kind."""
    text = message.replace(str(path), "FILE").replace(str(path.parent), "DIR")
    text = re.sub(r"'[^']*'|\"[^\"]*\"|\([^)]*\)", "'...'", text)
    text = re.sub(r"-?[\d.]+(?:e[-+]?\d+)?|nan|inf|[^\x20-\x7e]+", "#", text)
    return " ".join(text.split())[:110]


def run_batch(
    kind: str, seed: int, batch: int, cases: int, folder: Path, at: Any = None, *, coverage: bool = False
) -> dict[str, Any]:
    """Run the cases of a batch in this process: counts of refusals by reason, and failures with their input.

    Args:
        kind: One of :data:`KINDS`, or ``cli``.
        seed: Seed of the run.
        batch: Number of the batch.
        cases: Cases of the batch.
        folder: Where the input is written.
        at: Shared number that holds the current case.
        coverage: Also keep inputs that reach new lines of mrwarp.
    """
    rng = random.Random(f"{kind}/{seed}/{batch}")
    counts: Counter[str] = Counter()
    failures: list[dict[str, Any]] = []
    spec = KINDS.get(kind)
    corpus = spec.seeds() if spec else []
    errors = spec.refusals() if spec else ()
    path = folder / f"input{spec.suffix if spec else ''}"
    (folder / "file").write_text("a file where a folder is wanted")
    known = {"file", path.name}
    lines = Lines() if coverage and spec else None
    signal.signal(signal.SIGALRM, _hang)
    for case in range(cases):
        if at is not None:
            at.value = case
        data, argv, message, problem = b"", [], "good", ""
        signal.setitimer(signal.ITIMER_REAL, HANG)
        faulthandler.dump_traceback_later(2.5 * HANG)  # of a hang in C, which the alarm cannot end
        try:
            with warnings.catch_warnings(), lines or contextlib.nullcontext():
                warnings.simplefilter("ignore")
                if spec is None:
                    message, argv = run_cli(folder, rng)
                else:
                    data = spec.mutate(rng.choice(corpus), rng)
                    path.write_bytes(data)
                    spec.read(path)
        except errors as error:
            message = str(error)
            if str(folder) not in message or not REMEDY.search(message) or "\n" in message or len(message) > 2000:
                problem = f"refusal without file or remedy, or of several lines: {message[:500]}"
        except Exception:  # what a reader lets escape is the failure that is looked for
            problem = traceback.format_exc(limit=-6)
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
            faulthandler.cancel_dump_traceback_later()
        left = {file.name for file in folder.iterdir()} - known
        if left:
            problem = problem or f"left behind: {sorted(left)}"
            known |= left
        key = reason(message, path)
        reached = message != "good" and key not in counts or lines is not None and lines.new > 0
        if spec and reached and len(corpus) < 60:
            corpus.append(data)
        counts["FAILED" if problem else key] += 1
        if problem:
            failures.append(
                {"case": case, "problem": problem, "argv": argv, "data": data.hex() if len(data) < 2**20 else ""}
            )
    return {"counts": dict(counts), "failures": failures, "peak": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}


def _hang(*_: Any) -> None:
    raise HangError(f"longer than {HANG} s")


def _child(kind: str, seed: int, batch: int, cases: int, coverage: bool, at: Any, out: Any, said: str) -> None:
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 2)  # USD and MuJoCo write there from C
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        work = Path(folder) / "work"
        work.mkdir()
        out.put(run_batch(kind, seed, batch, cases, work, at, coverage=coverage))


def isolated(kind: str, seed: int, batch: int, cases: int, *, coverage: bool = False) -> dict[str, Any]:
    """Run a batch in a process of its own; a crash, a hang in C or a memory blow-up is a failure like others.

    The same batch makes the same cases, so one that ends its process is run again: what ended it from outside does not
    come back.
    """
    found = [_isolated(kind, seed, batch, cases, coverage)]
    if found[0].get("ended"):
        found.append(_isolated(kind, seed, batch, cases, coverage))
    return found[-1]


def _isolated(kind: str, seed: int, batch: int, cases: int, coverage: bool) -> dict[str, Any]:
    context = multiprocessing.get_context("fork")
    at, out = context.Value("i", -1), context.SimpleQueue()
    said = tempfile.NamedTemporaryFile(suffix=".txt")
    process = context.Process(target=_child, args=(kind, seed, batch, cases, coverage, at, out, said.name))
    process.start()
    last, since = -1, time.monotonic()
    while process.is_alive() and out.empty():
        time.sleep(0.02)
        if at.value != last:
            last, since = at.value, time.monotonic()
        if time.monotonic() - since > 3.0 * HANG:
            process.kill()
            break
    result = out.get() if not out.empty() else None
    process.join()
    if result is None:
        tail = Path(said.name).read_text(errors="replace")[-2000:]
        problem = f"process ended with {process.exitcode} (killed, crashed or hung) in case {at.value}: {tail}"
        failure = {"case": at.value, "problem": problem, "argv": [], "data": ""}
        result = {"counts": {"FAILED": 1}, "failures": [failure], "ended": True}
    return result


def run(kind: str, cases: int, *, seed: int, out: Path, seconds: float, coverage: bool = False) -> dict[str, Any]:
    """Run up to ``cases`` cases of a kind, from where the state file says, for at most ``seconds``; the new state."""
    out.mkdir(parents=True, exist_ok=True)
    name = f"{kind}-{seed}{'-coverage' if coverage else ''}"
    file = out / f"{name}.json"
    state: dict[str, Any] = {"kind": kind, "seed": seed, "cases": 0, "batches": 0, "counts": {}, "failures": 0}
    if file.is_file():
        state = json.loads(file.read_text())
    if kind == "cli":  # once, not in every batch
        for _, command in all_commands():
            command.load()
    else:
        with tempfile.TemporaryDirectory() as folder:  # a good file first: its imports are no case's time
            path = Path(folder) / f"input{KINDS[kind].suffix}"
            path.write_bytes(KINDS[kind].seeds()[0])
            with contextlib.suppress(Exception):
                KINDS[kind].read(path)
    end = time.monotonic() + seconds
    while state["cases"] < cases and time.monotonic() < end:
        size = min(BATCH, cases - state["cases"])
        found = isolated(kind, seed, state["batches"], size, coverage=coverage)
        state["counts"] = dict(Counter(state["counts"]) + Counter(found["counts"]))
        state["cases"], state["batches"] = state["cases"] + size, state["batches"] + 1
        state["peak_mib"] = max(state.get("peak_mib", 0), found.get("peak", 0) // 1024)
        for failure in found["failures"]:
            state["failures"] += 1
            if state["failures"] <= 50:
                (out / "failures").mkdir(exist_ok=True)
                stem = out / "failures" / f"{name}-{state['batches'] - 1}-{failure['case']}"
                stem.with_suffix(".txt").write_text(f"{failure['problem']}\n{failure['argv']}\n")
                stem.with_suffix(".bin").write_bytes(bytes.fromhex(failure["data"]))
        write_text(file, json.dumps(state, indent=1))
        print(
            f"{kind}: {state['cases']} of {cases} cases, {state['failures']} failures, {len(state['counts'])} outcomes",
            flush=True,
        )
    return state
