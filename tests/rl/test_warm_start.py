"""Warm start: a training of another task begins with an earlier one's networks, and refuses those that do not fit."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from mrwarp.cli import main
from mrwarp.env.cfg import TaskCfg
from mrwarp.rl import checkpoint, warm_start
from mrwarp.rl.checkpoint import CheckpointError
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy, export_onnx
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer
from mrwarp.rl.warm_start import CRITIC_FIRST, NOISE, critic_learns_alone
from tests.messages import Refused

pytestmark = pytest.mark.usefixtures("short_gate")


def make_cfg(out: Path, iterations: int = 1, **env: Any) -> TrainCfg:
    """A run of a few updates with 4 robots."""
    return TrainCfg(task=TaskCfg(num_envs=4, seed=5, **env), run=RunCfg(out=out, iterations=iterations, no_gate=True))


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Checkpoint of two updates on flat ground; tests only read it."""
    run = Trainer(make_cfg(tmp_path_factory.mktemp("flat"), 2))
    run.update()
    run.update()
    return run.save()


def networks(run: Trainer) -> dict[str, dict[str, torch.Tensor]]:
    """Weights, noise and normalisers of a run's networks, as they are now."""
    nets = {"actor": run.algorithm.actor, "critic": run.algorithm.critic}
    return {name: {key: value.clone() for key, value in net.state_dict().items()} for name, net in nets.items()}


def test_networks_and_normalisers_are_taken_over_and_the_rest_is_new(flat: Path, tmp_path: Path) -> None:
    """A robot with a load begins with the other's networks, and else as a run of its own: update 0, own draws."""
    run = Trainer(make_cfg(tmp_path / "loaded", payload=3), start_from=flat)
    plain = PpoCfg(symmetry=False)  # the shipped policy is not symmetric
    fresh = Trainer(replace(make_cfg(tmp_path / "fresh", payload=3), ppo=plain))
    saved, own, drawn = checkpoint.load(flat), networks(run), networks(fresh)
    for name in ("actor", "critic"):
        expected = saved["algorithm"][f"{name}_state_dict"]
        assert own[name].keys() == expected.keys()
        for key, value in expected.items():
            assert torch.equal(own[name][key], value), (name, key)
        assert not torch.equal(own[name]["mlp.0.weight"], drawn[name]["mlp.0.weight"])
        assert not torch.equal(own[name]["obs_normalizer._mean"], drawn[name]["obs_normalizer._mean"])
    assert (run.iteration, run.progress.rows, run.algorithm.learning_rate) == (0, [], fresh.algorithm.learning_rate)
    assert saved["algorithm"]["optimizer_state_dict"]["state"] and not run.algorithm.optimizer.state
    assert torch.equal(run.obs["actor"], fresh.obs["actor"])


def test_the_origin_stands_in_result_policy_and_checkpoint_also_after_a_resume(flat: Path, tmp_path: Path) -> None:
    """Stopped and resumed, a warm-started run still records where its first networks came from; others say None."""
    out = tmp_path / "loaded"
    cfg = make_cfg(out, payload=3)
    assert Trainer(make_cfg(tmp_path / "fresh")).run()["started_from"] is None
    origin = Trainer(cfg, start_from=flat).run()["started_from"]
    assert (origin["file"], origin["iteration"], origin["seed"]) == (str(flat), 2, 5)
    assert origin["task"]["payload"] == 0
    Trainer(replace(cfg, run=replace(cfg.run, iterations=2)), resume=out / "checkpoint.pt").run()
    result = json.loads((out / "result.json").read_text())
    assert (result["iterations"], result["task"]["payload"], result["started_from"]) == (2, 3, origin)
    assert OnnxPolicy(out / "policy.onnx").description["started_from"] == origin


def broken(flat: Path, folder: Path, what: str) -> Path:
    """The checkpoint with one thing wrong."""
    values = checkpoint.load(flat)
    values.pop("format")
    actor = values["algorithm"]["actor_state_dict"]
    if what == "a missing layer":
        del actor["mlp.2.bias"]
    elif what == "a layer more":
        actor["mlp.8.bias"] = torch.zeros(1)
    elif what == "no numbers":
        actor["mlp.0.weight"][0, 0] = float("nan")
    elif what == "text for a layer":
        actor["mlp.0.weight"] = "weights"
    elif what == "a list for networks":
        values["algorithm"] = []
    else:
        del values[what]
    path = folder / "broken.pt"
    checkpoint.save(path, values)
    return path


