"""The learned torque by itself: our kernels, the same in torch, torch's and onnxruntime's LSTM, Newton's LSTM drive.

They do not all compute the same. Our kernel over
windows, torch and onnxruntime replay the last 50 samples of each open window (eq. 12), so a window owes nothing to what
was before it. Our carried states and Newton's drive take one sample per step and joint.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import onnxruntime
import torch
import warp as wp

from benchmarks.perf.newton_lstm import NewtonLstm
from benchmarks.perf.timing import Turn
from mrwarp.actuator.residual import LearnedTorque, window_now
from mrwarp.enums import LstmState, ResidualEngine
from mrwarp.kernels.learned_torque import FEATURES, WINDOW
from mrwarp.nn import network_file
from mrwarp.nn.network_file import LearnedModel

TOLERANCE = 2e-5
"""Largest difference of our kernel and torch's LSTM [N·m]: float32 over 50 samples."""


class LstmCost:
    """All of them side by side on N joints, all windows open.

    Args:
        count: Number of joints N.
        folder: Where Newton's checkpoint is written.
        threads: CPU threads of our kernel; torch keeps the one it has, onnxruntime gets one.

    Attributes:
        difference: Largest difference of our torques to torch's and onnxruntime's [N·m].

    Raises:
        ValueError: it is more than rounding explains.
    """

    def __init__(self, count: int, folder: Path, *, threads: int = 0) -> None:
        path = network_file.shipped_model("pg_rlstm")
        assert path is not None  # it is shipped
        model = network_file.load(path)
        self._ours = {
            state: LearnedTorque(model, dt=model.dt, lstm_state=state, threads=threads) for state in LstmState
        }
        self._in_torch = LearnedTorque(model, dt=model.dt, engine=ResidualEngine.TORCH)
        rng = np.random.default_rng(0)
        scale = np.array([0.3, 3.0, 0.7])
        windows = (rng.normal(size=(count, 1, WINDOW, FEATURES)) * scale).astype(np.float32)
        self._ring, self._head = wp.array(windows, device="cpu"), wp.array([WINDOW - 1], dtype=int, device="cpu")
        self._open = wp.ones((count, 1), dtype=float, device="cpu")
        self._torque = wp.zeros((count, 1), dtype=float, device="cpu")
        self._newton = NewtonLstm(count, folder)
        self._net = model.net
        self._step_ours(LstmState.WINDOW)
        ordered = window_now(self._ring, self._head)[:, 0]
        with torch.inference_mode():
            wanted = self._net(ordered)
        self.difference = float((wp.to_torch(self._torque)[:, 0] - wanted).abs().max())
        self._session = onnx_session(model, folder / "lstm.onnx")
        found = torch.from_numpy(self._step_onnx())
        self.difference = max(self.difference, float((wp.to_torch(self._torque)[:, 0] - found).abs().max()))
        if not self.difference <= TOLERANCE:
            raise ValueError(f"our LSTM and that of torch or onnxruntime differ by {self.difference:.2g} N·m")

    def turns(self, repeat: int = 5) -> dict[str, Turn]:
        """Seconds per step of all joints."""
        return {
            **{state.value: _timed(partial(self._step_ours, state), repeat) for state in LstmState},
            "torch_engine": _timed(self._step_in_torch, repeat),
            "torch": _timed(self._step_torch, repeat),
            "newton": _timed(self._newton.step, repeat),
            "onnxruntime": _timed(self._step_onnx, repeat),
        }

    def _step_ours(self, state: LstmState) -> None:
        self._torque.zero_()
        self._ours[state](self._ring, self._head, self._open, self._torque)

    def _step_in_torch(self) -> None:
        self._torque.zero_()
        self._in_torch(self._ring, self._head, self._open, self._torque)

    def _step_torch(self) -> None:
        with torch.inference_mode():
            self._net(window_now(self._ring, self._head)[:, 0])

    def _step_onnx(self) -> np.ndarray:
        ordered = window_now(self._ring, self._head)[:, 0]
        return np.asarray(self._session.run(None, {"window": ordered.numpy()})[0])


def onnx_session(model: LearnedModel, path: Path) -> onnxruntime.InferenceSession:
    """An onnxruntime session of the model on one thread.

    Args:
        model: The model.
        path: Where its ONNX file is written.
    """
    network_file.export_onnx(model, path)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])


def _timed(step: Callable[[], object], repeat: int) -> Turn:
    def turn() -> dict[str, float]:
        begin = time.perf_counter()
        for _ in range(repeat):
            step()
        return {"step": (time.perf_counter() - begin) / repeat}

    return turn
