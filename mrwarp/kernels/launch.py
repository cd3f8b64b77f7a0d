"""Recorded Warp launches, whose arguments are packed once, and step graphs of several of them."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence, Set
from functools import partial
from typing import Any

import warp as wp

GPU_LAYOUT = False
"""Whether a CPU, too, takes the threads that a GPU would: a test sets it, to show that they give the same bits."""

Launch = Callable[[], object]
"""One step of a sequence: launches kernels on arrays that stay where they are."""


def record(
    kernel: Any, dim: int | tuple[int, ...], inputs: Sequence[Any], outputs: Sequence[Any], device: Any = None
) -> Launch:
    """Prepare a launch to be repeated by calling it. It keeps its arrays alive; nothing is launched yet.

    Args:
        kernel: The kernel.
        dim: Launch size.
        inputs: Arguments before the outputs, in order; Warp arrays, torch tensors, numbers or structs.
        outputs: Output arrays, in order.
        device: Warp device; None takes that of the last output.
    """
    arguments = [wp.from_torch(a) if hasattr(a, "data_ptr") else a for a in (*inputs, *outputs)]
    device = arguments[-1].device if device is None else device
    count = len(inputs)
    command = wp.launch(kernel, dim, arguments[:count], arguments[count:], device=device, record_cmd=True)
    assert command is not None  # always, with record_cmd
    command.arguments = arguments
    return command.launch


def in_one_thread(device: Any) -> bool:
    """Whether one thread takes all environments and joints, as on a CPU, instead of a thread for each, as on a GPU.

    A CPU runs threads one after the other, and starting one copies all arguments.

    Args:
        device: Warp device.
    """
    return wp.get_device(str(device)).is_cpu and not GPU_LAYOUT


def record_per_env(kernel: Any, num_envs: int, inputs: Sequence[Any], outputs: Sequence[Any]) -> Launch:
    """Prepare a launch of a kernel whose first parameter ``rows`` is the stride of a thread's environments."""
    rows = 1 if in_one_thread(outputs[-1].device) else num_envs
    return record(kernel, rows, [rows, *inputs], outputs)


def capture(launch: Launch, device: Any) -> wp.Graph:
    """Record what is launched, to be repeated by ``wp.capture_launch``; the recording itself changes nothing.

    Args:
        launch: Reads nothing back.
        device: Warp device; a CPU, too, replays the launches without Python between them.
    """
    with wp.ScopedDevice(device), wp.ScopedCapture() as recorded:
        launch()
    assert recorded.graph is not None  # set when the capture ends
    return recorded.graph


class StepGraph:
    """A sequence of launches that is run as captured graphs, in as few calls as possible.

    Neighbours become one graph, and equal runs of launches share one.

    Args:
        sequence: What is launched, in order.
        device: Warp device.
        eager: Capture nothing: every launch by itself, with the same bits.
    """

    def __init__(self, sequence: Sequence[Launch], device: Any, *, eager: bool = False) -> None:
        self.sequence = tuple(sequence)
        self._device, self._eager = device, eager
        self._calls: dict[Set[Launch], list[Launch]] = {}

    def run(self, host: Set[Launch] = frozenset()) -> None:
        """Launch the sequence.

        Args:
            host: Members that no graph can take, as they run on the host.
        """
        for call in self.calls(host):
            call()

    def calls(self, host: Set[Launch]) -> list[Launch]:
        """Calls of :meth:`run`: graphs, and the host's members between them."""
        if host not in self._calls:
            self._calls[host] = list(self.sequence) if self._eager else self._captured(host)
        return self._calls[host]

    def _captured(self, host: Set[Launch]) -> list[Launch]:
        graphs: dict[tuple[Launch, ...], Launch] = {}
        calls: list[Launch] = []
        for alone, found in itertools.groupby(self.sequence, lambda launch: launch in host):
            run = tuple(found)
            if alone:
                calls.extend(run)
                continue
            if run not in graphs:
                graphs[run] = partial(wp.capture_launch, capture(lambda run=run: [f() for f in run], self._device))
            calls.append(graphs[run])
        return calls
