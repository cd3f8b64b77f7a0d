"""Trainer: stop and resume to the bit, refusal of foreign checkpoints, when it stops, and what it leaves behind."""

import json
import math
import signal
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import pytest
import torch

from mrwarp.env.cfg import TaskCfg
from mrwarp.options.plain_values import plain
from mrwarp.rl import checkpoint, trainer
from mrwarp.rl import progress as curves
from mrwarp.rl.checkpoint import CheckpointError, ppo_of
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.rl.task_record import record
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer
from mrwarp.trials.walking import GateCheck, WalkingGate

ENV = TaskCfg(num_envs=8)
TINY_GATE = WalkingGate(num_envs=4, warmup=0.0, seconds=0.2)


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Gate checks of 0.2 s on 4 environments instead of 22 s on 64, and no picture: the training itself is the same."""
    monkeypatch.setattr(trainer, "GateCheck", lambda cfg: GateCheck(cfg, gate=TINY_GATE))
    monkeypatch.setattr(curves, "plot", lambda *_: None)


def make_cfg(out: Path, iterations: int, **changes: Any) -> TrainCfg:
    """A run of a few updates with 8 environments, episodes of which end by time-out and fall."""
    env = replace(ENV, episode_seconds=1.0)
    run = RunCfg(out=out, iterations=iterations, no_gate=True)
    names = {each.name for each in fields(RunCfg)}
    run = replace(run, **{name: value for name, value in changes.items() if name in names})
    task = replace(changes.get("task", env), seed=changes.get("seed", 3))
    return TrainCfg(task=task, ppo=changes.get("ppo", PpoCfg()), run=run)


def content(run: Trainer) -> dict[str, Any]:
    """The run's last checkpoint."""
    return checkpoint.load(run.cfg.run.out / "checkpoint.pt")


