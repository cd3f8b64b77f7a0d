"""Newton's own neural LSTM drive, built with as many hidden units as ours, to time against ours."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import numpy as np
import torch
import warp as wp

from mrwarp.actuator.newton_drive import DriveNeuralLSTM
from mrwarp.nn.models import HIDDEN


class _Cell(torch.nn.Module):
    """One LSTM step: position error and velocity to effort, as Newton's drive calls it."""

    def __init__(self) -> None:
        super().__init__()
        self.lstm = torch.nn.LSTM(2, HIDDEN, batch_first=True)
        self.out = torch.nn.Linear(HIDDEN, 1)

    def forward(
        self, x: torch.Tensor, state: tuple[torch.Tensor, torch.Tensor]
    ) -> tuple[torch.Tensor, tuple[torch.Tensor, torch.Tensor]]:
        """Effort (N, 1) and the next state, of inputs (N, 1, 2) and the state (1, N, HIDDEN) twice."""
        found, state = self.lstm(x, state)
        return self.out(found[:, -1]), state


class NewtonLstm:
    """The drive on N joints, from a torch checkpoint (its ONNX backend wants another package, warp_nn).

    Args:
        count: Number of joints N.
        folder: Where the checkpoint is written.
    """

    def __init__(self, count: int, folder: Path) -> None:
        path = folder / f"newton_lstm_{count}.pt2"
        example = (torch.zeros(count, 1, 2), (torch.zeros(1, count, HIDDEN), torch.zeros(1, count, HIDDEN)))
        metadata = json.dumps({"num_layers": 1, "hidden_size": HIDDEN})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Newton calls torch checkpoints deprecated
            exported = torch.export.export(_Cell().eval(), example)
            torch.export.save(exported, str(path), extra_files={"metadata.json": metadata})
            self._drive = DriveNeuralLSTM(str(path))
            self._drive.finalize(wp.get_device("cpu"), count)
        self._states = [self._drive.state(count, wp.get_device("cpu")) for _ in range(2)]
        rng = np.random.default_rng(0)

        def array(values: np.ndarray) -> wp.array:
            return wp.array(values, dtype=wp.float32, device="cpu")

        self._indices = wp.array(np.arange(count), dtype=wp.uint32, device="cpu")
        self._q, self._qd = array(rng.normal(size=count)), array(rng.normal(size=count))
        self._target, self._zero = array(rng.normal(size=count)), array(np.zeros(count))
        self.torque: wp.array = array(np.zeros(count))

    def step(self) -> None:
        """One step of the drive: writes :attr:`torque` [N·m], shape (N,)."""
        at = self._indices
        before, after = self._states
        self._drive.compute(
            self._q,
            self._qd,
            self._target,
            self._zero,
            None,
            at,
            at,
            at,
            at,
            self.torque,
            before,
            0.005,
        )
        self._drive.update_state(before, after)
        self._states.reverse()
