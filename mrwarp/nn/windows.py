"""Sliding windows over trajectories: views of one array of samples, never across two trajectories, never copied out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch


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
        if len(features) != len(targets):
            raise ValueError(f"{len(features)} trajectories of features, but {len(targets)} of targets")
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
    """Divide trajectories at random into training and validation (section 4.3), at least one in each.

    Args:
        count: Number of trajectories.
        seed: Seed of the division.
        validation: Share of the validation set.

    Returns:
        Sorted numbers of the training and of the validation trajectories.

    Raises:
        ValueError: there are fewer than two trajectories.
    """
    if count < 2:
        raise ValueError(f"{count} trajectory cannot be divided into training and validation; record at least two")
    order = np.random.default_rng(seed).permutation(count)
    held = min(max(round(validation * count), 1), count - 1)
    return sorted(order[held:].tolist()), sorted(order[:held].tolist())
