"""Two processes train as one: gradient, parameters, statistics, learning rate, seeds; resumed to the bit."""

import copy
import signal
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from rsl_rl.algorithms import PPO
from tensordict import TensorDict

from mrwarp.env.cfg import TaskCfg
from mrwarp.rl import checkpoint, ppo
from mrwarp.rl.checkpoint import CheckpointError
from mrwarp.rl.ppo_cfg import STEPS_PER_UPDATE, PpoCfg, make_ppo_cfg
from mrwarp.rl.ranks import Ranks, RanksPPO
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.rl.trainer import Trainer, TrainingError
from mrwarp.runtime import silent
from tests.rl.test_trainer import assert_same_bits
from tests.rl.together import together

pytestmark = pytest.mark.usefixtures("short_gate")

ENVS = 8
"""Environments of each process."""

STORED = ("actions", "rewards", "dones", "values", "actions_log_prob")

TERMS = ENVS * 2 * STEPS_PER_UPDATE // 4 + 128
"""Terms of a gradient's longest sums: samples of a mini-batch of both processes, and units of the widest layer. In
another order such a sum differs by up to as many machine epsilons."""


def make_cfg(out: Path, iterations: int) -> TrainCfg:
    """A run of a few updates."""
    env = replace(TaskCfg(num_envs=ENVS, threads=1), episode_seconds=1.0)
    return TrainCfg(
        task=replace(env, seed=3),
        ppo=PpoCfg(symmetry=False),
        run=RunCfg(out=out, iterations=iterations, no_gate=True),
    )


def parameters(algorithm: PPO) -> torch.Tensor:
    """All weights in one row."""
    return torch.cat([p.detach().flatten() for p in (*algorithm.actor.parameters(), *algorithm.critic.parameters())])


def gradient(algorithm: PPO) -> torch.Tensor:
    """The gradient of all weights in one row."""
    found = [p.grad for p in (*algorithm.actor.parameters(), *algorithm.critic.parameters())]
    return torch.cat([g.flatten() for g in found if g is not None])


def learn_in_float64(algorithm: PPO) -> None:
    """Networks and rollout in float64, in which no sample lies within a rounding of a clip's edge."""
    storage = algorithm.storage
    algorithm.actor.double()
    algorithm.critic.double()
    for owner, names in ((storage, (*STORED, "returns", "advantages")), (algorithm, ("_means", "_time_outs"))):
        for name in names:
            if name != "dones" and hasattr(owner, name):
                setattr(owner, name, getattr(owner, name).double())
    storage.observations = storage.observations.double()
    if storage.distribution_params is not None:
        storage.distribution_params = tuple(part.double() for part in storage.distribution_params)


def update(ranks: Ranks, out: Path, ppo: str) -> dict[str, Any]:
    """One update of a rank: what it collected, the order of its mini-batches, its gradients, and what came out.

    The rollout is a training's, in float32; what is learned from it is learned in float64.
    """
    patch = pytest.MonkeyPatch()
    if ppo == "rsl-rl":
        patch.setattr(Ranks, "ppo", PPO)
    run = Trainer(make_cfg(out, 1), ranks=ranks)
    algorithm, order, own, mean = run.algorithm, [], [], []
    randperm, reduce = torch.randperm, algorithm.reduce_parameters

    def kept(*args: Any, **kwargs: Any) -> torch.Tensor:
        order.append(randperm(*args, **kwargs))
        return order[-1]

    def reduced() -> None:
        own.append(gradient(algorithm))
        reduce()
        mean.append(gradient(algorithm))

    learn, complete = algorithm.update, algorithm.compute_returns
    start: dict[str, Any] = {}

    def completed(obs: TensorDict) -> None:
        with torch.inference_mode(False):
            learn_in_float64(algorithm)
        complete(obs.double())

    def away() -> dict[str, float]:
        # the collecting policy is another one, so that the KL divergence is no rounding error even before the first
        # step, and one process finds the same learning rate
        with torch.no_grad():
            next(reversed(list(algorithm.actor.mlp.parameters()))).add_(0.02)
        start.update(copy.deepcopy(algorithm.save()), parameters=parameters(algorithm))
        return learn()

    algorithm.update, algorithm.compute_returns = away, completed
    patch.setattr(torch, "randperm", kept)
    algorithm.reduce_parameters = reduced
    run.update()
    patch.undo()
    storage = algorithm.storage
    return {
        "start": start,
        "start_parameters": start.pop("parameters"),
        "order": order[0],
        "own": torch.stack(own),
        "mean": torch.stack(mean),
        "storage": {name: getattr(storage, name).clone() for name in STORED},
        "observations": storage.observations.to_dict(),
        "distribution": list(storage.distribution_params or ()),
        "last": run.obs.to_dict(),
        "parameters": parameters(algorithm),
        "networks": algorithm.save(),
        "learning_rate": algorithm.learning_rate,
        "seed": run._seed,
    }


