"""Recorded Warp launches: the arguments are packed once, so that a step costs only the call."""

from __future__ import annotations

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
