"""Shared parts of commands: silent libraries, one torch thread, one process that prints, progress, tables and figures.

Torch, Warp and matplotlib are loaded when they are first set up, so that ``--help`` need not wait for them.
"""

from __future__ import annotations

import contextlib
import ctypes
import difflib
import gc
import io
import logging
import math
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure

NAMED_BY = ("RANK", "WORLD_SIZE", "MASTER_ADDR", "MASTER_PORT")
"""Environment variables by which torchrun (or a scheduler) names a rank and where it meets the others."""


def one_of_several() -> bool:
    """Whether this process was started as one of several that train together."""
    return all(os.environ.get(name) for name in NAMED_BY) and os.environ["WORLD_SIZE"] != "1"


@contextlib.contextmanager
def one_voice() -> Iterator[None]:
    """Only rank 0 prints, before the ranks have met."""
    if not one_of_several() or os.environ["RANK"] == "0":
        yield
        return
    with contextlib.redirect_stderr(io.StringIO()), contextlib.redirect_stdout(io.StringIO()):
        yield


def exit_code(error: BaseException) -> int | None:
    """Exit code of a command that ends with this error: its ``exit_code``, 2 for bad input; None for a bug."""
    return getattr(error, "exit_code", 2 if isinstance(error, ValueError | OSError) else None)


DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
"""Environment variables that name a screen on Linux."""


def has_display() -> bool:
    """Whether a window can be opened."""
    return not sys.platform.startswith("linux") or bool(set(DISPLAYS) & set(os.environ))


def render_offscreen() -> None:
    """Let MuJoCo render without a screen, by EGL unless MUJOCO_GL says else; call it before MuJoCo is imported."""
    if not has_display():
        os.environ.setdefault("MUJOCO_GL", "egl")


def core_count() -> int:
    """CPU cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def gpu_count() -> int:
    """CUDA devices that this process may use; asks the driver, so that no engine need be loaded."""
    count = ctypes.c_int(0)
    try:
        driver = ctypes.CDLL("nvcuda.dll" if sys.platform == "win32" else "libcuda.so.1")
        return 0 if driver.cuInit(0) or driver.cuDeviceGetCount(ctypes.byref(count)) else count.value
    except (OSError, AttributeError):
        return 0


def check_device(device: str) -> None:
    """Raise ValueError unless the device is there; ``cuda`` alone is a GPU for each process of a training."""
    if device == "cuda":
        device = f"cuda:{os.environ.get('LOCAL_RANK') or 0}"
    if device != "cpu" and device not in (known := [f"cuda:{i}" for i in range(gpu_count())]):
        raise ValueError(f"--device {device}: no such device here; choose from {', '.join(['cpu', *known])}")


@contextlib.contextmanager
def _silent_stderr() -> Iterator[None]:
    """Swallow what native code writes to the error stream."""
    sys.stderr.flush()
    kept, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)


class DeviceWarning(UserWarning):
    """Note for a user on a simulated device; a command prints it as a line without a place in the code."""


_USUAL_WARNING = warnings.formatwarning


def _one_line_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    if category is DeviceWarning:
        return f"warning: {message}\n"
    return _USUAL_WARNING(message, category, filename, lineno, line)


def quiet_libraries(*, gpu: bool = True, networks: bool = True) -> None:
    """Silence the libraries' start-up notes, and keep torch on one thread as :func:`one_torch_thread` does.

    Args:
        gpu: Let Warp complain if there is no GPU.
        networks: Load torch, which not every command needs and not every installation has.
    """
    warnings.formatwarning = _one_line_warning
    warnings.simplefilter("once", DeviceWarning)  # from any place in the code
    quiet_warp(gpu=gpu)
    logging.getLogger("newton").setLevel(logging.WARNING)
    if networks:
        import torch

        torch.set_num_threads(1)
        leave_compiler_out(torch)


def quiet_warp(*, gpu: bool = False) -> None:
    """Silence Warp's notes on what it finds and compiles, unless a level was chosen before.

    Args:
        gpu: Let it complain if there is no GPU.
    """
    import warp as wp

    if wp.config.log_level == wp.LOG_INFO:  # its default
        wp.config.log_level = wp.LOG_WARNING
    if not gpu and gpu_count() == 0:
        with _silent_stderr():
            wp.init()


@contextlib.contextmanager
def uncollected() -> Iterator[None]:
    """Keep Python's garbage collector off, for seconds in which much is loaded.

    Warp reads the syntax tree of every kernel when Newton and MuJoCo-Warp are imported: the collector goes through the
    many small objects again and again, which is two fifths of the processor time of that.
    """
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


def leave_compiler_out(torch: Any) -> None:
    """Keep torch's compiler from being loaded, which takes a second: nothing here is compiled by it.

    tensordict marks functions for it, and torch's optimisers mark theirs when they are first called.
    """
    torch.compiler.allow_in_graph = torch.compiler.assume_constant_result = lambda function: function
    for name in ("add_param_group", "load_state_dict", "state_dict", "zero_grad"):
        function = getattr(getattr(torch.optim.Optimizer, name), "__wrapped__", None)
        if function is not None:
            function.__dynamo_disable = function


@contextlib.contextmanager
def one_torch_thread() -> Iterator[None]:
    """Keep torch's CPU work on one thread.

    The networks are small: more threads cost more than they give. And torch splits sums of more than 32,768 numbers
    among its threads, so that with three of them the bits of a training with 700 environments are others.
    """
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextlib.contextmanager
def repeating_torch(wanted: bool) -> Iterator[None]:
    """Have torch take algorithms that repeat their bits on a GPU, and warn where it has none; on the CPU all do."""
    import torch

    if not wanted:  # even to switch it off torch loads its compiler, a second
        yield
        return
    before = torch.are_deterministic_algorithms_enabled(), torch.is_deterministic_algorithms_warn_only_enabled()
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # without it matrix products may not repeat
    torch.use_deterministic_algorithms(True, warn_only=True)
    try:
        yield
    finally:
        torch.use_deterministic_algorithms(before[0], warn_only=before[1])


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Swallow what a library prints while it builds something."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield


@contextlib.contextmanager
def unwarned(*modules: str) -> Iterator[None]:
    """Swallow Python warnings where the caller reports in its own words what matters of them.

    Args:
        modules: Beginnings of the names of modules whose warnings are swallowed; none: all.
    """
    with warnings.catch_warnings():
        for module in modules or ("",):
            warnings.filterwarnings("ignore", module=re.escape(module))
        yield


def duration(seconds: float) -> str:
    """A length of time as people say it beforehand: ``40 s``, ``3 min``, ``1.5 h``."""
    if seconds < 90.0:
        return f"{max(seconds, 1.0):.0f} s"
    return f"{seconds / 60.0:.0f} min" if seconds < 5400.0 else f"{seconds / 3600.0:.1f} h"


def panels(
    size: tuple[float, float], rows: int = 1, columns: int = 1, *, grid: Literal["both", "x", "y"] = "both", **more: Any
) -> tuple[Figure, np.ndarray]:
    """A figure [inches] that lays itself out, and its axes with a faint grid behind all else, shape (rows, columns).

    Further choices are those of :meth:`matplotlib.figure.Figure.subplots`.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, **more)
    for axis in axes.flat:
        axis.grid(axis=grid, alpha=0.3)
        axis.set_axisbelow(True)
    return figure, axes


