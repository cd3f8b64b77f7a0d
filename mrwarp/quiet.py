"""What the commands set up before they start: libraries that speak only when something is wrong, one torch thread."""

from __future__ import annotations

import contextlib
import io
import logging
import os
from collections.abc import Iterator

import torch
import warp as wp


def quiet_libraries() -> None:
    """Silence the libraries' start-up notes, and keep torch on one thread as :func:`one_torch_thread` does."""
    wp.config.log_level = wp.LOG_WARNING
    logging.getLogger("newton").setLevel(logging.WARNING)
    torch.set_num_threads(1)


@contextlib.contextmanager
def one_torch_thread() -> Iterator[None]:
    """Keep torch's CPU work on one thread.

    The networks are small: more threads cost more than they give. And torch splits sums of more than 32,768 numbers
    among its threads, so that with three of them the bits of a training with 700 environments are others.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


@contextlib.contextmanager
def repeating_torch(wanted: bool) -> Iterator[None]:
    """Have torch take algorithms that repeat their bits on a GPU, and warn where it has none; on the CPU all do."""
    before = torch.are_deterministic_algorithms_enabled(), torch.is_deterministic_algorithms_warn_only_enabled()
    if wanted:
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
