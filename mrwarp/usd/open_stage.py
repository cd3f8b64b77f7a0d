"""Open a USD file: tried out in another process first, then composed here, with every error on one line.

USD's readers are fast, not careful: a damaged or malicious file can make them overflow the stack, take all memory or
never end, and no exception reports it. So a helper process with little memory, stack and time opens and composes each
file first (:func:`serve`; a request a line, an answer a line). What kills the helper is refused; what it refuses, in
its words. A file that passed is not tried again in this process until it or a layer of it changes. The shipped assets
are not tried out: they are a part of this package as its code is.
"""

from __future__ import annotations

import atexit
import contextlib
import itertools
import json
import math
import os
import re
import resource
import select
import signal
import subprocess
import sys
import threading
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import newton_usd_schemas  # noqa: F401  (registers Newton's schemas; must happen before the registry is first used)
from pxr import Plug, Sdf, Tf, Usd, UsdPhysics, UsdUtils

from mrwarp.run_dir import no_file

SCHEMA = "MrwarpMRDriveAPI"
"""Applied API schema that makes a ``NewtonActuator`` an MR joint."""

_HERE = Path(__file__).resolve().parents[1]
ASSETS = next((p for p in (_HERE / "assets/usd", _HERE.parent / "assets/usd") if p.is_dir()), _HERE / "assets/usd")
"""Folder of the USD assets: inside the package when installed as a wheel, next to it in a checkout."""

MAX_BYTES = 2**28
"""Largest file [bytes]."""

MAX_CHOICES = 64
"""Most combinations of the default prim's variants."""

MAX_QUOTED = 400
"""Most characters of USD's own messages, which quote from the file."""

MAX_MESSAGE = 1500
"""Length of a refusal [characters]."""

CPU_SECONDS = 20
"""Processor time that a file may take in the helper [s]."""

WALL_SECONDS = 10.0 * CPU_SECONDS
"""Longest wait for the helper's answer [s]; a busy machine may need much longer than the processor time."""

MEMORY = 2**30
"""Address space that a file may take [bytes]."""

STACK = 2**22
"""The helper's stack [bytes]: half of the usual, so that what overflows the asking process' ends the helper first."""

IDLE = 30.0
"""Time without a request after which the helper ends [s]."""

_REMEDY = "it is damaged or made to harm: undo the last edit, or export it again"
_TOO_LARGE = {"trouble": f"takes more than {MEMORY >> 20} MiB"}


class AssetError(ValueError):
    """A USD asset was refused; the message names file, prim path, attribute, value and the allowed range or remedy.

    Names and values come from the file and may be of any length: the middle of a long message is left out.
    """

    def __init__(self, message: str) -> None:
        if len(message) > MAX_MESSAGE:
            message = f"{message[: MAX_MESSAGE - 400]} ... {message[-395:]}"
        super().__init__(message)


# USD knows the schema from the import on; too late once its registry is built: then opening warns
Plug.Registry().RegisterPlugins(str(ASSETS / "schema"))


def open_stage(file: Path) -> Usd.Stage:
    """Try ``file`` out, then open it with a session layer of its own as edit target.

    Raises:
        AssetError: the file cannot be read or composed, or not with the helper's memory, stack and time.
    """
    check_layer(file)
    key = file.resolve()
    if key.is_relative_to(ASSETS.resolve()):
        return open_here(file)
    if key not in _passed or any(_state(path) != known for path, known in _passed[key].items()):
        with _lock:
            answer = ask_helper({"folder": os.getcwd(), "file": str(file), "seconds": CPU_SECONDS})
        if "trouble" in answer:
            raise AssetError(f"{file}: USD's reader {answer['trouble']} with it; {_REMEDY}")
        if "refused" in answer:
            raise AssetError(answer["refused"])
        _passed[key] = {path: _state(path) for path in answer["layers"]}
    return open_here(file)


