"""Checkpoints: round trip, atomic write, and refusal of everything that is not one, without executing it."""

import os
import pickle
from pathlib import Path
from typing import Any

import pytest
import torch

from mrwarp.rl import checkpoint
from mrwarp.rl.checkpoint import CheckpointError


class Bomb:
    """An object whose unpickling runs code: it creates the file it was made for."""

    def __init__(self, target: Path) -> None:
        self.target = target

    def __reduce__(self) -> tuple[Any, ...]:
        """A call, as pickle stores it."""
        return os.mkdir, (str(self.target),)


def content() -> dict[str, Any]:
    """A small checkpoint of all kinds of values that training stores."""
    generator = torch.Generator().manual_seed(0)
    return {
        "weights": {"a": torch.randn(5, 3, generator=generator), "b": torch.arange(4)},
        "double": torch.randn(2, dtype=torch.float64, generator=generator),
        "generator": generator.get_state(),
        "rows": [{"reward": 0.1, "iteration": 3.0}, {"gate": {"passed": False, "0.5": 0.2}}],
        "flag": True,
        "name": "mr_go",
    }


def assert_same(found: Any, expected: Any) -> None:
    """Equal values, tensors with equal bits and types."""
    if isinstance(expected, torch.Tensor):
        assert found.dtype == expected.dtype and torch.equal(found, expected)
    elif isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for name in expected:
            assert_same(found[name], expected[name])
    else:
        assert found == expected


def test_round_trip_keeps_every_bit(tmp_path: Path) -> None:
    """The saved content is loaded, with the format's version added; nothing else is left in the folder."""
    path = tmp_path / "checkpoint.pt"
    checkpoint.save(path, content())
    assert_same(checkpoint.load(path), {"format": checkpoint.FORMAT, **content()})
    assert [file.name for file in tmp_path.iterdir()] == ["checkpoint.pt"]


@pytest.mark.parametrize("moment", ["fsync", "replace", None])
def test_a_failing_write_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moment: str | None
) -> None:
    """Whether the disk, the rename or (None) a value fails: the old checkpoint stays whole and alone."""
    path = tmp_path / "checkpoint.pt"
    checkpoint.save(path, content())
    before = path.read_bytes()

    def fail(*_: Any) -> None:
        raise OSError("no space left on device")

    new: dict[str, Any] = {"value": (x for x in "ab")}  # a generator cannot be written
    with monkeypatch.context() as patch:
        if moment is not None:
            new = {"value": 2}
            patch.setattr(os, moment, fail)
        with pytest.raises((OSError, TypeError)):
            checkpoint.save(path, new)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["checkpoint.pt"]


@pytest.mark.filterwarnings("ignore:Detected pickle protocol")
@pytest.mark.parametrize("kind", ["torch", "pickle", "inside"])
def test_code_is_refused_and_not_executed(tmp_path: Path, kind: str) -> None:
    """A file whose unpickling would run a command is refused by name, and the command does not run."""
    path, trap = tmp_path / "checkpoint.pt", tmp_path / "trap"
    bomb = Bomb(trap)
    if kind == "torch":
        torch.save(bomb, path)
    elif kind == "pickle":
        path.write_bytes(pickle.dumps(bomb))
    else:
        torch.save({"format": checkpoint.FORMAT, "env": {"q": torch.zeros(2), "extra": [bomb]}}, path)
    with pytest.raises(CheckpointError, match="refused.*use a checkpoint that mrwarp wrote") as info:
        checkpoint.load(path)
    assert str(path) in str(info.value)
    assert not trap.exists()
    if kind == "torch":  # the payload is a working one
        torch.load(path, weights_only=False)
        assert trap.is_dir()


@pytest.mark.parametrize("value", [{"weights": torch.zeros(2)}, {"format": 0}, {"format": "1"}, [1, 2], torch.zeros(3)])
def test_another_format_is_refused(tmp_path: Path, value: Any) -> None:
    """Data without this version's mark, or that is no dictionary, was not written by this mrwarp."""
    path = tmp_path / "checkpoint.pt"
    torch.save(value, path)
    with pytest.raises(CheckpointError, match="format .* is not 1; it was written by another version") as info:
        checkpoint.load(path)
    assert str(path) in str(info.value)


GPU = torch.device("cuda:1")


@pytest.fixture
def gpu_states(monkeypatch: pytest.MonkeyPatch) -> dict[torch.device, torch.Tensor]:
    """Stands in for the generators of GPUs, where there is none."""
    states = {GPU: torch.arange(16, dtype=torch.uint8)}
    monkeypatch.setattr(torch.cuda, "get_rng_state", lambda device: states[device].clone())
    monkeypatch.setattr(torch.cuda, "set_rng_state", lambda state, device: states.update({device: state.clone()}))
    return states


def test_random_states_come_back(tmp_path: Path, gpu_states: dict[torch.device, torch.Tensor]) -> None:
    """Draws after loading are those after saving; the GPU's generator, and no other, gets its state back."""
    torch.manual_seed(5)
    checkpoint.save(tmp_path / "c.pt", checkpoint.random_state(GPU))
    drawn = torch.rand(3)
    gpu_states[GPU] = torch.zeros(16, dtype=torch.uint8)
    assert checkpoint.set_random_state(checkpoint.load(tmp_path / "c.pt"), GPU) == ""
    assert torch.equal(torch.rand(3), drawn)
    assert list(gpu_states) == [GPU] and torch.equal(gpu_states[GPU], torch.arange(16, dtype=torch.uint8))


def test_a_checkpoint_without_the_gpus_state_goes_on_with_a_note(gpu_states: dict[torch.device, torch.Tensor]) -> None:
    """As earlier versions wrote them; on the CPU nothing is missing, and nothing of a GPU is asked."""
    cpu = torch.device("cpu")
    before = gpu_states[GPU].clone()
    state = checkpoint.random_state(cpu)
    assert list(state) == ["torch_rng"] and checkpoint.set_random_state(state, cpu) == ""
    assert "no random state of cuda:1" in checkpoint.set_random_state(state, GPU)
    assert torch.equal(gpu_states[GPU], before)
