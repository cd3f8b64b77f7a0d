"""Narrow lines in the mismatch: found with their frequency, and not in noise."""

import numpy as np
import pytest
from scipy.signal import lfilter

from mrwarp.diagnose.spectral_lines import find_line
from mrwarp.identify.dataset import Dataset, Scales
from mrwarp.identify.noise import Noise

DT = 0.005


def samples(lengths: list[int]) -> Dataset:
    """Trajectories of some lengths; only their bounds count here."""
    zero = np.zeros(sum(lengths))
    return Dataset(
        q=zero, qd=zero, current=zero, torque=zero, start=np.cumsum([0, *lengths]), dt=np.full(len(lengths), DT),
        scales=Scales(),
    )  # fmt: skip


def white(sigma: float = 1.0) -> Noise:
    """Noise without memory."""
    return Noise(whitening=np.ones(1), sigma=sigma, rms=sigma, offset=0.0, gain=0.0)


def with_line(seed: int, lengths: list[int], frequency: float, size: float, share: float = 1.0) -> np.ndarray:
    """White noise with a line of its own phase in the first ``share`` of the trajectories."""
    rng = np.random.default_rng(seed)
    out = []
    for k, n in enumerate(lengths):
        line = size * np.sin(2 * np.pi * frequency * DT * np.arange(n) + rng.uniform(0, 2 * np.pi))
        out.append(rng.normal(size=n) + (line if k < share * len(lengths) else 0.0))
    return np.concatenate(out)


def still(lengths: list[int]) -> np.ndarray:
    """Simulated torque of a joint at rest."""
    return np.zeros(sum(lengths))


@pytest.mark.parametrize("frequency", [3.0, 7.3, 50.0, 91.7])
@pytest.mark.parametrize("lengths", [[1600] * 32, [800] * 12], ids=["large", "small"])
def test_line_is_found(frequency: float, lengths: list[int]) -> None:
    """A line of 0.4 of the noise's RMS, with a phase of its own in each trajectory, to half a bin."""
    size = 0.4 * np.sqrt(2.0)
    found = find_line(with_line(1, lengths, frequency, size), still(lengths), samples(lengths), white())
    assert found is not None
    assert found.frequency == pytest.approx(frequency, abs=0.6 / (lengths[0] * DT))
    # taking it out gains size^2/2 per sample where the bin holds all of it, 40 % of it where two bins share it
    possible = sum(lengths) * size**2 / 2.0
    assert 0.3 * possible < found.gain < 1.1 * possible


def test_no_line_in_noise() -> None:
    """In 40 data sets of white and coloured noise there is none."""
    lengths = [800] * 12
    for seed in range(40):
        noise = np.random.default_rng(seed).normal(size=sum(lengths))
        keep = np.exp(-DT / 0.05)
        if seed % 2:
            noise = lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], noise)
        assert find_line(noise, still(lengths), samples(lengths), white()) is None, seed


def test_swinging_mismatch_is_no_line() -> None:
    """Each trajectory's own motion frequency is none: it is another one in the next trajectory."""
    lengths, rng = [800] * 12, np.random.default_rng(3)
    t = DT * np.arange(800)
    parts = [np.sin(2 * np.pi * (0.5 + 0.13 * k) * t) + rng.normal(size=800) for k in range(12)]
    assert find_line(np.concatenate(parts), still(lengths), samples(lengths), white()) is None


def test_line_in_few_trajectories_is_none() -> None:
    """In a third of the trajectories it is an event, not a line; with three trajectories nothing is said."""
    lengths = [800] * 12
    assert find_line(with_line(4, lengths, 20.0, 1.0, share=1 / 3), still(lengths), samples(lengths), white()) is None
    assert find_line(with_line(4, lengths, 20.0, 1.0), still(lengths), samples(lengths), white()) is not None
    assert find_line(with_line(5, [800] * 3, 20.0, 1.0), still([800] * 3), samples([800] * 3), white()) is None


def test_shorter_trajectories_are_left_out() -> None:
    """Trajectories of less than nine tenths of the usual length do not spoil the bins."""
    lengths = [800] * 8 + [300] * 3
    found = find_line(with_line(6, lengths, 33.0, 0.8), still(lengths), samples(lengths), white())
    assert found is not None and found.frequency == pytest.approx(33.0, abs=0.15)


def test_what_follows_the_motion_is_no_line() -> None:
    """A wrong gain in each trajectory of a swing at the same frequency everywhere."""
    lengths, rng = [800] * 12, np.random.default_rng(7)
    swing = np.tile(np.sin(2 * np.pi * 3.0 * DT * np.arange(800)), 12)
    gains = np.repeat(rng.normal(size=12), 800)
    mismatch = gains * swing + rng.normal(size=len(swing))
    assert find_line(mismatch, still(lengths), samples(lengths), white()) is not None
    assert find_line(mismatch, swing, samples(lengths), white()) is None
