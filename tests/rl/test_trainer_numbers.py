"""Trainer: numbers that go wrong, full disks and shared folders end in a clear message, never in a lost checkpoint."""

import errno
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from mrwarp import run_dir as folder
from mrwarp.env import nan_dump
from mrwarp.env.cfg import TaskCfg
from mrwarp.rl import checkpoint
from mrwarp.rl.progress import not_finite
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer, TrainingError
from mrwarp.run_dir import FolderError

NAN = float("nan")


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, short_gate: None) -> None:
    """MuJoCo's log goes to the temporary folder."""
    monkeypatch.chdir(tmp_path)


def make_trainer(out: Path, *, iterations: int = 2, **changes: Any) -> Trainer:
    """A run of a few updates with 8 environments."""
    env = replace(TaskCfg(num_envs=8), episode_seconds=1.0)
    run = RunCfg(out=out, iterations=iterations, no_gate=True)
    return Trainer(TrainCfg(task=replace(env, seed=3), run=replace(run, **changes)))


def corrupt(run: Trainer, envs: list[int], step: int) -> None:
    """Write NaN into a joint speed of some environments at one policy step."""
    count = [0]

    def watch() -> None:
        count[0] += 1
        if count[0] == step:
            run.env.view(run.env.sim.backend.field("qvel"))[envs, 12] = NAN

    run.watchers.append(watch)


def test_one_broken_environment_is_dumped_and_training_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """NaN in one environment: a line, a dump that opens, a count in the result, finite networks at the end."""
    run = make_trainer(tmp_path / "run", save_every=0.0)
    corrupt(run, [5], 10)
    result = run.run()
    assert (result["diverged_episodes"], result["iterations"]) == (1, 2)
    (path,) = (tmp_path / "run" / "diverged").iterdir()
    found = nan_dump.load(path)
    assert found.env == 5 and found.run["update"] == 1 and "velocity" in str(found)
    assert "diverged: environment 5" in capsys.readouterr().out
    kept = checkpoint.load(tmp_path / "run" / "checkpoint.pt")
    assert kept["divergences"] == 1 and not_finite(kept["algorithm"]) == ""
    assert Trainer(run.cfg, resume=tmp_path / "run" / "checkpoint.pt").divergences.count == 1


def test_too_many_broken_environments_stop_the_training(tmp_path: Path) -> None:
    """2 of 8 in the third update: the message names the share, the first cause and the checkpoint of the second."""
    run = make_trainer(tmp_path / "run", iterations=5, save_every=0.0)
    corrupt(run, [1, 6], 2 * 24 + 7)
    with pytest.raises(TrainingError, match=r"25.0% of the environments in update 3, more.*first: environment 1"):
        run.run()
    assert checkpoint.load(tmp_path / "run" / "checkpoint.pt")["iteration"] == 2
    assert len(list((tmp_path / "run" / "diverged").iterdir())) == 2


def test_an_environment_that_breaks_again_and_again_stops_the_training(tmp_path: Path) -> None:
    """One environment per update is 12.5 % of 8: above 1 % of 50 updates from the fifth on."""
    run = make_trainer(tmp_path / "run", iterations=50)
    run.watchers.append(lambda: run.env.view(run.env.sim.backend.field("qvel"))[0].__setitem__(9, NAN))
    with pytest.raises(TrainingError, match="per update over the last 50"):
        run.run()
    assert run.iteration == 4


def test_an_action_that_is_no_number_is_not_learned_from(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One NaN among the actions of a rollout would reach every weight: that rollout is left out."""
    run = make_trainer(tmp_path / "run")
    act, calls = run.algorithm.act, [0]

    def broken(obs: Any) -> torch.Tensor:
        actions = act(obs)
        calls[0] += 1
        if calls[0] == 5:
            actions[2, 4] = NAN
        return actions

    monkeypatch.setattr(run.algorithm, "act", broken)
    assert run.run()["diverged_episodes"] == 1
    assert not_finite(run.algorithm.save()) == ""


def test_networks_without_numbers_are_never_saved(tmp_path: Path) -> None:
    """A NaN weight: every action is NaN, the training stops, and the checkpoint before stays."""
    run = make_trainer(tmp_path / "run")
    path = run.save()
    before = path.read_bytes()
    with torch.no_grad():
        list(run.algorithm.get_policy().parameters())[-1].fill_(NAN)
    with pytest.raises(TrainingError, match=f"holds no numbers after update 0; go on from {path}"):
        run.save()
    with pytest.raises(TrainingError, match="100.0% of the environments in update 1.*action of"):
        run.run()
    assert path.read_bytes() == before


def fail(code: int) -> Callable[..., Any]:
    """A function of the operating system that fails."""

    def raising(*_: Any, **__: Any) -> None:
        raise OSError(code, os.strerror(code))

    return raising


@pytest.mark.parametrize("name", ["fsync", "replace"])
def test_a_full_disk_stops_with_the_earlier_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    """No space for the next checkpoint: the file, the reason and what to go on from; the old one is intact."""
    run = make_trainer(tmp_path / "run", save_every=0.0)
    path = run.save()
    before = path.read_bytes()
    monkeypatch.setattr(os, name, fail(errno.ENOSPC))
    with pytest.raises(TrainingError, match=f"{path}: No space left on device .update 1.; go on from {path}"):
        run.run()
    assert path.read_bytes() == before and not list(path.parent.glob("*.part"))


def test_a_second_training_in_the_same_folder_is_refused(tmp_path: Path) -> None:
    """While one writes the other is refused; afterwards the folder is free, and no lock file is left."""
    run = make_trainer(tmp_path / "run")
    with folder.claim(tmp_path / "run"), pytest.raises(FolderError, match="another run writes here; wait"):
        run.run()
    assert list(tmp_path.glob("run/*")) == []
    with folder.claim(tmp_path / "run"):
        pass