def alone(parts: list[dict[str, Any]]) -> dict[str, Any]:
    """The update repeated in one process with all environments, by rsl-rl's own PPO."""

    def union(name: str, dim: int) -> TensorDict:
        groups = {g: torch.cat([part[name][g] for part in parts], dim).double() for g in ("actor", "critic")}
        return TensorDict(groups, batch_size=groups["actor"].shape[:-1])

    class Shape:
        num_envs, num_actions = ENVS * len(parts), parts[0]["storage"]["actions"].shape[-1]

    cfg, last = make_ppo_cfg(Shape.num_envs), union("last", 0)
    with silent():
        algorithm = PPO.construct_algorithm(last, Shape(), cfg, "cpu")
    algorithm.actor.double()
    algorithm.critic.double()
    algorithm.load(parts[0]["start"], None, strict=True)
    storage = algorithm.storage
    for name in STORED:
        value = torch.cat([part["storage"][name] for part in parts], 1)
        setattr(storage, name, value if name == "dones" else value.double())
    storage.observations = union("observations", 1)
    storage.distribution_params = tuple(
        torch.cat(rows, 1).double() for rows in zip(*(part["distribution"] for part in parts), strict=True)
    )
    storage.returns, storage.step = torch.zeros_like(storage.values), STEPS_PER_UPDATE
    with torch.inference_mode():
        algorithm.compute_returns(last)
    # mini-batch k of all environments is what the ranks had in their k-th ones
    rows = []
    for rank, part in enumerate(parts):
        step, env = part["order"] // ENVS, part["order"] % ENVS
        rows.append((step * len(parts) * ENVS + rank * ENVS + env).view(4, -1))
    order, gradients = torch.cat(rows, 1).flatten(), []
    clip = torch.nn.utils.clip_grad_norm_

    def kept(weights: Any, norm: float) -> Any:
        weights = list(weights)
        if weights[0] is next(algorithm.actor.parameters()):
            gradients.append(gradient(algorithm))
        return clip(weights, norm)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torch, "randperm", lambda *_, **__: order)
        patch.setattr(torch.nn.utils, "clip_grad_norm_", kept)
        algorithm.update()
    return {
        "mean": torch.stack(gradients), "parameters": parameters(algorithm), "networks": algorithm.save(),
        "learning_rate": algorithm.learning_rate,
    }  # fmt: skip


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """One update of two processes."""
    folder = tmp_path_factory.mktemp("parts")
    return together(update, folder, folder / "run", "mrwarp")


def relative(found: torch.Tensor, expected: torch.Tensor) -> float:
    """Distance over length."""
    return float((found.double() - expected.double()).norm() / expected.double().norm())


def test_update_of_two_processes_is_that_of_one(parts: list[dict[str, Any]]) -> None:
    """The first mini-batch's gradient to the rounding of sums in another order; then weights, statistics and rate.

    Of all 20 mini-batches: only the learning rate is float32 on its way to all, once each, so steps differ by as much.
    """
    exact = alone(parts)
    first = exact["mean"][0]
    assert torch.equal(parts[0]["mean"][0], parts[1]["mean"][0])
    assert relative(parts[0]["mean"][0], first) < TERMS * torch.finfo(torch.float64).eps
    # what a rank would have learned from its own environments alone is far from that
    assert all(relative(part["own"][0], first) > 0.1 for part in parts)
    rounding = len(exact["mean"]) * torch.finfo(torch.float32).eps
    for part in parts:
        moved = relative(part["start_parameters"], exact["parameters"])
        assert relative(part["parameters"], exact["parameters"]) < rounding * moved
        assert part["learning_rate"] == pytest.approx(exact["learning_rate"], rel=rounding)
        assert part["learning_rate"] != 1e-3
        for net in ("actor_state_dict", "critic_state_dict"):
            for name in ("obs_normalizer._mean", "obs_normalizer._var", "obs_normalizer.count"):
                torch.testing.assert_close(
                    part["networks"][net][name], exact["networks"][net][name], rtol=1e-12, atol=1e-12
                )
    assert int(parts[0]["networks"]["actor_state_dict"]["obs_normalizer.count"]) == 2 * ENVS * STEPS_PER_UPDATE


def test_ranks_stay_bit_equal_and_draw_for_themselves(parts: list[dict[str, Any]]) -> None:
    """Networks, optimiser and rate are the same bits on both; seeds, observations and actions are not."""
    first, second = parts
    assert_same_bits(first["networks"], second["networks"])
    assert first["learning_rate"] == second["learning_rate"]
    assert first["seed"] == 3 and second["seed"] not in (3, 4)
    for name in ("actions", "rewards"):
        assert not torch.equal(first["storage"][name], second["storage"][name])
    assert not torch.equal(first["observations"]["actor"][0], second["observations"]["actor"][0])


def test_advantages_are_normalised_over_all_environments(tmp_path: Path) -> None:
    """With rsl-rl's own normalisation per process the gradient is off by percents, which the tests above would see."""
    parts = together(update, tmp_path, tmp_path / "run", "rsl-rl")
    assert relative(parts[0]["mean"][0], alone(parts)["mean"][0]) > 0.01