@contextlib.contextmanager
def drawing(name: str, note: Callable[[str], Any] = print) -> Iterator[None]:
    """Draw a picture: an error in it becomes a note, for what was computed stands without it.

    An error of the system, such as a full disk, is no fault of the picture and is raised.
    """
    try:
        yield
    except OSError:
        raise
    except Exception as error:  # any error of a picture
        note(f"note: {name} was not drawn: {' '.join(str(error).split()) or type(error).__name__}")


def closest(word: str, known: Iterable[str], *, cutoff: float = 0.6) -> str:
    """A hint at the name that a misspelt one is nearest to; empty where none is near."""
    near = difflib.get_close_matches(word, list(known), n=1, cutoff=cutoff)
    return f"did you mean {near[0]!r}? " if near else ""


NOT_KNOWN = "not known"
"""Text in a table in place of a figure that depends on a number that nobody measured."""


def figure_text(value: float | None, form: str, unit: str = "") -> str:
    """A figure in a format such as ``.1f``, with its unit; :data:`NOT_KNOWN` for none and NaN."""
    return NOT_KNOWN if value is None or math.isnan(value) else f"{value:{form}}{unit}"


def four_digits(note: str) -> str:
    """A note for people, its numbers with four digits at most, as 0.01489 of 0.01488980216119077."""
    return re.sub(r"(?<![\w./-])-?\d+\.\d{3,}(?:e[-+]?\d+)?(?![\w./])", lambda found: f"{float(found[0]):.4g}", note)


def text_table(head: Sequence[str], rows: Iterable[Sequence[str]], *, left: int = 1) -> list[str]:
    """Lines of a table, each column as wide as its widest cell; the first ``left`` columns begin at the left."""
    cells = [tuple(head), *map(tuple, rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return [
        "  ".join(f"{cell:{'<' if i < left else '>'}{widths[i]}}" for i, cell in enumerate(row)).rstrip()
        for row in cells
    ]
