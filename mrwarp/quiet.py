"""What the commands set up before they start: libraries that speak only when something is wrong, one torch thread."""

from __future__ import annotations

import contextlib
import io
import logging
from collections.abc import Iterator

import torch
import warp as wp


def quiet_libraries() -> None:
    """Silence the libraries' start-up notes, and keep torch on one thread.

    The networks are small: more threads cost more than they give, and one thread keeps the bits the same everywhere.
    """
    wp.config.log_level = wp.LOG_WARNING
    logging.getLogger("newton").setLevel(logging.WARNING)
    torch.set_num_threads(1)


@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Swallow what a library prints while it builds something."""
    with contextlib.redirect_stdout(io.StringIO()):
        yield
