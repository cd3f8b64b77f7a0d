"""Killing a training: the short version of ``benchmarks.kills``."""

import multiprocessing
from pathlib import Path

import pytest

from benchmarks import kills


def measure(out: Path, queue: "multiprocessing.SimpleQueue[dict]") -> None:
    """Run in a process of its own, whose folder and signals are its own."""
    queue.put(kills.measure(8, 20, out, seed=1, longest=0.4))


@pytest.mark.slow
def test_killed_and_resumed_training_is_bit_equal(tmp_path: Path) -> None:
    """8 kills at random moments: every checkpoint is readable, of the last update or the one before, and bit-equal."""
    context = multiprocessing.get_context("fork")
    queue = context.SimpleQueue()
    process = context.Process(target=measure, args=(tmp_path, queue))
    process.start()
    found = queue.get()
    process.join()
    assert found["kills"] == 8
    assert (found["unreadable"], found["old"], found["different"]) == (0, 0, 0)
    assert found["updates_seen"] >= 2


def test_the_digest_sees_single_bits_and_no_wall_times() -> None:
    """One bit of one weight changes it; a wall time does not."""
    import torch

    weight = torch.ones(3)
    first = kills.digest({"algorithm": {"w": weight}, "rows": [{"seconds": 1.0, "reward": 2.0}]})
    assert first == kills.digest({"algorithm": {"w": weight.clone()}, "rows": [{"seconds": 9.0, "reward": 2.0}]})
    weight[1] = torch.nextafter(weight[1], torch.tensor(2.0))
    assert first != kills.digest({"algorithm": {"w": weight}, "rows": [{"seconds": 1.0, "reward": 2.0}]})
    assert first != kills.digest({"algorithm": {"w": torch.ones(3)}, "rows": [{"seconds": 1.0, "reward": 2.5}]})