def open_here(file: Path) -> Usd.Stage:
    """Open ``file`` with a session layer of its own as edit target; nothing but its composition is checked."""
    check_layer(file)
    try:
        layer = Sdf.Layer.FindOrOpen(str(file.resolve()))
        if layer is not None:
            layer.Reload()  # the file may have been edited since an earlier load in this process
            _refuse_external(layer, file.resolve().parent, set())
        stage = Usd.Stage.Open(layer, Sdf.Layer.CreateAnonymous("session.usda")) if layer else None
    except Tf.ErrorException as error:
        raise AssetError(f"{file}: not readable as USD: {said(error)}; repair the file there") from None
    if stage is None or not stage.GetDefaultPrim():
        raise AssetError(f"{file}: not readable as USD, or without a defaultPrim; name the robot's root prim there")
    for error in stage.GetCompositionErrors():
        raise AssetError(f"{file}: composition error: {said(error)}; repair the reference or path named there")
    if Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(SCHEMA) is None:
        warnings.warn(
            f"USD built its schema registry before {SCHEMA} was registered; import mrwarp.usd.asset before other USD "
            "code. Parameters load as authored; USD tools show no units and defaults.",
            stacklevel=3,
        )
    stage.SetEditTarget(stage.GetSessionLayer())
    return stage


def check_layer(file: Path) -> None:
    """Refuse what USD must not even begin to read: no file, or one that is too large."""
    if not file.is_file():
        raise AssetError(f"{file}: {no_file(file, 'file')}; name a .usda file, such as those in {ASSETS}")
    if (size := file.stat().st_size) > MAX_BYTES:
        raise AssetError(f"{file}: {size} bytes; allowed: {MAX_BYTES}; put meshes into other files")
    if not os.access(file, os.R_OK):
        raise AssetError(f"{file}: cannot be read: Permission denied; check the file and its permissions")


def choices(stage: Usd.Stage) -> Iterator[tuple[str, ...]]:
    """Select every combination of the default prim's variants in turn; yields its labels, ``robot=mr_go`` first.

    Raises:
        AssetError: there are more than :data:`MAX_CHOICES`.
    """
    root = stage.GetDefaultPrim()
    sets = root.GetVariantSets()
    names = sorted(sets.GetNames(), reverse=True)
    offered = [sorted(sets.GetVariantSet(name).GetVariantNames(), key=lambda n: (n != "mr_go", n)) for name in names]
    if (count := math.prod(map(len, offered))) > MAX_CHOICES:
        raise AssetError(
            f"{stage.GetRootLayer().realPath}: {root.GetPath()}: {count} combinations of variants; "
            f"allowed: {MAX_CHOICES}; remove some"
        )
    for choice in itertools.product(*offered):
        for name, variant in zip(names, choice, strict=True):
            sets.SetSelection(name, variant)
        yield tuple(f"{name}={variant}" for name, variant in zip(names, choice, strict=True))


def said(error: object) -> str:
    """Text of USD's errors, on one line, without where in USD's own source they were raised."""
    try:
        text = str(error)
    except UnicodeDecodeError:  # the message quotes the file
        return "the text is not UTF-8"
    found = re.findall(r" at line \d+ in file \S+ : '(.*?)'(?=\n|$)", text.strip(), flags=re.DOTALL)
    return " ".join(" ".join(found or [text]).split())[:MAX_QUOTED]


def _refuse_external(layer: Sdf.Layer, folder: Path, seen: set[str]) -> None:
    """Refuse any path in ``layer`` (layers, clips, asset attributes), and in what it names, that leaves ``folder``."""
    seen.add(layer.identifier)
    for name in itertools.chain(*UsdUtils.ExtractExternalReferences(layer.identifier)):
        try:
            target = Path(layer.ComputeAbsolutePath(name)).resolve()
            there = target.is_file()
        except (OSError, ValueError, RuntimeError):  # too long, with a NUL, links in a circle
            raise AssetError(f"{layer.identifier}: @{name[:80]!r}@ is no file name; correct it") from None
        inside = target.is_relative_to(folder)
        if "://" not in name and not there and (not inside or name in layer.subLayerPaths):
            raise AssetError(
                f"{layer.identifier}: @{name}@ is missing, there is no file {target}; put it into the asset's folder "
                f"{folder} and name it there, or remove it"
            )
        if "://" in name or not inside:
            raise AssetError(f"{layer.identifier}: @{name}@ lies outside the asset's folder {folder}; copy it there")
        if not there or not Usd.Stage.IsSupportedFile(str(target)):
            continue  # what is missing is a composition error, or nobody's business
        check_layer(target)
        inner = Sdf.Layer.FindOrOpen(str(target))
        if inner is not None and inner.identifier not in seen:
            _refuse_external(inner, folder, seen)


_passed: dict[Path, dict[str, Any]] = {}
"""State of every layer of the files that passed."""

_lock = threading.Lock()
_helper: subprocess.Popen[str] | None = None


