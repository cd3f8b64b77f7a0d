"""WalkEnv to the bit: masked reset, saved state, restart, copies, seeds and threads, captured graphs."""

from dataclasses import replace
from typing import Any

import pytest
import torch

from mrwarp.enums import Coupling
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.kernels import launch
from tests.env.env_bench import assert_same_state, assert_same_step, make_cfg, random_actions

TASKS = {
    "devices": {},
    "no devices": {"actuator": "none"},
    "rough ground, explicit": {"coupling": Coupling.EXPLICIT, "terrain": "rough"},
}


def test_masked_reset_leaves_other_environments_bit_equal() -> None:
    """Environments 1 and 4 start over; the others keep their state and their next 20 steps.

    Noise, pushes and commands of the others are the same draws: they follow from seed, step and environment.
    """
    env, twin = WalkEnv(make_cfg(8, seed=5)), WalkEnv(make_cfg(8, seed=5))
    actions = random_actions(35, 8)
    for action in actions[:15]:
        env.step(action)
        twin.step(action)
    mask = torch.tensor([False, True, False, False, True, False, False, False])
    env._reset(mask)
    ours, theirs = env.state(), twin.state()
    for name in ours.keys() - {"key", "actuator/head"}:
        assert torch.equal(ours[name][~mask], theirs[name][~mask]), name
    for name in ("key", "actuator/head"):
        assert torch.equal(ours[name], theirs[name]), name
    assert bool((ours["q_des"][mask] != theirs["q_des"][mask]).any())
    for action in actions[15:]:
        first, second = env.step(action), twin.step(action)
        assert not bool(first[2].any()) and not bool(second[2].any())
        assert_same_step(first, second, rows=~mask)
        assert bool((first[0]["actor"][mask] != second[0]["actor"][mask]).any())


@pytest.mark.parametrize("changes", TASKS.values(), ids=TASKS.keys())
def test_a_gpus_threads_give_the_bits_of_one_thread(changes: dict, monkeypatch: pytest.MonkeyPatch) -> None:
    """The task in a thread per environment or joint, here on the CPU, and in one thread for all: every bit identical.

    With noise, randomisation, pushes, falls and new episodes.
    """
    envs = []
    for gpu_layout in (False, True):
        monkeypatch.setattr(launch, "GPU_LAYOUT", gpu_layout)
        envs.append(WalkEnv(replace(TaskCfg(num_envs=6, seed=8, **changes), episode_seconds=0.5)))
    ended = 0
    for step, action in enumerate(random_actions(40, 6, scale=1.0)):
        for env in envs:
            env.view(env.sim.backend.field("qpos"))[1, 2] -= 0.3 * (step == 10)
        first, second = (env.step(action) for env in envs)
        assert_same_step(first, second)
        ended += int(first[2].sum())
    assert ended > 6
    assert_same_state(*envs)


@pytest.mark.gpu
def test_state_goes_on_on_a_gpu() -> None:
    """Another object on the GPU that loads the state holds the same bits, and goes on identically for five steps.

    Not to the bit: MuJoCo-Warp's constraint rows stand in the order in which threads found them.
    """
    cfg = make_cfg(64, seed=7, episode_seconds=0.7)
    cfg = replace(cfg, device="cuda:0")
    env, other = WalkEnv(cfg), WalkEnv(cfg)
    actions = [action.to(env.device) for action in random_actions(37, 64, scale=0.3)]
    for action in actions[:20]:
        env.step(action)
    for action in actions[30:37]:
        other.step(action)
    other.load_state({name: value.cpu().clone() for name, value in env.state().items()})
    assert_same_state(env, other)
    assert other.last_observations["actor"].device == env.last_observations["actor"].device
    for action in actions[20:25]:
        first, second = env.step(action), other.step(action)
        torch.testing.assert_close(first[0]["critic"], second[0]["critic"], rtol=0.0, atol=0.02)
        assert torch.equal(first[2], second[2])