def test_a_policy_gives_its_actor_and_the_critic_is_new(flat: Path, tmp_path: Path) -> None:
    """From the shipped policy: its actions to rounding, its statistics with their weight, little noise, no critic."""
    plain = PpoCfg(symmetry=False)  # a symmetric critic is drawn in another way than it is taken over
    fresh = Trainer(replace(make_cfg(tmp_path / "fresh", payload=3), ppo=plain))
    run = Trainer(replace(make_cfg(tmp_path / "out", payload=3), ppo=plain), start_from=DEFAULT_POLICY)
    policy, actor = OnnxPolicy(DEFAULT_POLICY), run.algorithm.actor
    with torch.no_grad():
        torch.testing.assert_close(actor(run.obs), policy(run.obs), rtol=1e-5, atol=1e-5)
    assert int(actor.obs_normalizer.count) == policy.description["iteration"] * 24 * 64
    assert torch.equal(actor.state_dict()["distribution.std_param"], torch.full((12,), NOISE))
    assert torch.equal(networks(run)["critic"]["mlp.0.weight"], networks(fresh)["critic"]["mlp.0.weight"])
    assert run.started_from is not None and run.started_from["file"] == str(DEFAULT_POLICY)
    assert math.isfinite(run.update()["reward"])


def test_a_new_critic_learns_before_the_actor_does(flat: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a policy's actor the critic is new and learns alone, resumed or not; a checkpoint's learns with it."""
    monkeypatch.setattr(warm_start, "CRITIC_FIRST", 2)
    cfg = make_cfg(tmp_path / "out")
    run = Trainer(cfg, start_from=DEFAULT_POLICY)
    before = networks(run)
    run.update()
    run = Trainer(cfg, resume=run.save())
    run.update()
    then = networks(run)
    run.update()
    moved = {
        name: [
            not torch.equal(nets[name]["mlp.0.weight"], before[name]["mlp.0.weight"]) for nets in (then, networks(run))
        ]
        for name in before
    }
    assert moved == {"actor": [False, True], "critic": [True, True]}
    run = Trainer(make_cfg(tmp_path / "rough", terrain="rough"), start_from=flat)
    before = networks(run)
    run.update()
    assert not torch.equal(networks(run)["actor"]["mlp.0.weight"], before["actor"]["mlp.0.weight"])


def test_new_networks_learn_together() -> None:
    """Only a policy's actor waits, and not for longer than the critic needs."""
    policy, whole = {"file": "a/policy.onnx"}, {"file": "a/checkpoint.pt"}
    assert critic_learns_alone(policy, CRITIC_FIRST - 1) and not critic_learns_alone(policy, CRITIC_FIRST)
    assert not critic_learns_alone(whole, 0) and not critic_learns_alone(None, 0)


def test_the_command_refuses_a_policy_without_its_record(tmp_path: Path, refused: Refused) -> None:
    """A policy that does not record its training task: exit code 2 and one line."""
    run, path = Trainer(make_cfg(tmp_path / "run")), tmp_path / "bare.onnx"
    export_onnx(run.algorithm.get_policy(), path, {"task": {}})
    error = refused("train", "--num-envs", "4", "--out", tmp_path / "out", "--start-from", path)
    assert error.startswith(f"mrwarp train: {path}: ") and "lacks 'seed'" in error
    assert not (tmp_path / "out").exists()


REFUSED = {
    "a missing layer": "its actor has mlp.2.bias of shape none, this training needs \\(64,\\)",
    "a layer more": "its actor has mlp.8.bias of shape \\(1,\\), this training needs none",
    "no numbers": "its actor holds no numbers in mlp.0.weight",
    "text for a layer": "does not fit this version.*start from another checkpoint",
    "a list for networks": "does not fit this version",
    "algorithm": "does not fit this version",
    "task": "does not fit this version",
}


@pytest.mark.parametrize("what", REFUSED)
def test_a_checkpoint_that_does_not_fit_is_refused(what: str, flat: Path, tmp_path: Path) -> None:
    """One line that names file, part and remedy, and no output folder."""
    path = broken(flat, tmp_path, what)
    with pytest.raises(CheckpointError, match=REFUSED[what]) as info:
        Trainer(make_cfg(tmp_path / "out"), start_from=path)
    assert str(info.value).startswith(f"{path}: ") and "\n" not in str(info.value)
    assert not (tmp_path / "out").exists()


def test_the_command_refuses_networks_of_another_robot(flat: Path, tmp_path: Path, refused: Refused) -> None:
    """Go1 has no devices, so its critic sees less: exit code 2 and one line with both shapes."""
    args = ["--num-envs", "4", "--robot", "go1", "--actuator", "none", "--sal", "off", "--out", str(tmp_path / "out")]
    error = refused("train", *args, "--start-from", flat)
    assert "critic has mlp.0.weight of shape (128, " in error
    assert "trained on mr_go with bouc_wen" in error and not (tmp_path / "out").exists()


def test_start_from_and_resume_exclude_each_other(flat: Path, tmp_path: Path) -> None:
    """A run is either gone on with or new."""
    with pytest.raises(ValueError, match="not both"):
        Trainer(make_cfg(tmp_path / "out"), resume=flat, start_from=flat)
    assert main(["train", "--resume", str(flat), "--start-from", str(flat), "--out", str(tmp_path / "out")]) == 2
    assert not (tmp_path / "out").exists()
