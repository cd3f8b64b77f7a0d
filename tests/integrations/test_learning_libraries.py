"""The walking task in other people's learning code: rsl-rl's own runner, and gymnasium's vector interface."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("newton", reason="the task needs mrwarp[sim]")
gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed")

import torch  # noqa: E402
from rsl_rl.runners import OnPolicyRunner  # noqa: E402

import mrwarp  # noqa: E402
from mrwarp.rl.gymnasium_env import GymWalkEnv  # noqa: E402

NETWORK = {"class_name": "MLPModel", "hidden_dims": [32, 32], "activation": "elu"}
RSL_RL = {
    "num_steps_per_env": 6,
    "save_interval": 50,
    "obs_groups": {"actor": ["actor"], "critic": ["critic"]},
    "algorithm": {"class_name": "PPO", "num_learning_epochs": 2, "num_mini_batches": 2, "learning_rate": 1e-3},
    "actor": {
        **NETWORK,
        "obs_normalization": True,
        "distribution_cfg": {"class_name": "GaussianDistribution", "init_std": 1.0},
    },
    "critic": {**NETWORK, "obs_normalization": True},
}
"""rsl-rl's usual configuration, small."""


def test_rsl_rls_own_runner_trains_the_task(tmp_path: Path) -> None:
    """Two updates change the actor, and the checkpoint is written."""
    env = mrwarp.WalkEnv(mrwarp.TaskCfg(num_envs=4, seed=1))
    torch.manual_seed(0)
    runner = OnPolicyRunner(env, RSL_RL, log_dir=str(tmp_path), device="cpu")
    before = [p.detach().clone() for p in runner.alg.get_policy().parameters()]
    runner.learn(num_learning_iterations=2, init_at_random_ep_len=True)
    after = list(runner.alg.get_policy().parameters())
    assert any(not torch.equal(a, b) for a, b in zip(before, after, strict=True))
    assert (tmp_path / "model_1.pt").is_file()


def test_gymnasium_sees_the_same_task() -> None:
    """Observations, rewards and ends are those of WalkEnv; shapes are those of the spaces; a fall is a termination."""
    cfg = mrwarp.TaskCfg(num_envs=3, seed=2)
    env, plain = GymWalkEnv(mrwarp.WalkEnv(cfg)), mrwarp.WalkEnv(cfg)
    observed, info = env.reset(seed=2)
    assert observed in env.observation_space and info["critic"].shape[0] == 3
    rng = np.random.default_rng(3)
    ended = 0
    for _ in range(60):
        action = rng.normal(0.0, 3.0, (3, 12)).astype(np.float32)
        observed, reward, terminated, truncated, _ = env.step(action)
        wanted, wanted_reward, done, extras = plain.step(torch.from_numpy(action))
        np.testing.assert_array_equal(observed, wanted["actor"].numpy())
        np.testing.assert_array_equal(reward, wanted_reward.numpy())
        np.testing.assert_array_equal(terminated | truncated, done.numpy())
        assert not (terminated & truncated).any()
        ended += int(terminated.sum())
    assert ended > 0
    with pytest.raises(ValueError, match="seed = 3: the task was made with 2"):
        env.reset(seed=3)