@pytest.mark.parametrize(("inference", "terrain"), [(False, "flat"), (True, "flat"), (False, "rough")])
def test_state_goes_on_bit_equal(inference: bool, terrain: str) -> None:
    """With noise, randomisation, pushes and resets: another object that loads the state repeats 30 steps exactly.

    The other object has a past of its own, also one under ``torch.inference_mode``, as in training.
    """
    cfg = make_cfg(8, seed=7, episode_seconds=0.7, terrain=terrain)
    env, other = WalkEnv(cfg), WalkEnv(cfg)
    if terrain == "rough":
        env.arrays.level.fill_(3)  # robots that do not get far come to the level below
    actions = random_actions(50, 8, scale=1.0)
    for action in actions[:20]:
        env.step(action)
    with torch.inference_mode(inference):
        for action in actions[30:37]:
            other.step(action)
    state = {name: value.clone() for name, value in env.state().items()}
    other.load_state(state)
    assert_same_state(env, other)
    resets = 0
    for action in actions[20:]:
        first, second = env.step(action), other.step(action)
        assert_same_step(first, second)
        assert_same_state(env, other)  # float64: sees what observations round away
        resets += int(first[2].sum())
    assert resets > 0
    assert terrain == "flat" or not torch.equal(env.state()["terrain/level"], state["terrain/level"])


def test_state_is_a_copy() -> None:
    """Stepping on does not change a state that was taken, and loading does not tie the environment to it."""
    env = WalkEnv(make_cfg(4))
    actions = random_actions(6, 4)
    env.step(actions[0])
    state = env.state()
    copies = {name: value.clone() for name, value in state.items()}
    env.step(actions[1])
    env.load_state(state)
    for action in actions[2:]:
        env.step(action)
    for name, value in state.items():
        assert torch.equal(value, copies[name]), name


def test_environment_draws_nothing_from_the_global_generator() -> None:
    """Exploration noise comes from torch's global generator; the environment has its own and leaves that alone."""
    env = WalkEnv(make_cfg(4, episode_seconds=0.1))
    before = torch.get_rng_state()
    for action in random_actions(7, 4):
        env.step(action)
    assert torch.equal(torch.get_rng_state(), before)


def test_restart_repeats_a_new_object() -> None:
    """Also with noise and randomisation: a restarted environment does what a new one of its configuration does."""
    cfg = make_cfg(6, seed=8, episode_seconds=0.3)
    used, new = WalkEnv(cfg), WalkEnv(cfg)
    for action in random_actions(20, 6, scale=1.0):
        used.step(action)
    used.restart()
    assert torch.equal(used.last_observations["actor"], new.last_observations["actor"])
    assert torch.equal(used.last_observations["critic"], new.last_observations["critic"])
    for action in random_actions(20, 6, scale=1.0, seed=2):
        assert_same_step(used.step(action), new.step(action))


def test_copy_envs_makes_bit_equal_copies() -> None:
    """Environment e goes on as source[e] did: nominal robots with equal currents and no draws repeat it exactly."""
    changes: dict[str, Any] = {"noise": None, "randomize": None, "currents": (1.0,)}
    changes["commands"] = replace(make_cfg().commands, period=float("inf"))
    env, twin = WalkEnv(make_cfg(4, seed=2, **changes)), WalkEnv(make_cfg(4, seed=2, **changes))
    actions = random_actions(30, 4)
    for action in actions[:10]:
        env.step(action)
        twin.step(action)
    source = torch.tensor([2, 0, 2, 3])
    env.copy_envs(source)
    for action in actions[10:]:
        obs, reward, done, _ = env.step(action[source])
        expected, expected_reward, expected_done, _ = twin.step(action)
        assert torch.equal(obs["critic"], expected["critic"][source])
        assert torch.equal(reward, expected_reward[source])
        assert not bool(done.any()) and not bool(expected_done.any())


@pytest.mark.gpu
def test_a_captured_control_step_on_a_gpu_is_that_of_eager_launches() -> None:
    """One graph of physics, laws, rewards, resets and draws: equal up to rounding in five steps with resets."""
    found = []
    for wanted in (True, False):
        cfg = make_cfg(64, seed=3)
        env = WalkEnv(replace(cfg, device="cuda:0", capture=wanted, episode_seconds=0.06))
        steps = [env.step(actions.to(env.device)) for actions in random_actions(5, 64, scale=0.3)]
        assert sum(int(step[2].sum()) for step in steps) >= 64
        found.append(torch.stack([torch.cat([obs["critic"], reward[:, None]], dim=1) for obs, reward, _, _ in steps]))
    torch.testing.assert_close(found[0], found[1], rtol=0.0, atol=0.02)