def _state(file: str) -> tuple[int, ...] | None:
    """Marks that show whether a file was changed."""
    with contextlib.suppress(OSError):
        found = os.stat(file)
        return found.st_mtime_ns, found.st_size, found.st_ino
    return None


def ask_helper(request: dict[str, Any]) -> dict[str, Any]:
    """The helper's answer; a file is blamed for a crash only of a helper that was started for it."""
    global _helper
    fresh = _helper is None
    helper = _helper = _helper or start_helper()
    assert helper.stdin and helper.stdout
    line, late = "", False
    try:
        with contextlib.suppress(BrokenPipeError):
            helper.stdin.write(json.dumps(request) + "\n")
            helper.stdin.flush()
            late = not select.select([helper.stdout], [], [], WALL_SECONDS)[0]
            line = "" if late else helper.stdout.readline()
    finally:
        # dead, late, or Ctrl-C was pressed: an answer on its way must not be taken for the next one's
        code = 0 if line.endswith("\n") else stop()
    if line.endswith("\n"):
        return json.loads(line)
    if late or code == -signal.SIGXCPU:
        return {"trouble": f"takes more than {CPU_SECONDS} s"}
    if not fresh:  # an earlier file may have harmed it
        return ask_helper(request)
    how = signal.Signals(-code).name if code < 0 else f"exit code {code}"
    return {"trouble": f"crashes or {_TOO_LARGE['trouble']} ({how})"}


def start_helper() -> subprocess.Popen[str]:
    """A process that tries USD files out, with one thread and limits of its own."""
    package = str(Path(__file__).resolve().parents[2])
    run = f"import sys; sys.path = {[package, *sys.path]!r}; from mrwarp.usd.open_stage import serve; serve()"
    # the limit is of address space, of which every thread takes a large piece
    env = {**os.environ, "PXR_WORK_THREAD_LIMIT": "1", "MALLOC_ARENA_MAX": "1", "OPENBLAS_NUM_THREADS": "1"}
    try:
        return subprocess.Popen(
            [sys.executable, "-I", "-c", run],
            env=env,
            encoding="ascii",
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
    except OSError as error:
        raise AssetError(f"no process can be started to try USD files out ({error.strerror}); free some") from None


def stop() -> int:
    """End the helper, if there is one; its exit code."""
    global _helper
    helper, _helper = _helper, None
    if helper is None:
        return 0
    assert helper.stdin and helper.stdout
    helper.kill()  # a process that has ended already keeps its exit code
    helper.stdout.close()
    with contextlib.suppress(OSError):
        helper.stdin.close()
    return helper.wait()


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
    while select.select([sys.stdin], [], [], IDLE)[0] and (line := sys.stdin.readline()):
        request = json.loads(line)
        seconds = request.pop("seconds")
        _limit(resource.RLIMIT_CPU, math.ceil(sum(resource.getrusage(resource.RUSAGE_SELF)[:2])) + seconds)
        answer = try_out(**request)
        answers.write(json.dumps(answer) + "\n")
        answers.flush()
        if "trouble" in answer:
            return  # who knows what is left of the libraries


def try_out(folder: str, file: str) -> dict[str, Any]:
    """Open a file as the asking process would, and read every value under every choice of variants.

    Returns:
        ``layers``, the files that were read, or ``refused``, the message, or ``trouble``, what the reader does.
    """
    os.chdir(folder)
    layers: set[str] = set()
    try:
        stage = open_here(Path(file))
        for _ in choices(stage):
            for prim in stage.TraverseAll():
                prim.GetAppliedSchemas()
                for attribute in prim.GetAttributes():
                    _read(attribute, file)
            layers.update(layer.realPath for layer in stage.GetUsedLayers() if layer.realPath)
    except AssetError as error:
        return _TOO_LARGE if "bad_alloc" in str(error) else {"refused": str(error)}
    except MemoryError:
        return _TOO_LARGE
    except Exception as error:  # any error here is about this file
        return {"refused": f"{file}: cannot be opened: {type(error).__name__}: {said(error)}; repair the file"}
    return {"layers": sorted(layers)}


def _read(attribute: Usd.Attribute, file: str) -> None:
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


def keep_fixed_joints(stage: Usd.Stage) -> None:
    """Say on the layer that is edited that Newton keeps fixed joints: version 1.8 merges the inertias wrongly."""
    for prim in [prim for prim in stage.Traverse() if prim.IsA(UsdPhysics.Scene)]:
        if (said := prim.GetAttribute("newton:collapse_fixed_joints")).Get():
            said.Set(False)
