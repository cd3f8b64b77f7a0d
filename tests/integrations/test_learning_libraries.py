"""The walking task in other people's learning code: rsl-rl's own runner, and gymnasium's vector interface."""

import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("newton", reason="the task needs mrwarp[sim]")
gymnasium = pytest.importorskip("gymnasium", reason="gymnasium is not installed")

import torch  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402
from gymnasium.wrappers import vector  # noqa: E402
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
    env, plain = GymWalkEnv(mrwarp.WalkEnv(cfg), autoreset_mode="SameStep"), mrwarp.WalkEnv(cfg)
    observed, info = env.reset(seed=2)
    assert observed in env.observation_space and info["critic"].shape[0] == 3
    rng = np.random.default_rng(3)
    ended = 0
    for _ in range(60):
        action = rng.normal(0.0, 3.0, (3, 12)).astype(np.float32)
        observed, reward, terminated, truncated, info = env.step(action)
        wanted, wanted_reward, done, extras = plain.step(torch.from_numpy(action))
        np.testing.assert_array_equal(observed, wanted["actor"].numpy())
        np.testing.assert_array_equal(reward, wanted_reward.numpy())
        np.testing.assert_array_equal(terminated | truncated, done.numpy())
        assert not (terminated & truncated).any()
        for k in np.flatnonzero(terminated):  # last observation: fallen, with the action that was taken
            last = info["final_obs"][k]
            assert info["_final_obs"][k] and not np.array_equal(last, observed[k])
            np.testing.assert_array_equal(last[9 + 24 : 9 + 36], action[k])
        ended += int(terminated.sum())
    assert ended > 0


@pytest.fixture(scope="module")
def single() -> Iterator[Any]:
    """The registered task, one robot; episodes of a second."""
    env = gymnasium.make("mrwarp/MrGoWalk-v0", episode_seconds=1.0)
    yield env
    env.close()


def test_gymnasiums_own_check_passes(single: Any) -> None:
    """Spaces, types, seeds and determinism, as the library sees them; the only warnings are of unbounded spaces."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        check_env(single.unwrapped, skip_render_check=True)
    assert [
        str(w.message) for w in said if not any(x in str(w.message) for x in ("infinity", "normalized space"))
    ] == []


def test_a_seed_starts_all_draws_again_and_none_goes_on(single: Any) -> None:
    """Equal seeds, equal episodes; without a seed the next episode is another; an end is seen before the reset."""

    def episode(seed: int | None) -> np.ndarray:
        rows = [single.reset(seed=seed)[0]]
        while True:
            observed, _, terminated, truncated, _ = single.step(np.zeros(12, np.float32))
            rows.append(observed)
            if terminated or truncated:
                assert truncated and len(rows) == 51
                return np.array(rows)

    first, again, other, following = episode(5), episode(5), episode(6), episode(None)
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first[0], other[0]) and not np.array_equal(other[0], following[0])
    assert not np.array_equal(first[-1], first[0])
    with pytest.raises(ValueError, match=r"actions have shape \(1, 12\), need \(12,\)"):
        single.unwrapped.step(np.zeros((1, 12)))


def test_robots_begin_again_in_the_step_after_an_end() -> None:
    """NEXT_STEP, gymnasium's default: last observation, then a first one without a reward; its wrappers work."""
    env = gymnasium.make_vec("mrwarp/MrGoWalk-v0", num_envs=3, episode_seconds=0.4)
    wrapped = vector.NormalizeObservation(vector.RecordEpisodeStatistics(vector.NormalizeReward(env)))
    wrapped.reset(seed=1)
    lengths, before = [], np.zeros(3, dtype=bool)
    for _ in range(50):
        _, reward, terminated, truncated, info = wrapped.step(wrapped.action_space.sample() * 0.1)
        assert not (before & (terminated | truncated)).any() and (reward[before] == 0.0).all()
        before = terminated | truncated
        lengths += [int(info["episode"]["l"][k]) for k in np.flatnonzero(before)]
    assert lengths and set(lengths) == {20}
    with pytest.raises(ValueError, match=r"actions have shape \(2, 12\), need \(3, 12\)"):
        env.step(np.zeros((2, 12)))
    with pytest.raises(ValueError, match=r"seed = \[1, 2\]: give one whole number"):
        env.reset(seed=[1, 2])
    with pytest.raises(ValueError, match=r"reset_mask is int64 of shape \(3,\), need bool"):
        env.reset(options={"reset_mask": np.ones(3, int)})
    kept = env.step(np.zeros((3, 12)))[0]
    observed, _ = env.reset(options={"reset_mask": np.array([True, False, False])})
    np.testing.assert_array_equal(observed[1:], kept[1:])
    assert not np.array_equal(observed[0], kept[0])
