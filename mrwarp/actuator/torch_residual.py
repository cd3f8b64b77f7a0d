"""A learned torque that torch itself evaluates, on views of Warp's arrays: any module, without a copy through the host.

The kernels of :mod:`mrwarp.actuator.residual` know two shapes of network and are faster. This engine runs the rest.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Protocol, runtime_checkable

import numpy as np
import torch
import warp as wp
from torch import nn

from mrwarp.kernels import learned_torque as learned
from mrwarp.kernels.learned_torque import FEATURES, WINDOW

WARM_UP = 3
"""Calls before a CUDA graph is captured: torch chooses its kernels and allocates its workspaces in the first ones."""


@runtime_checkable
class CarriedNet(Protocol):
    """A module whose state is carried from sample to sample, as that of an LSTM or a GRU."""

    state_size: int
    """Numbers of its state per joint."""

    def step(self, x: torch.Tensor, state: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Torque [N·m], shape (N,), and next state, shape (N, state_size), of raw samples (N, 3) and states."""
        ...


class TorchTorque:
    """Evaluates a module for the open windows of an actuator, see :class:`mrwarp.actuator.residual.LearnedTorque`.

    All arrays are views of Warp's. On a GPU the module is captured once as a CUDA graph, if torch can capture it, and
    replayed on Warp's stream; every window is evaluated there, since the number of open ones stays on the device. On a
    CPU only open windows are. Calls do not depend on anything random, so a repetition gives the same bits on a CPU.

    Args:
        net: A module that maps raw windows (N, samples, 3) to torques (N,), or a :class:`CarriedNet`.
        ring: History, shape (E, M, 50, 3).
        head: Row of its newest sample, shape (1,).
        m_dyn: Dynamic gate, shape (E, M).
        tau_dyn: tau_BW on entry, the prediction on return [N·m], shape (E, M).
        samples: Newest samples that a window holds; unused where a state is carried.
        carries: Take the module as a :class:`CarriedNet`.
        whole: The module gives the whole torque; False adds it to tau_BW.
        evaluate_all: Evaluate closed windows on a CPU, too.

    Raises:
        ValueError: the module does not give one torque per window, or not one state per joint.
    """

    def __init__(
        self,
        net: nn.Module,
        ring: wp.array,
        head: wp.array,
        m_dyn: wp.array,
        tau_dyn: wp.array,
        *,
        samples: int,
        carries: bool,
        whole: bool,
        evaluate_all: bool = False,
    ) -> None:
        self._device = wp.get_device(str(tau_dyn.device))
        self.net = net.to(wp.device_to_torch(self._device)).eval()
        self._ring, self._head = wp.to_torch(ring).flatten(0, 1), wp.to_torch(head)
        self._gate, self._tau = wp.to_torch(m_dyn).flatten(), wp.to_torch(tau_dyn).flatten()
        self._samples, self._whole, self._all = samples, whole, evaluate_all or self._device.is_cuda
        self._order = torch.arange(WINDOW - samples + 1, WINDOW + 1, device=self._tau.device)
        self._carries = carries
        joints = self._tau.numel()
        self.fresh = wp.full(joints, 1, dtype=int, device=self._device)
        if carries:
            assert isinstance(net, CarriedNet)  # the caller has checked
            self._step = net.step
            size = net.state_size
            self.states = torch.zeros(joints, size, device=self._tau.device)
            self._fresh = wp.to_torch(self.fresh)
            self._rest = rest_states(net.step, size, self._tau.device)
        self._check()
        self._run: Callable[[], object] = self._captured() if self._device.is_cuda and joints else self._evaluate

    def __call__(self) -> None:
        """Write the predicted torque where the gate is open."""
        with self._stream():
            self._run()

    def load(self, states: np.ndarray, fresh: np.ndarray) -> None:
        """Restore carried states, shape (E*M, state_size), and what marks joints that begin again, shape (E*M,)."""
        self.states.copy_(torch.from_numpy(np.ascontiguousarray(states, dtype=np.float32)))
        self.fresh.assign(np.ascontiguousarray(fresh, dtype=np.int32))

    def _stream(self):
        if self._device.is_cuda:
            return torch.cuda.stream(wp.stream_to_torch(self._device))
        return nullcontext()

    @torch.no_grad()
    def _evaluate(self) -> None:
        torque = self._carried() if self._carries else self._windows()
        if torque is not None:
            total = torque if self._whole else self._tau + torque
            self._tau.copy_(torch.where(self._gate > 0.0, total, self._tau))

    def _carried(self) -> torch.Tensor:
        """Torque of every joint, whose state goes on by the newest sample."""
        fresh = self._fresh[:, None] > 0
        self.states.copy_(torch.where(fresh, self._at_rest(), self.states))
        torque, states = self._step(self._ring.index_select(1, self._head)[:, 0], self.states)
        self.states.copy_(states)
        self._fresh.zero_()
        return torque.reshape(-1)

    def _at_rest(self) -> torch.Tensor:
        """State of a joint that has rested at the displacement of its oldest sample, between the points of a table."""
        oldest = (self._head + 1) % WINDOW
        q_c = self._ring.index_select(1, oldest)[:, 0, 0]
        last = learned.REST_POINTS - 1
        x = ((q_c + learned.REST_RANGE) * (0.5 * last / learned.REST_RANGE)).clamp(0.0, last)
        i = x.long().clamp(max=last - 1)
        return torch.lerp(self._rest[i], self._rest[i + 1], (x - i)[:, None])

    def _windows(self) -> torch.Tensor | None:
        """Torque of the open windows, 0 for the others; None where no window is open."""
        rows = (self._head + self._order) % WINDOW
        if self._all:
            return self.net(self._ring.index_select(1, rows)).reshape(-1)
        index = self._gate.nonzero()[:, 0]
        if not len(index):
            return None
        torque = torch.zeros_like(self._tau)
        torque[index] = self.net(self._ring[index][:, rows]).reshape(-1)
        return torque

    @torch.no_grad()
    def _check(self) -> None:
        """Refuse a module that gives something else than a torque per window."""
        x = torch.zeros(2, self._samples, FEATURES, device=self._tau.device)
        if self._carries:
            torque, states = self._step(x[:, -1], torch.zeros(2, self.states.shape[1], device=self._tau.device))
            if tuple(states.shape) != (2, self.states.shape[1]):
                raise ValueError(
                    f"{type(self.net).__name__}.step gives states of shape {tuple(states.shape)} for two joints; need "
                    f"(2, {self.states.shape[1]}), its state_size"
                )
        else:
            torque = self.net(x)
        if torque.numel() != 2:
            raise ValueError(
                f"{type(self.net).__name__} gives an output of shape {tuple(torque.shape)} for two windows of shape "
                f"({self._samples}, {FEATURES}); need a torque each, shape (2,)"
            )

    def _captured(self) -> Callable[[], object]:
        """The evaluation as a CUDA graph on arrays that stay, or by itself where torch cannot capture the module."""
        written = [self._tau, self.states, self._fresh] if self._carries else [self._tau]
        kept = [array.clone() for array in written]
        graph = torch.cuda.CUDAGraph()
        side = torch.cuda.Stream(self._tau.device)
        side.wait_stream(torch.cuda.current_stream(self._tau.device))
        try:
            with torch.cuda.stream(side):
                for _ in range(WARM_UP):
                    self._evaluate()
            torch.cuda.current_stream(self._tau.device).wait_stream(side)
            with torch.cuda.graph(graph):
                self._evaluate()
        except RuntimeError:  # the module reads something back
            return self._evaluate
        finally:
            for array, value in zip(written, kept, strict=True):
                array.copy_(value)
        return graph.replay


@torch.no_grad()
def rest_states(
    step: Callable[[torch.Tensor, torch.Tensor], tuple[torch.Tensor, torch.Tensor]],
    size: int,
    device: torch.device | str = "cpu",
) -> torch.Tensor:
    """States after resting for all but one sample of a window, without current.

    Args:
        step: Method of a :class:`CarriedNet`.
        size: Numbers of its state.
        device: Where to compute it.

    Returns:
        Shape (REST_POINTS, size), for displacements evenly from -REST_RANGE to REST_RANGE.
    """
    x = torch.zeros(learned.REST_POINTS, FEATURES, device=device)
    x[:, 0] = torch.linspace(-learned.REST_RANGE, learned.REST_RANGE, learned.REST_POINTS, device=device)
    states = torch.zeros(learned.REST_POINTS, size, device=device)
    for _ in range(WINDOW - 1):
        _, states = step(x, states)
    return states
