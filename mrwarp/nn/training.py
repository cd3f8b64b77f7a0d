"""Training of a torque network on windows: Adam on the mean squared error, early stopping, one recipe for all kinds.

Windows are views of one array of samples, never across two trajectories, never copied out.

An epoch is a fixed number of windows, drawn without replacement from all overlapping ones: neighbours differ by one
sample in fifty, so a pass over every window costs far more than it teaches. What is validated and kept is the running
average of the weights, which takes out the noise that Adam's constant rate leaves.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch

from mrwarp.nn.models import TorqueNet
from mrwarp.options.progress_bar import ProgressBar, roughly
from mrwarp.runtime import panels

MICRO = 128
"""Windows per forward and backward pass; larger ones fall out of the processor's cache and take 1.6 times as long."""


class WindowSet:
    """All overlapping windows of a set of trajectories, each with the torque at its last sample as target (eq. 12).

    Args:
        features: Samples of each trajectory, shape (N_i, 3).
        targets: Target at each sample [N·m], shape (N_i,).
        samples: Length of a window.

    Attributes:
        features: All samples end to end, float32, shape (N, 3).
        targets: float32, shape (N,).
        last: Row of each window's last sample, shape (W,). A trajectory shorter than a window has none.
    """

    def __init__(self, features: Sequence[np.ndarray], targets: Sequence[np.ndarray], samples: int) -> None:
        self.samples = samples
        rows, begin = [], 0
        for x, y in zip(features, targets, strict=True):
            if len(x) != len(y):
                raise ValueError(f"a trajectory has {len(x)} samples of features, but {len(y)} of the target")
            rows.append(begin + torch.arange(samples - 1, max(len(x), samples - 1)))
            begin += len(x)
        empty = np.zeros((0, 3), dtype=np.float32)
        self.features = torch.from_numpy(np.concatenate([empty, *features]).astype(np.float32))
        self.targets = torch.from_numpy(np.concatenate([empty[:, 0], *targets]).astype(np.float32))
        self.last = torch.cat(rows) if rows else torch.zeros(0, dtype=torch.long)
        self._offsets = torch.arange(1 - samples, 1).unsqueeze(1)

    def __len__(self) -> int:
        return len(self.last)

    def standardize(self, scaler: torch.nn.Module) -> None:
        """Replace the features by the standardised ones, once for all windows."""
        with torch.no_grad():
            self.features = scaler(self.features)

    def batch(self, which: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Windows with time first, shape (samples, B, 3), and their targets (B,), of window numbers ``which`` (B,)."""
        last = self.last[which]
        return self.features[last + self._offsets], self.targets[last]


def split(count: int, seed: int, validation: float = 0.2) -> tuple[list[int], list[int]]:
    """Sorted numbers of the training and of the validation trajectories, divided at random (section 4.3).

    Raises:
        ValueError: there are fewer than two trajectories.
    """
    if count < 2:
        raise ValueError(f"{count} trajectory cannot be divided into training and validation; record at least two")
    order = np.random.default_rng(seed).permutation(count)
    held = min(max(round(validation * count), 1), count - 1)
    return sorted(order[held:].tolist()), sorted(order[:held].tolist())


@dataclass(frozen=True, kw_only=True)
class FitCfg:
    """The recipe."""

    epochs: int = 80
    """Most epochs."""
    windows_per_epoch: int = 65_536
    """Training windows per epoch; fewer where there are not so many."""
    validation_windows: int = 16_384
    """Windows that an epoch is validated on, the same ones each time; fewer where there are not so many."""
    batch: int = 256
    """Windows per step of the optimiser."""
    learning_rate: float = 1e-3
    """Adam's rate, table 1."""
    average: float = 0.999
    """Decay of the running average of the weights per step; 0 for none."""
    patience: int = 15
    """Epochs without a new best validation error before stopping."""
    seed: int = 0
    """Seed of the batches."""

    def __post_init__(self) -> None:
        for name in ("epochs", "windows_per_epoch", "validation_windows", "batch", "patience"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} = {getattr(self, name)} must be at least 1")
        if not self.learning_rate > 0.0:
            raise ValueError(f"learning_rate = {self.learning_rate} must be positive")
        if not 0.0 <= self.average < 1.0:
            raise ValueError(f"average = {self.average} must lie in [0, 1)")


@dataclass
class History:
    """How a training went."""

    epoch: list[int] = field(default_factory=list)
    train_rmse: list[float] = field(default_factory=list)
    """While learning, over the epoch's windows [N·m]."""
    validation_rmse: list[float] = field(default_factory=list)
    """Of the averaged weights after the epoch [N·m]."""
    seconds: list[float] = field(default_factory=list)
    """Since the start [s]."""
    best_epoch: int = 0
    """Epoch whose weights were kept."""
    stopped: str = "epochs"
    """Why it ended: ``epochs``, ``patience`` or ``interrupted``."""


Report = Callable[[History, FitCfg], None]
"""Called after every epoch."""


def fit(net: TorqueNet, train: WindowSet, validation: WindowSet, cfg: FitCfg, report: Report | None = None) -> History:
    """Train in place; the network ends with the weights of the best epoch. Ctrl-C ends the training, not the program.

    The network's scaler is fitted on the training set; both sets come raw and are standardised in place. ``report`` is
    called after every epoch.

    Raises:
        ValueError: a set holds no window.
    """
    for name, windows in (("training", train), ("validation", validation)):
        if not len(windows):
            raise ValueError(f"no trajectory of the {name} set is as long as a window of {windows.samples} samples")
    net.scaler.fit(train.features)
    train.standardize(net.scaler)
    validation.standardize(net.scaler)
    generator = torch.Generator().manual_seed(cfg.seed)
    held = torch.randperm(len(validation), generator=generator)[: cfg.validation_windows]
    optimizer = torch.optim.Adam(net.parameters(), lr=cfg.learning_rate)
    average = copy.deepcopy(net)
    best, history = copy.deepcopy(net.state_dict()), History()
    began, steps, lowest = time.perf_counter(), 0, float("inf")
    try:
        for epoch, windows in enumerate(_epochs(len(train), cfg, generator), start=1):
            square = 0.0
            for batch in windows.split(cfg.batch):
                square += _step(net, optimizer, train, batch)
                steps += 1
                _follow(average, net, min(cfg.average, steps / (steps + 10.0)))
            error = rmse(average, validation, held)
            history.epoch.append(epoch)
            history.train_rmse.append((square / len(windows)) ** 0.5)
            history.validation_rmse.append(error)
            history.seconds.append(time.perf_counter() - began)
            if error < lowest:
                lowest, history.best_epoch = error, epoch
                best = copy.deepcopy(average.state_dict())
            if report:
                report(history, cfg)
            if epoch - history.best_epoch >= cfg.patience:
                history.stopped = "patience"
                break
    except KeyboardInterrupt:
        history.stopped = "interrupted"
    net.load_state_dict(best)
    return history


@torch.no_grad()
def predict(net: TorqueNet, windows: WindowSet, which: torch.Tensor | None = None) -> torch.Tensor:
    """Prediction [N·m] for standardised windows (all, or those of ``which``), shape (W,)."""
    which = torch.arange(len(windows)) if which is None else which
    parts = [net.scaled(windows.batch(batch)[0]) for batch in which.split(4 * MICRO)]
    return torch.cat(parts) if parts else torch.zeros(0)


def rmse(net: TorqueNet, windows: WindowSet, which: torch.Tensor | None = None) -> float:
    """Root mean square error [N·m] over standardised windows (all, or those of ``which``)."""
    target = windows.targets[windows.last if which is None else windows.last[which]]
    return float((predict(net, windows, which) - target).double().square().mean().sqrt())


def _epochs(count: int, cfg: FitCfg, generator: torch.Generator):
    """Window numbers of each epoch: random, and no window twice before all have had their turn."""
    queue = torch.zeros(0, dtype=torch.long)
    size = min(cfg.windows_per_epoch, count)
    for _ in range(cfg.epochs):
        while len(queue) < size:
            queue = torch.cat([queue, torch.randperm(count, generator=generator)])
        yield queue[:size]
        queue = queue[size:]


def _step(net: TorqueNet, optimizer: torch.optim.Optimizer, train: WindowSet, batch: torch.Tensor) -> float:
    """One step of the optimiser; returns the batch's sum of squared errors [(N·m)^2]."""
    optimizer.zero_grad()
    total = 0.0
    for part in batch.split(MICRO):
        window, target = train.batch(part)
        square = (net.scaled(window) - target).square().sum()
        (square / len(batch)).backward()
        total += float(square.detach())
    optimizer.step()
    return total


@torch.no_grad()
def _follow(average: TorqueNet, net: TorqueNet, decay: float) -> None:
    """Move the averaged weights towards the current ones."""
    for slow, fast in zip(average.parameters(), net.parameters(), strict=True):
        slow.lerp_(fast, 1.0 - decay)


def epochs_shown(kind: str, bar: ProgressBar) -> Callable[[History, FitCfg], None]:
    """A report of epochs on a progress bar; a training may end before its last epoch."""

    def report(history: History, cfg: FitCfg) -> None:
        done = history.epoch[-1]
        left = history.seconds[-1] / done * (cfg.epochs - done)
        errors = f"training {history.train_rmse[-1]:.3g}, validation {history.validation_rmse[-1]:.3g} N·m"
        ending = f"{roughly(left)} to epoch {cfg.epochs}" if left else ""
        bar(f"training {kind}", done / cfg.epochs, detail=errors, ending=ending)

    return report


def plot_history(history: History, kind: str, path: Path) -> None:
    """Draw the learning curves."""
    figure, ((axis,),) = panels((7, 4))
    axis.plot(history.epoch, history.train_rmse, color="#7f7f7f", label="training, while learning")
    axis.plot(history.epoch, history.validation_rmse, color="#1f6fb4", label="validation, averaged weights")
    if history.best_epoch:
        axis.axvline(history.best_epoch, color="#3a8f3a", linestyle=":", label=f"kept: epoch {history.best_epoch}")
    axis.set_xlabel("epoch")
    axis.set_ylabel(f"{kind} RMSE [N·m]")
    axis.set_ylim(bottom=0.0)
    axis.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
