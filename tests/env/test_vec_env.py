"""WalkEnv as an rsl-rl ``VecEnv``: the contract, what a step gives, episodes and how they end."""

from pathlib import Path

import numpy as np
import pytest
import torch
from rsl_rl.env import VecEnv
from tensordict import TensorDict

from mrwarp.energy.power import ElectricalCfg, copper_factor
from mrwarp.env.vec_env import WalkEnv
from mrwarp.usd.robot import DEFAULT_Q, STAND_HEIGHT
from tests.env.env_bench import assert_same_step, make_cfg, random_actions

NEUTRAL = torch.tensor(DEFAULT_Q)


def test_contract_of_shapes_types_and_devices() -> None:
    """Inputs of rsl-rl: attributes, groups with the batch size, float rewards, bool dones, time-outs in extras."""
    env = WalkEnv(make_cfg(8))
    assert isinstance(env, VecEnv)
    assert (env.num_envs, env.num_actions, env.max_episode_length) == (8, 12, 1000)
    assert torch.device(env.device) == torch.device("cpu")
    assert env.episode_length_buf.dtype == torch.long and env.episode_length_buf.tolist() == [0] * 8
    start = env.get_observations()
    obs, reward, done, extras = env.step(torch.zeros(8, 12))
    for groups in (start, obs):
        assert isinstance(groups, TensorDict) and groups.batch_size == torch.Size([8])
        assert set(groups.keys()) == {"actor", "critic"}
        assert groups["actor"].shape == (8, 47)
        assert groups["critic"].shape == start["critic"].shape == (8, 82)
        assert {groups[name].dtype for name in ("actor", "critic")} == {torch.float32}
        assert {groups[name].device for name in ("actor", "critic")} == {torch.device("cpu")}
    assert reward.shape == (8,) and reward.dtype == torch.float32
    assert done.shape == (8,) and done.dtype == torch.bool
    assert set(extras) == {"time_outs"}
    assert extras["time_outs"].shape == (8,) and extras["time_outs"].dtype == torch.bool
    assert env.episode_length_buf.tolist() == [1] * 8


def test_two_hundred_random_steps_stay_finite_and_solved() -> None:
    """Strong random actions, with falls and resets: all numbers finite, one solve in a thousand may be unconverged."""
    env = WalkEnv(make_cfg(16, seed=3))
    falls = 0
    for action in random_actions(200, 16, scale=3.0, seed=1):
        obs, reward, done, extras = env.step(action)
        for values in (obs["actor"], obs["critic"], reward):
            assert bool(torch.isfinite(values).all())
        assert not bool((extras["time_outs"] & ~done).any())
        falls += int(done.sum())
    assert falls > 0
    assert int(env.sim.unsolved.numpy().sum()) <= 1e-3 * 200 * 4 * 16


