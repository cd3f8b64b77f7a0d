"""Recorded Warp launches, whose arguments are packed once, and graphs of several of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Container, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import warp as wp

GPU_LAYOUT = False
"""Whether a CPU, too, takes the threads that a GPU would: a test sets it, to show that they give the same bits."""

Work = Callable[[], object]
"""Launches on arrays that stay where they are."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Around:
    """What a task does around a robot's steps, on the device: no number is read back."""

    before: Sequence[Work]
    """Launched before the first step, in order."""
    after: Sequence[Work]
    """Launched after the last step, in order."""


def in_one_thread(device: Any) -> bool:
    """Whether one thread takes all environments and joints, as on a CPU, instead of a thread for each, as on a GPU.

    A CPU runs threads one after the other, and starting one copies all arguments.

    Args:
        device: Warp device.
    """
    return wp.get_device(str(device)).is_cpu and not GPU_LAYOUT


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


def record_per_env(kernel: Any, num_envs: int, inputs: list[Any], outputs: list[Any], device: Any) -> wp.Launch:
    """As :func:`record`, for a kernel whose first parameter ``rows`` is how far apart a thread's environments are."""
    rows = 1 if in_one_thread(device) else num_envs
    return record(kernel, rows, [rows, *inputs], outputs, device)


def capture(work: Work, device: Any) -> wp.Graph:
    """Record what ``work`` launches, to be repeated by ``wp.capture_launch``; the recording itself changes nothing.

    Args:
        work: Launches on arrays that stay where they are; reads nothing back.
        device: Warp device; a CPU replays the launches without a way through Python for each.
    """
    with wp.ScopedDevice(device), wp.ScopedCapture() as recorded:
        work()
    assert recorded.graph is not None  # set when the capture ends
    return recorded.graph


def in_graphs(works: Sequence[Work], host: Container[Work], device: Any) -> list[Work]:
    """Works in as few calls as possible: neighbours become one captured graph, and equal runs of them share one.

    Args:
        works: What is done, in order.
        host: Those that no graph can take.
        device: Warp device.
    """
    graphs: dict[tuple[Work, ...], Work] = {}
    calls: list[Work] = []
    for alone, found in itertools.groupby(works, lambda work: work in host):
        run = tuple(found)
        if alone:
            calls.extend(run)
            continue
        if run not in graphs:
            graphs[run] = partial(wp.capture_launch, capture(in_turn(run), device))
        calls.append(graphs[run])
    return calls


def in_turn(works: Sequence[Work]) -> Work:
    """Works as one, in order."""

    def run() -> None:
        for work in works:
            work()

    return run