def assert_same_bits(found: Any, expected: Any, where: str = "") -> None:
    """Equal nested values; tensors with equal bits."""
    if isinstance(expected, torch.Tensor):
        assert torch.equal(found, expected), where
    elif isinstance(expected, dict):
        assert found.keys() == expected.keys(), where
        for name in expected:
            assert_same_bits(found[name], expected[name], f"{where}/{name}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), where
        for i, (ours, theirs) in enumerate(zip(found, expected, strict=True)):
            assert_same_bits(ours, theirs, f"{where}/{i}")
    else:
        assert found == expected, where


def without_times(values: Any) -> Any:
    """Progress figures without wall times, which no two runs share."""
    if isinstance(values, list):
        return [without_times(value) for value in values]
    return {k: v for k, v in values.items() if k not in ("seconds", "collect_ms", "learn_ms", "steps_per_second")}


def test_resume_equals_an_uninterrupted_run(tmp_path: Path) -> None:
    """2 updates, stop, new process state, 2 more = 4 updates: networks, optimiser, draws, environment, figures."""
    whole = Trainer(make_cfg(tmp_path / "whole", 4))
    whole.run()
    Trainer(make_cfg(tmp_path / "part", 2)).run()
    torch.manual_seed(999)  # random draws in between
    torch.rand(17)
    resumed = Trainer(make_cfg(tmp_path / "part", 4), resume=tmp_path / "part" / "checkpoint.pt")
    assert resumed.iteration == 2
    resumed.run()
    ours, theirs = content(resumed), content(whole)
    for name in ("algorithm", "learning_rate", "torch_rng", "env", "iteration", "seed", "task"):
        assert_same_bits(ours[name], theirs[name], name)
    for name in ("rows", "window"):
        assert without_times(ours[name]) == without_times(theirs[name])
    assert torch.equal(resumed.obs["actor"], whole.obs["actor"])
    assert [row["iteration"] for row in resumed.progress.rows] == [1, 2, 3, 4]
    # the run in two parts was checked against the gate after 2 updates too, which must leave no trace
    assert [row["iteration"] for row in resumed.progress.gate_rows] == [2, 4]
    assert without_times(resumed.progress.gate_rows[-1]) == without_times(whole.progress.gate_rows[-1])


@pytest.mark.gpu
def test_resume_on_a_gpu(tmp_path: Path) -> None:
    """The saved state is loaded to the bit, by another object on the GPU, which trains on."""
    env = replace(ENV, episode_seconds=1.0)
    env = replace(env, device="cuda:0", num_envs=64)
    first = Trainer(make_cfg(tmp_path, 2, task=env))
    first.run()
    torch.rand(17, device="cuda:0")  # random draws in between
    resumed = Trainer(make_cfg(tmp_path, 4, task=env), resume=tmp_path / "checkpoint.pt")
    before = content(first)
    resumed.save()
    for name in ("algorithm", "learning_rate", "torch_rng", "env"):
        assert_same_bits(content(resumed)[name], before[name], name)
    result = resumed.run()
    assert resumed.iteration == 4 and math.isfinite(result["training"]["reward"])


def test_training_changes_the_policy_and_stays_finite(tmp_path: Path) -> None:
    """An update moves actor, critic and observation statistics; all parameters and figures are finite."""
    run = Trainer(make_cfg(tmp_path, 2))
    before = {name: value.clone() for name, value in run.algorithm.get_policy().state_dict().items()}
    result = run.run()
    after = run.algorithm.get_policy().state_dict()
    for name in ("mlp.0.weight", "obs_normalizer._mean", "distribution.std_param"):
        assert not torch.equal(after[name], before[name]), name
    assert all(bool(torch.isfinite(value).all()) for value in after.values())
    assert all(math.isfinite(value) for row in run.progress.rows for value in row.values())
    assert result["training"] == run.progress.rows[-1]


CHANGES: dict[str, tuple[Callable[[TrainCfg], TrainCfg], str]] = {
    "num_envs": (lambda c: replace(c, task=replace(c.task, num_envs=4)), "num_envs = 8.* has 4"),
    "robot": (lambda c: replace(c, task=replace(c.task, robot="go1")), "robot = 'mr_go'.* has 'go1'"),
    "payload": (lambda c: replace(c, task=replace(c.task, payload=3)), "payload = 0.* has 3"),
    "sal": (lambda c: replace(c, task=replace(c.task, sal=False)), "sal = True"),
    "seed": (lambda c: replace(c, task=replace(c.task, seed=4)), "seed = 3.* has 4"),
    "desired_kl": (lambda c: replace(c, ppo=PpoCfg(desired_kl=0.01)), "desired_kl = 0.04.* has 0.01"),
    "entropy": (lambda c: replace(c, ppo=PpoCfg(entropy=0.0)), "entropy = 0.003.* has 0.0"),
    "symmetry": (lambda c: replace(c, ppo=PpoCfg(symmetry=False)), "symmetry = True.* has False"),
}


def test_networks_learn_as_fast_as_asked(tmp_path: Path) -> None:
    """Step and exploration reach the algorithm; checkpoint and result record them."""
    run = Trainer(replace(make_cfg(tmp_path, 1), ppo=PpoCfg(desired_kl=0.01, entropy=0.0005)))
    assert (run.algorithm.desired_kl, run.algorithm.entropy_coef) == (0.01, 0.0005)
    asked = {"desired_kl": 0.01, "entropy": 0.0005, "symmetry": True}
    assert run.run()["learning"] == checkpoint.load(tmp_path / "checkpoint.pt")["learning"] == asked
    assert plain(ppo_of({"learning": asked})) == asked
    assert plain(ppo_of({})) == {"desired_kl": 0.04, "entropy": 0.003, "symmetry": False}  # of earlier versions


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a finished training of one update; tests only read it."""
    out = tmp_path_factory.mktemp("finished")
    with pytest.MonkeyPatch.context() as patch:  # before the fixture above: with the picture
        patch.setattr(trainer, "GateCheck", lambda cfg: GateCheck(cfg, gate=TINY_GATE))
        Trainer(make_cfg(out, 1, command="python train/ppo.py --iterations 1")).run()
    return out


@pytest.mark.parametrize("name", CHANGES)
def test_resume_refuses_another_task(finished: Path, tmp_path: Path, name: str) -> None:
    """A checkpoint of another task or seed is refused with both values, before anything is written."""
    change, message = CHANGES[name]
    with pytest.raises(CheckpointError, match=message) as info:
        Trainer(change(make_cfg(tmp_path / "out", 2)), resume=finished / "checkpoint.pt")
    assert str(finished) in str(info.value)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("part", ["task", "seed", "algorithm", "env", "window", "env/qpos", "algorithm/weights"])
def test_resume_refuses_an_incomplete_checkpoint(finished: Path, tmp_path: Path, part: str) -> None:
    """Missing or misshapen parts end in a CheckpointError that names the file, not in a traceback."""
    values = checkpoint.load(finished / "checkpoint.pt")
    values.pop("format")
    if part == "env/qpos":
        values["env"]["sim/qpos"] = torch.zeros(3, 19)
    elif part == "algorithm/weights":
        values["algorithm"]["actor_state_dict"]["mlp.0.weight"] = torch.zeros(2, 2)
    else:
        del values[part]
    path = tmp_path / "broken.pt"
    checkpoint.save(path, values)
    with pytest.raises(CheckpointError, match="does not fit this version.*start again") as info:
        Trainer(make_cfg(tmp_path / "out", 2), resume=path)
    assert str(info.value).startswith(f"{path}: ") and "\n" not in str(info.value)
    assert not (tmp_path / "out").exists()


def test_run_leaves_checkpoint_policy_curve_and_result(finished: Path) -> None:
    """The files of a run, nothing half-written, and the documented keys of ``result.json``."""
    names = {path.name for path in finished.iterdir()}
    assert names == {"checkpoint.pt", "policy.onnx", "learning_curve.png", "result.json", "tensorboard"}
    assert (finished / "learning_curve.png").read_bytes().startswith(b"\x89PNG")
    result = json.loads((finished / "result.json").read_text())
    assert set(result) == {
        "schema", "gate", "gate_passed", "stopped", "iterations", "seconds", "environment_steps", "training",
        "unsolved_steps", "warnings", "diverged_episodes", "task", "learning", "started_from", "processes", "seed",
        "versions", "command",
    }  # fmt: skip
    assert result["stopped"] == "iterations" and result["gate_passed"] is False
    assert (result["iterations"], result["seed"], result["environment_steps"]) == (1, 3, 24 * 8)
    assert result["command"] == "python train/ppo.py --iterations 1"
    assert result["task"] == record(make_cfg(finished, 1).task)
    assert set(result["gate"]["conditions"]) == {"never_fell", "rmse", "height", "frequency", "clock_match"}
    assert {"v_x_rmse", "reward", "falls_per_hour", "clock_match", "learning_rate"} <= set(result["training"])
    assert {"python", "torch", "mujoco", "warp-lang", "newton", "rsl-rl-lib"} <= set(result["versions"])


def test_exported_policy_is_the_trained_actor(tmp_path: Path) -> None:
    """``policy.onnx`` gives the actions of the networks in memory on real observations."""
    run = Trainer(make_cfg(tmp_path, 1))
    run.run()
    exported = OnnxPolicy(tmp_path / "policy.onnx")
    with torch.no_grad():
        expected = run.algorithm.get_policy()(run.obs)
    torch.testing.assert_close(exported(run.obs), expected, rtol=1e-5, atol=1e-5)
    assert exported.description["task"] == record(run.cfg.task)


def verdict(passed: bool) -> dict[str, Any]:
    """Report of a gate check, as far as the trainer reads it."""
    return {
        "reward": 0.0, "v_x_rmse": {"0.3": 0.1, "0.5": 0.1}, "never_fell": 1.0, "height": 0.32,
        "stride_frequency": 1.5, "clock_match": 0.9, "conditions": {"rmse": passed}, "passed": passed,
    }  # fmt: skip


class ScriptedGate:
    """A gate whose verdicts are given; it counts its checks."""

    def __init__(self, verdicts: list[bool]) -> None:
        self.gate, self.left = WalkingGate(), list(verdicts)

    def __call__(self, _: Any) -> dict[str, Any]:
        """The next verdict."""
        return verdict(self.left.pop(0))


def test_training_stops_when_the_gate_is_met(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first passing check ends the run and is not repeated; the result says so."""
    gate = ScriptedGate([False, True])
    monkeypatch.setattr(trainer, "GateCheck", lambda _: gate)
    cfg = make_cfg(tmp_path, 5, no_gate=False, check_every=0.0, check_below=1e9)
    result = Trainer(cfg).run()
    assert (result["stopped"], result["gate_passed"], result["iterations"]) == ("gate", True, 2)
    assert gate.left == []


def test_last_policy_is_the_one_that_was_judged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A gate met on the way does not count for the policy that is written at the end of a run without stopping."""
    gate = ScriptedGate([True, False])
    monkeypatch.setattr(trainer, "GateCheck", lambda _: gate)
    run = Trainer(make_cfg(tmp_path, 2, check_every=0.0, check_below=1e9))
    update = run.update

    def late() -> dict[str, float]:
        row = update()
        return {**row, "v_x_rmse": 0.0 if run.iteration == 1 else 1e10}  # the first update asks for a check

    run.update = late
    result = run.run()
    assert (result["gate_passed"], result["stopped"]) == (False, "iterations")
    assert result["gate"]["iteration"] == result["iterations"] == 2


def test_ctrl_c_stops_after_the_update_and_can_be_resumed(tmp_path: Path) -> None:
    """SIGINT during the second update: it is finished and saved; resuming gives the bits of an unbroken run."""
    handler = signal.getsignal(signal.SIGINT)
    run = Trainer(make_cfg(tmp_path / "part", 3))
    update = run.update

    def interrupted() -> dict[str, float]:
        signal.raise_signal(signal.SIGINT) if run.iteration == 1 else None
        return update()

    run.update = interrupted
    result = run.run()
    assert (result["stopped"], result["iterations"], result["gate"]) == ("interrupted", 2, None)
    assert signal.getsignal(signal.SIGINT) is handler
    resumed = Trainer(make_cfg(tmp_path / "part", 3), resume=tmp_path / "part" / "checkpoint.pt")
    assert resumed.run()["stopped"] == "iterations"
    whole = Trainer(make_cfg(tmp_path / "whole", 3))
    whole.run()
    for name in ("algorithm", "env", "torch_rng"):
        assert_same_bits(content(resumed)[name], content(whole)[name], name)


def test_checkpoints_are_written_on_the_way(tmp_path: Path) -> None:
    """A run that dies between two updates has a checkpoint of the last one to go on from."""
    run = Trainer(make_cfg(tmp_path, 3, save_every=0.0))
    update = run.update

    def dying() -> dict[str, float]:
        if run.iteration == 2:
            raise MemoryError
        return update()

    run.update = dying
    with pytest.raises(MemoryError):
        run.run()
    assert content(run)["iteration"] == 2
    resumed = Trainer(make_cfg(tmp_path, 3), resume=tmp_path / "checkpoint.pt")
    assert resumed.iteration == 2 and len(resumed.progress.rows) == 2