def test_seeds_of_ranks_do_not_meet() -> None:
    """10 seeds of 64 ranks each are 640 numbers that torch takes; rank 0 keeps the run's."""
    seeds = {Ranks(rank=rank, world=64).seed(seed) for seed in range(-2, 8) for rank in range(64)}
    assert len(seeds) == 640 and {-2, -1, *range(8)} <= seeds
    for seed in seeds:
        torch.Generator().manual_seed(seed)


def test_a_lone_process_agrees_with_itself() -> None:
    """Without other ranks nothing is changed, and the algorithm is that of one process."""
    ranks = Ranks()
    assert ranks.means({"a": 0.1}) == {"a": 0.1} and ranks.total(0.1, 2.0) == [0.1, 2.0]
    assert ranks.decided(True, False) == [True, False] and not ranks.any(False)
    assert ranks.gather("x") == ranks.share("x") == ["x"]
    assert ranks.ppo is ppo.PPO and ranks.ppo_setting is None and ranks.threads(0) == 0
    assert Ranks(world=2).ppo is RanksPPO


def test_devices_of_ranks() -> None:
    """``cuda`` is one GPU for each process of a machine; two processes on one named GPU are refused."""
    assert [Ranks(rank=4 + i, world=8, local_rank=i, local_world=4).device("cuda") for i in (0, 3)] == [
        "cuda:0",
        "cuda:3",
    ]
    assert Ranks(world=2, local_world=2).device("cpu") == "cpu"
    assert Ranks(world=2, local_world=1).device("cuda:1") == "cuda:1"
    with pytest.raises(ValueError, match="cuda:1: 2 processes would share it; give --device cuda"):
        Ranks(world=2, local_world=2).device("cuda:1")


def train(ranks: Ranks, out: Path, iterations: int, resume: bool, stopping: bool = False) -> dict[str, Any]:
    """A training of a rank; its own random state at the end. Stopping: Ctrl-C comes to rank 1 in the first update."""
    run = Trainer(make_cfg(out, iterations), resume=out / "checkpoint.pt" if resume else None, ranks=ranks)
    if stopping and ranks.rank == 1:

        def stop() -> None:
            run.watchers.clear()
            signal.raise_signal(signal.SIGINT)

        run.watchers.append(stop)
    result = run.run()
    return {
        "iterations": result["iterations"],
        "rng": torch.get_rng_state(),
        "env": run.env.state(),
        "networks": run.algorithm.save(),
        "rows": len(run.progress.rows),
    }


@pytest.mark.slow
def test_two_processes_resume_to_the_bit(tmp_path: Path) -> None:
    """Ctrl-C in the first of 2 updates, new processes, 1 more: networks, and each rank's environment and draws."""
    whole = together(train, tmp_path, tmp_path / "whole", 2, False)
    stopped = together(train, tmp_path, tmp_path / "part", 2, False, True)
    assert [rank["iterations"] for rank in stopped] == [1, 1]
    resumed = together(train, tmp_path, tmp_path / "part", 2, True)
    for found, expected in zip(resumed, whole, strict=True):
        assert_same_bits(found, expected)
    assert not torch.equal(whole[0]["rng"], whole[1]["rng"])
    kept = [checkpoint.load(tmp_path / name / "checkpoint.pt") for name in ("part", "whole")]
    for name in ("algorithm", "env", "other_ranks"):
        assert_same_bits(kept[0][name], kept[1][name])
    with pytest.raises(CheckpointError, match="by 2 processes, this run has 1; resume with 'torchrun"):
        Trainer(make_cfg(tmp_path / "part", 3), resume=tmp_path / "part" / "checkpoint.pt")


def corrupted(ranks: Ranks, out: Path) -> str:
    """A training in which two of rank 1's environments break in the first update; what both ranks say."""
    run = Trainer(make_cfg(out, 2), ranks=ranks)
    if ranks.rank == 1:

        def corrupt() -> None:
            run.watchers.clear()
            run.env.view(run.env.sim.backend.field("qvel"))[[2, 5], 12] = float("nan")

        run.watchers.append(corrupt)
    with pytest.raises(TrainingError) as info:
        run.run()
    return str(info.value)


def test_all_stop_where_the_environments_of_one_break(tmp_path: Path) -> None:
    """2 of 16 environments, both on rank 1: both ranks stop in the same update and name the same cause."""
    first, second = together(corrupted, tmp_path, tmp_path / "run")
    assert first == second
    assert "in 12.5% of the environments in update 1" in first and "first: environment 2" in first
    names = sorted(path.name for path in (tmp_path / "run" / "diverged").iterdir())
    assert names == [f"update000001-rank1-env{env:05d}.safetensors" for env in (2, 5)]


def test_one_process_is_not_resumed_by_two(tmp_path: Path) -> None:
    """Nor the other way round: the environments and draws of the second are nowhere."""
    cfg = make_cfg(tmp_path, 1)
    Trainer(cfg).save()
    with pytest.raises(CheckpointError, match="trained by 1 process, this run has 2; resume without torchrun"):
        Trainer(cfg, resume=tmp_path / "checkpoint.pt", ranks=Ranks(world=2))
