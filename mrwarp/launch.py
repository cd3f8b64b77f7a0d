"""Recorded Warp launches, whose arguments are packed once, and graphs of several of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import warp as wp


def record(kernel: Any, dim: int | tuple[int, ...], inputs: list[Any], outputs: list[Any], device: Any) -> wp.Launch:
    """Prepare a launch to be repeated by ``.launch()``; its arrays must outlive it. Launches nothing yet.

    Args:
        kernel: The kernel.
        dim: Launch size.
        inputs: Arguments before the outputs, in order.
        outputs: Output arrays, in order.
        device: Warp device.
    """
    command = wp.launch(kernel, dim=dim, inputs=inputs, outputs=outputs, device=device, record_cmd=True)
    assert command is not None  # always, with record_cmd
    return command


def capture(work: Callable[[], object], device: Any) -> wp.Graph:
    """Record what ``work`` launches, to be repeated by ``wp.capture_launch``; the recording itself changes nothing.

    Args:
        work: Launches on arrays that stay where they are; reads nothing back.
        device: Warp device; a CPU replays the launches without a way through Python for each.
    """
    with wp.ScopedDevice(device), wp.ScopedCapture() as recorded:
        work()
    assert recorded.graph is not None  # set when the capture ends
    return recorded.graph
