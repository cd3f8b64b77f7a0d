"""Sliding windows and the division of trajectories."""

import numpy as np
import pytest
import torch

from mrwarp.nn.models import StandardScaler
from mrwarp.nn.training import WindowSet, split


def make_set(lengths: tuple[int, ...], samples: int) -> WindowSet:
    """Trajectories whose features show where they come from: (trajectory, sample, -sample)."""
    features = [
        np.stack([np.full(n, i), np.arange(n), -np.arange(n)], axis=1).astype(float) for i, n in enumerate(lengths)
    ]
    return WindowSet(features, [10.0 * x[:, 0] + x[:, 1] for x in features], samples)


def test_windows_are_all_overlapping_ones_of_each_trajectory() -> None:
    """N - 49 windows each, none across two trajectories, oldest sample first, the target at the last sample."""
    windows = make_set((60, 20, 50), 50)
    assert len(windows) == 11 + 0 + 1
    x, y = windows.batch(torch.arange(len(windows)))
    assert x.shape == (50, 12, 3)
    assert torch.equal(x[:, :, 0], x[-1:, :, 0].expand(50, -1))
    assert torch.equal(x[:, :, 1], torch.arange(50)[:, None] + torch.tensor([*range(11), 0])[None, :])
    assert torch.equal(y, torch.tensor([*range(49, 60), 20.0 + 49.0]))


def test_windows_share_the_samples() -> None:
    """The set holds every sample once, for any length of the window."""
    windows = make_set((1000,), 50)
    assert windows.features.shape == (1000, 3)


def test_scaler_is_fitted_on_what_it_is_given() -> None:
    """Mean 0 and standard deviation 1 afterwards; a constant feature is only shifted."""
    x = torch.randn(5000, 3, generator=torch.Generator().manual_seed(0)) * 3.0 + 1.0
    x[:, 2] = 1.5
    scaler = StandardScaler()
    scaler.fit(x)
    scaled = scaler(x)
    assert torch.allclose(scaled.mean(0), torch.zeros(3), atol=1e-5)
    assert torch.allclose(scaled[:, :2].std(0, correction=0), torch.ones(2), atol=1e-5)
    assert torch.equal(scaled[:, 2], torch.zeros(5000))


def test_split_is_by_trajectory_and_seed() -> None:
    """80 to 20, no trajectory in both, the same for the same seed and another for another."""
    training, held = split(120, seed=3)
    assert (len(training), len(held)) == (96, 24)
    assert sorted(training + held) == list(range(120))
    assert split(120, seed=3) == (training, held)
    assert split(120, seed=4) != (training, held)
    assert [len(part) for part in split(2, seed=0)] == [1, 1]
    with pytest.raises(ValueError, match="at least two"):
        split(1, seed=0)
