"""Helper process that tries USD files out (:mod:`mrwarp.usd.stage_trial`): a request a line, an answer a line."""

from __future__ import annotations

import json
import math
import os
import resource
import select
import signal
import sys
from pathlib import Path
from typing import Any

from pxr import Usd

from mrwarp.usd.open_stage import AssetError, choices, open_here, said

MEMORY = 2**30
"""Address space that a file may take [bytes]."""

STACK = 2**22
"""Stack [bytes]: half of what a process usually has, so that what overflows the asking process' ends this one first."""

IDLE = 30.0
"""Time without a request after which the process ends [s]."""

READY = "ready\n"
"""What it says once it can take requests."""


def main() -> None:
    """Answer requests until there are no more."""
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