@pytest.mark.parametrize("num_envs", [1, 8, 10, 64])
def test_current_groups_are_eq_20(num_envs: int) -> None:
    """Environment e may use the current of group floor(4e/N), also where N is no multiple of 4."""
    env = WalkEnv(make_cfg(num_envs))
    expected = [(0.0, 0.5, 1.0, 1.5)[4 * e // num_envs] for e in range(num_envs)]
    assert env.current_e.tolist() == expected
    env.step(torch.zeros(num_envs, 12))
    env._reset(torch.ones(num_envs, dtype=torch.bool))
    assert env.current_e.tolist() == expected


def test_actions_are_targets_relative_to_the_neutral_stance() -> None:
    """q_des = q_default + 0.25*action, unclipped, joint by joint; the last two actions are kept."""
    env = WalkEnv(make_cfg(4))
    first, second = random_actions(2, 4, scale=2.0)
    env.step(first)
    torch.testing.assert_close(env.q_des, NEUTRAL + 0.25 * first, rtol=0.0, atol=2e-7)  # one float32 rounding
    obs, _, _, _ = env.step(second)
    torch.testing.assert_close(env.q_des, NEUTRAL + 0.25 * second, rtol=0.0, atol=2e-7)
    assert torch.equal(env.action, second) and torch.equal(env.last_action, first)
    assert torch.equal(obs["actor"][:, 33:45], second)


def test_actions_are_copied() -> None:
    """The caller may overwrite the tensor it passed without touching the environment."""
    env = WalkEnv(make_cfg(4))
    action = torch.ones(4, 12)
    env.step(action)
    action.fill_(9.0)
    assert torch.equal(env.action, torch.ones(4, 12))


def test_returned_tensors_keep_their_values() -> None:
    """A rollout may store what a step returned: later steps do not write into it."""
    env = WalkEnv(make_cfg(4, seed=2))
    actions = random_actions(6, 4)
    obs, reward, done, extras = env.step(actions[0])
    held = [obs["actor"], obs["critic"], reward, done, extras["time_outs"], env.fallen]
    copies = [tensor.clone() for tensor in held]
    for action in actions[1:]:
        env.step(action)
    for tensor, copy in zip(held, copies, strict=True):
        assert torch.equal(tensor, copy)


def test_effort_is_the_mean_squared_torque_of_the_policy_step() -> None:
    """With one torque step per policy step it is the sum of the squared motor torques, from the energy ledger."""
    env = WalkEnv(make_cfg(4, decimation=1))
    for action in random_actions(5, 4):
        env.step(action)
        expected = env.view(env.actuator.tau_motor).double().square().sum(1)
        # difference of float32 sums over 5 steps, each 1e-7 of at most 5 times the value
        torch.testing.assert_close(env.effort.double(), expected, rtol=1e-5, atol=0.0)


def test_power_is_the_electrical_models_without_losses_of_gears_and_supply() -> None:
    """Copper loss, mechanical power and coil loss from torques, velocities and currents of the four torque steps."""
    env = WalkEnv(make_cfg(8, currents=(1.5,)))
    factor, coils = torch.tensor(copper_factor(ElectricalCfg(winding_resistance=0.128))), []
    resistance = env.view(env.actuator.param("coil_resistance")).double()
    rows: list[torch.Tensor] = []

    def count() -> None:
        tau, qd = env.view(env.actuator.tau_motor).double(), env.qd.double()
        coil = (resistance * env.view(env.actuator.current).double().square()).sum(1)
        coils.append(float(coil.sum()))
        rows.append((factor * tau.square() + tau * qd).sum(1) + coil)

    env.substep_hooks.append(count)
    for action in random_actions(10, 8):
        rows.clear()
        env.step(action)
        expected = torch.stack(rows).mean(0)
        # differences of float32 sums over 40 steps: 1e-7 of some 100 J within 20 ms are 5e-4 W
        torch.testing.assert_close(env.power.double(), expected, rtol=1e-4, atol=5e-3)
    assert sum(coils) > 0.0


def test_time_out_comes_at_the_end_of_the_episode() -> None:
    """Episodes of 0.1 s: steps 1 to 4 end nothing, step 5 is done by time-out in all environments, and so on."""
    env = WalkEnv(make_cfg(4, episode_seconds=0.1))
    for step in range(1, 11):
        _, _, done, extras = env.step(torch.zeros(4, 12))
        last = step % 5 == 0
        assert done.tolist() == extras["time_outs"].tolist() == [last] * 4
        assert env.fallen.tolist() == [False] * 4
        assert env.episode_length_buf.tolist() == [step % 5] * 4


def test_a_fall_is_no_time_out_even_in_the_last_step() -> None:
    """A robot on its back is done without bootstrapping, whether or not its time is also up."""
    env = WalkEnv(make_cfg(4, episode_seconds=0.1))
    for _ in range(3):
        env.step(torch.zeros(4, 12))
    qpos = env.view(env.sim.backend.field("qpos"))
    qpos[1, 3:7] = torch.tensor([0.0, 1.0, 0.0, 0.0], dtype=qpos.dtype)
    _, _, done, extras = env.step(torch.zeros(4, 12))
    assert done.tolist() == env.fallen.tolist() == [False, True, False, False]
    assert extras["time_outs"].tolist() == [False] * 4
    assert env.episode_length_buf.tolist() == [4, 0, 4, 4]
    qpos[2, 3:7] = torch.tensor([0.0, 1.0, 0.0, 0.0], dtype=qpos.dtype)
    _, _, done, extras = env.step(torch.zeros(4, 12))
    assert done.tolist() == [True, False, True, True]
    assert env.fallen.tolist() == [False, False, True, False]
    assert extras["time_outs"].tolist() == [True, False, False, True]
    assert env.episode_length_buf.tolist() == [0, 1, 0, 0]


def test_episode_length_buf_may_be_replaced() -> None:
    """rsl-rl assigns a new tensor to spread the episodes; the time limit follows it."""
    env = WalkEnv(make_cfg(4, episode_seconds=0.2))
    env.episode_length_buf = torch.tensor([0, 3, 8, 9])
    _, _, done, _ = env.step(torch.zeros(4, 12))
    assert done.tolist() == [False, False, False, True]
    _, _, done, _ = env.step(torch.zeros(4, 12))
    assert done.tolist() == [False, False, True, False]


def test_a_new_episode_starts_near_the_neutral_stance() -> None:
    """After a reset: pose and speed near the stance, no contact, no past in action, actuator or critic."""
    env = WalkEnv(make_cfg(16, episode_seconds=0.2))
    for action in random_actions(10, 16, scale=1.0):
        obs, _, done, _ = env.step(action)
    assert bool(done.all())
    np.testing.assert_allclose(env.root_pos[:, 2].numpy(), STAND_HEIGHT + 0.01, rtol=1e-6)
    assert torch.equal(env.root_pos[:, :2], torch.zeros(16, 2))
    assert torch.equal(env.gravity, torch.tensor([0.0, 0.0, -1.0]).expand(16, 3))
    assert float((env.q - NEUTRAL).abs().max()) <= 0.1 + 1e-6
    assert float(env.root_vel.abs().max()) <= 0.1 and float(env.root_ang.abs().max()) <= 0.1
    assert float((env.q - NEUTRAL).abs().max()) > 0.05 and len(env.phase.unique()) == 16
    device = env.actuator
    for zero in (env.action, env.last_action, env.qd, env.f_foot, obs["actor"][:, 33:45]):
        assert not bool(zero.any())
    for array in (device.z, device.current, device.ledger, device.tau_motor, device.m_dyn, device.m_hold):
        assert not array.numpy().any()
    torch.testing.assert_close(env.q_des, NEUTRAL.expand(16, 12), rtol=0.0, atol=0.0)


def test_observations_of_a_done_step_belong_to_the_new_episode() -> None:
    """The observation returned with done is the first observation of the next episode (reset, then observe)."""
    env = WalkEnv(make_cfg(4, episode_seconds=0.1, noise=None))
    for action in random_actions(5, 4, scale=1.0):
        obs, _, done, _ = env.step(action)
    assert bool(done.all())
    again = env.get_observations()
    assert torch.equal(obs["actor"], again["actor"]) and torch.equal(obs["critic"], again["critic"])
    assert torch.equal(obs["actor"][:, 9:21], env.q - NEUTRAL)


def test_substep_hooks_see_every_torque_step_and_change_nothing() -> None:
    """A hook is called after each of the four torque steps; an environment with one has the same bits as without."""
    env, twin = WalkEnv(make_cfg(4, seed=2)), WalkEnv(make_cfg(4, seed=2))
    seen: list[torch.Tensor] = []
    env.substep_hooks.append(lambda: seen.append(env.q.clone()))
    for action in random_actions(5, 4):
        assert_same_step(env.step(action), twin.step(action))
    assert len(seen) == 5 * 4
    assert torch.equal(seen[-1], twin.q)
    assert all(not torch.equal(before, after) for before, after in zip(seen, seen[1:], strict=False))


@pytest.mark.parametrize(("robot", "model"), [("go1", "bouc_wen"), ("mr_go", "none")])
def test_robots_without_devices_are_environments_too(robot: str, model: str) -> None:
    """``go1`` and ``actuator none`` keep the contract, without device columns in the critic."""
    env = WalkEnv(make_cfg(4, robot=robot, actuator=model))
    for action in random_actions(5, 4):
        obs, reward, _, _ = env.step(action)
    assert obs["actor"].shape == (4, 47) and obs["critic"].shape == (4, 70)
    assert bool(torch.isfinite(obs["critic"]).all()) and bool(torch.isfinite(reward).all())


@pytest.mark.slow
def test_walking_on_needs_no_more_memory() -> None:
    """16 robots with resets: 400 steps fill allocators and caches, 1,600 more take less than 2 %, and stay finite."""
    env = WalkEnv(make_cfg(16, episode_seconds=2.0))

    def resident_after(steps: int) -> int:
        for _ in range(steps):
            _, reward, _, _ = env.step(torch.randn(16, 12))
            assert torch.isfinite(reward).all()
        return int(Path("/proc/self/statm").read_text().split()[1])

    torch.manual_seed(3)
    settled = resident_after(400)
    assert resident_after(1600) < 1.02 * settled
