"""The three learned torque models of paper section 4 as plain torch modules, their standardisation inside.

* ``mlp``: three consecutive samples (9 numbers) -> 64 -> 64 (tanh) -> 1, the whole torque.
* ``lstm``: 50 samples -> one LSTM layer of 64 -> 1 from its final output, the whole torque.
* ``pg_rlstm``: the same LSTM, but its output is the residual over the frozen Bouc-Wen model (eqs. 16, 17).
"""

from __future__ import annotations

import torch
from torch import nn

FEATURES = 3
"""Features per sample: displacement q_c [rad], velocity qd [rad/s], coil current [A]."""

HIDDEN = 64
"""Hidden units, section 4.1 and table 1."""

SAMPLES = {"mlp": 3, "lstm": 50, "pg_rlstm": 50}
"""Samples that each kind of model sees; its keys are the kinds there are."""


class StandardScaler(nn.Module):
    """x -> (x - mean)/std per feature; the identity until :meth:`fit`.

    Attributes:
        mean, std: Shape (FEATURES,).
    """

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(FEATURES))
        self.register_buffer("std", torch.ones(FEATURES))

    def fit(self, x: torch.Tensor) -> None:
        """Take mean and standard deviation from samples of the training set, shape (N, FEATURES).

        A feature that never changes keeps std = 1.
        """
        x = x.double()
        std = x.std(0, correction=0)
        self.mean.copy_(x.mean(0))
        self.std.copy_(torch.where(std > 1e-9, std, torch.ones_like(std)))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Standardise features in the last dimension."""
        return (x - self.mean) / self.std


class MlpTorque(nn.Module):
    """Torque from three consecutive samples."""

    def __init__(self) -> None:
        super().__init__()
        self.scaler = StandardScaler()
        layers = [nn.Linear(SAMPLES["mlp"] * FEATURES, HIDDEN), nn.Tanh(), nn.Linear(HIDDEN, HIDDEN), nn.Tanh()]
        self.net = nn.Sequential(*layers, nn.Linear(HIDDEN, 1))

    def forward(self, window: torch.Tensor) -> torch.Tensor:
        """Torque [N·m], shape (N,), of raw windows (N, 3, FEATURES), oldest sample first."""
        return self.scaled(self.scaler(window).transpose(0, 1))

    def scaled(self, window: torch.Tensor) -> torch.Tensor:
        """Torque [N·m], shape (N,), of standardised windows with time first, shape (3, N, FEATURES)."""
        return self.net(window.transpose(0, 1).flatten(1)).squeeze(1)


class LstmTorque(nn.Module):
    """Torque, or residual torque, from fifty samples."""

    def __init__(self) -> None:
        super().__init__()
        self.scaler = StandardScaler()
        self.lstm = nn.LSTM(FEATURES, HIDDEN)
        self.out = nn.Linear(HIDDEN, 1)

    def forward(self, window: torch.Tensor) -> torch.Tensor:
        """Torque [N·m], shape (N,), of raw windows (N, 50, FEATURES), oldest sample first."""
        return self.scaled(self.scaler(window).transpose(0, 1))

    def scaled(self, window: torch.Tensor) -> torch.Tensor:
        """Torque [N·m], shape (N,), of standardised windows with time first, shape (50, N, FEATURES)."""
        output, _ = self.lstm(window)
        return self.out(output[-1]).squeeze(1)

    state_size = 2 * HIDDEN
    """Hidden and cell state."""

    def step(self, x: torch.Tensor, state: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Torque [N·m], shape (N,), and next state (N, 2 HIDDEN), hidden first, of raw samples (N, FEATURES)."""
        hidden, cell = (part.contiguous()[None] for part in state.split(HIDDEN, dim=1))
        output, (hidden, cell) = self.lstm(self.scaler(x)[None], (hidden, cell))
        return self.out(output[0]).squeeze(1), torch.cat([hidden[0], cell[0]], dim=1)

    def carried(self, x: torch.Tensor) -> torch.Tensor:
        """Torque [N·m] at every sample of one trajectory, the state carried on, shape (N,), of raw x (N, FEATURES)."""
        output, _ = self.lstm(self.scaler(x).unsqueeze(1))
        return self.out(output).flatten()


TorqueNet = MlpTorque | LstmTorque
"""Any of the networks."""


def make_net(kind: str, seed: int = 0) -> TorqueNet:
    """A network of a kind of :data:`SAMPLES` with seeded random weights; torch's global generator stays as it was."""
    if kind not in SAMPLES:
        raise ValueError(f"there is no learned model {kind!r}; choose from {', '.join(SAMPLES)}")
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        return MlpTorque() if kind == "mlp" else LstmTorque()
